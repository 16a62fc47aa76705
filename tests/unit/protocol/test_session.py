"""Session settings: what Zenoh makes of them, and sessions that really speak to each other with them."""

import json
import socket
import threading
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack, contextmanager
from queue import Queue
from typing import Any

import pytest
import zenoh

from protocol.messages import MAX_PAYLOAD_BYTES
from protocol.session import NEVER_DROP, client_session, world_session

PATIENCE_S = 60
"""Ends a test that would otherwise wait for ever; nothing is asserted about times."""
TCP = "tcp/127.0.0.1:7447"
KEY = "unspoken/test/pose/a"


def read_back(config: zenoh.Config, key: str) -> Any:
    return json.loads(config.get_json(key))


EVERYWHERE = {
    "scouting/multicast/enabled": False,
    "scouting/gossip/enabled": False,
    "scouting/delay": 0,
    "transport/shared_memory/enabled": False,
    "transport/unicast/open_timeout": 1000,
    "transport/unicast/accept_timeout": 1000,
    "transport/unicast/accept_pending": 1000,
    "transport/link/tx/lease": 1000,
}


@pytest.mark.parametrize("session", [world_session, client_session])
@pytest.mark.parametrize(("key", "value"), EVERYWHERE.items())
def test_zenoh_reads_the_measured_settings(session: Any, key: str, value: Any) -> None:
    assert read_back(session(TCP).to_zenoh(), key) == value


def test_the_world_is_a_router_that_listens_and_connects_to_nobody() -> None:
    config = world_session(TCP).to_zenoh()
    assert read_back(config, "mode") == "router"
    assert read_back(config, "listen/endpoints") == [TCP]
    assert read_back(config, "connect/endpoints") == []


def test_robots_and_bench_are_clients_that_wait_for_the_world_and_listen_nowhere() -> None:
    config = client_session(TCP).to_zenoh()
    assert read_back(config, "mode") == "client"
    assert read_back(config, "connect/endpoints") == [TCP]
    assert read_back(config, "listen/endpoints") == []
    assert read_back(config, "connect/timeout_ms") == -1
    assert read_back(config, "connect/exit_on_failure") is False
    assert read_back(config, "connect/retry") == {
        "period_init_ms": 100,
        "period_max_ms": 500,
        "period_increase_factor": 1.5,
    }


def test_an_endpoint_that_is_none_is_refused() -> None:
    with pytest.raises(zenoh.ZError):
        client_session("nowhere").to_zenoh()


class Listener:
    """A subscription that keeps the sizes of what arrives and lets a test wait for one."""

    def __init__(self, session: zenoh.Session) -> None:
        self._sizes: Queue[int] = Queue()
        session.declare_subscriber(KEY, lambda sample: self._sizes.put(len(bytes(sample.payload))))

    def next_size(self) -> int:
        return self._sizes.get(timeout=PATIENCE_S)


def wait_for_a_listener(publisher: zenoh.Publisher) -> None:
    matched = threading.Event()
    publisher.declare_matching_listener(lambda status: matched.set() if status.matching else None)
    assert publisher.matching_status.matching or matched.wait(PATIENCE_S)


def test_a_robot_that_was_there_first_hears_the_world_that_comes_later(endpoint: str) -> None:
    def wait_for_the_world_and_listen() -> int:
        opening.set()
        with zenoh.open(client_session(endpoint).to_zenoh()) as robot:
            return Listener(robot).next_size()

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
        for sender, receiver in ((world, robot), (robot, world)):
            listener = Listener(receiver)
            publisher = sender.declare_publisher(KEY, **NEVER_DROP)
            wait_for_a_listener(publisher)
            for size in (MAX_PAYLOAD_BYTES, MAX_PAYLOAD_BYTES + 4096, 1):
                publisher.put(bytes(size))
            assert (listener.next_size(), listener.next_size()) == (MAX_PAYLOAD_BYTES, 1)
            publisher.undeclare()


def test_robots_and_bench_are_linked_to_the_world_and_to_nobody_else(endpoint: str) -> None:
    with (
        zenoh.open(world_session(endpoint).to_zenoh()) as world,
        zenoh.open(client_session(endpoint).to_zenoh()) as robot,
        zenoh.open(client_session(endpoint).to_zenoh()) as bench,
    ):
        for client in (robot, bench):
            assert client.info.routers_zid() == [world.info.zid()]
            assert client.info.peers_zid() == []
        assert world.info.peers_zid() == []


IDLE_SOCKETS = 150


@contextmanager
def idle_sockets(port: int) -> Iterator[None]:
    """Connections that are opened and never say a word."""
    with ExitStack() as sockets:
        for _ in range(IDLE_SOCKETS):
            sockets.enter_context(socket.create_connection(("127.0.0.1", port), timeout=PATIENCE_S))
        yield


def is_let_in(port: int) -> bool:
    """Whether a newcomer gets in within the time that a world gives a half-open connection, and some more."""
    try:
        session = zenoh.open(client_session(f"tcp/127.0.0.1:{port}", patience_s=4.0).to_zenoh())
    except zenoh.ZError:
        return False
    session.close()
    return True


def open_at_a_free_port(of_ours: bool) -> tuple[zenoh.Session, int]:
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
    endpoint = f"tcp/127.0.0.1:{port}"
    plain = zenoh.Config.from_json5(json.dumps({"mode": "router", "listen": {"endpoints": [endpoint]}}))
    return zenoh.open(world_session(endpoint).to_zenoh() if of_ours else plain), port


@pytest.mark.parametrize("of_ours", [True, False], ids=["our world", "Zenoh's own router"])
def test_half_open_connections_keep_nobody_out(of_ours: bool) -> None:
    session, port = open_at_a_free_port(of_ours)
    with session:
        assert is_let_in(port)
        with idle_sockets(port):
            assert is_let_in(port) == of_ours  # with Zenoh's own settings they would
