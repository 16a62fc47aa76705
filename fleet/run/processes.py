"""The processes of one run: started, watched, signalled, ended and started again, each by its own name."""

import os
import signal
import subprocess
import sys
import time
from collections import Counter
from collections.abc import Callable, Mapping
from contextlib import suppress
from enum import StrEnum
from pathlib import Path
from typing import Self

import structlog

from chassis.process import PARENT
from chassis.refusal import ExitStatus
from fleet.inject.process_faults import WORLD

PATIENCE_S = 5.0
"""How long processes may take to end after they were asked to."""
LOG_TAIL_LINES = 8
OWN = ("UNSPOKEN_", "NOTIFY_SOCKET", "WATCHDOG_")
"""Environment variables that are for this process: its options, and its service manager."""
BACK_OFF_S = (0.5, 1.0, 2.0, 4.0, 8.0)
"""How long after its end a process is started again, the first time and each further time; then no more."""

log = structlog.get_logger("bench")


class Processes:
    """Starts processes as ``python -m <module>`` with one log file each; none outlives the block.

    Nor does one outlive this process, where it asks for that by :func:`chassis.process.end_with_parent`;
    all are therefore to be started on the thread that stays to the end. The directory for log files exists.
    """

    def __init__(self, log_directory: Path) -> None:
        self._log_directory = log_directory
        self._parts: dict[str, tuple[str, Mapping[str, str]]] = {}
        self._processes: dict[str, subprocess.Popen[bytes]] = {}
        self._started_again: list[str] = []

    def __enter__(self) -> Self:
        """Nothing runs yet."""
        return self

    def __exit__(self, *_error: object) -> None:
        """End what still runs: ask first, insist after ``PATIENCE_S``."""
        for name in self._processes:
            self.ask_to_end(name)
            self.signal(name, signal.SIGCONT)  # whoever is stopped cannot do as asked
        until_s = time.monotonic() + PATIENCE_S
        for process in self._processes.values():
            try:
                process.wait(max(until_s - time.monotonic(), 0.0))
            except subprocess.TimeoutExpired:
                process.kill()
                process.wait()

    def start(self, name: str, module: str, settings: Mapping[str, str]) -> None:
        """Start a process that takes its options from the environment, where no process list shows them.

        Args:
            name: by which it is known here; also names its log file.
            module: what to run.
            settings: options; ``robot`` becomes ``UNSPOKEN_ROBOT``.
        """
        self._parts[name] = module, settings
        self.log_file(name).write_bytes(b"")
        self._run(name)

    def start_again(self, name: str) -> None:
        """Start a process that ended or was killed just now, with the settings it had; its log goes on."""
        self._processes[name].wait()
        self._run(name)
        self._started_again.append(name)

    def take_started_again(self) -> list[str]:
        """Who was started again since the last time."""
        taken, self._started_again = self._started_again, []
        return taken

    def log_file(self, name: str) -> Path:
        """Where a process writes."""
        return self._log_directory / f"{name}.log"

    def ask_to_end(self, name: str) -> None:
        """SIGTERM, unless it has ended."""
        self.signal(name, signal.SIGTERM)

    def signal(self, name: str, number: signal.Signals) -> None:
        """Send a signal, unless it has ended."""
        if self.is_running(name):
            self._processes[name].send_signal(number)

    def wait(self, name: str) -> None:
        """Let a process that is about to end do so; it is ended with the others if it takes too long."""
        with suppress(subprocess.TimeoutExpired):
            self._processes[name].wait(PATIENCE_S)

    def is_running(self, name: str) -> bool:
        """Whether it has not ended; a process that is stopped has not."""
        return self._processes[name].poll() is None

    def names(self) -> tuple[str, ...]:
        """Everybody who was started."""
        return tuple(self._processes)

    def statuses(self) -> dict[str, int]:
        """Exit statuses of the processes that have ended; negative: the signal that killed it."""
        polled = {name: process.poll() for name, process in self._processes.items()}
        return {name: status for name, status in polled.items() if status is not None}

    def ended(self) -> dict[str, str]:
        """Processes that have ended, with how and what they said last."""
        return {name: self.account(name) for name in self.statuses()}

    def account(self, name: str) -> str:
        """How a process has ended, and what it said last."""
        status = self._processes[name].returncode
        how = f"was killed by signal {-status}" if status < 0 else f"ended with exit status {status}"
        log_file = self.log_file(name)
        said = log_file.read_text(encoding="utf-8", errors="replace").splitlines()[-LOG_TAIL_LINES:]
        last = "".join(f"\n  {line}" for line in said) if said else " nothing"
        return f"{name} {how} before the run was over. Its log {log_file} says last:{last}"

    def _run(self, name: str) -> None:
        module, settings = self._parts[name]
        inherited = {key: value for key, value in os.environ.items() if not key.startswith(OWN)}
        own = {f"UNSPOKEN_{key.upper()}": value for key, value in settings.items()}
        with self.log_file(name).open("ab") as log_file:
            self._processes[name] = subprocess.Popen(
                # -P: a folder `world` where the user happens to stand is not our package.
                [sys.executable, "-P", "-m", module],
                env={**inherited, **own, PARENT: str(os.getpid()), "PYTHONUNBUFFERED": "1"},
                stdin=subprocess.DEVNULL,
                stdout=log_file,
                stderr=subprocess.STDOUT,
                start_new_session=True,  # Ctrl-C reaches the bench only, which ends the run in order
            )


class Restart(StrEnum):
    """Which processes are started again."""

    NEVER = "never"
    ON_FAILURE = "on-failure"


class Supervisor:
    """Knows which processes have ended, whether that was to be, and starts them again.

    Attributes:
        lost: who has ended and is not started again, with how it ended and what it said last.
    """

    def __init__(
        self,
        processes: Processes,
        restart: Restart = Restart.NEVER,
        now_s: Callable[[], float] = time.monotonic,
    ) -> None:
        self._processes, self._restart, self._now_s = processes, restart, now_s
        self._due_s: dict[str, float] = {}
        self._attempts: Counter[str] = Counter()
        self._excused: set[str] = set()
        self.lost: dict[str, str] = {}

    def excuse(self, name: str) -> None:
        """The end of this process is wanted: it is neither lost nor started again by this."""
        self._excused.add(name)

    def expect(self, name: str) -> None:
        """This process is to run from now on."""
        self._excused.discard(name)

    def give_up_restarting(self) -> None:
        """The run is about to end: start nothing more."""
        self._restart = Restart.NEVER
        self._due_s.clear()

    def look(self) -> None:
        """Note who has ended, and start again whose time has come."""
        for name, status in self._processes.statuses().items():
            if name in self._excused or name in self.lost:
                continue
            if name in self._due_s:
                self._start_if_due(name)
            elif self._is_to_return(name, status):
                pause_s = BACK_OFF_S[self._attempts[name]]
                self._due_s[name] = self._now_s() + pause_s
                log.warning("ended, and is to be started again", process=name, status=status, in_s=pause_s)
            else:
                self.lost[name] = self._processes.account(name)

    def _is_to_return(self, name: str, status: int) -> bool:
        over = name == WORLD and status in (ExitStatus.DONE, ExitStatus.UNMET)
        return self._restart is Restart.ON_FAILURE and not over and self._attempts[name] < len(BACK_OFF_S)

    def _start_if_due(self, name: str) -> None:
        if self._now_s() < self._due_s[name]:
            return
        del self._due_s[name]
        self._attempts[name] += 1
        self._processes.start_again(name)
        log.warning("started again", process=name, attempt=self._attempts[name])
