"""One step of sequential quadratic programming, how far to follow it, and how it moves with the goals."""

import math
from typing import NamedTuple

import numpy as np

from agent.solve.compiled import kernel
from agent.solve.realtime.cost import blocks_of, cost_of, gradient_of
from agent.solve.realtime.distances import gaps_after, rows_about, violations_of
from agent.solve.realtime.factorisation import solve_stages, solve_stages_transposed
from agent.solve.realtime.kkt import Program, solve_schur
from agent.solve.realtime.profiles import (
    bounds_of,
    displacements,
    jacobian_of,
    limited_quantities,
    moved,
    pull_back,
)
from agent.solve.realtime.qp import Outcome, solve_program
from agent.solve.vehicle import Array

SUFFICIENT = 1e-4
"""Part of the predicted decrease that a step must bring (Armijo)."""
LEAST_PRICE = 7.0
"""Of a violated length in the merit, where no row pushes."""
NARROWEST = 1e-3
"""Of the largest change of an input in a step: closer bounds of the first one are widened to it inside the
program, which needs some room."""
SHORTEST = 1e-3
"""Shorter steps are not tried."""


class Data(NamedTuple):
    """The arrays of a ``JointProblem``, as its fields and properties describe them."""

    previous_inputs: Array
    first_inputs: Array
    goals: Array
    input_bounds: Array
    rate_bounds: Array
    speed_bounds: Array
    obstacles: Array
    safety_distances: Array
    sides: Array
    area: Array
    weights: Array
    step_s: float


class Improvement(NamedTuple):
    """What came of one step."""

    states: Array
    """Shape (M, K + 1, 4); the old ones where the quadratic program was not solved, as the next two."""
    forces: Array
    """Shape (M, K + 1, 2)."""
    limit_multipliers: Array
    """Shape (2, M, 5K)."""
    promised: float
    """Decrease of the merit that was promised, relative to the merit; zero if no part of the step helped."""
    by_goal: Array
    """See :func:`sensitivities`."""
    solved: bool
    """Whether the quadratic program was."""


@kernel
def program_about(data: Data, states: Array, forces: Array, penalty: float) -> Program:
    """The quadratic program about a trajectory (M, K + 1, 4) with constraint forces (M, K + 1, 2).

    Limits that the trajectory does not keep (a vehicle that is too fast already) are widened to it.
    """
    robots, steps = states.shape[0], states.shape[1] - 1
    jacobian = jacobian_of(states, data.step_s)
    low, high = np.empty((robots, 5 * steps)), np.empty((robots, 5 * steps))
    quantities = np.empty(5 * steps)
    for robot in range(robots):
        bounds = bounds_of(data.input_bounds[robot], data.rate_bounds[robot], data.speed_bounds[robot], steps)
        limited_quantities(states[robot], data.previous_inputs[robot], data.step_s, quantities)
        for row in range(len(bounds)):
            high[robot, row] = max(bounds[row] - quantities[row], 0.0)
            low[robot, row] = min(-bounds[row] - quantities[row], 0.0)
        for c in range(2):
            lowest, highest = data.first_inputs[robot, 0, c], data.first_inputs[robot, 1, c]
            if math.isfinite(lowest) and math.isfinite(highest):
                row, more = c * steps, NARROWEST * data.rate_bounds[robot, c] - 0.5 * (highest - lowest)
                lowest, highest = lowest - max(more, 0.0), highest + max(more, 0.0)
                high[robot, row] = max(min(high[robot, row], highest - quantities[row]), 0.0)
                low[robot, row] = min(max(low[robot, row], lowest - quantities[row]), 0.0)
    return Program(
        2.0 * data.weights[:, :2],
        blocks_of(states, data.goals, data.weights, forces, data.step_s),
        gradient_of(states, data.goals, data.weights, jacobian),
        jacobian,
        low,
        high,
        rows_about(states, data.obstacles, data.safety_distances, data.sides, data.area),
        forces,
        penalty,
        data.step_s,
    )


@kernel
def merit_of(data: Data, states: Array, price: float) -> float:
    """Cost plus the price of all violations a metre."""
    violation, _ = violations_of(states, data.obstacles, data.safety_distances, data.sides, data.area)
    return cost_of(states, data.goals, data.weights) + price * violation


