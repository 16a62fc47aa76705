import os
import socket
import uuid

import pytest
from notify_socket import NotifySocket
from structlog.testing import capture_logs

from chassis.process import LONGEST_START_S, ServiceManager


class Clock:
    now_s = 100.0

    def __call__(self):
        return self.now_s


@pytest.fixture
def clock():
    return Clock()


@pytest.fixture(params=["path", "abstract"])
def listens(request, tmp_path):
    address = f"@unspoken-{uuid.uuid4()}" if request.param == "abstract" else str(tmp_path / "n")
    with NotifySocket(address) as socket_:
        yield socket_


def manager_of(listens, clock, watchdog_s=None):
    watchdog = {} if watchdog_s is None else {"WATCHDOG_USEC": f"{watchdog_s * 1e6:.0f}"}
    return ServiceManager(listens.environment | watchdog, clock)


def test_what_is_told_arrives(listens, clock):
    manager = manager_of(listens, clock)
    manager.tell(STATUS="it waits\nfor a world")
    manager.up()
    manager.up()
    assert listens.drain() == [{"STATUS": "it waits for a world"}, {"READY": "1"}]


def test_a_start_that_goes_on_asks_for_more_time_and_feeds_no_watchdog(listens, clock):
    manager = manager_of(listens, clock, watchdog_s=8.0)
    manager.alive()
    manager.alive()
    clock.now_s += LONGEST_START_S / 2
    manager.alive()
    assert listens.drain() == 2 * [{"EXTEND_TIMEOUT_USEC": "120000000"}]


def test_the_watchdog_is_fed_several_times_in_its_time_and_by_nothing_else(listens, clock):
    manager = manager_of(listens, clock, watchdog_s=8.0)
    manager.up()
    listens.drain()
    fed = 0
    for _ in range(80):
        clock.now_s += 0.1
        manager.alive()
        fed += listens.drain() == [{"WATCHDOG": "1"}]
    assert fed in (3, 4)
    clock.now_s += 100.0
    assert listens.drain() == []


def test_a_listener_whose_queue_is_full_holds_nothing_up_and_is_told_later(listens, clock):
    manager = manager_of(listens, clock, watchdog_s=8.0)
    for number in range(2_000):
        manager.tell(STATUS=str(number))
    manager.up()
    told = listens.drain()
    assert len(told) < 2_000
    assert not any("READY" in each for each in told)
    manager.alive()
    [late] = listens.drain()
    assert late["READY"] == "1"
    assert late["STATUS"] == "1999"


def test_a_listener_that_is_gone_is_told_of_once(tmp_path, clock):
    manager = ServiceManager({"NOTIFY_SOCKET": str(tmp_path / "nobody")}, clock)
    with capture_logs() as log:
        for _ in range(3):
            clock.now_s += 100.0
            manager.alive()
            manager.tell(STATUS="here")
    assert [entry["event"] for entry in log] == ["the service manager does not listen"]


def test_without_a_service_manager_nothing_happens(monkeypatch):
    def refuse(*_):
        raise AssertionError("a socket was opened")

    monkeypatch.setattr(socket, "socket", refuse)
    manager = ServiceManager({})
    manager.alive()
    manager.up()
    manager.tell(STATUS="alone")


@pytest.mark.parametrize(
    ("told", "fed"),
    [
        ({"WATCHDOG_USEC": "4000000"}, True),
        ({"WATCHDOG_USEC": "4000000", "WATCHDOG_PID": str(os.getpid())}, True),
        ({"WATCHDOG_USEC": "4000000", "WATCHDOG_PID": str(os.getpid() + 1)}, False),
        ({"WATCHDOG_USEC": "soon"}, False),
        ({}, False),
    ],
)
def test_the_environment_says_whether_a_watchdog_wants_to_be_fed(listens, told, fed):
    manager = ServiceManager({**listens.environment, **told})
    manager.up()
    listens.drain()
    manager.alive()
    assert listens.drain() == ([{"WATCHDOG": "1"}] if fed else [])
