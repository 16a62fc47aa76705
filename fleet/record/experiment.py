"""What an experimenter asks for: a scenario and how to run it."""

import secrets
from dataclasses import dataclass
from importlib.metadata import version
from pathlib import Path
from typing import Final, Self

from agent.estimate import GoalsName
from agent.process.options import DecisionOptions
from fleet.inject.scenario import Scenario, load_scenario, with_faults
from protocol.keys import Name
from protocol.scenario import scenario_text
from scenarios import find
from world.clock import ClockKind

SHARING: Final = "exchanged"
"""The one choice of ``--goals`` for which the world tells the goals."""
VIRTUAL = "virtual"
"""The clock of ``simulate``, as its summary names it."""
BUDGET_SHARE = 0.5
"""Of Δt, for decisions in real time unless told otherwise; the rest is for the way there and back."""


class RunFacts(DecisionOptions):
    """Which experiment a run is; kept in its summary and in its recording."""

    scenario: str
    """The scenario's name."""
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

    @classmethod
    def in_virtual_time(cls, scenario: Scenario, goals: GoalsName, seed: int, run: str) -> Self:
        """Of a run that is made to be judged, with all other choices as they are unless told otherwise."""
        return cls(
            scenario=scenario.name,
            goals=goals,
            clock=VIRTUAL,
            seed=seed,
            faults=len(scenario.faults),
            run=run,
            version=version("unspoken"),
        )


@dataclass(frozen=True)
class Experiment:
    """One run to be made."""

    path: Path
    """Of the scenario file."""
    scenario: Scenario
    """With the faults of a file of their own, if one was given."""
    facts: RunFacts
    text: str
    """What the recording keeps: that of the scenario file, or of a scenario with the other file's faults."""


def prepare(
    name_or_path: str,
    decisions: DecisionOptions,
    *,
    clock: str,
    seed: int,
    policy: bool = False,
    faults: Path | None = None,
) -> Experiment:
    """Read the scenario and give the run a name of its own.

    Args:
        name_or_path: of the scenario.
        decisions: how its robots decide; without a budget they have a share of Δt in real time and no limit
            otherwise.
        clock: as the summary names it.
        seed: of sensor noise and dropouts.
        policy: whether processes may do only what they are granted.
        faults: a file of faults, which come after those of the scenario.

    Raises:
        Refusal: there is no such scenario, or it is wrong, or the file of faults is.
    """
    path = find(name_or_path).resolve()
    scenario, text = load_scenario(path), path.read_text(encoding="utf-8")
    if faults is not None:
        scenario = with_faults(scenario, faults)
        text = scenario_text(scenario)
    options = decisions.decisions()
    if decisions.budget_ms is None and clock == ClockKind.REALTIME:
        options["budget_ms"] = BUDGET_SHARE * 1000.0 * scenario.step_s
    facts = RunFacts(
        **options,
        scenario=scenario.name,
        clock=clock,
        seed=seed,
        faults=len(scenario.faults),
        policy=policy,
        run=f"run-{secrets.token_hex(4)}",
        version=version("unspoken"),
    )
    return Experiment(path, scenario, facts, text)
