"""Signals are noted while a run goes on, and handled as before afterwards."""

import os
import signal
from collections.abc import Iterator

import pytest

from fleet.interruption import Interruption


@pytest.fixture(params=[signal.SIGINT, signal.SIGTERM, signal.SIGHUP], ids=lambda number: number.name)
def number(request: pytest.FixtureRequest) -> Iterator[signal.Signals]:
    """A signal; its handling is put back after the test."""
    former = signal.getsignal(request.param)
    yield request.param
    signal.signal(request.param, former)


def test_the_first_signal_is_a_wish_and_the_second_insists(number: signal.Signals) -> None:
    with Interruption() as interruption:
        assert not interruption.requested
        signal.raise_signal(number)
        assert interruption.requested
        assert not interruption.insisted
        signal.raise_signal(number)
        assert interruption.insisted
        signal.raise_signal(number)
        assert interruption.insisted


def test_signals_are_given_back(number: signal.Signals) -> None:
    came = []
    signal.signal(number, lambda *_: came.append(number))
    with Interruption():
        signal.raise_signal(number)
    assert came == []
    signal.raise_signal(number)
    assert came == [number]


def test_an_ignored_signal_stays_ignored(number: signal.Signals) -> None:
    signal.signal(number, signal.SIG_IGN)
    with Interruption() as interruption:
        os.kill(os.getpid(), number)
        assert not interruption.requested
    assert signal.getsignal(number) == signal.SIG_IGN
