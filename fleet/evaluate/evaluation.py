"""What is evaluated: the settings that stand in ``experiment.json``, and the runs that they ask for."""

from collections.abc import Iterator
from datetime import datetime
from typing import Annotated, Any, Literal

from pydantic import Field, field_serializer

from agent.estimate import GoalsName
from agent.solve import SolverName
from fleet.evaluate.noise import NoiseLevel, needs_seeds, with_noise
from fleet.evaluate.row import RunKey
from fleet.record.machine import Machine
from fleet.record.report_file import Record
from protocol.scenario import Scenario


class Run(Record):
    """One run to be made."""

    key: RunKey
    scenario: Scenario
    """With its noise."""
    goals: GoalsName
    solver: SolverName


class Evaluation(Record):
    """Every scenario of a suite with every method, seed and level of noise.

    In JSON the version stands under ``schema``.
    """

    schema_version: Literal[1] = Field(default=1, alias="schema")
    suite: str
    goals: tuple[GoalsName, ...]
    solver: SolverName
    seeds: Annotated[int, Field(ge=1)]
    """Of sensor noise: 0 to one less than this."""
    noise: tuple[NoiseLevel, ...]
    machine: Machine
    """Where it began, and the version and commit of this software."""
    begun: datetime | None = None
    """When it began; None where an earlier version did not note it."""
    scenarios: dict[str, Scenario]
    """By the stems of their files."""

    @field_serializer("scenarios")
    def _without_defaults(self, scenarios: dict[str, Scenario]) -> dict[str, Any]:
        return {
            stem: scenario.model_dump(mode="json", exclude_defaults=True)
            for stem, scenario in scenarios.items()
        }

    def runs(self) -> Iterator[Run]:
        """All runs, scenario by scenario; where nothing is random, one seed stands for all."""
        for stem, scenario in self.scenarios.items():
            for level in self.noise:
                noisy = with_noise(scenario, level)
                for seed in range(self.seeds if needs_seeds(noisy) else 1):
                    for goals in self.goals:
                        key = RunKey(stem, goals, self.solver, level, seed)
                        yield Run(key=key, scenario=noisy, goals=goals, solver=self.solver)

    @property
    def spared_seeds(self) -> int:
        """Scenarios (each level of noise counted) for which one seed stands for several."""
        if self.seeds == 1:
            return 0
        noisy = (with_noise(scenario, level) for scenario in self.scenarios.values() for level in self.noise)
        return sum(not needs_seeds(scenario) for scenario in noisy)

    def differences(self, other: "Evaluation") -> list[str]:
        """In what another evaluation differs from this one, so that their runs do not belong together."""
        mine, others = self._identity(), other._identity()
        told = [
            f"{name}: {mine[name]} there, {others[name]} here" for name in mine if mine[name] != others[name]
        ]
        changed = [
            stem
            for stem in {**self.scenarios, **other.scenarios}
            if self.scenarios.get(stem) != other.scenarios.get(stem)
        ]
        return [*told, *(f"scenario {stem}: {self._how_changed(stem, other)}" for stem in changed)]

    def _identity(self) -> dict[str, object]:
        """What can be compared and told in a word; the machine may be another one."""
        return {
            "suite": self.suite,
            "goals": ",".join(self.goals),
            "solver": self.solver,
            "seeds": self.seeds,
            "noise": ",".join(self.noise),
            "version": self.machine.version,
            "commit": self.machine.commit,
        }

    def _how_changed(self, stem: str, other: "Evaluation") -> str:
        if stem not in self.scenarios:
            return "here only"
        return "changed" if stem in other.scenarios else "there only"
