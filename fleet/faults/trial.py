"""One trial: a case with a number of robots and a seed, in virtual time or in real processes."""

import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from importlib.metadata import version
from pathlib import Path
from typing import NamedTuple

import numpy as np
import psutil
from pydantic import BaseModel, ConfigDict

from agent.estimate import GoalsName
from chassis.refusal import ExitStatus, Refusal
from fleet.evaluate.running import described, make_ready
from fleet.faults.cases import Case
from fleet.faults.invariants import Evidence, lost_steps, violations
from fleet.inject.process_faults import Kill
from fleet.inject.scenario import Scenario
from fleet.interruption import Interruption
from fleet.record.experiment import VIRTUAL, RunFacts
from fleet.record.recording import read_recording
from fleet.run.virtual import closed_loop
from fleet.scenarios.suite import FAMILIES
from protocol.scenario import scenario_text

TIME_LIMIT_S = 40.0
"""Of a crossing, which takes about ten without faults."""
STREAM = 6
"""Sets the scenarios of trials apart from those of other suites with the same seeds."""
LOOK_S = 0.1
HANG_S = 300.0
"""A run that takes longer hangs."""
FAREWELL_S = 10.0
"""For what is left of a run to vanish."""
MOST_FILES = 256
"""That one process of a run may hold open at a time."""
MOST_MEMORY_BYTES = 1024**3


class Trial(NamedTuple):
    """What to try."""

    case: Case
    robots: int
    seed: int
    goals: GoalsName

    def scenario(self) -> Scenario:
        """A crossing of the publication's kind, drawn by the seed, with the faults of the case."""
        drawn = FAMILIES["perimeter"](self.robots, np.random.default_rng((STREAM, self.seed, self.robots)))
        name = f"{self.case.name}-{self.robots}-{self.seed}"
        changes = {"name": name, "faults": self.case.faults, "time_limit_s": TIME_LIMIT_S}
        return drawn.model_copy(update=changes)

    def outcome(self, evidence: Evidence, found: list[str], begin_s: float) -> "Outcome":
        """What came of it.

        Args:
            evidence: what is known of the run.
            found: what did not hold.
            begin_s: when it began, by ``time.perf_counter``.
        """
        end = evidence.end
        return Outcome(
            case=self.case.name,
            robots=self.robots,
            seed=self.seed,
            verdict=end.verdict if end else None,
            time_s=end.time_s if end else 0.0,
            collisions=sum(len(epoch.truths[-1].collisions) for epoch in evidence.epochs if epoch.truths),
            interventions=sum(sum(epoch.interventions.values()) for epoch in evidence.epochs),
            violations=tuple(found),
            wall_s=round(time.perf_counter() - begin_s, 3),
        )

    def without_result(self, reason: str) -> "Outcome":
        """Of a trial that could not be made."""
        return self.outcome(Evidence(), [reason], time.perf_counter())


class Outcome(BaseModel):
    """What came of a trial."""

    model_config = ConfigDict(frozen=True)

    case: str
    robots: int
    seed: int
    verdict: str | None
    """None: there is none, or an exception came before it."""
    time_s: float
    """When the run ended, since step 0."""
    collisions: int
    interventions: int
    violations: tuple[str, ...]
    """What did not hold; empty if everything did."""
    wall_s: float


def in_virtual_time(trial: Trial) -> Outcome:
    """Make a trial; an exception on the way is a violation."""
    begin_s = time.perf_counter()
    evidence, scenario = Evidence(), trial.scenario()
    facts = RunFacts(
        scenario=scenario.name,
        goals=trial.goals,
        solver="realtime",
        clock=VIRTUAL,
        seed=trial.seed,
        faults=len(scenario.faults),
        run="trial",
        version=version("unspoken"),
    )
    try:
        make_ready(trial.goals, "realtime")
        for step in closed_loop(scenario, facts, time.thread_time):
            evidence.add(step.truth)
            for decision in step.decisions.values():
                evidence.add(decision.mind)
        found = violations(trial.case, scenario, trial.seed, evidence)
    except Exception as error:  # whatever it is, it must not happen, and the other trials go on
        found = [described(error)]
    return trial.outcome(evidence, found, begin_s)


def in_processes(trial: Trial, interruption: Interruption) -> Outcome:
    """Make a trial by ``unspoken run`` as a user gives it, watched from outside.

    Raises:
        KeyboardInterrupt: an interruption came; all processes of the run have ended.
    """
    begin_s, evidence = time.perf_counter(), Evidence()
    cut = [fault.exit_status for fault in trial.case.faults if fault.exit_status is not None]
    with tempfile.TemporaryDirectory(prefix="unspoken-trial-") as directory:
        run = _WatchedRun(trial, Path(directory))
        found = run.follow(interruption)
        found += run.unlike(cut[:1] or [ExitStatus.DONE, ExitStatus.UNMET])
        try:
            for _, message in read_recording(run.out / "run.mcap"):
                evidence.add(message)
        except Refusal as error:
            found.append(f"the recording cannot be read: {error}")
        else:
            # Of a recording that was cut short, the last chunk is missing; what was written before it is not.
            whole = violations(trial.case, trial.scenario(), trial.seed, evidence)
            found += lost_steps(evidence) if cut else whole
    return trial.outcome(evidence, found, begin_s)


class _WatchedRun:
    """A run and all processes that belong to it."""

    def __init__(self, trial: Trial, directory: Path) -> None:
        self.out = directory / "out"
        self._errors = directory / "errors"
        self._seen: set[psutil.Process] = set()
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
        with self._errors.open("wb") as errors:
            self._bench = psutil.Popen(
                [sys.executable, "-P", "-c", "from fleet.entry import main; main()", *command],
                stdin=subprocess.DEVNULL,
                stdout=subprocess.DEVNULL,
                stderr=errors,
                start_new_session=True,  # Ctrl-C is for whoever makes the trials
            )

    def follow(self, interruption: Interruption) -> list[str]:
        """Wait for the end of the run, and make it come; what was wrong with its processes.

        Raises:
            KeyboardInterrupt: an interruption came.
        """
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

    def unlike(self, statuses: list[int]) -> list[str]:
        """The exit status with what was said last, if it is none of these."""
        if self._bench.returncode in statuses:
            return []
        said = self._errors.read_text(encoding="utf-8", errors="replace").strip().splitlines()
        return [f"exit status {self._bench.returncode}: {' '.join(said[-3:]) or 'nothing said'}"]

    def _excesses(self) -> Iterator[str]:
        try:
            self._seen.update(self._bench.children(recursive=True))
            for each in (self._bench, *self._seen):
                if each.is_running() and each.status() != psutil.STATUS_ZOMBIE:
                    if each.num_fds() > MOST_FILES:
                        yield f"a process held more than {MOST_FILES} files open"
                    if each.memory_info().rss > MOST_MEMORY_BYTES:
                        yield "a process took more than a gibibyte of memory"
        except psutil.NoSuchProcess:
            return  # it has just ended

    def _end(self) -> None:
        for each in (self._bench, *self._seen):
            try:
                each.kill()
            except psutil.NoSuchProcess:
                continue
        psutil.wait_procs([self._bench, *self._seen], timeout=FAREWELL_S)
