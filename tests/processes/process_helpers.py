"""Real processes through the real command line: started, watched, and ended by their ids."""

import json
import os
import re
import shutil
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from tempfile import mkdtemp
from typing import Any, Self

import psutil
import pytest
import yaml
import zenoh

from fleet.record.recording import read_recording
from protocol.codec import decode
from protocol.identity import Login
from protocol.keys import BENCH_NAME, Keys
from protocol.messages import Message, Mind, Timings, TrueRobot, Truth
from protocol.session import client_session
from protocol.vehicle import Input, Limits, braking_input

PATIENCE_S = 240.0
"""How long a test waits for what should come; only reached when it fails."""
UNSPOKEN = Path(sys.executable).with_name("unspoken")
SHORT_SIGHTED = {"prediction_steps": 5, "estimation_steps": 3}
"""Horizons that make decisions cheap, for tests that are not about driving."""
FAR_SIGHTED = {"prediction_steps": 20, "estimation_steps": 3}
"""Horizons with which a robot alone in its lane stops at its goal, and with which nobody is warned of any."""
DEFAULT_LIMITS = Limits()


def write_scenario(path: Path, robots: list[dict[str, Any]], **rules: Any) -> Path:
    content = {"name": path.stem, "horizons": SHORT_SIGHTED, "robots": robots, **rules}
    path.write_text(yaml.safe_dump(content), encoding="utf-8")
    return path


def lanes(count: int, length_m: float, **robot: Any) -> list[dict[str, Any]]:
    """Robots 1, 2, … side by side, each with its goal straight ahead along x."""
    return [
        {
            "id": i + 1,
            "start": {"x_m": 0.0, "y_m": 2.0 * i},
            "goal": {"x_m": length_m, "y_m": 2.0 * i},
            **robot,
        }
        for i in range(count)
    ]


def endless(path: Path, count: int) -> Path:
    """Slow robots, which stop within their horizon, with a way of more than half an hour."""
    robots = lanes(count, 900.0, limits={"speed_mps": 0.4})
    return write_scenario(path, robots, area={"x_max_m": 1000.0}, time_limit_s=10_000.0)


def until(condition: Callable[[], bool], what: str, patience_s: float = PATIENCE_S) -> None:
    """Wait for something that can only be looked at, such as a file's content."""
    give_up_s = time.monotonic() + patience_s
    while not condition():
        assert time.monotonic() < give_up_s, f"{what} did not come"
        time.sleep(0.01)


def kill_all(pids: Iterable[int]) -> None:
    for pid in filter(psutil.pid_exists, pids):
        os.kill(pid, signal.SIGKILL)


def ends_all(pids: Collection[int]) -> None:
    """Check that the end of a bench is that of its processes; end them where it is not."""
    try:
        until(lambda: not any(map(psutil.pid_exists, pids)), "the end of all processes")
    finally:
        kill_all(pids)


class Truths:
    """The truths of a run as they come to a session of its own, from now on."""

    def __init__(self, session: zenoh.Session, keys: Keys) -> None:
        self.all: list[Truth] = []
        self._more = threading.Condition()
        self._session = session
        self._subscriber = session.declare_subscriber(keys.truth, self._keep)

    def _keep(self, sample: zenoh.Sample) -> None:
        with self._more:
            self.all.append(decode(Truth, sample.payload.to_bytes()))
            self._more.notify_all()

    def wait_for(self, what: Callable[[Truth], object], patience_s: float = PATIENCE_S) -> Truth:
        """Wait for a truth of this kind; the last one."""
        with self._more:
            assert self._more.wait_for(lambda: self.all and what(self.all[-1]), patience_s), "it did not come"
            return self.all[-1]

    def reached(self, step: int, patience_s: float = PATIENCE_S) -> None:
        """Wait until the world has published this step."""
        self.wait_for(lambda truth: truth.step >= step, patience_s)

    def ended(self) -> Truth:
        """The last truth; after it this reader leaves, for which the world waits."""
        last = self.wait_for(lambda truth: truth.verdict)
        self._subscriber.undeclare()
        return last

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self._session.close()


