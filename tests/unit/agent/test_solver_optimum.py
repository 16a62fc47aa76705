"""A solution of the reference solver is a local optimum, checked with nothing but rollouts.

The limits and distances that are met balance the gradient of the cost (Karush, Kuhn, Tucker), gradients being
differences. The real-time solver is compared with the reference in ``test_realtime_solver``, and its
quadratic programs keep the same conditions in ``test_realtime_quadratic_programs``.
"""

import math
from dataclasses import replace
from itertools import combinations

import casadi as ca
import numpy as np
import pytest
from agent_helpers import SOLVERS, cold, problem_of

from agent.solve.problem import JointProblem
from agent.solve.reference import PENALTY_PER_M2

OPPOSITE = [(4.0, 0.0, 0.0, 0.0), (-4.0, 0.0, math.pi, 0.0)]
PASSING = np.column_stack([np.zeros(31), -2.0 + 0.12 * np.arange(31)])
PROBLEMS = {
    "alone": problem_of([(-2.0, 0.0, 0.5, 1.0)], [(2.0, 1.0, 0.0, 0.0)]),
    "head on": problem_of([(-4.0, 0.0, 0.1, 1.0), (4.0, 0.0, math.pi, 1.5)], OPPOSITE),
    "among obstacles": problem_of([(-4.0, 0.0, 0.0, 2.0)], [OPPOSITE[0]], obstacles=PASSING[None]),
    "too close": problem_of([(-0.5, 0.0, 0.0, 1.0), (0.5, 0.1, math.pi, 1.0)], OPPOSITE),
    "late weights": replace(
        problem_of([(-2.0, 0.5, 0.3, 1.0)], [(0.0, 0.0, 0.0, 0.0)]),
        weights=np.linspace(0.02, 2.0, 31)[:, None] ** 2 * [1.0, 1.0, 0.5, 0.1],
    ),
    "a bounded first input": replace(
        problem_of([(-4.0, 0.0, 0.1, 1.0), (4.0, 0.0, math.pi, 1.5)], OPPOSITE),
        first_inputs=np.array([[[-0.02, -0.5], [0.01, 0.2]], [[0.03, -0.7], [0.05, -0.1]]]),
    ),
}
NEARBY = np.array([0.05, 0.05, 0.0, 0.0])
"""From a goal to another one that gives a slightly different problem."""
MET = 1e-4
"""A row nearer to its bound than this may hold the solution back."""
TOLERANCE = 1e-6
"""To which rows are kept, in their units."""


def limit_rows(problem: JointProblem, inputs: np.ndarray) -> np.ndarray:
    """Value less bound of every limit of eq. 9; negative inside."""
    changes = np.diff(np.concatenate([problem.previous_inputs[:, None], inputs], axis=1), axis=1)
    bounded = [
        (inputs, [1.57, 3.0]),
        (changes, [0.05, 0.7]),
        (problem.rollout(inputs)[:, 1:, [0, 1, 3]], [10.0, 10.0, 4.5]),
    ]
    rows = [(sign * values - bound).ravel() for values, bound in bounded for sign in (1, -1)]
    first = [inputs[:, 0] - problem.first_inputs[:, 1], problem.first_inputs[:, 0] - inputs[:, 0]]
    return np.concatenate([*rows, *(each[np.isfinite(each)] for each in first)])


def distance_rows(problem: JointProblem, inputs: np.ndarray) -> np.ndarray:
    """d² − ‖Δp‖² of every pair and stage from the second on; negative where the distance is kept."""
    bodies = [*problem.rollout(inputs)[:, :, :2], *problem.obstacles]
    return np.array(
        [
            problem.safety_distances[i, j] ** 2 - ((one - other)[2:] ** 2).sum(axis=1)
            for (i, one), (j, other) in combinations(enumerate(bodies), 2)
            if i < len(inputs)
        ]
    ).ravel()


def imbalance(problem: JointProblem, inputs: np.ndarray) -> float:
    """‖∇cost + Σ μ ∇row‖ / ‖∇cost‖ with the best multipliers μ ≥ 0 of the rows that are met.

    The penalty lets no multiplier of a distance grow beyond its weight, which those of broken distances have.
    """

    def everything(changed: np.ndarray) -> np.ndarray:
        cost = problem.objective(problem.rollout(changed))
        return np.concatenate([[cost], limit_rows(problem, changed), distance_rows(problem, changed)])

    slopes = []
    for index in np.ndindex(inputs.shape):
        change = np.zeros_like(inputs)
        change[index] = 1e-6
        slopes.append((everything(inputs + change) - everything(inputs - change)) / 2e-6)
    gradient, rows = np.array(slopes)[:, 0], np.array(slopes)[:, 1:]
    values, distances = everything(inputs)[1:], len(distance_rows(problem, inputs))
    highest = np.full(len(values), np.inf)
    highest[len(values) - distances :] = PENALTY_PER_M2
    lowest = np.where(np.isinf(highest) | (values < TOLERANCE), 0.0, PENALTY_PER_M2)
    met = values > -MET
    rows, lowest, highest = rows[:, met], lowest[met], highest[met]
    count = rows.shape[1]
    quadratic = rows.T @ rows + 1e-9 * np.eye(count)
    solver = ca.conic("multipliers", "daqp", {"h": ca.Sparsity.dense(count, count)})
    result = solver(h=quadratic, g=rows.T @ gradient, lbx=lowest, ubx=highest)
    return float(np.linalg.norm(gradient + rows @ result["x"].full().ravel()) / np.linalg.norm(gradient))


@pytest.mark.parametrize("problem", PROBLEMS.values(), ids=PROBLEMS)
def test_what_a_solution_meets_balances_the_gradient_of_the_cost(problem):
    solution = SOLVERS["reference"].solve(problem, cold(problem))
    assert solution.solved
    assert (limit_rows(problem, solution.inputs) <= TOLERANCE).all()
    assert imbalance(problem, solution.inputs) < 1e-5


@pytest.mark.parametrize("name", ["alone", "head on", "among obstacles"])
def test_the_balance_notices_goals_a_few_centimetres_away(name):
    other = replace(PROBLEMS[name], goals=PROBLEMS[name].goals + NEARBY)
    solution = SOLVERS["reference"].solve(other, cold(other))
    assert imbalance(PROBLEMS[name], solution.inputs) > 1e-4
