"""Arrive: a plan that is at its goal as early as it can be.

The cost of eq. 1, a sum of squares, approaches a goal ever more slowly, and does not see a wrong heading before
it is all that is left. What counts is when the robot has arrived: when ‖x − L‖ ≤ μ. So the ego's own plan
minimises how many of its stages are not there yet, smoothly counted,

    Σ_k φ(‖x_k − L‖²),    φ(e²) = e² / (μ² + e²)

It is concave in e², so that the squares weighted by its slope at a known plan x̄ lie above it,

    φ(e²) ≤ φ(ē²) + w (e² − ē²),    w = φ'(ē²) = μ² / (μ² + ē²)²

and who makes those smaller makes the count smaller (majorise and minimise; the weights are those of Geman and
McClure's estimator). With the last plan as the known one, a step costs no more than with eq. 1: only the weights
differ from stage to stage, low on the way and high from where the plan arrives.
"""

from collections.abc import Callable
from functools import partial

import numpy as np

from agent.solve.problem import JointProblem, Solution, Start, within_limits
from agent.solve.starts import AWAY, STANDS, cold_start
from agent.solve.vehicle import Array


def stages_away(states: Array, goal: Array, tolerance: float) -> float:
    """How many of the stages (K + 1, 4) are not at the goal (4,), each counted from 0 to 1."""
    squares = ((states - goal) ** 2).sum(axis=1)
    return float((squares / (tolerance**2 + squares)).sum())


def arrival_weights(weights: Array, known: Array, goal: Array, tolerance: float) -> Array:
    """Weights (K + 1, 4) of squares that lie above the count of stages away, and touch it at a known plan.

    Args:
        weights: those of eq. 1, shape (K + 1, 4); their mean over stages, of positions, is kept, so that the
            prices of distances stay what they are.
        known: states of the known plan, shape (K + 1, 4).
        goal: L, shape (4,).
        tolerance: μ.
    """
    squares = ((known - goal) ** 2).sum(axis=1)
    slopes = 1.0 / (tolerance**2 + squares) ** 2
    slopes *= weights[1:, :2].max() / slopes[1:].mean()
    return np.repeat(slopes[:, None], 4, axis=1)


def rests_beside(problem: JointProblem, solution: Solution, tolerance: float) -> bool:
    """Whether a robot comes to rest near its goal (4,), but not at it."""
    end = solution.states[0, -1]
    rest = solution.states[0, -1 - problem.steps // 3 :, :2]
    stands = np.linalg.norm(rest - rest[-1], axis=-1).max() < STANDS * problem.size_m
    error = float(np.linalg.norm(end - problem.goals[0]))
    near = float(np.linalg.norm(end[:2] - problem.goals[0, :2])) <= AWAY * problem.size_m
    return bool(solution.solved and stands and near and error > tolerance)


def manoeuvres(problem: JointProblem) -> list[Callable[[], Start]]:
    """Starts for a robot that would come to rest beside its goal: there and back again, and back and there.

    A robot that stands cannot move sideways, not to first order; one that is to come back to where it is can.
    """
    return [partial(_there_and_back, problem, direction) for direction in (1.0, -1.0)]


def _there_and_back(problem: JointProblem, direction: float) -> Start:
    steps = problem.steps
    quarter = np.arange(steps) * 4 // max(steps, 1)
    sign = np.where((quarter == 0) | (quarter == 3), direction, -direction)
    inputs = np.zeros((1, steps, 2))
    inputs[0, :, 1] = 0.5 * sign * problem.input_bounds[0, 1]
    return cold_start(problem, within_limits(problem, inputs))
