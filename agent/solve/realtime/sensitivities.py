"""How the solution of the joint problem moves with the goals, by the factorisation of its last program."""

import numpy as np

from agent.solve.compiled import kernel
from agent.solve.realtime.kkt import Program, solve_schur
from agent.solve.realtime.profiles import displacements, pull_back
from agent.solve.realtime.qp import Outcome
from agent.solve.realtime.stagewise import solve_stages, solve_stages_transposed
from agent.solve.vehicle import Array


@kernel
def respond(program: Program, outcome: Outcome, gradients: Array) -> Array:
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
        pull[:, goal % 2] = -program.weights[goal % 2]
        pull_back(program.jacobian[goal // 2], pull, gradients[goal // 2])
        changes = respond(program, outcome, gradients)
        for robot in range(robots):
            displacements(program.jacobian[robot], changes[robot], shifts)
            for k in range(1, stages + 1):
                slot = 2 * (steps - k)
                result[goal, robot, k - 1, :2] = shifts[k]
                result[goal, robot, k - 1, 2:] = changes[robot, slot : slot + 2]
    return result
