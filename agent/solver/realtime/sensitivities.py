"""How the solution of the joint problem moves with the goals: the implicit function theorem on its last program."""

import numpy as np

from agent.compiled import kernel
from agent.solver.realtime.interior_point import Outcome, Program, respond
from agent.solver.realtime.profiles import displacements, pull_back
from agent.solver.realtime.sequential import Data, followed, program_about, solve_from
from agent.vehicle import Array


@kernel
def improve_and_respond(
    data: Data, states: Array, forces: Array, pressures: Array, penalty: float, tolerance: float, stages: int
) -> tuple[Array, Array, Array, Array, bool]:
    """One step as ``sequential.improve`` takes it, and the sensitivities of the solution to the goals.

    Args:
        data: the problem.
        states: a trajectory within the limits, shape (M, K + 1, 4).
        forces: constraint forces to expect, shape (M, K + 1, 2).
        pressures: multipliers of the limits to expect, shape (2, M, 5K).
        penalty: price of a violated metre.
        tolerance: of the quadratic program's optimality conditions.
        stages: how many are wanted from stage 1 on.

    Returns:
        The new states, forces and pressures; the derivatives of the states of the wanted stages by the goal
        positions of all robots, shape (2M, M, stages, 4); whether the quadratic program was solved.
    """
    robots = len(states)
    program = program_about(data, states, forces, penalty)
    outcome = solve_from(program, pressures, tolerance)
    if not outcome.solved:
        return states, forces, pressures, np.zeros((2 * robots, robots, stages, 4)), False
    there, _ = followed(data, program, states, outcome)
    return there, outcome.forces, outcome.pressures, _sensitivities(program, outcome, stages), True


@kernel
def _sensitivities(program: Program, outcome: Outcome, stages: int) -> Array:
    """∂x_k/∂L: the gradient of the cost changes with L by −2Q, summed over the positions of all stages."""
    robots, size = program.gradients.shape
    steps = size // 2
    result = np.zeros((2 * robots, robots, stages, 4))
    pull, shifts = np.zeros((steps + 1, 2)), np.zeros((steps + 1, 2))
    for goal in range(2 * robots):
        gradients = np.zeros((robots, size))
        pull[:] = 0.0
        pull[:, goal % 2] = -program.weights[goal % 2]
        pull_back(program.arms[goal // 2], pull, gradients[goal // 2])
        changes = respond(program, outcome, gradients)
        for robot in range(robots):
            displacements(program.arms[robot], changes[robot], shifts)
            for k in range(1, stages + 1):
                slot = 2 * (steps - k)
                result[goal, robot, k - 1, :2] = shifts[k]
                result[goal, robot, k - 1, 2:] = changes[robot, slot : slot + 2]
    return result
