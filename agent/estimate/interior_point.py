"""Eq. 6 solved by a primal-dual interior-point method (Mehrotra's predictor and corrector).

With multipliers s of λ ≥ 0, and y of the stationarity equations, two a stage, the solution fulfils the latter
and, G_L being the change of the cost's gradient with L,

    2λ_k + 2 C_k C_kᵀ λ_k + G_k y = s_k,    λ∘s = 0,    2ν + S_K y = 0,    2W (L − x_t) + G_Lᵀ y = 0.

Newton's method on these equations, with λ∘s going to zero from above, eliminates λ_k and s_k: their matrix is
diagonal but for one term of rank one, from complementarity. Equations for y and L are left, which
``linear_quadratic`` solves. The solution is proportional to the cost, so that the cost can be scaled to one.
"""

from typing import NamedTuple

import numpy as np

from agent.estimate.inverse_problem import InverseProblem, add_loads, slopes, stage_costs
from agent.estimate.linear_quadratic import (
    COORDINATES,
    GOAL,
    INPUT,
    P_X,
    Drive,
    Recursion,
    drive_through,
    empty_stage_costs,
    factorise,
    solve,
)
from agent.solve.compiled import kernel
from agent.solve.vehicle import Array

FIRST_MULTIPLIER, FIRST_SLACK = 0.02, 0.5
COMPLEMENTARITY = 1e-13
"""Mean of λ∘s at which the problem counts as solved; L is then exact to 1e-7 m even where W alone decides."""
INFEASIBILITY = 1e-10
"""Share of the first residuals at which the equations count as fulfilled."""
STEP_SHARE = 0.995
"""Of the way to the nearest λ or s that would become zero; more of it near the solution."""


class InverseSolution(NamedTuple):
    """The solution of eq. 6."""

    goal_offset: Array
    """L − x_t in p_x, p_y, ψ, shape (3,)."""
    multipliers: Array
    """λ, shape (K, n)."""
    terminal_multipliers: Array
    """ν, shape (4,)."""
    stationarity_multipliers: Array
    """y, shape (K, 2)."""
    solved: bool


class _Iteration(NamedTuple):
    """Where the iteration stands, its direction, and the equations for that; (K, n) unless said otherwise."""

    multipliers: Array
    slacks: Array
    coordinates: Array
    """y and L − x_t, and the changes of state that y means (``linear_quadratic``), shape (K + 1, 11)."""
    multiplier_steps: Array
    slack_steps: Array
    coordinate_steps: Array
    targets: Array
    """Wanted value of δs + (s/λ) δλ."""
    slopes: Array
    """G_k y, or G_k δy."""
    residuals: Array
    """2λ_k + 2 C_k C_kᵀ λ_k + G_k y − s_k."""
    inverses: Array
    """1 / λ."""
    compliances: Array
    """1 / (2 + s/λ)."""
    couplings: Array
    """1 / (½ + C_kᵀ diag(compliances) C_k), shape (K,)."""
    loads: Array
    """Residual of the stationarity equations by the coordinates of each stage, shape (K, 11)."""


@kernel
def solve_inverse(problem: InverseProblem, iterations: int) -> InverseSolution:
    """Solve eq. 6; unsolved where anything is not finite or the iterations do not suffice.

    Args:
        problem: of a robot.
        iterations: how many are allowed; 11 are usual, 20 rare.
    """
    stages, each = problem.values.shape
    drive = drive_through(problem.states, problem.step_s, problem.weights, problem.nearness)
    costs = empty_stage_costs(stages)
    cost_loads, scale = _cost_loads(problem)
    it = _start(stages, each)
    infeasibility = 1.0
    solved = False
    for _ in range(iterations):
        product = _mean_product(it)
        solved = infeasibility < INFEASIBILITY and product < COMPLEMENTARITY
        if solved or not np.isfinite(product):
            break
        _weigh(problem, it)
        _write_residuals(problem, it)
        stage_costs(problem, it.compliances, it.couplings, costs)
        recursion = factorise(drive, costs)
        _write_loads(problem, cost_loads, it)
        _find_direction(problem, drive, recursion, it)
        _correct(it, product)
        _find_direction(problem, drive, recursion, it)
        step = min(1.0, max(STEP_SHARE, 1.0 - 10.0 * product) * _longest_step(it))
        _move(it, step)
        infeasibility *= 1.0 - step
    return InverseSolution(
        goal_offset=it.coordinates[0, GOAL : GOAL + 3] * scale,
        multipliers=it.multipliers * scale,
        terminal_multipliers=it.coordinates[stages, P_X : P_X + 4] * (-0.5 * scale),
        stationarity_multipliers=it.coordinates[:stages, INPUT:] * scale,
        solved=solved,
    )


