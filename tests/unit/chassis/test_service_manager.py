import os
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


@pytest.fixture
def manager(listens, clock):
    return ServiceManager({**listens.environment, "WATCHDOG_USEC": "8000000"}, clock)


def test_a_start_asks_for_more_time_and_feeds_no_watchdog_which_is_fed_several_times_in_its_time_then(
    listens, clock, manager
):
    manager.tell(STATUS="it waits\nfor a world")
    manager.alive()
    manager.alive()
    clock.now_s += LONGEST_START_S / 2
    manager.alive()
    more_time = {"EXTEND_TIMEOUT_USEC": "120000000"}
    assert listens.drain() == [{"STATUS": "it waits for a world"}, more_time, more_time]
    manager.up()
    manager.up()
    assert listens.drain() == [{"READY": "1"}]
    fed = 0
    for _ in range(80):
        clock.now_s += 0.1
        manager.alive()
        fed += listens.drain() == [{"WATCHDOG": "1"}]
    assert fed in (3, 4)


def test_a_listener_whose_queue_is_full_holds_nothing_up_and_is_told_later(listens, manager):
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


@pytest.mark.parametrize(
    ("told", "fed"),
    [
        ({"WATCHDOG_USEC": "4000000", "WATCHDOG_PID": str(os.getpid())}, True),
        ({"WATCHDOG_USEC": "4000000", "WATCHDOG_PID": str(os.getpid() + 1)}, False),
        ({"WATCHDOG_USEC": "soon"}, False),
    ],
)
def test_the_environment_says_whether_a_watchdog_wants_to_be_fed(listens, told, fed):
    manager = ServiceManager({**listens.environment, **told})
    manager.up()
    listens.drain()
    manager.alive()
    assert listens.drain() == ([{"WATCHDOG": "1"}] if fed else [])
