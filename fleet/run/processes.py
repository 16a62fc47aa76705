"""The processes of one run: started, watched, signalled and ended, each by its own id."""

import os
import signal
import subprocess
import sys
import time
from collections.abc import Mapping
from pathlib import Path
from typing import NamedTuple, Self

from chassis.process import PARENT

PATIENCE_S = 5.0
"""How long processes may take to end after they were asked to."""
LOG_TAIL_LINES = 8
OWN = ("UNSPOKEN_", "NOTIFY_SOCKET", "WATCHDOG_")
"""Environment variables that are for this process: its options, and its service manager."""


class _Part(NamedTuple):
    module: str
    settings: Mapping[str, str]


class Processes:
    """Starts processes as ``python -m <module>`` with one log file each; none outlives the block.

    Nor does one outlive this process, where it asks for that by :func:`chassis.process.end_with_parent`;
    all are therefore to be started on the thread that stays to the end.

    Args:
        log_directory: where the log files go; it exists.
    """

    def __init__(self, log_directory: Path) -> None:
        self._log_directory = log_directory
        self._parts: dict[str, _Part] = {}
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
        self._parts[name] = _Part(module, settings)
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
        try:
            self._processes[name].wait(PATIENCE_S)
        except subprocess.TimeoutExpired:
            return

    def is_running(self, name: str) -> bool:
        """Whether it has not ended; a process that is stopped has not."""
        return self._processes[name].poll() is None

    def names(self) -> tuple[str, ...]:
        """Everybody who was started."""
        return tuple(self._processes)

    def statuses(self) -> dict[str, int]:
        """Exit statuses of the processes that have ended; negative: the signal that killed it."""
        return {
            name: process.returncode
            for name, process in self._processes.items()
            if process.poll() is not None
        }

    def ended(self) -> dict[str, str]:
        """Processes that have ended, with how and what they said last."""
        return {name: self.account(name) for name in self.statuses()}

    def account(self, name: str) -> str:
        """How a process has ended, and what it said last."""
        status = self._processes[name].returncode
        how = f"was killed by signal {-status}" if status < 0 else f"ended with exit status {status}"
        log = self.log_file(name)
        said = log.read_text(encoding="utf-8", errors="replace").splitlines()[-LOG_TAIL_LINES:]
        last = "".join(f"\n  {line}" for line in said) if said else " nothing"
        return f"{name} {how} before the run was over. Its log {log} says last:{last}"

    def _run(self, name: str) -> None:
        part = self._parts[name]
        inherited = {key: value for key, value in os.environ.items() if not key.startswith(OWN)}
        own = {f"UNSPOKEN_{key.upper()}": value for key, value in part.settings.items()}
        with self.log_file(name).open("ab") as log:
            self._processes[name] = subprocess.Popen(
                # -P: a folder `world` where the user happens to stand is not our package.
                [sys.executable, "-P", "-m", part.module],
                env={**inherited, **own, PARENT: str(os.getpid()), "PYTHONUNBUFFERED": "1"},
                stdin=subprocess.DEVNULL,
                stdout=log,
                stderr=subprocess.STDOUT,
                start_new_session=True,  # Ctrl-C reaches the bench only, which ends the run in order
            )