@kernel
def _start(stages: int, each: int) -> _Iteration:
    rows, coordinates = (stages, each), (stages + 1, COORDINATES)
    return _Iteration(
        multipliers=np.full(rows, FIRST_MULTIPLIER),
        slacks=np.full(rows, FIRST_SLACK),
        coordinates=np.zeros(coordinates),
        multiplier_steps=np.empty(rows),
        slack_steps=np.empty(rows),
        coordinate_steps=np.zeros(coordinates),
        targets=np.empty(rows),
        slopes=np.empty(rows),
        residuals=np.empty(rows),
        inverses=np.empty(rows),
        compliances=np.empty(rows),
        couplings=np.empty(stages),
        loads=np.empty((stages, COORDINATES)),
    )


@kernel
def _cost_loads(problem: InverseProblem) -> tuple[Array, float]:
    """2Q (x_k − L) with L = x_t as loads (K, 11), the largest of them scaled to one, and that scale."""
    states = problem.states
    stages = len(states) - 1
    loads, scale = np.zeros((stages, COORDINATES)), 0.0
    for k in range(stages):
        for j in range(4):
            away = states[k, j] - states[stages, j] if j < 3 else states[k, j]
            loads[k, P_X + j] = 2.0 * problem.weights[j] * away
            scale = max(scale, abs(loads[k, P_X + j]))
    if scale > 0.0:
        loads /= scale
    return loads, scale


@kernel
def _mean_product(it: _Iteration) -> float:
    """The mean of λ∘s."""
    total = 0.0
    for k in range(len(it.couplings)):
        multipliers, slacks = it.multipliers[k], it.slacks[k]
        for i in range(len(slacks)):
            total += multipliers[i] * slacks[i]
    return total / it.slacks.size


@kernel
def _weigh(problem: InverseProblem, it: _Iteration) -> None:
    """Write what the inverse of the matrix of δλ is made of (``_respond``)."""
    for k in range(len(it.couplings)):
        multipliers, slacks = it.multipliers[k], it.slacks[k]
        inverses, compliances = it.inverses[k], it.compliances[k]
        for i in range(len(slacks)):
            # One division for both: divisions take longer than all else here.
            denominator = 2.0 * multipliers[i] + slacks[i]
            inverse = 1.0 / (multipliers[i] * denominator)
            inverses[i] = denominator * inverse
            compliances[i] = multipliers[i] * multipliers[i] * inverse
    for k in range(len(it.couplings)):
        values, compliances = problem.values[k], it.compliances[k]
        total = 0.5
        for i in range(len(values)):
            total += compliances[i] * values[i] ** 2
        it.couplings[k] = 1.0 / total


@kernel
def _write_residuals(problem: InverseProblem, it: _Iteration) -> None:
    """Write the residuals, and λ∘s = 0 as the target."""
    slopes(problem, it.coordinates, it.slopes)
    for k in range(len(it.couplings)):
        values, multipliers, slacks = problem.values[k], it.multipliers[k], it.slacks[k]
        change, residuals, targets = it.slopes[k], it.residuals[k], it.targets[k]
        complementarity = 0.0
        for i in range(len(values)):
            complementarity += multipliers[i] * values[i]
        for i in range(len(values)):
            slope = 2.0 * (multipliers[i] + complementarity * values[i]) + change[i]
            residuals[i] = slope - slacks[i]
        for i in range(len(values)):
            targets[i] = -slacks[i]


@kernel
def _write_loads(problem: InverseProblem, cost_loads: Array, it: _Iteration) -> None:
    """Write the residual of the stationarity equations, except for the part of ν, which acts at the end."""
    for k in range(len(it.loads)):
        for j in range(COORDINATES):
            it.loads[k, j] = cost_loads[k, j]
        for j in range(3):
            it.loads[k, P_X + j] -= 2.0 * problem.weights[j] * it.coordinates[0, GOAL + j]
    add_loads(problem, it.multipliers, it.loads)


