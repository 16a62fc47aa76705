"""A solution is a local optimum: no small change of the inputs that the limits allow makes it better.

Checked with rollouts only, on what eq. 7 minimises with its distance rows as an exact L1 penalty.
"""

import math
from dataclasses import replace
from itertools import combinations

import numpy as np
import pytest
from agent_helpers import euler, problem_of

from agent.solver.problem import JointProblem
from agent.solver.reference import PENALTY_PER_M2, ReferenceSolver
from agent.solver.starts import cold_start, within_limits

SIZES = (1e-1, 1e-2, 1e-3, 1e-4)
TOLERANCE_M2 = 1e-6
ROUNDING = 2e-3
"""Of the objective, which is in the hundreds: what the solver's own tolerance leaves, times the penalty."""


def merit(problem: JointProblem, inputs: np.ndarray) -> float:
    """Cost and penalty of driving these inputs; infinite where the speed or the area is not kept."""
    states = np.array([euler(*each) for each in zip(problem.states, inputs, strict=True)])
    bounds = np.array([10.0, 10.0, np.inf, 4.5]) + 1e-6
    if (np.abs(states) > bounds).any():
        return math.inf
    cost = float((problem.weights * (states - problem.goals[:, None]) ** 2).sum())
    bodies = [*states[:, :, :2], *problem.obstacles]
    for (i, one), (j, other) in combinations(enumerate(bodies), 2):
        if i < len(states):
            gaps = problem.safety_distances[i, j] ** 2 - ((one - other)[2:] ** 2).sum(axis=1)
            cost += PENALTY_PER_M2 * (gaps - TOLERANCE_M2).clip(min=0.0).sum()
    return cost


def descent(problem: JointProblem, inputs: np.ndarray) -> np.ndarray:
    """Against the gradient of the merit, by central differences; length 1."""
    gradient = np.zeros_like(inputs)
    for index in np.ndindex(inputs.shape):
        change = np.zeros_like(inputs)
        change[index] = 1e-6
        gradient[index] = merit_without_bounds(problem, inputs, change)
    return -gradient / np.linalg.norm(gradient)


def merit_without_bounds(problem: JointProblem, inputs: np.ndarray, change: np.ndarray) -> float:
    above, below = (merit(problem, inputs + sign * change) for sign in (1, -1))
    return above - below if math.isfinite(above - below) else 0.0


def largest_gain(problem: JointProblem, inputs: np.ndarray) -> float:
    """By how much the best of many small changes, brought within the limits, lowers the merit."""
    random = np.random.default_rng(11)
    directions = [random.normal(size=inputs.shape) / math.sqrt(inputs.size) for _ in range(60)]
    # Changes that last are what random ones hardly contain: a whole stretch faster, or more to one side.
    for _ in range(60):
        begin, end = sorted(random.integers(0, inputs.shape[1] + 1, 2))
        stretch = np.zeros_like(inputs)
        stretch[:, begin:end] = random.normal(size=(len(inputs), 1, 2))
        directions.append(stretch)
    directions.append(descent(problem, inputs))
    here = merit(problem, inputs)
    return max(
        here - merit(problem, within_limits(problem, inputs + size * direction))
        for direction in directions
        for size in SIZES
    )


def problems() -> dict[str, JointProblem]:
    head_on = problem_of(
        [(-4.0, 0.0, 0.1, 1.0), (4.0, 0.0, math.pi, 1.5)], [(4.0, 0.0, 0.0, 0.0), (-4.0, 0.0, math.pi, 0.0)]
    )
    passing = np.column_stack([np.zeros(31), -2.0 + 0.12 * np.arange(31)])
    return {
        "alone": problem_of([(-2.0, 0.0, 0.5, 1.0)], [(2.0, 1.0, 0.0, 0.0)]),
        "head on": head_on,
        "among obstacles": problem_of(
            [(-4.0, 0.0, 0.0, 2.0)], [(4.0, 0.0, 0.0, 0.0)], obstacles=passing[None]
        ),
        "too close": problem_of(
            [(-0.5, 0.0, 0.0, 1.0), (0.5, 0.1, math.pi, 1.0)],
            [(4.0, 0.0, 0.0, 0.0), (-4.0, 0.0, math.pi, 0.0)],
        ),
    }


@pytest.mark.parametrize("name", problems())
def test_no_small_change_improves_a_solution(name):
    problem = problems()[name]
    solution = ReferenceSolver().solve(problem, cold_start(problem))
    assert solution.solved
    assert math.isfinite(merit(problem, solution.inputs))
    assert largest_gain(problem, solution.inputs) < ROUNDING


@pytest.mark.parametrize("name", ["alone", "head on", "among obstacles"])
def test_small_changes_do_improve_the_solution_of_a_slightly_different_problem(name):
    """Which shows that the search would notice: here the goals were five centimetres away."""
    problem = problems()[name]
    other = replace(problem, goals=problem.goals + [0.05, 0.05, 0.0, 0.0])
    solution = ReferenceSolver().solve(other, cold_start(problem))
    assert largest_gain(problem, solution.inputs) > 2 * ROUNDING
