"""Scenario files: YAML in, a valid scenario or one exception for people out; and the way back."""

import math
from collections.abc import Iterator, Sequence
from itertools import combinations
from pathlib import Path
from typing import Annotated, Any, Self

import yaml
from pydantic import BeforeValidator, Field, model_validator

from chassis.files import Record, mistake_at, read_as
from protocol.keys import Id
from protocol.scene import MAX_ROBOTS, Goal, Metres, NonNegative, PublicRobot, Rules, Scene

MAX_FAULTS = 256
MAX_DELAY_STEPS = 10
"""Robots forget whom they have not seen for this long (``agent.remember.memory.LONGEST_GAP``)."""
MAX_ABSENCES = 16 + MAX_FAULTS
"""Of one robot; each of its faults may be one."""


def as_tuple(value: object) -> object:
    """A list, as YAML has it, for a field that is a tuple."""
    return tuple(value) if isinstance(value, Sequence) and not isinstance(value, str) else value


Time = Annotated[float, Field(ge=0, le=1e5)]
"""Simulated seconds since step 0."""
Interval = Annotated[tuple[Time, Time], BeforeValidator(as_tuple)]


class Pose(Record):
    """A position and a heading; without a heading, the direction from start to goal."""

    x_m: Metres
    y_m: Metres
    heading_rad: Metres | None = None


class Sensing(Record):
    """What one robot's sensors see of the others; the default is perfect.

    Noise is Gaussian with these standard deviations, drawn for every observer, robot and step by itself. A
    robot always sees itself, and as it is now; range, dropouts and delay concern the others.
    """

    range_m: Annotated[float, Field(gt=0)] | None = None
    """None: unlimited."""
    position_noise_m: NonNegative = 0.0
    heading_noise_rad: NonNegative = 0.0
    speed_noise_mps: NonNegative = 0.0
    dropout: Annotated[float, Field(ge=0, le=1)] = 0.0
    """Probability that one other robot is not seen at a step."""
    delay_steps: Annotated[int, Field(ge=0, le=MAX_DELAY_STEPS)] = 0
    """How many steps old the view of the others is."""


class ScenarioRobot(PublicRobot):
    """One robot: its id, its way, its body and limits, and its own sensing where it differs."""

    id: Id
    start: Pose
    goal: Pose
    sensing: Sensing | None = None
    absences_s: Annotated[
        tuple[Interval, ...], BeforeValidator(as_tuple), Field(max_length=MAX_ABSENCES)
    ] = ()
    """When the robot is not in the scene, from and to, in s: it is not seen, not met, and does not move."""

    def is_present(self, time_s: float) -> bool:
        """Whether the robot is in the scene at a time since step 0."""
        return not any(begin_s <= time_s < end_s for begin_s, end_s in self.absences_s)

    def start_state(self) -> tuple[float, float, float, float]:
        """(p_x, p_y, ψ, v) at step 0: standing."""
        return (self.start.x_m, self.start.y_m, self._heading(self.start), 0.0)

    def goal_pose(self) -> Goal:
        """The goal with its heading filled in."""
        return Goal(x_m=self.goal.x_m, y_m=self.goal.y_m, heading_rad=self._heading(self.goal))

    def _heading(self, pose: Pose) -> float:
        if pose.heading_rad is not None:
            return pose.heading_rad
        return math.atan2(self.goal.y_m - self.start.y_m, self.goal.x_m - self.start.x_m)


