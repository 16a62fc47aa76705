"""A solution is a local optimum, checked with nothing but rollouts.

First, no small change of the inputs that the limits allow makes it better, in cost and exact L1 penalty of
the distance rows together; each solver has its own form of the rows and its own penalty. Second, since random
changes hardly ever run along a distance row: the limits and distances that are met balance the gradient of
the cost (Karush, Kuhn, Tucker), gradients being differences.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from itertools import combinations

import casadi as ca
import numpy as np
import pytest
from agent_helpers import SOLVERS, cold, euler, problem_of

from agent.solve.problem import PRICE_PER_M, JointProblem, JointSolver, within_limits
from agent.solve.realtime import solver as realtime
from agent.solve.reference import PENALTY_PER_M2

SIZES = (1e-1, 1e-2, 1e-3, 1e-4)
NEARBY = np.array([0.05, 0.05, 0.0, 0.0])
"""From a goal to another one that gives a slightly different problem."""
MET = 1e-4
"""A row nearer to its bound than this may hold the solution back."""


def driven(problem: JointProblem, inputs: np.ndarray) -> np.ndarray:
    return np.array([euler(*each) for each in zip(problem.states, inputs, strict=True)])


def cost(problem: JointProblem, inputs: np.ndarray) -> float:
    errors = driven(problem, inputs) - problem.goals[:, None]
    return float((problem.weights * errors**2).sum())


def of_squares(distances: np.ndarray, safe: float) -> np.ndarray:
    return safe**2 - distances**2


def of_lengths(distances: np.ndarray, safe: float) -> np.ndarray:
    return safe - distances


@dataclass(frozen=True)
class Judged:
    """A solver, and how its solutions are to be judged."""

    solver: JointSolver
    shortfall: Callable[[np.ndarray, float], np.ndarray]
    """Form of its distance rows."""
    penalty: float
    """What each unit of a shortfall costs it."""
    tolerance: float
    """To which it keeps its rows, in their units."""

    def distance_rows(self, problem: JointProblem, inputs: np.ndarray) -> np.ndarray:
        """Of every pair and stage from the second on; negative where the distance is kept."""
        bodies = [*driven(problem, inputs)[:, :, :2], *problem.obstacles]
        return np.array(
            [
                self.shortfall(np.linalg.norm((one - other)[2:], axis=1), problem.safety_distances[i, j])
                for (i, one), (j, other) in combinations(enumerate(bodies), 2)
                if i < len(inputs)
            ]
        ).ravel()


JUDGED = {
    "reference": Judged(SOLVERS["reference"], of_squares, PENALTY_PER_M2, 1e-6),
    "realtime": Judged(SOLVERS["realtime"], of_lengths, PRICE_PER_M, 1e-6),
}


@pytest.fixture(params=JUDGED)
def judged(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> Judged:
    """The real-time solver goes on to the end here, instead of stopping where little more is to be gained."""
    monkeypatch.setattr(realtime, "CONVERGED_COLD", 1e-12)
    monkeypatch.setattr(realtime, "COLD_ITERATIONS", 200)
    monkeypatch.setattr(realtime, "TOLERANCE", 1e-7)
    return JUDGED[request.param]


def limit_rows(problem: JointProblem, inputs: np.ndarray) -> np.ndarray:
    """Value less bound of every limit of eq. 9; negative inside."""
    changes = np.diff(np.concatenate([problem.previous_inputs[:, None], inputs], axis=1), axis=1)
    bounded = [
        (inputs, [1.57, 3.0]),
        (changes, [0.05, 0.7]),
        (driven(problem, inputs)[:, 1:, [0, 1, 3]], [10.0, 10.0, 4.5]),
    ]
    return np.concatenate([(sign * values - bound).ravel() for values, bound in bounded for sign in (1, -1)])


def merit(judged: Judged, problem: JointProblem, inputs: np.ndarray) -> float:
    """Cost and penalty; infinite where a limit is not kept."""
    if (limit_rows(problem, inputs) > judged.tolerance).any():
        return math.inf
    violations = (judged.distance_rows(problem, inputs) - judged.tolerance).clip(min=0.0)
    return cost(problem, inputs) + judged.penalty * violations.sum()


def largest_gain(judged: Judged, problem: JointProblem, inputs: np.ndarray) -> float:
    """By how much the best of many small changes, brought within the limits, lowers the merit."""
    random = np.random.default_rng(11)
    directions = [random.normal(size=inputs.shape) for _ in range(60)]
    for _ in range(60):
        # Changes that last, which those above hardly contain: a stretch faster, or more to one side.
        begin, end = sorted(random.integers(0, inputs.shape[1] + 1, 2))
        stretch = np.zeros_like(inputs)
        stretch[:, begin:end] = random.normal(size=(len(inputs), 1, 2))
        directions.append(stretch)
    here = merit(judged, problem, inputs)
    return max(
        here - merit(judged, problem, within_limits(problem, inputs + size * direction))
        for direction in directions
        for size in SIZES
    )


def imbalance(judged: Judged, problem: JointProblem, inputs: np.ndarray) -> float:
    """‖∇cost + Σ μ ∇row‖ / ‖∇cost‖ with the best multipliers μ ≥ 0 of the rows that are met.

    The penalty lets no multiplier of a distance grow beyond its weight, which those of broken distances have.
    """

    def everything(changed: np.ndarray) -> np.ndarray:
        rows = (limit_rows(problem, changed), judged.distance_rows(problem, changed))
        return np.concatenate([[cost(problem, changed)], *rows])

    slopes = []
    for index in np.ndindex(inputs.shape):
        change = np.zeros_like(inputs)
        change[index] = 1e-6
        slopes.append((everything(inputs + change) - everything(inputs - change)) / 2e-6)
    gradient, rows = np.array(slopes)[:, 0], np.array(slopes)[:, 1:]
    distances = judged.distance_rows(problem, inputs)
    highest = np.concatenate(
        [np.full(rows.shape[1] - len(distances), np.inf), np.full(len(distances), judged.penalty)]
    )
    lowest = np.where(np.isinf(highest) | (everything(inputs)[1:] < judged.tolerance), 0.0, judged.penalty)
    met = everything(inputs)[1:] > -MET
    rows, lowest, highest = rows[:, met], lowest[met], highest[met]
    count = rows.shape[1]
    quadratic = rows.T @ rows + 1e-9 * np.eye(count)
    solver = ca.conic("multipliers", "daqp", {"h": ca.Sparsity.dense(count, count)})
    result = solver(h=quadratic, g=rows.T @ gradient, lbx=lowest, ubx=highest)
    return float(np.linalg.norm(gradient + rows @ result["x"].full().ravel()) / np.linalg.norm(gradient))


def problems() -> dict[str, JointProblem]:
    opposite = [(4.0, 0.0, 0.0, 0.0), (-4.0, 0.0, math.pi, 0.0)]
    passing = np.column_stack([np.zeros(31), -2.0 + 0.12 * np.arange(31)])
    return {
        "alone": problem_of([(-2.0, 0.0, 0.5, 1.0)], [(2.0, 1.0, 0.0, 0.0)]),
        "head on": problem_of([(-4.0, 0.0, 0.1, 1.0), (4.0, 0.0, math.pi, 1.5)], opposite),
        "among obstacles": problem_of(
            [(-4.0, 0.0, 0.0, 2.0)], [(4.0, 0.0, 0.0, 0.0)], obstacles=passing[None]
        ),
        "too close": problem_of([(-0.5, 0.0, 0.0, 1.0), (0.5, 0.1, math.pi, 1.0)], opposite),
    }


@pytest.mark.parametrize("name", problems())
def test_no_small_change_improves_a_solution(judged, name):
    problem = problems()[name]
    solution = judged.solver.solve(problem, cold(problem))
    assert solution.solved
    assert math.isfinite(merit(judged, problem, solution.inputs))
    assert largest_gain(judged, problem, solution.inputs) < 1e-5 * solution.objective


@pytest.mark.parametrize("name", problems())
def test_limits_and_distances_balance_the_gradient_of_the_cost(judged, name):
    problem = problems()[name]
    solution = judged.solver.solve(problem, cold(problem))
    assert imbalance(judged, problem, solution.inputs) < 1e-5


@pytest.mark.parametrize("name", ["alone", "head on", "among obstacles"])
def test_the_balance_notices_goals_a_few_centimetres_away(judged, name):
    problem = problems()[name]
    other = replace(problem, goals=problem.goals + NEARBY)
    solution = judged.solver.solve(other, cold(problem))
    assert imbalance(judged, problem, solution.inputs) > 1e-4


def test_the_search_for_small_changes_notices_goals_a_few_centimetres_away(judged):
    problem = problems()["alone"]
    other = replace(problem, goals=problem.goals + NEARBY)
    solution = judged.solver.solve(other, cold(problem))
    assert largest_gain(judged, problem, solution.inputs) > 1e-4 * solution.objective
