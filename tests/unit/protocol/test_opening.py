"""A session that is waited for: signs of life, absence told, a wish to end heard, errors raised."""

import threading

import pytest
import zenoh

import protocol.session
from protocol.session import Opening, client_session, world_session


@pytest.fixture(autouse=True)
def hasty(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(protocol.session, "BEAT_S", 0.01)
    monkeypatch.setattr(protocol.session, "PATIENCE_S", 0.05)


def unexpected() -> None:
    raise AssertionError("its absence was told")


def test_absence_is_told_again_and_again_until_the_world_comes(endpoint):
    opening, beats, told, worlds = Opening(), [], [], []

    def tell() -> None:
        told.append(len(beats))
        if len(told) == 3:
            worlds.append(zenoh.open(world_session(endpoint).to_zenoh()))

    opening.begin(client_session(endpoint))
    session = opening.wait(lambda: beats.append(None), tell)
    try:
        assert session is not None
        assert len(told) >= 3
        assert len(beats) > told[-1] > told[0] >= 1
    finally:
        session.close()
        worlds[0].close()


def test_a_wish_to_end_ends_the_waiting_from_another_thread(endpoint):
    opening = Opening()
    opening.begin(client_session(endpoint))
    waits = threading.Event()
    ender = threading.Thread(target=lambda: (waits.wait(), opening.stop()))
    ender.start()
    assert opening.wait(lambda: None, waits.set) is None
    ender.join()


def test_a_wish_to_end_before_the_waiting_counts_as_well():
    opening = Opening()
    opening.stop()
    assert opening.wait(lambda: None, unexpected) is None


def test_an_endpoint_that_is_none_is_an_error_at_once():
    with pytest.raises(zenoh.ZError):
        Opening().begin(client_session("nowhere"))


def test_an_opening_that_fails_is_an_error_where_it_is_waited_for(endpoint):
    opening = Opening()
    opening.begin(client_session(endpoint, patience_s=0.1))
    with pytest.raises(zenoh.ZError):
        opening.wait(lambda: None, lambda: None)
