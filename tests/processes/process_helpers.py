"""Real processes through the real command line: started, watched, and ended by their ids."""

import os
import re
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any, Self

import yaml
import zenoh

from fleet.record.recording import read_recording
from protocol.codec import decode
from protocol.identity import Login
from protocol.keys import BENCH_NAME, Keys
from protocol.messages import Message, Truth
from protocol.session import client_session
from scenarios import find

PATIENCE_S = 120.0
"""How long a test waits for what should come; only reached when it fails."""
UNSPOKEN = Path(sys.executable).with_name("unspoken")
SHORT_SIGHTED = {"prediction_steps": 5, "estimation_steps": 3}
"""Horizons that make decisions cheap, for tests that are not about driving."""


def write_scenario(path: Path, robots: list[dict[str, Any]], **rules: Any) -> Path:
    content = {"name": path.stem, "horizons": SHORT_SIGHTED, "robots": robots, **rules}
    path.write_text(yaml.safe_dump(content), encoding="utf-8")
    return path


def bundled_with(path: Path, name: str, **rules: Any) -> Path:
    """A bundled scenario with other rules."""
    content = yaml.safe_load(find(name).read_text(encoding="utf-8"))
    path.write_text(yaml.safe_dump({**content, **rules}), encoding="utf-8")
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
    """Slow robots with a way of half an hour."""
    robots = lanes(count, 900.0, limits={"speed_mps": 0.5})
    return write_scenario(path, robots, area={"x_max_m": 1000.0}, time_limit_s=10_000.0)


def until(condition: Callable[[], bool], what: str, patience_s: float = PATIENCE_S) -> None:
    """Wait for something that can only be looked at, such as a file's content."""
    give_up_s = time.monotonic() + patience_s
    while not condition():
        assert time.monotonic() < give_up_s, f"{what} did not come"
        time.sleep(0.01)


def is_alive(pid: int) -> bool:
    try:
        os.kill(pid, 0)
    except ProcessLookupError:
        return False
    return True


def ends_all(pids):
    """Check that the end of a bench is that of its processes; end them where it is not."""
    try:
        until(lambda: not any(is_alive(pid) for pid in pids), "the end of all processes")
    finally:
        for pid in filter(is_alive, pids):
            os.kill(pid, signal.SIGKILL)


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
        for pid in children:
            if is_alive(pid):
                os.kill(pid, signal.SIGKILL)

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
        for stat in Path("/proc").glob("[0-9]*/stat"):
            try:
                # After the name, which stands in brackets and may hold spaces: state, parent, …
                parent = int(stat.read_text().rpartition(")")[2].split()[1])
                if parent == self._process.pid:
                    line = (stat.parent / "cmdline").read_text()
                    found[int(stat.parent.name)] = line.rstrip("\0").split("\0")
            except (FileNotFoundError, ProcessLookupError):
                continue  # it has ended meanwhile
        return found


class Bench(Process):
    """``unspoken run`` or ``unspoken simulate`` with an output directory and a temporary directory.

    Args:
        out: for the output.
        temporary: a directory of its own with a short path, for sockets.
        arguments: of the command line, without ``--out``.
        env: added to the environment.
    """

    def __init__(
        self, out: Path, temporary: Path, *arguments: object, env: Mapping[str, object] = {}
    ) -> None:
        self.out, self.temporary = out, temporary
        super().__init__(
            out.with_name(out.name + "-told"),
            *arguments,
            "--out",
            out,
            env={"TMPDIR": temporary, **env},
        )

    def log(self, name: str) -> str:
        path = self.out / "logs" / f"{name}.log"
        return path.read_text(encoding="utf-8") if path.exists() else ""

    def logs(self, name: str, text: str) -> None:
        """Wait until one of its processes has logged this."""
        until(lambda: text in self.log(name) or not self.running, f"{text} in the log of {name}")
        assert text in self.log(name), self.complained

    def keys(self) -> Keys:
        """The keys of its run, once its world is there."""
        self.logs("world", "waiting for robots")
        [run] = re.findall(r"run=(\S+)", self.log("world"))
        return Keys(run)

    def listening(self, name: str = BENCH_NAME) -> zenoh.Session:
        """A session of its world with the name and the password of one of its participants."""
        self.logs("world", "waiting for robots")
        [endpoint] = re.findall(r"listen=(\S+)", self.log("world"))
        users = Path(endpoint.removeprefix("unixsock-stream/")).with_name("users")
        if not users.exists():  # a run without policy
            return zenoh.open(client_session(endpoint).to_zenoh())
        passwords = dict(line.split(":") for line in users.read_text(encoding="utf-8").splitlines())
        return zenoh.open(client_session(endpoint, Login(name, passwords[name])).to_zenoh())

    def reach(self, step: int) -> None:
        """Wait until the world has published this step."""
        reached = threading.Event()

        def look(sample: zenoh.Sample) -> None:
            if decode(Truth, sample.payload.to_bytes()).step >= step:
                reached.set()

        with self.listening() as session:
            _truths = session.declare_subscriber(self.keys().truth, look)
            assert reached.wait(PATIENCE_S), f"step {step} was not reached"

    def pid(self, module: str, robot: str | None = None) -> int:
        """The id of its world, or of the process of one of its robots."""
        [pid] = [
            pid
            for pid, line in self.children().items()
            if line[-1] == module and (robot is None or environment(pid)["UNSPOKEN_ROBOT"] == robot)
        ]
        return pid

    def kill(self, module: str, robot: str | None = None) -> None:
        """Kill its world, or the process of one of its robots."""
        os.kill(self.pid(module, robot), signal.SIGKILL)

    def leaves_nothing(self, pids: Mapping[int, object]) -> None:
        """Check that after its end none of these processes is left, and no temporary file."""
        assert not self.running
        assert [pid for pid in pids if is_alive(pid)] == []
        assert list(self.temporary.iterdir()) == []


def environment(pid: int) -> dict[str, str]:
    """What a process was given at its start."""
    lines = (Path("/proc") / str(pid) / "environ").read_text().split("\0")
    return {name: value for name, _, value in (line.partition("=") for line in lines) if name}


def recorded(out: Path) -> list[tuple[str, Message]]:
    """The messages of a run by the end of their keys, such as ``pose/1``."""
    recording = read_recording(out / "run.mcap")
    start = f"unspoken/{recording.facts.run}/"
    return [(key.removeprefix(start), message) for key, message in recording]
