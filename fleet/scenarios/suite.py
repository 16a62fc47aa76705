"""Suites of scenarios: made of a family, written, and read from scenario files."""

import math
from collections import Counter
from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path
from typing import Literal, NamedTuple

import numpy as np

from chassis.files import new_directory
from chassis.refusal import Refusal
from fleet.inject.scenario import Scenario, load_scenario
from fleet.scenarios.wild import wild, wild_noisy
from protocol.scenario import Pose, ScenarioRobot, scenario_text
from protocol.scene import Area
from protocol.vehicle import Limits
from scenarios import find_suite

HALF_M = 4.0
"""Half the side of the publication's square: its starts and goals lie on the border."""
SPACING_M = 2.0
"""Least distance of two starts and of two goals; the largest robots drawn here park safely from 1.8 m on."""
ROOM_M = 2.0
"""Least distance of a start or goal from the border of the area."""
TRIES = 10_000
"""Draws that do not fit are drawn again, this often."""

Point = tuple[float, float]
Way = tuple[Point, Point]
FamilyName = Literal[
    "perimeter", "circle", "random", "corridor", "intersection", "heterogeneous", "wild", "wild-noisy"
]


def perimeter(robots: int, random: np.random.Generator) -> Scenario:
    """The publication's kind: from one side of the square to the opposite one, 8 m at least.

    Raises:
        Refusal: more than 16 robots, or no pairs of starts and goals were found.
    """
    return _scenario("perimeter", _along(_across(robots, random)))


def heterogeneous(robots: int, random: np.random.Generator) -> Scenario:
    """As ``perimeter``, with bodies and limits that differ."""
    drawn = []
    for robot in _along(_across(robots, random)):
        limits = Limits(
            speed_mps=_between(random, 1.5, 4.5),
            acceleration_mps2=_between(random, 1.5, 3.0),
            turn_rate_radps=_between(random, 0.8, 1.57),
            jerk_mps3=_between(random, 4.0, 7.0),
            turn_acceleration_radps2=_between(random, 0.35, 0.7),
        )
        drawn.append(robot.model_copy(update={"radius_m": _between(random, 0.3, 0.7), "limits": limits}))
    return _scenario("heterogeneous", drawn)


def circle(robots: int, random: np.random.Generator) -> Scenario:
    """From points of a circle, equally far apart, to the opposite ones; only the first angle is drawn."""
    radius_m = max(HALF_M, 0.28 * robots)
    first = random.uniform(0.0, math.tau)
    turns = [first + math.tau * index / robots for index in range(robots)]
    starts = [(radius_m * math.cos(turn), radius_m * math.sin(turn)) for turn in turns]
    return _scenario("circle", _along([((x, y), (-x, -y)) for x, y in starts]))


def random_poses(robots: int, random: np.random.Generator) -> Scenario:
    """Positions anywhere in a square that grows with the number of robots, and any headings.

    Raises:
        Refusal: no places were found.
    """
    half_m = HALF_M * max(1.0, math.sqrt(robots / 8.0))
    starts, goals = (_scattered(robots, half_m, random) for _ in range(2))
    return _scenario(
        "random",
        [
            ScenarioRobot(
                id=str(index), start=_pose(start, _heading(random)), goal=_pose(goal, _heading(random))
            )
            for index, (start, goal) in enumerate(zip(starts, goals, strict=True), 1)
        ],
    )


CORRIDOR_LANES_M = (-2.0, 0.0, 2.0)
WALL_M = 3.0
"""From the middle of the corridor."""


def corridor(robots: int, random: np.random.Generator) -> Scenario:
    """Two groups meet head on between walls; those in front drive furthest, out of the way."""
    ways: list[Way] = []
    for side, count in zip((-1.0, 1.0), _shares(robots, 2), strict=True):
        starts, goals = (
            sorted(
                (along, lane) for lane, queue in _queues(count, CORRIDOR_LANES_M, random) for along in queue
            )
            for _ in range(2)
        )
        for (before, lane), (after, other_lane) in zip(starts, reversed(goals), strict=True):
            ways.append(((side * before, lane), (-side * after, other_lane)))
    return _scenario("corridor", _along(ways), half_height_m=WALL_M)