@kernel
def _find_direction(problem: InverseProblem, drive: Drive, recursion: Recursion, it: _Iteration) -> None:
    """Newton's direction for the targets."""
    it.slopes.fill(0.0)
    _respond(problem, it)
    loads, end = it.loads.copy(), np.zeros(COORDINATES)
    add_loads(problem, it.multiplier_steps, loads)
    for j in range(P_X, P_X + 4):
        end[j] = -0.5 * it.coordinates[len(loads), j]
    solve(drive, recursion, loads, end, it.coordinate_steps)
    slopes(problem, it.coordinate_steps, it.slopes)
    _respond(problem, it)


@kernel
def _respond(problem: InverseProblem, it: _Iteration) -> None:
    """δλ and δs for given G_k δy: (diag(2 + s/λ) + 2 C_k C_kᵀ) δλ_k = targets − residuals − G_k δy.

    The inverse is that of Sherman and Morrison.
    """
    for k in range(len(it.couplings)):
        values, targets, residuals, change = problem.values[k], it.targets[k], it.residuals[k], it.slopes[k]
        slacks, inverses, compliances = it.slacks[k], it.inverses[k], it.compliances[k]
        multiplier_steps, slack_steps = it.multiplier_steps[k], it.slack_steps[k]
        total = 0.0
        for i in range(len(values)):
            total += values[i] * compliances[i] * (targets[i] - residuals[i] - change[i])
        total *= it.couplings[k]
        for i in range(len(values)):
            force = targets[i] - residuals[i] - change[i] - values[i] * total
            multiplier_steps[i] = compliances[i] * force
        for i in range(len(values)):
            slack_steps[i] = targets[i] - slacks[i] * inverses[i] * multiplier_steps[i]


@kernel
def _correct(it: _Iteration, product: float) -> None:
    """Aim at a mean of λ∘s that the prediction shows to be in reach, and allow for the δλ∘δs it neglected."""
    step = min(1.0, _longest_step(it))
    total = 0.0
    for k in range(len(it.couplings)):
        multipliers, multiplier_steps = it.multipliers[k], it.multiplier_steps[k]
        slacks, slack_steps = it.slacks[k], it.slack_steps[k]
        for i in range(len(slacks)):
            total += (multipliers[i] + step * multiplier_steps[i]) * (slacks[i] + step * slack_steps[i])
    aim = product * (total / it.slacks.size / product) ** 3
    for k in range(len(it.couplings)):
        inverses, multiplier_steps = it.inverses[k], it.multiplier_steps[k]
        slack_steps, targets = it.slack_steps[k], it.targets[k]
        for i in range(len(targets)):
            targets[i] += (aim - multiplier_steps[i] * slack_steps[i]) * inverses[i]


@kernel
def _longest_step(it: _Iteration) -> float:
    """The step at which the first λ or s becomes zero; infinite if none does.

    Without branches: towards the end most of them approach zero at nearly the same rate.
    """
    fastest = np.zeros(it.slacks.shape[1])
    for k in range(len(it.couplings)):
        inverses, multiplier_steps = it.inverses[k], it.multiplier_steps[k]
        slacks, slack_steps = it.slacks[k], it.slack_steps[k]
        for i in range(len(fastest)):
            rate = -multiplier_steps[i] * inverses[i]
            fastest[i] = rate if rate > fastest[i] else fastest[i]
        for i in range(len(fastest)):
            rate = -slack_steps[i] / slacks[i]
            fastest[i] = rate if rate > fastest[i] else fastest[i]
    return float(1.0 / fastest.max())


@kernel
def _move(it: _Iteration, step: float) -> None:
    for k in range(len(it.couplings)):
        for i in range(it.slacks.shape[1]):
            it.multipliers[k, i] += step * it.multiplier_steps[k, i]
            it.slacks[k, i] += step * it.slack_steps[k, i]
    for k in range(len(it.coordinates)):
        for j in range(COORDINATES):
            it.coordinates[k, j] += step * it.coordinate_steps[k, j]
