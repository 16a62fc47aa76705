"""Agents and worlds as a service manager and a health check see them, from their start to their end."""

import signal
import socket
import sys
import time
from pathlib import Path

import pytest
from notify_socket import NotifySocket
from process_helpers import endless, until

from chassis.healthy import LIVE, METRICS, READY, ask

WATCHDOG_S = 2.0
HANGING = Path(__file__).with_name("hanging.py")

pytestmark = pytest.mark.slow


def free_port() -> int:
    with socket.create_server(("127.0.0.1", 0)) as free:
        return int(free.getsockname()[1])


class Stage:
    """One robot in its endless world; both can be watched, and both tell a service manager how they are."""

    def __init__(self, process, folder: Path, hangs: str = "") -> None:
        self._process, self._hangs = process, hangs
        self.endpoint = f"unixsock-stream/{folder}/w"
        settings = {
            "agent": {"ROBOT": 1, "GOAL": "900,0,0", "CONNECT": self.endpoint},
            "world": {"SCENARIO": endless(folder / "endless.yaml", 1), "LISTEN": self.endpoint},
        }
        self._ports = {what: free_port() for what in settings}
        self.listens = {what: NotifySocket(folder / what) for what in settings}
        self._environments = {
            what: {f"UNSPOKEN_{name}": value for name, value in told.items()}
            | {"UNSPOKEN_WATCH_PORT": self._ports[what], "WATCHDOG_USEC": round(WATCHDOG_S * 1e6)}
            | self.listens[what].environment
            for what, told in settings.items()
        }

    def start(self, what: str):
        hanging, normal = (sys.executable, HANGING, what), (sys.executable, "-P", "-m", what)
        program = hanging if what == self._hangs else normal
        return self._process(what, program=program, env=self._environments[what])

    def says(self, what: str, path: str) -> str:
        """What a process answers, or that it does not."""
        return ask(str(self._ports[what]), path)[1]

    def will_say(self, what: str, path: str, answer: str) -> None:
        until(lambda: answer in self.says(what, path), f"{answer} at {path} of the {what}")


@pytest.fixture
def stage(process, temporary, request):
    stage = Stage(process, temporary, getattr(request, "param", ""))
    yield stage
    for listens in stage.listens.values():
        listens.__exit__()


def test_each_is_ready_once_it_is_and_feeds_the_watchdog_while_it_waits_and_drives(stage):
    agent_tells, world_tells = stage.listens["agent"], stage.listens["world"]
    world = stage.start("world")
    told = world_tells.until("STATUS", "it waits for 1")
    assert any(each.get("READY") == "1" for each in told)
    assert stage.says("world", READY) == "not ready: it waits for 1"
    assert stage.says("world", LIVE) == "live"
    world_tells.until("WATCHDOG", "1")
    world.signal(signal.SIGTERM)
    world_tells.until("STOPPING", "1")
    assert world.end() == 1

    agent = stage.start("agent")
    told = agent_tells.until("STATUS", f"it waits for a world at {stage.endpoint}")
    assert any("EXTEND_TIMEOUT_USEC" in each for each in told)
    stage.will_say("agent", READY, "not ready: it waits for a world")
    assert stage.says("agent", LIVE) == "live"
    assert not any("READY" in each or "WATCHDOG" in each for each in [*told, *agent_tells.drain()])

    world = stage.start("world")
    agent_tells.until("READY", "1")
    agent_tells.until("STATUS", "drives")
    world_tells.until("STATUS", "drives 1 robots")
    for tells in (agent_tells, world_tells, agent_tells):
        tells.until("WATCHDOG", "1")
    assert stage.says("agent", READY) == stage.says("world", READY) == "ready"

    world.signal(signal.SIGKILL)  # from now on nothing comes, and the loop waits
    world.end()
    agent_tells.drain()
    begin_s = time.monotonic()
    for _ in range(4):
        agent_tells.until("WATCHDOG", "1")
    assert time.monotonic() - begin_s < 4 * WATCHDOG_S
    agent.signal(signal.SIGTERM)
    agent_tells.until("STOPPING", "1")
    assert agent.end() == 0


@pytest.mark.parametrize(
    ("stage", "other"), [("agent", "world"), ("world", "agent")], indirect=["stage"], ids=["agent", "world"]
)
def test_who_hangs_feeds_no_watchdog_and_is_not_live_although_it_answers_and_the_other_lives_on(stage, other):
    hangs = "agent" if other == "world" else "world"
    stage.start("agent")
    stage.start("world")
    stage.listens["agent"].until("READY", "1")
    stage.will_say(hangs, LIVE, "not live: no sign of life for")
    stage.listens[hangs].drain()
    assert stage.listens[hangs].next(2 * WATCHDOG_S) is None
    assert stage.says(other, LIVE) == "live"
    if hangs == "agent":
        assert "not ready" in stage.says("agent", READY)
        assert 'phase="estimate"' in stage.says("agent", METRICS)
