"""Makes one run of an evaluation, in whichever process this is called."""

import time
import traceback
from functools import cache
from importlib.metadata import version
from pathlib import Path

from agent.estimate import GoalsName
from agent.process.warm import compile_in_background, warm_up
from agent.solve import SolverName
from fleet.evaluate.evaluation import Run
from fleet.evaluate.row import Row
from fleet.record.summary import Tally
from fleet.run.experiment import RunFacts
from fleet.run.virtual import closed_loop

CLOCK = "virtual"


def execute(run: Run) -> Row:
    """Drive a scenario to its verdict; an exception on the way becomes a failed row."""
    try:
        make_ready(run.goals, run.solver)
        return _drive(run)
    except Exception as error:  # whatever it is, the other runs go on
        return Row.without_result(run.key, len(run.scenario.robots), told(error))


@cache
def make_ready(goals: GoalsName, solver: SolverName) -> None:
    """Load all that robots need, once in a process, so that no run is charged with it."""
    compile_in_background(unwanted=lambda: False)
    warm_up(goals, solver)


def facts_of(run: Run) -> RunFacts:
    """How this run is made."""
    return RunFacts(
        scenario=run.scenario.name,
        goals=run.goals,
        solver=run.solver,
        clock=CLOCK,
        seed=run.key.seed,
        faults=len(run.scenario.faults),
        run="evaluation",
        version=version("unspoken"),
    )


def _drive(run: Run) -> Row:
    facts = facts_of(run)
    tally = Tally()
    cpu_s, wall_s = time.thread_time(), time.perf_counter()
    for moment in closed_loop(run.scenario, facts, time.thread_time):
        tally.add(moment.truth)
        for decision in moment.decisions.values():
            tally.add(decision.mind)
    cpu_s, wall_s = time.thread_time() - cpu_s, time.perf_counter() - wall_s
    return Row.finished(run.key, tally.summary(facts), cpu_s, wall_s)


def told(error: Exception) -> str:
    """What went wrong, and where."""
    place = traceback.extract_tb(error.__traceback__)[-1]
    return f"{type(error).__name__}: {error} ({Path(place.filename).name}:{place.lineno})"