class Scenario(Rules):
    """What a scenario file says."""

    name: Annotated[str, Field(min_length=1, max_length=64)]
    time_limit_s: Annotated[float, Field(gt=0, le=1e5)] = 60.0
    sensing: Sensing = Sensing()
    robots: Annotated[list[ScenarioRobot], Field(min_length=1, max_length=MAX_ROBOTS)]
    faults: Annotated[tuple[Any, ...], BeforeValidator(as_tuple), Field(max_length=MAX_FAULTS)] = ()
    """What is to break during the run: the bench knows the kinds (``fleet.inject.scenario``), nobody else."""

    def scene(self, *, with_goals: bool) -> Scene:
        """What everybody may know; the goals only for a run with exchanged goals."""
        rules = {name: getattr(self, name) for name in Rules.model_fields}
        return Scene(
            **rules,
            robots={r.id: PublicRobot(radius_m=r.radius_m, limits=r.limits) for r in self.robots},
            goals={r.id: r.goal_pose() for r in self.robots} if with_goals else None,
        )

    def sensing_of(self, robot: ScenarioRobot) -> Sensing:
        """This robot's own sensing, or that of the scenario."""
        return robot.sensing if robot.sensing is not None else self.sensing

    @model_validator(mode="after")
    def _robots_fit(self) -> Self:
        for where, what in self._mistakes():
            raise mistake_at(f"robots.{where}", what)
        return self

    def _mistakes(self) -> Iterator[tuple[str, str]]:
        """The place of each mistake among the robots, and what it is."""
        seen: set[str] = set()
        for index, robot in enumerate(self.robots):
            if robot.id in seen:
                yield f"{index}.id", f"the id {robot.id!r} is used twice; ids must differ"
            seen.add(robot.id)
        area = self.area
        for index, robot in enumerate(self.robots):
            for field, pose in (("start", robot.start), ("goal", robot.goal)):
                if not area.contains(pose.x_m, pose.y_m):
                    yield (
                        f"{index}.{field}",
                        f"({pose.x_m:g}, {pose.y_m:g}) lies outside the area "
                        f"x {area.x_min_m:g}…{area.x_max_m:g}, y {area.y_min_m:g}…{area.y_max_m:g} m",
                    )
        for (_, one), (index, other) in combinations(enumerate(self.robots), 2):
            touching = one.radius_m + other.radius_m
            safe = touching + 2.0 * self.safety_margin_m
            for field, a, b, least, why in (
                ("start", one.start, other.start, touching, "their bodies overlap"),
                ("goal", one.goal, other.goal, safe, "they could not both park"),
            ):
                distance = math.hypot(a.x_m - b.x_m, a.y_m - b.y_m)
                if distance < least:
                    yield (
                        f"{index}.{field}",
                        f"the {field}s of robots {one.id!r} and {other.id!r} are {distance:.3g} m apart, "
                        f"at least {least:.4g} m are needed: {why}",
                    )


def load_scenario(path: Path, text: str | None = None) -> Scenario:
    """Read a scenario file, or the text of one that has been read already.

    Raises:
        Refusal: the file cannot be read, is no single YAML map, or is not a valid scenario. One line
            a problem, with file, line and field.
    """
    return read_as(path, Scenario, "scenario", text=text)


def scenario_text(scenario: Scenario) -> str:
    """A file that ``load_scenario`` reads as this scenario: one line a robot or fault, defaults left out."""
    rules = scenario.model_dump(exclude_defaults=True)
    name, robots, faults = rules.pop("name"), rules.pop("robots"), rules.pop("faults", ())
    lines = [_yaml({key: value}, inline=False) for key, value in {"name": name, **_written(rules)}.items()]
    lines.append("robots:\n")
    for robot in _written(robots):
        in_order = {key: robot[key] for key in ("id", "start", "goal")} | robot
        lines.append(f"  - {_yaml(in_order, inline=True)}")
    if faults:
        lines.append("faults:\n")
    for fault in _written(faults):
        lines.append(f"  - {_yaml({'kind': fault['kind']} | fault, inline=True)}")
    return "".join(lines)


def _yaml(fields: dict[str, Any], *, inline: bool) -> str:
    """A map as YAML in one line: with its braces, or as a field of the file."""
    of_maps = any(isinstance(value, dict) for value in fields.values())
    style = True if inline else None if of_maps else False  # PyYAML: None puts the innermost maps into braces
    return yaml.dump(
        fields,
        Dumper=yaml.SafeDumper,
        default_flow_style=style,
        sort_keys=False,
        width=math.inf,
        allow_unicode="\\" not in repr(fields),  # PyYAML would write U+0085, a line break, as it is
    )


def _written(value: Any) -> Any:
    """Numbers as a person writes them: 4 for 4.0, and the id 1 for '1'."""
    match value:
        case dict():
            return {key: _written(part) for key, part in value.items()}
        case list() | tuple():
            return [_written(part) for part in value]
        case str() if value.isdecimal() and str(int(value)) == value:
            return int(value)
        case float() if value.is_integer() and str(value) != "-0.0":  # there is no whole number −0
            return int(value)
    return value
