"""Session settings as Zenoh reads them, sessions that really speak with them, and how one is waited for."""

import json
import socket
import threading
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack
from functools import partial
from queue import Queue
from typing import Any

import pytest
import zenoh

import protocol.session
from protocol.messages import MAX_PAYLOAD_BYTES
from protocol.session import NEVER_DROP, Opening, client_session, world_session

PATIENCE_S = 60
"""Ends a test that would otherwise wait for ever; nothing is asserted about times."""
TCP = "tcp/127.0.0.1:7447"
KEY = "unspoken/test/pose/a"


EVERYWHERE = {
    "scouting/multicast/enabled": False,
    "scouting/gossip/enabled": False,
    "transport/shared_memory/enabled": False,
    "transport/link/tx/lease": 1000,
}
WORLD = {"mode": "router", "listen/endpoints": [TCP], "connect/endpoints": []}
CLIENT = {"mode": "client", "listen/endpoints": [], "connect/endpoints": [TCP], "connect/timeout_ms": -1}


@pytest.mark.parametrize(("session", "own"), [(world_session, WORLD), (client_session, CLIENT)])
def test_zenoh_reads_the_settings(session: Any, own: dict[str, Any]) -> None:
    """The world listens and connects to nobody; clients wait for it and listen nowhere."""
    config, expected = session(TCP).to_zenoh(), EVERYWHERE | own
    assert {key: json.loads(config.get_json(key)) for key in expected} == expected


def listener(session: zenoh.Session) -> Callable[[], int]:
    """A subscription, as a function that waits for the next payload and tells its size."""
    sizes: Queue[int] = Queue()
    session.declare_subscriber(KEY, lambda sample: sizes.put(len(bytes(sample.payload))))
    return partial(sizes.get, timeout=PATIENCE_S)


def wait_for_a_listener(publisher: zenoh.Publisher) -> None:
    matched = threading.Event()
    publisher.declare_matching_listener(lambda status: matched.set() if status.matching else None)
    assert publisher.matching_status.matching or matched.wait(PATIENCE_S)


def test_a_robot_that_was_there_first_hears_the_world_that_comes_later(endpoint: str) -> None:
    def wait_for_the_world_and_listen() -> int:
        opening.set()
        with zenoh.open(client_session(endpoint).to_zenoh()) as robot:
            return listener(robot)()

    opening = threading.Event()
    with ThreadPoolExecutor(1) as pool:
        heard = pool.submit(wait_for_the_world_and_listen)
        assert opening.wait(PATIENCE_S)
        with zenoh.open(world_session(endpoint).to_zenoh()) as world:
            publisher = world.declare_publisher(KEY)
            wait_for_a_listener(publisher)
            publisher.put(b"hello")
            assert heard.result(PATIENCE_S) == 5


def test_the_largest_payload_passes_both_ways_and_a_larger_one_is_dropped(endpoint: str) -> None:
    with (
        zenoh.open(world_session(endpoint).to_zenoh()) as world,
        zenoh.open(client_session(endpoint).to_zenoh()) as robot,
    ):
        assert (robot.info.routers_zid(), robot.info.peers_zid()) == ([world.info.zid()], [])
        for sender, receiver in ((world, robot), (robot, world)):
            next_size = listener(receiver)
            publisher = sender.declare_publisher(KEY, **NEVER_DROP)
            wait_for_a_listener(publisher)
            for size in (MAX_PAYLOAD_BYTES, MAX_PAYLOAD_BYTES + 4096, 1):
                publisher.put(bytes(size))
            assert (next_size(), next_size()) == (MAX_PAYLOAD_BYTES, 1)
            publisher.undeclare()


def test_half_open_connections_keep_nobody_out() -> None:
    """With Zenoh's own settings they would."""
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        at = free.getsockname()
    endpoint = f"tcp/127.0.0.1:{at[1]}"
    with zenoh.open(world_session(endpoint).to_zenoh()), ExitStack() as idle:
        for _ in range(150):
            idle.enter_context(socket.create_connection(at, timeout=PATIENCE_S))
        zenoh.open(client_session(endpoint, patience_s=4.0).to_zenoh()).close()


def test_absence_is_told_again_and_again_until_the_world_comes(endpoint, monkeypatch):
    monkeypatch.setattr(protocol.session, "PATIENCE_S", 0.05)
    opening, beats, told, worlds = Opening(), [], [], []

    def tell() -> None:
        told.append(len(beats))
        if len(told) == 3:
            worlds.append(zenoh.open(world_session(endpoint).to_zenoh()))

    opening.begin(client_session(endpoint))
    with opening.wait(lambda: beats.append(None), tell, every_s=0.01), worlds[0]:
        assert len(beats) > told[-1] > told[0] >= 1
