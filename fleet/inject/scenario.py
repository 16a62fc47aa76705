"""Scenarios with their faults, and files of faults alone: read, or refused with file, line and field."""

from collections.abc import Collection, Iterator, Sequence
from functools import reduce
from operator import or_
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Self

from pydantic import BeforeValidator, Field, model_validator

import protocol.scenario
from chassis.files import Record, mistake_at, read_as
from chassis.refusal import Refusal
from fleet.inject import command_faults, mind_faults, observation_faults  # noqa: F401  # they define kinds
from fleet.inject.fault import KINDS, Fault, of_kind, schedule
from fleet.inject.process_faults import AbsenceFault
from protocol.scenario import MAX_FAULTS, as_tuple

END_S = 1e5
"""After the end of every run; the latest time that a scenario can tell."""

if TYPE_CHECKING:
    _OneOfAllKinds = Fault
else:  # a union that only grows by the definition of kinds, so no type checker can read it
    _union = reduce(or_, (KINDS[name] for name in sorted(KINDS)))
    _OneOfAllKinds = Annotated[_union, Field(discriminator="kind")]

Faults = Annotated[tuple[_OneOfAllKinds, ...], BeforeValidator(as_tuple), Field(max_length=MAX_FAULTS)]


class FaultFile(Record):
    """A file of faults alone."""

    faults: Annotated[Faults, Field(min_length=1)]


class Scenario(protocol.scenario.Scenario):
    """A scenario as the bench reads it: its faults are of known kinds, and of robots that exist."""

    faults: Faults = ()

    @model_validator(mode="after")
    def _faults_befall_robots_that_exist(self) -> Self:
        if found := unknown_robot(self.faults, [robot.id for robot in self.robots]):
            raise mistake_at(*found)
        return self


def load_scenario(path: Path) -> Scenario:
    """Read a scenario file.

    Raises:
        Refusal: the file cannot be read, is no single YAML map, or is not a valid scenario. One line
            a problem, with file, line and field.
    """
    return read_as(path, Scenario, "scenario")


def with_faults(scenario: Scenario, path: Path) -> Scenario:
    """A scenario with the faults of a file after its own.

    Raises:
        Refusal: as of ``load_scenario``; or the file names robots that the scenario lacks, or there are
            too many faults together.
    """

    def befall_robots_that_exist(file: FaultFile) -> None:
        if found := unknown_robot(file.faults, [robot.id for robot in scenario.robots]):
            raise mistake_at(*found)

    file = read_as(path, FaultFile, "file of faults", befall_robots_that_exist)
    merged = (*scenario.faults, *file.faults)
    if len(merged) > MAX_FAULTS:
        raise Refusal(
            f"{path}: {len(merged)} faults, those of the scenario included, are too many; at most "
            f"{MAX_FAULTS} can befall a run: leave some out"
        )
    return scenario.model_copy(update={"faults": merged})


def unknown_robot(faults: Sequence[Fault], robots: Collection[str]) -> tuple[str, str] | None:
    """The first place in a list of faults that names a robot which does not exist, and what is wrong there.

    Args:
        faults: the list.
        robots: ids of those that exist.
    """
    for index, fault in enumerate(faults):
        named = {f"robots.{place}": name for place, name in enumerate(getattr(fault, "robots", None) or ())}
        named |= {"seen": fault.seen} if hasattr(fault, "seen") else {}
        for place, name in named.items():
            if name not in robots:
                what = f"there is no robot {name!r}; the robots are {', '.join(robots)}"
                return f"faults.{index}.{place}", what
    return None


def effective(scenario: Scenario, seed: int) -> Scenario:
    """The scenario that the world drives: robots that arrive late or leave are absent meanwhile.

    Args:
        scenario: with its faults, which stay in the list.
        seed: of the run.
    """
    faults = of_kind(schedule(scenario.faults, seed=seed, step_s=scenario.step_s), AbsenceFault)

    def absences_s(robot: str) -> Iterator[tuple[float, float]]:
        for each in faults:
            begin_s = min(scenario.time_s(each.begin), END_S)
            end_s = END_S if each.end is None else min(scenario.time_s(each.end), END_S)
            absence_s = each.fault.absence_s(begin_s, end_s)
            if each.fault.befalls(robot) and absence_s is not None:
                yield absence_s

    robots = [
        robot.model_copy(update={"absences_s": (*robot.absences_s, *absences_s(robot.id))})
        for robot in scenario.robots
    ]
    return scenario.model_copy(update={"robots": robots})
