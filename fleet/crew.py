"""The processes of one run: started, watched and ended, each by its own id."""

import os
import subprocess
import sys
import time
from collections.abc import Mapping
from pathlib import Path
from typing import Self

PATIENCE_S = 5.0
"""How long processes may take to end after they were asked to."""
LOG_TAIL_LINES = 8


class ProcessFailedError(Exception):
    """A process of the run ended when it should not have; the text says which, how, and what it said last."""


class Crew:
    """Starts processes as ``python -m <module>`` with one log file each; none outlives the block.

    Args:
        log_directory: where the log files go; it exists.
    """

    def __init__(self, log_directory: Path) -> None:
        self._log_directory = log_directory
        self._processes: dict[str, subprocess.Popen[bytes]] = {}

    def __enter__(self) -> Self:
        """Nothing runs yet."""
        return self

    def __exit__(self, *_error: object) -> None:
        """End what still runs: ask first, insist after ``PATIENCE_S``."""
        for name in self._processes:
            self.ask_to_end(name)
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
        inherited = {key: value for key, value in os.environ.items() if not key.startswith("UNSPOKEN_")}
        own = {f"UNSPOKEN_{key.upper()}": value for key, value in settings.items()}
        with self.log_file(name).open("wb") as log:
            self._processes[name] = subprocess.Popen(
                # -P: a folder `world` where the user happens to stand is not our package.
                [sys.executable, "-P", "-m", module],
                env={**inherited, **own, "PYTHONUNBUFFERED": "1"},
                stdin=subprocess.DEVNULL,
                stdout=log,
                stderr=subprocess.STDOUT,
                start_new_session=True,  # Ctrl-C reaches the bench only, which ends the run in order
            )

    def log_file(self, name: str) -> Path:
        """Where a process writes."""
        return self._log_directory / f"{name}.log"

    def ask_to_end(self, name: str) -> None:
        """SIGTERM, unless it has ended."""
        if self._processes[name].poll() is None:
            self._processes[name].terminate()

    def wait(self, name: str) -> None:
        """Let a process that is about to end do so; it is ended with the others if it takes too long."""
        try:
            self._processes[name].wait(PATIENCE_S)
        except subprocess.TimeoutExpired:
            return

    def ended(self) -> dict[str, str]:
        """Processes that have ended, with how and what they said last."""
        return {
            name: self._account(name, process.returncode)
            for name, process in self._processes.items()
            if process.poll() is not None
        }

    def _account(self, name: str, status: int) -> str:
        how = f"was killed by signal {-status}" if status < 0 else f"ended with exit status {status}"
        log = self.log_file(name)
        said = log.read_text(encoding="utf-8", errors="replace").splitlines()[-LOG_TAIL_LINES:]
        last = "".join(f"\n  {line}" for line in said) if said else " nothing"
        return f"{name} {how} before the run was over. Its log {log} says last:{last}"
