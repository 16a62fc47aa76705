"""What an experimenter asks for: a scenario and how to run it."""

import secrets
from dataclasses import dataclass
from importlib.metadata import version
from pathlib import Path

from agent.estimation import GoalsName
from agent.solver import SolverName
from fleet.facts import RunFacts
from protocol.scenario import Scenario
from protocol.scenario_file import load_scenario
from scenarios import find

SHARING: GoalsName = "exchanged"
"""The one choice of ``--goals`` for which the world tells the goals."""


@dataclass(frozen=True)
class Experiment:
    """One run to be made."""

    path: Path
    scenario: Scenario
    facts: RunFacts

    @property
    def goals_are_exchanged(self) -> bool:
        """Whether the scene holds the goals."""
        return self.facts.goals == SHARING


def prepare(name_or_path: str, *, goals: GoalsName, solver: SolverName, clock: str, seed: int) -> Experiment:
    """Read the scenario and give the run a name of its own.

    Raises:
        ScenarioError: there is no such scenario, or it is wrong.
    """
    path = find(name_or_path).resolve()
    scenario = load_scenario(path)
    facts = RunFacts(
        scenario=scenario.name,
        goals=goals,
        solver=solver,
        clock=clock,
        seed=seed,
        run=f"run-{secrets.token_hex(4)}",
        version=version("unspoken"),
    )
    return Experiment(path, scenario, facts)