class Process:
    """One ``unspoken …``; its output goes to files in its directory.

    Args:
        directory: for its output.
        arguments: of the command line.
        cwd: where it stands.
        env: added to the environment.
        program: what is run, if not ``unspoken`` alone.
    """

    def __init__(
        self,
        directory: Path,
        *arguments: object,
        cwd: Path | None = None,
        env: Mapping[str, object] = {},
        program: Sequence[object] = (UNSPOKEN,),
    ) -> None:
        directory.mkdir(exist_ok=True)
        self._stdout, self._stderr = directory / "stdout", directory / "stderr"
        clean = {name: value for name, value in os.environ.items() if not name.startswith("UNSPOKEN_")}
        with self._stdout.open("wb") as stdout, self._stderr.open("wb") as stderr:
            self._process = subprocess.Popen(
                [*map(str, program), *map(str, arguments)],
                stdin=subprocess.DEVNULL,
                stdout=stdout,
                stderr=stderr,
                cwd=cwd,
                env={**clean, "PYTHONUNBUFFERED": "1", **{name: str(value) for name, value in env.items()}},
            )

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        children = self.children()
        self._process.kill()
        self._process.wait()
        kill_all(children)

    @property
    def own_pid(self) -> int:
        return self._process.pid

    @property
    def running(self) -> bool:
        return self._process.poll() is None

    @property
    def told(self) -> str:
        return self._stdout.read_text(encoding="utf-8")

    @property
    def complained(self) -> str:
        return self._stderr.read_text(encoding="utf-8")

    def signal(self, number: signal.Signals) -> None:
        self._process.send_signal(number)

    def end(self, patience_s: float = PATIENCE_S) -> int:
        """Wait for the end; the exit status."""
        return self._process.wait(patience_s)

    def tells(self, text: str) -> None:
        """Wait until it has printed this."""
        until(lambda: text in self.told or not self.running, text)
        assert text in self.told, self.told + self.complained

    def children(self) -> dict[int, list[str]]:
        """Process ids and command lines of its children."""
        found = {}
        with suppress(psutil.NoSuchProcess):
            for child in psutil.Process(self.own_pid).children():
                with suppress(psutil.NoSuchProcess):
                    found[child.pid] = child.cmdline()
        return found


class Bench(Process):
    """``unspoken run`` or ``unspoken simulate`` with an output directory and a temporary directory.

    The path of the latter is short: that of a socket holds about a hundred characters.

    Args:
        out: for the output.
        arguments: of the command line, without ``--out``.
        cwd: where it stands.
        env: added to the environment.
    """

    def __init__(
        self, out: Path, *arguments: object, cwd: Path | None = None, env: Mapping[str, object] = {}
    ) -> None:
        self.out, self.temporary = out, Path(mkdtemp(prefix="u"))
        told = out.with_name(out.name + "-told")
        super().__init__(told, *arguments, "--out", out, cwd=cwd, env={"TMPDIR": self.temporary, **env})

    def __exit__(self, *error: object) -> None:
        super().__exit__(*error)
        shutil.rmtree(self.temporary)

    def log(self, name: str) -> str:
        path = self.out / "logs" / f"{name}.log"
        return path.read_text(encoding="utf-8") if path.exists() else ""

    def logs(self, name: str, text: str) -> None:
        """Wait until one of its processes has logged this."""
        until(lambda: text in self.log(name) or not self.running, f"{text} in the log of {name}")
        assert text in self.log(name), self.complained

    def _of_world(self, name: str) -> str:
        self.logs("world", "waiting for robots")
        [value] = re.findall(rf"{name}=(\S+)", self.log("world"))
        return value

    @property
    def endpoint(self) -> str:
        """Of its world, once that is there."""
        return self._of_world("listen")

    @property
    def folder(self) -> Path:
        """Where its sockets and passwords are."""
        return Path(self.endpoint.removeprefix("unixsock-stream/")).parent

    def keys(self) -> Keys:
        """The keys of its run, once its world is there."""
        return Keys(self._of_world("run"))

    def listening(self, name: str = BENCH_NAME) -> zenoh.Session:
        """A session of its world with the name and the password of one of its participants."""
        users = self.folder / "users"
        if not users.exists():  # a run without policy
            return zenoh.open(client_session(self.endpoint).to_zenoh())
        passwords = dict(line.split(":") for line in users.read_text(encoding="utf-8").splitlines())
        return zenoh.open(client_session(self.endpoint, Login(name, passwords[name])).to_zenoh())

    def reach(self, step: int, patience_s: float = PATIENCE_S) -> None:
        """Wait until the world has published this step."""
        with self.watched() as truths:
            truths.reached(step, patience_s)

    def watched(self) -> "Truths":
        """Its truths as they come."""
        return Truths(self.listening(), self.keys())

    def pid(self, module: str, robot: str | None = None) -> int:
        """The id of its world, or of the process of one of its robots."""
        [pid] = [
            pid
            for pid, line in self.children().items()
            if line[-1] == module and (robot is None or environment(pid)["UNSPOKEN_ROBOT"] == robot)
        ]
        return pid

    def kill(self, module: str, robot: str | None = None) -> dict[int, list[str]]:
        """Kill its world, or the process of one of its robots; the children that it had."""
        children = self.children()
        os.kill(self.pid(module, robot), signal.SIGKILL)
        return children

    def leaves_nothing(self, pids: Iterable[int] = ()) -> None:
        """Check that after its end none of these processes is left, and no temporary file."""
        assert not self.running
        assert list(filter(psutil.pid_exists, pids)) == []
        assert list(self.temporary.iterdir()) == []

    @property
    def summary(self) -> dict[str, Any]:
        """What it has left as its summary."""
        found: dict[str, Any] = json.loads((self.out / "summary.json").read_text(encoding="utf-8"))
        return found

    def messages(self, kind: type[Message]) -> list[Any]:
        """What it has recorded of one kind."""
        return [message for _, message in recorded(self.out) if isinstance(message, kind)]

    def true(self, robot: str) -> dict[int, TrueRobot]:
        """How a robot really was, by step."""
        return {truth.step: truth.robots[robot] for truth in self.messages(Truth)}

    def missed(self, robot: str) -> list[int]:
        """Steps that a robot did not answer."""
        true = self.true(robot)
        return [
            step for step in range(max(true)) if true[step + 1].deadline_misses > true[step].deadline_misses
        ]

    def begun(self, robot: str) -> list[int]:
        """At which steps a robot began anew, without any memory."""
        return [mind.step for mind in self.messages(Mind) if mind.robot == robot and mind.decision == 0]