@kernel
def improve(
    data: Data,
    states: Array,
    forces: Array,
    limit_multipliers: Array,
    penalty: float,
    tolerance: float,
    stages: int,
) -> Improvement:
    """One step: write the quadratic program about a trajectory, solve it and follow its solution.

    Args:
        data: the problem.
        states: a trajectory within the limits, shape (M, K + 1, 4).
        forces: constraint forces to expect, shape (M, K + 1, 2).
        limit_multipliers: multipliers of the limits to expect, shape (2, M, 5K).
        penalty: price of a violated metre in the quadratic program.
        tolerance: of its optimality conditions.
        stages: of so many, from stage 1 on, the sensitivities to the goals are wanted.
    """
    program = program_about(data, states, forces, penalty)
    outcome = solve_program(program, limit_multipliers, tolerance)
    if not outcome.solved:  # where limits leave no room, limit_multipliers have no bound and are no start
        outcome = solve_program(program, np.zeros_like(limit_multipliers), tolerance)
    if not outcome.solved:
        nothing = np.zeros((2 * len(states), len(states), stages, 4))
        return Improvement(states, forces, limit_multipliers, 0.0, nothing, False)
    there, promised = _followed(data, program, states, outcome)
    by_goal = sensitivities(program, outcome, stages)
    return Improvement(there, outcome.forces, outcome.limit_multipliers, promised, by_goal, True)


@kernel
def _followed(data: Data, program: Program, states: Array, outcome: Outcome) -> tuple[Array, float]:
    """Go as far along a change as it brings enough decrease of the merit, on true rollouts.

    The merit's price of violations is twice the largest force: enough for the change to lead downhill, and no
    more, since a higher price shortens steps along curved boundaries.
    """
    price = LEAST_PRICE + 2.0 * outcome.largest_multiplier
    violation, _ = violations_of(states, data.obstacles, data.safety_distances, data.sides, data.area)
    merit = cost_of(states, data.goals, data.weights) + price * violation
    increase, left = _modelled(program, outcome.change)
    promised = price * (violation - left) - increase
    share = 1.0
    while share >= SHORTEST:
        there = moved(states, outcome.change, share, data.step_s)
        if merit_of(data, there, price) <= merit - SUFFICIENT * share * promised:
            return there, promised / (1.0 + merit)
        share *= 0.5
    return states, 0.0


@kernel
def _modelled(program: Program, change: Array) -> tuple[float, float]:
    """Of a change, by the program: the increase of the cost, gᵀd + ½ dᵀHd, and the violation left, in m."""
    robots, size = change.shape
    shifts, gaps = np.empty((robots, size // 2 + 1, 2)), np.empty(len(program.rows.gap))
    increase, left = 0.0, 0.0
    for robot in range(robots):
        displacements(program.jacobian[robot], change[robot], shifts[robot])
        for c in range(2):
            increase += 0.5 * (program.weights[:, c] * shifts[robot, :, c] ** 2).sum()
        increase += (program.gradients[robot] * change[robot]).sum()
        for slot in range(0, size, 2):
            block = program.blocks[robot, slot // 2]
            heading, speed = change[robot, slot], change[robot, slot + 1]
            increase += 0.5 * (block[0] * heading + 2.0 * block[1] * speed) * heading
            increase += 0.5 * block[2] * speed * speed
    gaps_after(program.rows, shifts, gaps)
    for gap in gaps:
        left += max(-gap, 0.0)
    return increase, left


@kernel
def response(program: Program, outcome: Outcome, gradients: Array) -> Array:
    """How the solution changes with the gradients, to first order and as long as the same rows are tight.

    Args:
        program: that was solved.
        outcome: its solution.
        gradients: changes of the gradients, shape (M, n).

    Returns:
        The change of d, shape (M, n).
    """
    system, count = outcome.system, len(outcome.active)
    result, rows = -gradients, np.zeros(count)
    for robot in range(len(result)):
        solve_stages_transposed(system.factors[robot], program.jacobian[robot], 0, result[robot])
    solve_schur(program, outcome.active, system, rows, result)
    for robot in range(len(result)):
        solve_stages(system.factors[robot], program.jacobian[robot], result[robot])
    return result


@kernel
def sensitivities(program: Program, outcome: Outcome, stages: int) -> Array:
    """∂x_k/∂L of the states of so many stages, from 1 on, by the positions of all goals (x_0, y_0, x_1, …).

    By the implicit function theorem: with L, the gradient of the cost changes by −2Q, summed over the
    positions of all stages. It holds as long as the same constraints are tight, with the program's Hessian.

    Returns:
        Shape (2M, M, stages, 4).
    """
    robots, size = program.gradients.shape
    steps = size // 2
    result = np.zeros((2 * robots, robots, stages, 4))
    if stages == 0:
        return result
    pull, shifts = np.zeros((steps + 1, 2)), np.zeros((steps + 1, 2))
    for goal in range(2 * robots):
        gradients = np.zeros((robots, size))
        pull[:] = 0.0
        pull[:, goal % 2] = -program.weights[:, goal % 2]
        pull_back(program.jacobian[goal // 2], pull, gradients[goal // 2])
        changes = response(program, outcome, gradients)
        for robot in range(robots):
            displacements(program.jacobian[robot], changes[robot], shifts)
            for k in range(1, stages + 1):
                slot = 2 * (steps - k)
                result[goal, robot, k - 1, :2] = shifts[k]
                result[goal, robot, k - 1, 2:] = changes[robot, slot : slot + 2]
    return result
