"""Agents and worlds as a service manager and a health check see them, from their start to their end."""

import signal
import socket
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
from notify_socket import NotifySocket
from process_helpers import Process, endless, until

from chassis.healthy import LIVE, METRICS, READY, ask

WATCHDOG_S = 2.0
HANGING = Path(__file__).with_name("hanging.py")
Start = Callable[..., Process]


@pytest.fixture
def listens(temporary: Path) -> Iterator[NotifySocket]:
    with NotifySocket(temporary / "notify") as listens:
        yield listens


def free_port() -> int:
    with socket.create_server(("127.0.0.1", 0)) as free:
        return int(free.getsockname()[1])


def program(what: str, *, hanging: bool) -> tuple[object, ...]:
    return (sys.executable, HANGING, what) if hanging else (sys.executable, "-P", "-m", what)


class Stage:
    """One robot in its endless world; all can be watched, and one of them tells a service manager."""

    def __init__(self, process: Start, folder: Path, listens: NotifySocket, told_by: str, hangs: str = ""):
        self._process = process
        self._scenario = endless(folder / "endless.yaml", 1)
        self._endpoint = f"unixsock-stream/{listens.environment['NOTIFY_SOCKET']}.world"
        self._hangs = hangs
        watchdog = {"WATCHDOG_USEC": round(WATCHDOG_S * 1e6)}
        self._environments = {told_by: {**listens.environment, **watchdog}}
        self.ports = {"agent": free_port(), "world": free_port()}

    def _start(self, what: str, **told: object) -> Process:
        settings = {"UNSPOKEN_WATCH_PORT": self.ports[what], **told, **self._environments.get(what, {})}
        return self._process(what, program=program(what, hanging=what == self._hangs), env=settings)

    def world(self) -> Process:
        return self._start("world", UNSPOKEN_SCENARIO=self._scenario, UNSPOKEN_LISTEN=self._endpoint)

    def agent(self) -> Process:
        return self._start(
            "agent", UNSPOKEN_ROBOT=1, UNSPOKEN_GOAL="900,0,0", UNSPOKEN_CONNECT=self._endpoint
        )

    def says(self, what: str, path: str) -> str:
        """What a process answers, or that it does not."""
        return ask(str(self.ports[what]), path)[1]

    def will_say(self, what: str, path: str, answer: str) -> None:
        until(lambda: answer in self.says(what, path), f"{answer} at {path} of the {what}")


@pytest.mark.slow
def test_an_agent_is_ready_once_it_has_joined_and_feeds_the_watchdog_while_it_waits_and_drives(
    process: Start, tmp_path: Path, listens: NotifySocket
) -> None:
    stage = Stage(process, tmp_path, listens, told_by="agent")
    agent = stage.agent()
    told = listens.until("STATUS", f"it waits for a world at {stage._endpoint}")
    assert any("EXTEND_TIMEOUT_USEC" in each for each in told)
    stage.will_say("agent", READY, "not ready: it waits for a world")
    assert stage.says("agent", LIVE) == "live"
    assert not any("READY" in each or "WATCHDOG" in each for each in [*told, *listens.drain()])
    world = stage.world()
    listens.until("READY", "1")
    listens.until("STATUS", "drives")
    for _ in range(3):
        listens.until("WATCHDOG", "1")
    assert stage.says("agent", READY) == stage.says("world", READY) == "ready"
    world.signal(signal.SIGKILL)  # from now on nothing comes, and the loop waits
    world.end()
    listens.drain()
    begin_s = time.monotonic()
    for _ in range(4):
        listens.until("WATCHDOG", "1")
    assert time.monotonic() - begin_s < 4 * WATCHDOG_S
    agent.signal(signal.SIGTERM)
    listens.until("STOPPING", "1")
    assert agent.end() == 0


@pytest.mark.slow
def test_a_hung_decision_feeds_no_watchdog_and_is_not_live_although_the_process_answers(
    process: Start, tmp_path: Path, listens: NotifySocket
) -> None:
    stage = Stage(process, tmp_path, listens, told_by="agent", hangs="agent")
    stage.agent()
    stage.world()
    listens.until("READY", "1")
    stage.will_say("agent", LIVE, "not live: no sign of life for")
    listens.drain()
    assert listens.next(2 * WATCHDOG_S) is None
    assert "not ready" in stage.says("agent", READY)
    assert 'phase="estimate"' in stage.says("agent", METRICS)
    assert stage.says("world", LIVE) == "live"


@pytest.mark.slow
def test_a_world_can_be_waited_for_and_is_ready_with_its_robots(
    process: Start, tmp_path: Path, listens: NotifySocket
) -> None:
    stage = Stage(process, tmp_path, listens, told_by="world")
    world = stage.world()
    told = listens.until("STATUS", "it waits for 1")
    assert any(each.get("READY") == "1" for each in told)
    assert stage.says("world", READY) == "not ready: it waits for 1"
    assert stage.says("world", LIVE) == "live"
    listens.until("WATCHDOG", "1")
    stage.agent()
    listens.until("STATUS", "drives 1 robots")
    assert stage.says("world", READY) == "ready"
    listens.until("WATCHDOG", "1")
    world.signal(signal.SIGTERM)
    listens.until("STOPPING", "1")
    assert world.end() == 1


@pytest.mark.slow
def test_a_hung_world_feeds_no_watchdog_and_its_robot_lives_on(
    process: Start, tmp_path: Path, listens: NotifySocket
) -> None:
    stage = Stage(process, tmp_path, listens, told_by="world", hangs="world")
    stage.world()
    stage.agent()
    listens.until("STATUS", "drives 1 robots")
    stage.will_say("world", LIVE, "not live: no sign of life for")
    listens.drain()
    assert listens.next(2 * WATCHDOG_S) is None
    assert stage.says("agent", LIVE) == "live"


@pytest.mark.slow
def test_a_watch_port_in_use_is_a_clear_error_of_both(process: Start, tmp_path: Path) -> None:
    with socket.create_server(("127.0.0.1", 0)) as taken:
        port = taken.getsockname()[1]
        scenario = endless(tmp_path / "endless.yaml", 1)
        world = process("w", "world", "--scenario", scenario, "--watch-port", port)
        agent = process("a", "agent", "--robot", "1", "--goal", "1,0,0", "--watch-port", port)
        for each in (world, agent):
            assert each.end() == 3
            assert (
                f"the watch port {port} on 127.0.0.1 cannot be used: Address already in use"
                in each.complained
            )
            assert "Traceback" not in each.complained