STREAM_LANES_M = (-1.0, 1.0)


def intersection(robots: int, random: np.random.Generator) -> Scenario:
    """Two streams cross at a right angle, each on two lanes; on a lane, those in front drive furthest."""
    ways: list[Way] = []
    for turned, count in zip((False, True), _shares(robots, 2), strict=True):
        for lane, queue in _queues(count, STREAM_LANES_M, random):
            for before, after in zip(queue, reversed(queue), strict=True):
                start, goal = (-before, lane), (after, lane)
                ways.append((start[::-1], goal[::-1]) if turned else (start, goal))
    return _scenario("intersection", _along(ways))


FAMILIES: dict[FamilyName, Callable[[int, np.random.Generator], Scenario]] = {
    "perimeter": perimeter,
    "circle": circle,
    "random": random_poses,
    "corridor": corridor,
    "intersection": intersection,
    "heterogeneous": heterogeneous,
    "wild": wild,
    "wild-noisy": wild_noisy,
}
"""What makes a scenario for a number of robots, drawn from a generator alone, by what ``--family`` takes."""


def _across(robots: int, random: np.random.Generator) -> list[Way]:
    """Ways between opposite sides of the square, over points ``SPACING_M`` apart."""
    along = np.arange(-HALF_M, HALF_M + SPACING_M, SPACING_M).tolist()
    points = [(x, y) for x in along for y in along if HALF_M in (abs(x), abs(y))]
    if robots > len(points):
        raise Refusal(f"the border of the square has room for {len(points)} robots, not for {robots}")
    for _ in range(TRIES):
        ways: list[Way] = []
        free = list(points)
        for index in random.permutation(len(points))[:robots]:
            opposite = [point for point in free if _are_opposite(points[index], point)]
            if not opposite:
                break
            goal = opposite[random.integers(len(opposite))]
            ways.append((points[index], goal))
            free.remove(goal)
        else:
            return ways
    raise Refusal(f"no goals were found for {robots} robots in {TRIES} draws")


def _are_opposite(one: Point, other: Point) -> bool:
    return any(abs(here - there) == 2.0 * HALF_M for here, there in zip(one, other, strict=True))


def _scattered(robots: int, half_m: float, random: np.random.Generator) -> list[Point]:
    """Points anywhere in a square, any two of them ``SPACING_M`` apart."""
    points: list[Point] = []
    for _ in range(TRIES):
        x_m, y_m = random.uniform(-half_m, half_m, 2).tolist()
        if all(math.dist((x_m, y_m), other) >= SPACING_M for other in points):
            points.append((x_m, y_m))
        if len(points) == robots:
            return points
    raise Refusal(f"no places were found for {robots} robots in {TRIES} draws")


def _queues(
    count: int, lanes: tuple[float, ...], random: np.random.Generator
) -> Iterable[tuple[float, list[float]]]:
    """Lanes in random order, each with the distances from the middle in m of those who wait there."""
    for lane, share in zip(random.permutation(lanes).tolist(), _shares(count, len(lanes)), strict=True):
        gaps = random.uniform(SPACING_M, 1.5 * SPACING_M, share)
        yield lane, (HALF_M - SPACING_M + np.cumsum(gaps)).tolist()


