"""Several starts, one solution: where the local optima of a problem are looked for, and which one counts."""

from collections.abc import Callable, Sequence

import numpy as np

from agent.solve import Deadline
from agent.solve.problem import (
    LIMITED_QUANTITIES,
    PRICE_PER_M,
    JointProblem,
    JointSolver,
    Solution,
    Start,
    braking_inputs,
    within_limits,
)
from agent.solve.vehicle import Array

SIDESTEP_RADPS = 0.2
"""Turn rate of a cold start. When all robots lean to the same side, standing robots stay clear of one
another, and a symmetrical crossing begins as a roundabout instead of a deadlock."""
WORTH = 0.01
"""Part of the objective by which an optimum must be better than one preferred to it. Robots choose for
themselves: what differs by less may look the other way round to another one."""
NEAR_GOAL_M = 0.5
STANDING_M = 0.02
"""A robot that goes no further than this in the last third of the horizon stands."""


def best_solution(
    solver: JointSolver,
    problem: JointProblem,
    starts: Sequence[Start],
    deadline: Deadline,
    escapes: Callable[[JointProblem], Sequence[Start]] | None = None,
) -> Solution:
    """Solve from each start, as time allows but at least from the first, and take the best solution.

    Solved beats unsolved, going on beats a deadlock, then the lower objective counts; among nearly equal ones
    the earlier start. ``escapes`` gives further starts where the first one ends in a deadlock.
    """
    best = solver.solve(problem, starts[0])
    if escapes is not None and is_deadlock(problem, best):
        starts = [*starts, *escapes(problem)]
    for start in starts[1:]:
        if deadline.has_passed():
            break
        other = solver.solve(problem, start)
        if _rank(problem, other, WORTH) < _rank(problem, best, 0.0):
            best = other
    return best


def _rank(problem: JointProblem, solution: Solution, handicap: float) -> tuple[bool, bool, float]:
    objective = solution.objective + PRICE_PER_M * solution.violation_m
    return not solution.solved, is_deadlock(problem, solution), (1.0 + handicap) * objective


def is_deadlock(problem: JointProblem, solution: Solution) -> bool:
    """Whether a robot comes to a stand away from its goal while others are in its way."""
    positions = solution.states[:, :, :2]
    rest = positions[:, -1 - problem.steps // 3 :]
    stands = np.linalg.norm(rest - rest[:, -1:], axis=-1).max(axis=1) < STANDING_M
    away = np.linalg.norm(positions[:, -1] - problem.goals[:, :2], axis=-1) > NEAR_GOAL_M
    held = np.linalg.norm(solution.forces[:, -1], axis=-1) > 0.0
    return bool((stands & away & held).any())


def cold_starts(problem: JointProblem) -> list[Start]:
    """Starts for when nothing is known yet, in order of preference.

    Every robot brakes to a standstill while leaning to its left; to its right; in turn to its left and right;
    not at all.
    """
    left = np.ones(len(problem.states))
    alternating = np.where(np.arange(len(left)) % 2, -left, left)
    return _turning(problem, [SIDESTEP_RADPS * sides for sides in (left, -left, alternating, 0.0 * left)])


def escapes(problem: JointProblem) -> list[Start]:
    """Starts for when the way ahead is blocked: all brake and turn as quickly as they can, to either side.

    Standing still is a stationary point: a heading matters only to a robot that drives.
    """
    quickest = problem.input_bounds[:, 0]
    return _turning(problem, [quickest, -quickest])


def _turning(problem: JointProblem, turns_radps: Sequence[Array]) -> list[Start]:
    """All brake, each start with other turn rates (M,) in addition."""
    braking = braking_inputs(problem)
    robots, steps = braking.shape[:2]
    starts = []
    for rates_radps in turns_radps:
        inputs = braking.copy()
        inputs[:, :, 0] += rates_radps[:, None]
        forces, multipliers = np.zeros((robots, steps + 1, 2)), np.zeros((robots, steps, LIMITED_QUANTITIES))
        starts.append(Start(within_limits(problem, inputs), forces, multipliers, warm=False))
    return starts


class WarmStarts:
    """The last solution of each robot: where the next solution starts, one step on."""

    def __init__(self) -> None:
        self._last: dict[str, tuple[Array, Array, Array]] = {}

    def starts(self, problem: JointProblem, robots: Sequence[str], steps_on: int = 1) -> list[Start]:
        """The last solution, so many steps on; where a robot has none, each of the cold starts for it."""
        known = {
            index: [shifted(each, steps_on) for each in self._last[robot]]
            for index, robot in enumerate(robots)
            if robot in self._last
        }
        if len(known) == len(robots):
            inputs, forces, multipliers = (np.array(each) for each in zip(*known.values(), strict=True))
            return [Start(inputs, forces, multipliers, warm=True)]
        starts = cold_starts(problem)
        for start in starts:
            for index, parts in known.items():
                start.inputs[index], start.forces[index], start.limit_multipliers[index] = parts
        return starts

    def keep(self, robots: Sequence[str], solution: Solution) -> None:
        """Remember a solution; all earlier ones are forgotten."""
        parts = zip(solution.inputs, solution.forces, solution.limit_multipliers, strict=True)
        self._last = dict(zip(robots, parts, strict=True))

    def forget(self) -> None:
        """Start cold next time."""
        self._last = {}


def shifted(stages: Array, steps: int = 1) -> Array:
    """Inputs or multipliers of one robot so many steps on; those of the new last stages are zero."""
    return np.concatenate([stages[steps:], np.zeros_like(stages[:steps])])
