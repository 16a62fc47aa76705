"""A trial in real processes: ``unspoken run`` as a user gives it, watched from outside."""

import subprocess
import sys
import tempfile
import time
from pathlib import Path

import psutil

from fleet.faults.invariants import Evidence, lost_steps, violations
from fleet.faults.trial import Outcome, Trial, outcome
from fleet.interruption import Interruption
from fleet.record.recording import RecordingError, read_recording
from protocol.faults import DiskFull, Kill, RecorderDies
from protocol.scenario import scenario_text
from world.process import ExitStatus

LOOK_S = 0.1
HANG_S = 300.0
"""A run that takes longer hangs."""
FAREWELL_S = 10.0
"""For what is left of a run to vanish."""
MOST_FILES = 256
"""That one process of a run may hold open at a time."""
MOST_MEMORY_BYTES = 1024**3
KILLED = -9


def execute(trial: Trial, interruption: Interruption) -> Outcome:
    """Make a trial in real processes.

    Raises:
        KeyboardInterrupt: an interruption came; all processes of the run have ended.
    """
    begin_s = time.perf_counter()
    with tempfile.TemporaryDirectory(prefix="unspoken-trial-") as directory:
        watched = _Watched(trial, Path(directory))
        found = [*watched.follow(interruption), *watched.status_violations()]
        evidence = Evidence()
        try:
            for _, message in read_recording(watched.out / "run.mcap"):
                evidence.add(message)
        except RecordingError as error:
            found.append(f"the recording cannot be read: {error}")
        else:
            found += _judged(trial, evidence)
        return outcome(trial, evidence, found, time.perf_counter() - begin_s)


def _judged(trial: Trial, evidence: Evidence) -> list[str]:
    if not any(isinstance(each, DiskFull | RecorderDies) for each in trial.case.faults):
        return violations(trial.case, trial.scenario(), trial.seed, evidence)
    # The messages of the last chunk, which was not written yet, are missing; those before it are not.
    return lost_steps(evidence)


class _Watched:
    """A run and all processes that belong to it."""

    def __init__(self, trial: Trial, directory: Path) -> None:
        self._trial = trial
        self.out = directory / "out"
        path = directory / "scenario.yaml"
        path.write_text(scenario_text(trial.scenario()), encoding="utf-8")
        command = [
            "run",
            str(path),
            "--out",
            str(self.out),
            "--goals",
            trial.goals,
            "--seed",
            str(trial.seed),
        ]
        # A process takes seconds to start again, for which lock-step does not wait.
        restarts = any(isinstance(each, Kill) and each.duration_s for each in trial.case.faults)
        command += ["--clock", "realtime" if restarts else "lockstep"]
        self._errors = directory / "errors"
        with self._errors.open("wb") as errors:
            self._bench = psutil.Popen(
                [sys.executable, "-P", "-c", "from fleet.entry import main; main()", *command],
                stdin=subprocess.DEVNULL,
                stdout=subprocess.DEVNULL,
                stderr=errors,
                start_new_session=True,  # Ctrl-C is for whoever makes the trials
            )
        self._seen: set[psutil.Process] = set()

    def follow(self, interruption: Interruption) -> list[str]:
        """Wait for the end of the run; tells what was wrong with its processes."""
        found: dict[str, None] = {}
        until_s = time.monotonic() + HANG_S
        try:
            while self._bench.poll() is None:
                if interruption.requested:
                    raise KeyboardInterrupt
                if time.monotonic() > until_s:
                    return [*found, f"it had not ended after {HANG_S:.0f} s"]
                found |= dict.fromkeys(self._excesses())
                time.sleep(LOOK_S)
            _, left = psutil.wait_procs(self._seen, timeout=FAREWELL_S)
            return [*found, *(f"process {each.pid} of the run was left" for each in left)]
        finally:
            self._end()

    def status_violations(self) -> list[str]:
        """Whether the run ended as its faults ask for."""
        faults, status = self._trial.case.faults, self._bench.returncode
        allowed: tuple[int, ...] = (ExitStatus.ARRIVED, ExitStatus.ENDED_OTHERWISE)
        if any(isinstance(each, DiskFull) for each in faults):
            allowed = (ExitStatus.FAILED,)
        elif any(isinstance(each, RecorderDies) for each in faults):
            allowed = (KILLED,)
        if status in allowed:
            return []
        said = self._errors.read_text(encoding="utf-8", errors="replace").strip().splitlines()
        return [f"exit status {status}: {' '.join(said[-3:]) or 'nothing said'}"]

    def _excesses(self) -> list[str]:
        found = []
        try:
            self._seen.update(self._bench.children(recursive=True))
            for each in (self._bench, *self._seen):
                if each.is_running() and each.status() != psutil.STATUS_ZOMBIE:
                    with each.oneshot():
                        if each.num_fds() > MOST_FILES:
                            found.append(f"a process held more than {MOST_FILES} files open")
                        if each.memory_info().rss > MOST_MEMORY_BYTES:
                            found.append("a process took more than a gibibyte of memory")
        except psutil.NoSuchProcess:
            return found  # one that has just ended
        return found

    def _end(self) -> None:
        for each in (self._bench, *self._seen):
            try:
                each.kill()
            except psutil.NoSuchProcess:
                continue
        psutil.wait_procs([self._bench, *self._seen], timeout=FAREWELL_S)