def _shares(count: int, parts: int) -> list[int]:
    """As equal as can be, the larger ones first."""
    return [(count + parts - 1 - part) // parts for part in range(parts)]


def _between(random: np.random.Generator, low: float, high: float) -> float:
    return round(float(random.uniform(low, high)), 2)


def _heading(random: np.random.Generator) -> float:
    return _between(random, -math.pi, math.pi)


def _along(ways: Iterable[Way]) -> list[ScenarioRobot]:
    """Robots of the usual kind that head for their goals."""
    return [
        ScenarioRobot(id=str(index), start=_pose(start), goal=_pose(goal))
        for index, (start, goal) in enumerate(ways, 1)
    ]


def _pose(point: Point, heading_rad: float | None = None) -> Pose:
    """To the millimetre; adding zero makes 0 of −0, which would turn a heading round."""
    x_m, y_m = (round(part, 3) + 0.0 for part in point)
    return Pose(x_m=x_m, y_m=y_m, heading_rad=heading_rad)


def _scenario(family: str, robots: list[ScenarioRobot], half_height_m: float | None = None) -> Scenario:
    """A scenario in the usual area, or a larger one where robots need it."""
    poses = [pose for robot in robots for pose in (robot.start, robot.goal)]
    furthest_m = max(max(abs(pose.x_m), abs(pose.y_m)) for pose in poses)
    half_m = max(Area().x_max_m, math.ceil(furthest_m + ROOM_M))
    height_m = half_m if half_height_m is None else half_height_m
    return Scenario(
        name=f"{family}-{len(robots)}",
        robots=robots,
        area=Area(x_min_m=-half_m, x_max_m=half_m, y_min_m=-height_m, y_max_m=height_m),
    )


class Suite(NamedTuple):
    """Scenarios by the stems of their files, in the order of these."""

    name: str
    scenarios: dict[str, Scenario]


def load_suite(name_or_path: str) -> Suite:
    """Read a bundled suite, a directory of scenario files (``*.yaml``), or a single one as a suite of one.

    Raises:
        Refusal: there is no such suite, it is empty, or files in it are wrong: the text says for each
            of them what ``load_scenario`` says.
    """
    path = find_suite(name_or_path)
    if not path.is_dir():
        return Suite(path.stem, {path.stem: load_scenario(path)})
    scenarios, problems = {}, []
    for file in sorted(path.glob("*.yaml"), key=lambda file: file.stem):
        try:
            scenarios[file.stem] = load_scenario(file)
        except Refusal as error:
            problems.append(str(error))
    if problems:
        raise Refusal("\n".join(problems))
    if not scenarios:
        raise Refusal(f"{path}: a suite needs at least one scenario file, and no *.yaml is there")
    return Suite(path.resolve().name, scenarios)


def generate(family: FamilyName, robots: Sequence[int], count: int, seed: int) -> dict[str, Scenario]:
    """Scenarios by name, such as ``circle-8-03``: of this family, the third with eight robots.

    Numbers of robots are gone through in turn. Each scenario has draws of its own, so with a larger count the
    robots of the first ones stay the same.

    Raises:
        Refusal: the family cannot place so many robots.
    """
    made: dict[str, Scenario] = {}
    drawn = Counter[int]()
    for index in range(count):
        number = robots[index % len(robots)]
        drawn[number] += 1
        # Zeros in front, so that the order of names is that of numbers.
        name = f"{family}-{number:0{len(str(max(robots)))}}-{drawn[number]:0{len(str(count))}}"
        scenario = FAMILIES[family](number, np.random.default_rng((seed, index)))
        made[name] = scenario.model_copy(update={"name": name})
    return made


def write_suite(directory: Path, scenarios: Mapping[str, Scenario], comment: str) -> None:
    """Write a file for each scenario, with a comment for its first line: all of them, or nothing.

    Args:
        directory: new or empty.
        scenarios: by the stems of their files.
        comment: one line.

    Raises:
        Refusal: the directory holds something or cannot be written.
    """
    try:
        with new_directory(directory, "choose another directory with --out, or remove it") as whole:
            for name, scenario in scenarios.items():
                text = f"# {comment}\n{scenario_text(scenario)}"
                (whole / f"{name}.yaml").write_text(text, encoding="utf-8")
    except OSError as error:
        raise Refusal(f"{directory} cannot be used for the output: {error.strerror}") from None
