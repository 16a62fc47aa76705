"""One trial: a case with a number of robots and a seed, in virtual time or in real processes."""

import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path
from typing import NamedTuple

import numpy as np
import psutil

from agent.estimate import GoalsName
from chassis.files import Record
from chassis.refusal import ExitStatus, Refusal
from fleet.evaluate.running import described, make_ready
from fleet.faults.cases import Case, Evidence, lost_steps, violations
from fleet.inject.process_faults import Kill
from fleet.inject.scenario import Scenario
from fleet.interruption import Interruption
from fleet.record.experiment import RunFacts
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
        """What came of it, given what did not hold and when it began by ``time.perf_counter``."""
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


class Outcome(Record):
    """What came of a trial."""

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
    facts = RunFacts.in_virtual_time(scenario, trial.goals, trial.seed, "trial")
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
    begin_s, evidence, scenario = time.perf_counter(), Evidence(), trial.scenario()
    cut = [fault.exit_status for fault in trial.case.faults if fault.exit_status is not None]
    # A process takes seconds to start again, for which lock-step does not wait.
    restarts = any(isinstance(each, Kill) and each.duration_s for each in trial.case.faults)
    with tempfile.TemporaryDirectory(prefix="unspoken-trial-") as directory:
        path, out, errors = (Path(directory, name) for name in ("scenario.yaml", "out", "errors"))
        path.write_text(scenario_text(scenario), encoding="utf-8")
        clock = "realtime" if restarts else "lockstep"
        options = [f"--out={out}", f"--goals={trial.goals}", f"--seed={trial.seed}", f"--clock={clock}"]
        status, found = _watched(["run", str(path), *options], errors, interruption)
        if status not in (cut[:1] or [ExitStatus.DONE, ExitStatus.UNMET]):
            said = errors.read_text(encoding="utf-8", errors="replace").strip().splitlines()
            found.append(f"exit status {status}: {' '.join(said[-3:]) or 'nothing said'}")
        try:
            for _, message in read_recording(out / "run.mcap"):
                evidence.add(message)
        except Refusal as error:
            found.append(f"the recording cannot be read: {error}")
        else:
            # Of a recording that was cut short, the last chunk is missing; what was written before it is not.
            whole = violations(trial.case, scenario, trial.seed, evidence)
            found += lost_steps(evidence) if cut else whole
    return trial.outcome(evidence, found, begin_s)


def _watched(command: list[str], errors: Path, interruption: Interruption) -> tuple[int | None, list[str]]:
    """Let a command come to its end, and with it all of its processes; what it says goes into a file.

    Returns:
        Its exit status, and what was wrong with its processes.

    Raises:
        KeyboardInterrupt: an interruption came.
    """
    with errors.open("wb") as file:
        bench = psutil.Popen(
            [sys.executable, "-P", "-c", "from fleet.entry import main; main()", *command],
            stdin=subprocess.DEVNULL,
            stdout=subprocess.DEVNULL,
            stderr=file,
            start_new_session=True,  # Ctrl-C is for whoever makes the trials
        )
    children: set[psutil.Process] = set()
    found: dict[str, None] = {}
    until_s = time.monotonic() + HANG_S
    try:
        while bench.poll() is None:
            if interruption.requested:
                raise KeyboardInterrupt
            if time.monotonic() > until_s:
                found[f"it had not ended after {HANG_S:.0f} s"] = None
                break
            found |= dict.fromkeys(_excesses(bench, children))
            time.sleep(LOOK_S)
        else:
            _, left = psutil.wait_procs(children, timeout=FAREWELL_S)
            found |= {f"process {each.pid} of the run was left": None for each in left}
    finally:
        for each in (bench, *children):
            with suppress(psutil.NoSuchProcess):
                each.kill()
        psutil.wait_procs([bench, *children], timeout=FAREWELL_S)
    return bench.returncode, list(found)


def _excesses(bench: psutil.Popen, children: set[psutil.Process]) -> Iterator[str]:
    """What a command and its processes take too much of; children that are new are added to those known."""
    with suppress(psutil.NoSuchProcess):  # it has just ended
        children.update(bench.children(recursive=True))
        for each in (bench, *children):
            if each.is_running() and each.status() != psutil.STATUS_ZOMBIE:
                if each.num_fds() > MOST_FILES:
                    yield f"a process held more than {MOST_FILES} files open"
                if each.memory_info().rss > MOST_MEMORY_BYTES:
                    yield "a process took more than a gibibyte of memory"
