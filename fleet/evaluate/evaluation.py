"""What is evaluated: levels of noise, the settings kept in ``experiment.json``, and the runs that follow."""

import math
from collections.abc import Iterator
from dataclasses import dataclass
from datetime import datetime
from importlib.metadata import version
from typing import Annotated, Any, Literal, NamedTuple

from pydantic import AfterValidator, Field, ValidationError, field_serializer

from agent.estimate import GoalsName
from agent.solve import SolverName
from chassis.files import Record
from fleet.inject.scenario import Scenario, warnings_of
from fleet.record.experiment import VIRTUAL, RunFacts
from fleet.record.report import Machine
from protocol.scenario import Sensing

AS_IN_THE_FILE = "none"
"""This level leaves a scenario's sensing as its file says."""
LEVELS = {
    name: {
        "position_noise_m": str(0.02 * factor),
        "heading_noise_rad": str(math.radians(2.0) * factor),
        "speed_noise_mps": str(0.05 * factor),
    }
    for name, factor in (("low", 1.0), ("medium", 2.0), ("high", 4.0))
}
"""Fields of sensing and their values, by the names of levels of noise."""
GRAMMAR = (
    f"comma-separated levels; each is {AS_IN_THE_FILE}, or a combination of {', '.join(LEVELS)} and "
    "FIELD=VALUE joined by +, such as low+dropout=0.3"
)


def sensing_of(level: str) -> Sensing:
    """The sensing of every robot at a level such as ``low+delay_steps=2``; what it does not name is perfect.

    Raises:
        ValueError: a part of it is neither a name nor a field of sensing with a value in its range, or a
            field is set twice.
    """
    settings: dict[str, str] = {}
    for part in level.split("+"):
        name, equals, value = part.partition("=")
        if equals and name not in Sensing.model_fields:
            raise ValueError(f"{name!r} found, one of {', '.join(Sensing.model_fields)} is expected before =")
        fields = {name: value} if equals else LEVELS.get(name)
        if fields is None:
            raise ValueError(f"{part!r} found, one of {', '.join(LEVELS)} or FIELD=VALUE is expected")
        if again := settings.keys() & fields.keys():
            raise ValueError(f"{level!r} says {min(again)} twice")
        settings |= fields
    try:
        return Sensing.model_validate_strings(settings)
    except ValidationError as error:
        first = error.errors(include_url=False, include_context=False)[0]
        raise ValueError(f"{level!r}: {first['loc'][0]}: {first['msg']}, found {first['input']}") from None


def _checked(level: str) -> str:
    if level != AS_IN_THE_FILE:
        sensing_of(level)
    return level


NoiseLevel = Annotated[str, AfterValidator(_checked)]
"""One level as ``--noise`` takes it, and as it stands in ``runs.csv``."""


def levels_in(text: str) -> tuple[str, ...]:
    """The levels of a list with commas, each once.

    Raises:
        ValueError: one of them cannot be understood.
    """
    return tuple(dict.fromkeys(_checked(part.strip()) for part in text.split(",")))


def with_noise(scenario: Scenario, level: str) -> Scenario:
    """The scenario with this level of sensing for every robot."""
    if level == AS_IN_THE_FILE:
        return scenario
    robots = [robot.model_copy(update={"sensing": None}) for robot in scenario.robots]
    return scenario.model_copy(update={"sensing": sensing_of(level), "robots": robots})


def needs_seeds(scenario: Scenario) -> bool:
    """Whether anything is drawn at random, so that runs with different seeds differ."""
    drawn = "position_noise_m", "heading_noise_rad", "speed_noise_mps", "dropout"
    return any(getattr(scenario.sensing_of(robot), name) for robot in scenario.robots for name in drawn)


class RunKey(NamedTuple):
    """Identifies a run among all of an evaluation."""

    scenario: str
    """The stem of its file."""
    method: GoalsName
    solver: SolverName
    noise: str
    seed: int


@dataclass(frozen=True)
class Run:
    """One run to be made."""

    key: RunKey
    scenario: Scenario
    """With its noise."""
    reserve: bool = True
    """Whether robots keep it."""

    @property
    def facts(self) -> RunFacts:
        """How it is made."""
        return RunFacts(
            scenario=self.scenario.name,
            goals=self.key.method,
            solver=self.key.solver,
            reserve=self.reserve,
            clock=VIRTUAL,
            seed=self.key.seed,
            faults=len(self.scenario.faults),
            run="evaluation",
            version=version("unspoken"),
        )


class Evaluation(Record):
    """Every scenario of a suite with every method, seed and level of noise.

    In JSON the version stands under ``schema``.
    """

    schema_version: Literal[1] = Field(default=1, alias="schema")
    suite: str
    goals: tuple[GoalsName, ...]
    solver: SolverName
    reserve: bool = True
    """Whether robots keep it."""
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
                    for method in self.goals:
                        yield Run(RunKey(stem, method, self.solver, level, seed), noisy, self.reserve)

    def warnings(self) -> Iterator[str]:
        """Why scenarios cannot be safe, each reason once a scenario."""
        for stem, scenario in self.scenarios.items():
            levels = [with_noise(scenario, level) for level in self.noise]
            for warning in dict.fromkeys(warning for noisy in levels for warning in warnings_of(noisy)):
                yield f"{stem}: {warning}"

    @property
    def spared_seeds(self) -> int:
        """Scenarios (each level of noise counted) for which one seed stands for several."""
        if self.seeds == 1:
            return 0
        noisy = (with_noise(scenario, level) for scenario in self.scenarios.values() for level in self.noise)
        return sum(not needs_seeds(scenario) for scenario in noisy)

    def differences(self, other: "Evaluation") -> list[str]:
        """Why the runs of another evaluation do not belong to this one; the machine may be another one."""
        there, here = self._settings(), other._settings()
        said = [
            f"{name}: {there[name]} there, {here[name]} here" for name in there if there[name] != here[name]
        ]
        for stem in {**self.scenarios, **other.scenarios}:
            mine, theirs = self.scenarios.get(stem), other.scenarios.get(stem)
            if mine != theirs:
                how = "here only" if mine is None else "there only" if theirs is None else "changed"
                said.append(f"scenario {stem}: {how}")
        return said

    def _settings(self) -> dict[str, object]:
        return {
            "suite": self.suite,
            "goals": ",".join(self.goals),
            "solver": self.solver,
            "reserve": self.reserve,
            "seeds": self.seeds,
            "noise": ",".join(self.noise),
            "version": self.machine.version,
            "commit": self.machine.commit,
        }
