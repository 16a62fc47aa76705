"""Where a solution starts: from the last one, or from what each robot would do if it were alone."""

from collections.abc import Callable, Mapping, Sequence
from functools import partial

import numpy as np

from agent.solve import Deadline
from agent.solve.problem import (
    LIMITED_QUANTITIES,
    JointProblem,
    JointSolver,
    Solution,
    Start,
    braking_inputs,
    within_limits,
)
from agent.solve.vehicle import Array

POOR = 0.1
"""A solution that violates a distance by more than this part of it is looked for again elsewhere: it may be
on the wrong side."""
AWAY = 0.4
"""In safety distances: a robot that is no further from its goal is nearly there."""
ALIKE = 1e-3
"""Costs that differ by no more than this part are equal, and of their solutions the earlier one counts: in a
symmetrical crossing they differ by what iterations and rounding leave, and processors round differently."""
LEANING_STEPS = 4
"""So many steps of the highest change lead to the turn rate of a leaning start: 0.2 rad/s by default."""
STANDS = 0.015
"""In safety distances: a robot that goes no further in the last third of the horizon stands."""


def solve_well(
    solver: JointSolver,
    problem: JointProblem,
    start: Start,
    other_start: Callable[[], Start],
    deadline: Deadline,
) -> Solution:
    """Solve from a start and, where what comes of it is poor and time is left, from another one.

    The better one is taken: solved beats unsolved, going on beats a deadlock, then the lower cost with the
    price of violations counts.
    """
    found = solver.solve(problem, start)
    if not is_poor(problem, found) or deadline.has_passed():
        return found
    return min(found, solver.solve(problem, other_start()), key=partial(rank, problem))


def is_poor(problem: JointProblem, solution: Solution) -> bool:
    """Whether it is not solved, violates a distance or an agreed side, or ends in a deadlock."""
    is_too_close = solution.violation_m > POOR * problem.size_m
    return not solution.solved or is_too_close or is_deadlock(problem, solution)


def rank(problem: JointProblem, solution: Solution, handicap: float = 0.0) -> tuple[bool, bool, float]:
    """By which the least of several solutions is the best one, its cost raised by a part of it."""
    cost = solution.objective + problem.price_per_m * solution.violation_m
    return not solution.solved, is_deadlock(problem, solution), (1.0 + handicap) * cost


def is_deadlock(problem: JointProblem, solution: Solution) -> bool:
    """Whether a robot comes to a stand away from its goal while others are in its way."""
    positions = solution.states[:, :, :2]
    stands = np.array([comes_to_rest(path, problem.size_m) for path in positions])
    away = np.linalg.norm(positions[:, -1] - problem.goals[:, :2], axis=-1) > AWAY * problem.size_m
    held = np.linalg.norm(solution.forces[:, -1], axis=-1) > 0.0
    return bool((stands & away & held).any())


def comes_to_rest(path: Array, size_m: float) -> bool:
    """Whether a robot stays in one place in the last third of its path (K + 1, 2)."""
    rest = path[-1 - (len(path) - 1) // 3 :]
    return bool(np.linalg.norm(rest - rest[-1], axis=1).max() < STANDS * size_m)


def cold_start(problem: JointProblem, inputs: Array | None = None) -> Start:
    """A start of which no forces are known: from inputs (M, K, 2), or from braking to a stand."""
    inputs = braking_inputs(problem) if inputs is None else inputs
    robots, steps = inputs.shape[:2]
    forces, multipliers = np.zeros((robots, steps + 1, 2)), np.zeros((robots, steps, LIMITED_QUANTITIES))
    return Start(inputs, forces, multipliers, warm=False)


def openings_of(problem: JointProblem) -> list[Callable[[], Start]]:
    """Starts for when no last solution is known, in order of preference.

    Everybody brakes to a standstill while leaning to its left; to its right; in turn to its left and right;
    not at all. When all robots lean to the same side, standing ones stay clear of one another, and a
    symmetrical crossing begins as a roundabout instead of a deadlock.
    """
    left = np.ones(len(problem.states))
    alternating = np.where(np.arange(len(left)) % 2, -left, left)
    return [partial(_leaning, problem, sides) for sides in (left, -left, alternating, 0.0 * left)]


def _leaning(problem: JointProblem, sides: Array) -> Start:
    """All brake and turn, at a rate that a few steps lead to, to their sides (M,)."""
    inputs = braking_inputs(problem)
    inputs[:, :, 0] += LEANING_STEPS * problem.rate_bounds[:, :1] * sides[:, None]
    return cold_start(problem, within_limits(problem, inputs))


class WarmStarts:
    """The last solution of each robot: where the next solution starts, one step on."""

    def __init__(self) -> None:
        self._last: dict[str, tuple[Array, Array, Array]] = {}

    def start(
        self,
        problem: JointProblem,
        robots: Sequence[str],
        steps_on: int = 1,
        otherwise: Callable[[], Start] | None = None,
    ) -> Start:
        """The last solution, so many steps on; of a robot that has none, its part of another start.

        ``otherwise`` gives that start; without it, it is the cold one.
        """
        known = {index: robot for index, robot in enumerate(robots) if robot in self._last}
        parts = {
            index: [shifted(each, steps_on) for each in self._last[robot]] for index, robot in known.items()
        }
        if len(parts) == len(robots):
            inputs, forces, multipliers = (np.array(each) for each in zip(*parts.values(), strict=True))
            return Start(inputs, forces, multipliers, warm=True)
        start = otherwise() if otherwise else cold_start(problem)
        for index, (inputs, forces, multipliers) in parts.items():
            start.inputs[index], start.forces[index], start.limit_multipliers[index] = (
                inputs,
                forces,
                multipliers,
            )
        return start

    def keep(self, robots: Sequence[str], solution: Solution) -> None:
        """Remember a solution of these robots and forget all earlier ones; of one that failed, nothing."""
        parts = zip(solution.inputs, solution.forces, solution.limit_multipliers, strict=True)
        self._last = dict(zip(robots, parts, strict=True)) if solution.solved else {}


class Alone:
    """What each robot would do if nobody else were there, from step to step."""

    def __init__(self, solver: JointSolver) -> None:
        self._solver = solver
        self._last: dict[str, WarmStarts] = {}

    def drive(self, problems: Mapping[str, JointProblem]) -> dict[str, Solution]:
        """The solution of each robot's own problem; of robots not among them nothing is kept."""
        self._last = {robot: self._last.get(robot, WarmStarts()) for robot in problems}
        solutions = {}
        for robot, problem in problems.items():
            solutions[robot] = self._solver.solve(problem, self._last[robot].start(problem, [robot]))
            self._last[robot].keep([robot], solutions[robot])
        return solutions


def shifted(stages: Array, steps: int = 1) -> Array:
    """Inputs or multipliers of one robot so many steps on; those of the new last stages are zero."""
    steps = min(steps, len(stages))
    return np.concatenate([stages[steps:], np.zeros((steps, *stages.shape[1:]))])
