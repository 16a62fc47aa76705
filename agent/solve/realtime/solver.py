"""Real-time iteration: a few steps of sequential quadratic programming from the last step's solution.

Inside, lengths are in safety distances and costs in what one of them is worth, so that tolerances and the
way of the iterations do not depend on the scale of a scene or its weights.
"""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from agent.solve import Deadline
from agent.solve.problem import LIMITED_QUANTITIES, JointProblem, Solution, Start, within_limits
from agent.solve.realtime.distances import violations_of
from agent.solve.realtime.profiles import inputs_of, states_of
from agent.solve.realtime.sequential import Data, improve
from agent.solve.vehicle import Array

TOLERANCE = 1e-5
"""Of the quadratic programs' optimality conditions."""
CONVERGED = 5e-4
"""From a warm start, a step that promises to decrease the merit by no more than this, relative to it, is the
last: near the optimum, what remains after a step is a hundred times less."""
FEASIBLE = 6e-4
"""A trajectory that violates a distance by more, in safety distances, is iterated on."""
CONVERGED_COLD = 1e-6
"""The same from a cold start."""
COLD_ITERATIONS = 30
"""Most iterations from a cold start."""


class RealTimeSolver:
    """Every iterate is a true rollout within the limits, so that it can end after any of them.

    Args:
        iterations: most of them a step, from a warm start.
        deadline: after it no further iteration begins; the first one always does.
    """

    def __init__(self, iterations: int, deadline: Deadline) -> None:
        self._iterations = iterations
        self._deadline = deadline

    def solve(self, problem: JointProblem, start: Start) -> Solution:
        """See :class:`agent.solve.problem.JointSolver`."""
        units = _units_of(problem)
        data, states, forces, multipliers = _begin(problem, start, units)
        most, least = (self._iterations, CONVERGED) if start.warm else (COLD_ITERATIONS, CONVERGED_COLD)
        price = problem.price_per_m / units.force
        given = (states, start.inputs, problem.previous_inputs)
        solved, iterations = all(bool(np.isfinite(each).all()) for each in given), 0
        while solved and iterations < most and not (iterations and self._deadline.has_passed()):
            states, forces, multipliers, promised, _, solved = improve(
                data, states, forces, multipliers, price, TOLERANCE, 0
            )
            iterations += 1
            _, largest = violations_of(states, data.obstacles, data.safety_distances, data.sides, data.area)
            if promised <= least and largest <= FEASIBLE:
                break
        return _solution(problem, states, forces, multipliers, units, solved, iterations)


@dataclass(frozen=True)
class Response:
    """A solution, and how it moves with the goals."""

    solution: Solution
    by_goal: Array
    """Derivatives of the states from stage 1 on by the goal positions (x_0, y_0, x_1, …), shape
    (2M, M, stages, 4); to first order, and as long as the same constraints are tight."""


def respond(problem: JointProblem, start: Start, stages: int, tolerance: float = TOLERANCE) -> Response:
    """One iteration of the real-time solver, with the sensitivities of so many stages to the goals.

    Args:
        problem: the problem.
        start: where the iteration starts.
        stages: of so many, from stage 1 on, the sensitivities are wanted.
        tolerance: of the quadratic program's optimality conditions.
    """
    units = _units_of(problem)
    data, states, forces, multipliers = _begin(problem, start, units)
    price = problem.price_per_m / units.force
    states, forces, multipliers, _, by_goal, solved = improve(
        data, states, forces, multipliers, price, tolerance, stages
    )
    by_goal[..., 2] /= units.length_m
    return Response(_solution(problem, states, forces, multipliers, units, solved, iterations=1), by_goal)


class _Units(NamedTuple):
    """What is one inside the solver."""

    length_m: float
    cost: float

    @property
    def force(self) -> float:
        """In cost a metre."""
        return self.cost / self.length_m

    @property
    def state(self) -> Array:
        """Of (p_x, p_y, ψ, v)."""
        return np.array([self.length_m, self.length_m, 1.0, self.length_m])

    @property
    def input(self) -> Array:
        """Of (ω, a)."""
        return self.state[2:]

    @property
    def multipliers(self) -> Array:
        """Of ω, a, their changes, and v."""
        return self.cost / self.state[[2, 3, 2, 3, 3]]


def _units_of(problem: JointProblem) -> _Units:
    weight = float(problem.weights[1:, :2].max(axis=1).mean()) or 1.0
    return _Units(problem.size_m, weight * problem.size_m**2)


def _begin(problem: JointProblem, start: Start, units: _Units) -> tuple[Data, Array, Array, Array]:
    """What an iteration needs: the data; states, forces and multipliers of limits as kernels take them."""
    inputs = within_limits(problem, start.inputs)
    return (
        _data_of(problem, units),
        states_of(_compact(problem.states / units.state), _compact(inputs / units.input), problem.step_s),
        _compact(start.forces / units.force),
        _by_side(start.limit_multipliers / units.multipliers),
    )


def _by_side(multipliers: Array) -> Array:
    """Multipliers (M, K, 5) of limits as the quadratic program has them: shape (2, M, 5K), none negative."""
    flat = multipliers.swapaxes(1, 2).reshape(len(multipliers), -1)
    return np.maximum([-flat, flat], 0.0)


def _by_stage(multipliers: Array, steps: int) -> Array:
    """The inverse of :func:`_by_side`."""
    low, high = multipliers.reshape(2, -1, LIMITED_QUANTITIES, steps)
    return (high - low).swapaxes(1, 2)


def _solution(
    problem: JointProblem,
    states: Array,
    forces: Array,
    multipliers: Array,
    units: _Units,
    solved: bool,
    iterations: int,
) -> Solution:
    # Quadratic programs keep limits to their tolerance; what is handed on keeps them exactly.
    inputs = within_limits(problem, inputs_of(states, problem.step_s) * units.input)
    states = problem.rollout(inputs)
    return Solution(
        inputs=inputs,
        states=states,
        forces=forces * units.force,
        limit_multipliers=_by_stage(multipliers, problem.steps) * units.multipliers,
        objective=problem.objective(states),
        violation_m=problem.violation_m(states),
        solved=solved,
        iterations=iterations,
    )


def _data_of(problem: JointProblem, units: _Units) -> Data:
    bounds = problem.input_bounds
    weights = problem.weights * units.state**2 / units.cost
    # Inputs recovered from noisy poses can lie outside the limits.
    previous = np.clip(problem.previous_inputs, -bounds, bounds)
    return Data(
        previous_inputs=_compact(previous / units.input),
        first_inputs=_compact(problem.first_inputs / units.input),
        goals=_compact(problem.goals / units.state),
        input_bounds=_compact(bounds / units.input),
        rate_bounds=_compact(problem.rate_bounds / units.input),
        speed_bounds=_compact(problem.speed_bounds / units.length_m),
        obstacles=_compact(problem.obstacles / units.length_m),
        safety_distances=_compact(problem.safety_distances / units.length_m),
        sides=_compact(problem.sides),
        area=_compact(problem.area / units.length_m),
        weights=_compact(weights),
        step_s=problem.step_s,
    )


def _compact(values: Array) -> Array:
    """As kernels take arrays: C-contiguous, of float64."""
    return np.ascontiguousarray(values, dtype=np.float64)