def environment(pid: int) -> dict[str, str]:
    """What a process was given at its start."""
    return psutil.Process(pid).environ()


def recorded(out: Path) -> list[tuple[str, Message]]:
    """The messages of a run by the end of their keys, such as ``pose/1``."""
    recording = read_recording(out / "run.mcap")
    start = f"unspoken/{recording.facts.run}/"
    return [(key.removeprefix(start), message) for key, message in recording]


def repeatable(out: Path) -> dict[tuple[str, int | None], str]:
    """The messages of a run by key and step, without what differs from run to run."""
    messages = {}
    for key, message in recorded(out):
        changes: dict[str, Any] = {"epoch": 0}
        if isinstance(message, Mind):
            changes["timings_ms"] = Timings()
        place = (key, getattr(message, "step", None))
        assert place not in messages, f"{place} was recorded twice"
        messages[place] = message.model_copy(update=changes).model_dump_json()
    return messages


def applied(robot: TrueRobot) -> Input:
    """What led to a truth."""
    return Input(robot.turn_rate_radps, robot.acceleration_mps2)


def brakes(
    true: Mapping[int, TrueRobot], steps: Iterable[int], limits: Limits = DEFAULT_LIMITS, step_s: float = 0.1
) -> None:
    """Check that at each of these steps a robot of which nothing is heard brakes as its vehicle does then."""
    for step in steps:
        former = true[step]
        braking = braking_input(limits, applied(former), former.state.speed_mps, step_s)
        assert applied(true[step + 1]) == pytest.approx(braking)


def audited(process: Callable[..., Process], out: Path, folder: Path) -> dict[str, Any]:
    """The report of ``unspoken audit`` on a run, which must follow."""
    report = folder / "audit.json"
    auditing = process("audit", "audit", out, "--json", report)
    assert auditing.end() == 0, auditing.told + auditing.complained
    found: dict[str, Any] = json.loads(report.read_text(encoding="utf-8"))
    return found


def numbers(report: Mapping[str, Any], kind: str) -> dict[str, int]:
    """How many messages of a kind an audit found by robot; all of them are identical in the repetition."""
    assert all(robot[kind]["recorded"] == robot[kind]["identical"] for robot in report["robots"])
    return {robot["id"]: robot[kind]["recorded"] for robot in report["robots"]}
