"""What an experimenter asks for: a scenario and how to run it."""

import secrets
from dataclasses import dataclass
from importlib.metadata import version
from pathlib import Path

from agent.estimate import GoalsName
from agent.solve import ITERATIONS, SolverName
from chassis.files import Record
from protocol.keys import Name
from protocol.scenario import Scenario, load_scenario, scenario_text, with_faults
from scenarios import find
from world.clock import ClockKind

SHARING: GoalsName = "exchanged"
"""The one choice of ``--goals`` for which the world tells the goals."""


VIRTUAL = "virtual"
"""The clock of ``simulate``, as its summary names it."""


class RunFacts(Record):
    """Which experiment a run is; kept in its summary and in its recording."""

    scenario: str
    """The scenario's name."""
    goals: GoalsName
    """How the robots come to know goals: ``exchanged`` or the name of an estimator."""
    solver: SolverName
    iterations: int = ITERATIONS
    """Most of the real-time solver for one problem."""
    budget_ms: float | None = None
    """After which the real-time solver improves a decision no further; None for no limit."""
    clock: str
    seed: int
    run: Name
    """The run's name on the bus."""
    faults: int = 0
    """How many were to befall it."""
    policy: bool = False
    """Whether the world's router let every process do what it was granted and nothing else."""
    version: str
    """Of this software."""

    @property
    def goals_are_exchanged(self) -> bool:
        """Whether the scene holds the goals."""
        return self.goals == SHARING

    @property
    def budget_s(self) -> float | None:
        """The time that a decision may take, in s; None for no limit."""
        return None if self.budget_ms is None else self.budget_ms / 1000.0


@dataclass(frozen=True)
class Experiment:
    """One run to be made."""

    path: Path
    """Of the scenario file."""
    scenario: Scenario
    """With the faults of a file of their own, if one was given."""
    facts: RunFacts
    faults: Path | None = None
    """That file."""

    def scenario_text(self) -> str:
        """What the recording keeps: the scenario file, or a scenario that holds the other file's faults."""
        return self.path.read_text(encoding="utf-8") if self.faults is None else scenario_text(self.scenario)


BUDGET_SHARE = 0.5
"""Of Δt, for decisions in real time unless told otherwise; the rest is for the way there and back."""


def prepare(
    name_or_path: str,
    *,
    goals: GoalsName,
    solver: SolverName,
    clock: str,
    seed: int,
    iterations: int = ITERATIONS,
    budget_ms: float | None = None,
    policy: bool = False,
    faults: Path | None = None,
) -> Experiment:
    """Read the scenario and give the run a name of its own.

    Args:
        name_or_path: of the scenario.
        goals: how robots come to know goals.
        solver: what solves their problems.
        clock: as the summary names it.
        seed: of sensor noise and dropouts.
        iterations: most of the real-time solver for one problem.
        budget_ms: for a decision; None for a share of Δt in real time and no limit otherwise.
        policy: whether processes may do only what they are granted.
        faults: a file of faults, which come after those of the scenario.

    Raises:
        Refusal: there is no such scenario, or it is wrong, or the file of faults is.
    """
    path = find(name_or_path).resolve()
    scenario = load_scenario(path)
    if faults is not None:
        scenario = with_faults(scenario, faults)
    if budget_ms is None and clock == ClockKind.REALTIME:
        budget_ms = BUDGET_SHARE * 1000.0 * scenario.step_s
    facts = RunFacts(
        scenario=scenario.name,
        goals=goals,
        solver=solver,
        iterations=iterations,
        budget_ms=budget_ms,
        clock=clock,
        seed=seed,
        faults=len(scenario.faults),
        policy=policy,
        run=f"run-{secrets.token_hex(4)}",
        version=version("unspoken"),
    )
    return Experiment(path, scenario, facts, faults)
