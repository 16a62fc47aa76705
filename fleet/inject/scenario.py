"""Scenarios with their faults, and files of faults alone: read or refused; told to the processes."""

import math
import os
from collections.abc import Collection, Sequence
from functools import reduce
from operator import or_
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Self

from pydantic import BeforeValidator, Field, model_validator

import protocol.scenario
from chassis.files import Record, mistake_at, read_as
from chassis.refusal import Refusal
from fleet.inject.fault import KINDS, Fault, Scheduled, of_kind, schedule
from fleet.inject.link import LINK_FAULTS
from fleet.inject.mind import MIND_FAULTS
from fleet.inject.process_faults import AbsenceFault
from protocol.scenario import MAX_FAULTS, as_tuple, scenario_text
from protocol.scene import Scene
from protocol.vehicle import stopping_distance_m, stopping_time_s

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
        check_robots(self.faults, [robot.id for robot in self.robots])
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
    robots = [robot.id for robot in scenario.robots]
    file = read_as(path, FaultFile, "file of faults", lambda file: check_robots(file.faults, robots))
    merged = (*scenario.faults, *file.faults)
    if len(merged) > MAX_FAULTS:
        raise Refusal(
            f"{path}: {len(merged)} faults, those of the scenario included, are too many; at most "
            f"{MAX_FAULTS} can befall a run: leave some out"
        )
    return scenario.model_copy(update={"faults": merged})


def check_robots(faults: Sequence[Fault], robots: Collection[str]) -> None:
    """Refuse a list of faults that names a robot which does not exist.

    Raises:
        PydanticCustomError: see :func:`chassis.files.mistake_at`.
    """
    for index, fault in enumerate(faults):
        named = {f"robots.{place}": name for place, name in enumerate(getattr(fault, "robots", None) or ())}
        named |= {"seen": fault.seen} if hasattr(fault, "seen") else {}
        for place, name in named.items():
            if name not in robots:
                what = f"there is no robot {name!r}; the robots are {', '.join(robots)}"
                raise mistake_at(f"faults.{index}.{place}", what)


def warnings_of(scenario: protocol.scenario.Scenario) -> list[str]:
    """Why robots cannot be safe in a scenario whatever they do: a sentence each, with what to do about it."""
    return [text for text in (_too_short_horizon(scenario), _too_short_range(scenario)) if text]


def _too_short_horizon(scenario: protocol.scenario.Scenario) -> str:
    slowest = max(scenario.robots, key=lambda robot: stopping_time_s(robot.limits))
    needed_s, steps = stopping_time_s(slowest.limits), scenario.horizons.prediction_steps
    horizon_s = steps * scenario.step_s
    if horizon_s >= needed_s:
        return ""
    return (
        f"the prediction horizon of {steps} × {scenario.step_s:g} s = {horizon_s:.3g} s is shorter than the "
        f"{needed_s:.3g} s that robot {slowest.id!r} takes to brake from full speed, so robots may see too "
        f"late that they have to: set horizons.prediction_steps to {math.ceil(needed_s / scenario.step_s)} "
        "or more, or step_s to a larger value"
    )


def _too_short_range(scenario: protocol.scenario.Scenario) -> str:
    """Of the robot whose sensors lack most: both of a pair brake from full speed, and then need room."""
    scene = scenario.scene(with_goals=False)
    lacking_m: dict[str, float] = {}
    """By sentence."""
    for robot in scenario.robots:
        range_m = scenario.sensing_of(robot).range_m
        others_m = [
            stopping_distance_m(other.limits) + scene.safety_distance_m(robot.id, other.id)
            for other in scenario.robots
            if other is not robot
        ]
        if range_m is None or not others_m:
            continue
        needed_m = stopping_distance_m(robot.limits) + max(others_m)
        if range_m < needed_m:
            lacking_m[
                f"robot {robot.id!r} sees others within {range_m:g} m, which is less than both braking "
                f"distances and the safety distance together, {needed_m:.3g} m, so it may see them too late: "
                f"set sensing.range_m to {math.ceil(10.0 * needed_m) / 10.0:g} or more, or lower speed limits"
            ] = needed_m - range_m
    return max(lacking_m, key=lambda sentence: lacking_m[sentence], default="")


def effective(scenario: Scenario, seed: int) -> Scenario:
    """The scenario that the world drives: robots that arrive late or leave are absent meanwhile."""
    faults = of_kind(schedule(scenario.faults, seed=seed, step_s=scenario.step_s), AbsenceFault)
    robots = []
    for robot in scenario.robots:
        absences_s = list(robot.absences_s)
        for each in of_kind(faults, AbsenceFault, robot.id):
            begin_s = min(scenario.time_s(each.begin), END_S)
            end_s = END_S if each.end is None else min(scenario.time_s(each.end), END_S)
            begin_s, end_s = each.fault.absence_s(begin_s, end_s)
            if begin_s < end_s:
                absences_s.append((begin_s, end_s))
        robots.append(robot.model_copy(update={"absences_s": tuple(absences_s)}))
    return scenario.model_copy(update={"robots": robots})


class FaultSettings:
    """What the processes of one run are told of its faults, in files of a directory that outlives it.

    Raises:
        OSError: they cannot be written.

    Attributes:
        scenario: the file that the world drives: the scenario's, or one with what its faults make of it.
        settings: of a process that has faults; see :func:`faults_of_this_process`.
    """

    def __init__(self, path: Path, scenario: Scenario, seed: int, directory: Path) -> None:
        self._scheduled = schedule(scenario.faults, seed=seed, step_s=scenario.step_s)
        self.scenario = path
        self.settings: dict[str, str] = {}
        if scenario.faults:
            self.scenario, faults = directory / "scenario.yaml", directory / "faults.json"
            self.scenario.write_text(scenario_text(effective(scenario, seed)), encoding="utf-8")
            faults.write_text(FaultFile(faults=scenario.faults).model_dump_json(), encoding="utf-8")
            self.settings = {"faults": str(faults), "seed": str(seed)}

    def on_link(self, robot: str) -> bool:
        """Whether one of them lies between the world and a robot."""
        return bool(of_kind(self._scheduled, LINK_FAULTS, robot))

    def on_robot(self, robot: str) -> bool:
        """Whether one of them lies on the process of a robot."""
        return bool(of_kind(self._scheduled, MIND_FAULTS, robot))


def faults_of_this_process(scene: Scene) -> list[Scheduled[Fault]]:
    """All faults of the run, as this process was told of them by its environment.

    Raises:
        OSError: the file cannot be read.
        KeyError: it was not told of any.
    """
    text = Path(os.environ["UNSPOKEN_FAULTS"]).read_text(encoding="utf-8")
    faults = FaultFile.model_validate_json(text).faults
    return schedule(faults, seed=int(os.environ["UNSPOKEN_SEED"]), step_s=scene.step_s)
