"""The bench's ear: what it makes of gaps, and of what comes after the world has gone."""

import threading
from collections.abc import Callable, Iterator
from types import SimpleNamespace
from typing import Any

import pytest
from structlog.testing import capture_logs

from fleet.record.stream import BusMessage
from fleet.run.listening import Subscriber
from fleet.run.processes import ProcessFailedError
from fleet.run.supervisor import WORLD
from protocol.codec import encode
from protocol.keys import Keys
from protocol.messages import Truth

MakeTruth = Callable[..., Truth]
KEYS = Keys("test")


@pytest.fixture
def lost() -> dict[str, str]:
    """Processes that have ended for good."""
    return {}


@pytest.fixture
def bench(lost: dict[str, str]) -> Subscriber:
    """Which has the scene, among processes of which nothing is to be told."""
    processes = SimpleNamespace(take_started_again=list, is_running=lambda name: name not in lost)
    supervisor = SimpleNamespace(look=lambda: None, lost=lost)
    director = SimpleNamespace(look=lambda: None, at=lambda truth: None)
    interruption = SimpleNamespace(insisted=False, requested=False)
    bench: Any = Subscriber("test", processes, supervisor, director, interruption)  # type: ignore[arg-type]
    bench._scene_due = False
    return bench


def say(bench: Any, truth: Truth) -> None:
    """As the world says it."""
    bench._store(
        SimpleNamespace(key_expr=KEYS.truth, payload=SimpleNamespace(to_bytes=lambda: encode(truth)))
    )


def steps(messages: Iterator[Any]) -> list[int]:
    return [item.message.step for item in messages if isinstance(item, BusMessage)]


def test_steps_that_the_bus_has_lost_are_told(bench: Subscriber, make_truth: MakeTruth) -> None:
    for step in (0, 1, 4):
        say(bench, make_truth(step, {"1": {}}))
    say(bench, make_truth(5, {"1": {}}, verdict="timeout"))
    with capture_logs() as logged:
        assert steps(bench.listen()) == [0, 1, 4, 5]
    gaps = [(line["first"], line["last"]) for line in logged if line["event"] == "the recording lacks steps"]
    assert gaps == [(2, 3)]


def test_what_the_world_said_before_its_end_counts_however_late_it_comes(
    bench: Subscriber, lost: dict[str, str], make_truth: MakeTruth
) -> None:
    lost[WORLD] = "world ended"
    late = threading.Timer(0.4, say, (bench, make_truth(0, {"1": {}}, verdict="timeout")))
    late.start()
    assert steps(bench.listen()) == [0]
    late.join()


def test_a_world_that_has_gone_without_a_verdict_is_a_failure(
    bench: Subscriber, lost: dict[str, str], make_truth: MakeTruth
) -> None:
    say(bench, make_truth(0, {"1": {}}))
    lost[WORLD] = "world ended with exit status 3"
    messages = bench.listen()
    assert next(messages).message.step == 0  # type: ignore[union-attr]
    with pytest.raises(ProcessFailedError, match="exit status 3"):
        next(messages)
