"""Which of several local optima to go by."""

from collections.abc import Callable, Sequence

import numpy as np

from agent.solve.deadline import Deadline
from agent.solve.problem import PRICE_PER_M, JointProblem, JointSolver, Solution, Start

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
