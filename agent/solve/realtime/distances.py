"""What keeps robots apart (eq. 10) and inside the area: rows n·(p_i − p_j) ≥ …, linearised at a trajectory.

A row concerns a robot at a stage and either a second robot or something that does not give way: an obstacle
or a side of the area. All of them are soft, with an exact L1 penalty.

Where it is agreed on which side a pair passes, the other side counts as violated: seen along the present line
of sight, whoever is not past the other yet has to be beside it on the agreed side. So the rows of a pair lead
to that side from wherever a trajectory begins, and a solution without violations passes there.
"""

import math
from typing import NamedTuple

import numpy as np

from agent.solve.compiled import kernel
from agent.solve.problem import FIRST_FREE_STAGE
from agent.solve.vehicle import Array, Integers

NOBODY = -1
"""In place of the second robot of a row whose other side does not give way."""


class Rows(NamedTuple):
    """gap + normal·(δp_first − δp_second) ≥ 0 for small displacements δp; C of them, stage after stage."""

    per_stage: int
    """Rows of one stage; those of the next one follow in the same order."""
    robots: Integers
    """Indices of the first robot and of the second one, or ``NOBODY``, shape (C, 2)."""
    stage: Integers
    normal: Array
    """Unit vector towards the first robot, shape (C, 2)."""
    gap: Array
    """Distance beyond the safety distance in m; negative where it is violated."""


@kernel
def rows_about(states: Array, obstacles: Array, safety_distances: Array, sides: Array, area: Array) -> Rows:
    """All rows of all stages that inputs can still influence.

    Args:
        states: shape (M, K + 1, 4).
        obstacles: positions, shape (O, K + 1, 2).
        safety_distances: shape (M, M + O).
        sides: shape (M, M + O); see ``JointProblem``.
        area: lower and upper corner, shape (2, 2).
    """
    robots, stages = states.shape[:2]
    per_stage = robots * (robots - 1) // 2 + robots * (len(obstacles) + 4)
    count = per_stage * max(stages - FIRST_FREE_STAGE, 0)
    rows = Rows(
        per_stage,
        np.empty((count, 2), np.int64),
        np.empty(count, np.int64),
        np.empty((count, 2)),
        np.empty(count),
    )
    at = 0
    for k in range(FIRST_FREE_STAGE, stages):
        for i in range(robots):
            for j in range(i + 1, robots):
                rows.robots[at, 0], rows.robots[at, 1], rows.stage[at] = i, j, k
                rows.normal[at, 0], rows.normal[at, 1], rows.gap[at] = _parted(
                    states[i, 0],
                    states[j, 0],
                    states[i, k],
                    states[j, k],
                    safety_distances[i, j],
                    sides[i, j],
                )
                at += 1
            for o in range(len(obstacles)):
                rows.robots[at, 0], rows.robots[at, 1], rows.stage[at] = i, NOBODY, k
                distance, side = safety_distances[i, robots + o], sides[i, robots + o]
                rows.normal[at, 0], rows.normal[at, 1], rows.gap[at] = _parted(
                    states[i, 0], obstacles[o, 0], states[i, k], obstacles[o, k], distance, side
                )
                at += 1
            for axis in range(2):
                for side in range(2):
                    sign = 1.0 - 2.0 * side
                    rows.robots[at, 0], rows.robots[at, 1], rows.stage[at] = i, NOBODY, k
                    rows.normal[at, axis], rows.normal[at, 1 - axis] = sign, 0.0
                    rows.gap[at] = sign * (states[i, k, axis] - area[side, axis])
                    at += 1
    return rows


@kernel
def _parted(
    here_now: Array, there_now: Array, here: Array, there: Array, distance: float, side: float
) -> tuple[float, float, float]:
    """The normal towards the first of a pair, and the gap, at a stage with these positions.

    ``side`` is as in ``JointProblem``; zero, or two robots that are in one place now, leave both sides free.
    """
    x, y = here[0] - there[0], here[1] - there[1]
    length = math.sqrt(x * x + y * y)
    sight_x, sight_y = here_now[0] - there_now[0], here_now[1] - there_now[1]
    sight = math.sqrt(sight_x * sight_x + sight_y * sight_y)
    if side != 0.0 and sight > 0.0:
        sight_x, sight_y = sight_x / sight, sight_y / sight
        along, across = x * sight_x + y * sight_y, side * (sight_x * y - sight_y * x)
        if across < 0.0 or length < distance:
            if abs(along) >= distance:
                sign = math.copysign(1.0, along)
                return sign * sight_x, sign * sight_y, abs(along) - distance
            beside = math.sqrt(distance * distance - along * along)
            normal_x = (along * sight_x - side * beside * sight_y) / distance
            normal_y = (along * sight_y + side * beside * sight_x) / distance
            return normal_x, normal_y, normal_x * x + normal_y * y - distance
    if length == 0.0:
        return 1.0, 0.0, -distance  # two robots in one place: any direction, the same for all who compute it
    return x / length, y / length, length - distance


@kernel
def violations_of(
    states: Array, obstacles: Array, safety_distances: Array, sides: Array, area: Array
) -> tuple[float, float]:
    """Sum and largest of all shortfalls of distances and all excursions from the area, in m."""
    total, largest = 0.0, 0.0
    for gap in rows_about(states, obstacles, safety_distances, sides, area).gap:
        total, largest = total + max(-gap, 0.0), max(largest, -gap)
    return total, largest


@kernel
def gaps_after(rows: Rows, shifts: Array, gaps: Array) -> None:
    """The linearised gaps (C,) after displacements (M, K + 1, 2)."""
    for row in range(len(gaps)):
        i, j, k = rows.robots[row, 0], rows.robots[row, 1], rows.stage[row]
        x, y = shifts[i, k, 0], shifts[i, k, 1]
        if j != NOBODY:
            x -= shifts[j, k, 0]
            y -= shifts[j, k, 1]
        gaps[row] = rows.gap[row] + rows.normal[row, 0] * x + rows.normal[row, 1] * y


@kernel
def add_forces(rows: Rows, active: Integers, sizes: Array, forces: Array) -> None:
    """Add the forces of some rows, as they push robots apart, to those on the positions (M, K + 1, 2)."""
    for at, row in enumerate(active):
        i, j, k = rows.robots[row, 0], rows.robots[row, 1], rows.stage[row]
        x, y = sizes[at] * rows.normal[row, 0], sizes[at] * rows.normal[row, 1]
        forces[i, k, 0] += x
        forces[i, k, 1] += y
        if j != NOBODY:
            forces[j, k, 0] -= x
            forces[j, k, 1] -= y
