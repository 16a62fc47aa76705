"""Scenarios of any number of robots that get in one another's way."""

import math

import numpy as np

from protocol.scenario import Pose, Scenario, ScenarioRobot

SPACING_M = 1.5
"""Least distance of two starts and of two goals; they park safely from 1.39 m on."""
SMALLEST_M = 4.0
"""Half the side of the square, or the radius of the circle, for few robots: that of scenario 8a."""

Points = list[tuple[float, float]]


def circle(robots: int) -> Scenario:
    """Robots on a circle, each with its goal at the opposite point."""
    radius_m = max(SMALLEST_M, 0.28 * robots)
    turns = [math.tau * index / robots for index in range(robots)]
    starts = [(radius_m * math.cos(turn), radius_m * math.sin(turn)) for turn in turns]
    return _scenario(f"circle {robots}", starts, [(-x_m, -y_m) for x_m, y_m in starts])


def random_crossing(robots: int, seed: int) -> Scenario:
    """Robots with starts and goals drawn from the border of a square, which grows with their number.

    Args:
        robots: 1 to ``settings.MOST_ROBOTS``.
        seed: the same one gives the same scenario.
    """
    generator = np.random.default_rng(seed)
    half_m = SMALLEST_M * max(1.0, math.sqrt(robots / 8.0))
    starts, goals = (_on_a_square(generator, robots, half_m) for _ in range(2))
    return _scenario(f"random {robots} seed {seed}", starts, goals)


def _on_a_square(generator: np.random.Generator, count: int, half_m: float) -> Points:
    """Points in random order, each placing with ``SPACING_M`` kept being equally probable."""
    perimeter_m = 8.0 * half_m
    while True:
        # Random gaps between the points come on top of the least ones, so none has to be drawn in vain...
        free_m = np.sort(generator.uniform(0.0, perimeter_m - count * SPACING_M, count))
        along_m = free_m + SPACING_M * np.arange(count) + generator.uniform(0.0, perimeter_m)
        points = [_border_point(along, half_m) for along in generator.permutation(along_m % perimeter_m)]
        # ... but for those around a corner.
        if all(math.dist(one, other) >= SPACING_M for i, one in enumerate(points) for other in points[:i]):
            return points


def _border_point(along_m: float, half_m: float) -> tuple[float, float]:
    """The point of a square's border at this length along it."""
    side, offset_m = divmod(float(along_m), 2.0 * half_m)
    x_m, y_m = offset_m - half_m, -half_m
    for _ in range(int(side)):
        x_m, y_m = -y_m, x_m
    return x_m, y_m


def _scenario(name: str, starts: Points, goals: Points) -> Scenario:
    return Scenario(
        name=name,
        robots=[
            ScenarioRobot(
                id=str(index + 1), start=Pose(x_m=start[0], y_m=start[1]), goal=Pose(x_m=goal[0], y_m=goal[1])
            )
            for index, (start, goal) in enumerate(zip(starts, goals, strict=True))
        ],
    )
