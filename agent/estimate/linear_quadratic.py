"""The linear-quadratic problem inside every iteration on eq. 6, solved by a Riccati recursion.

The multipliers y of the stationarity equations enter eq. 6 like a change of the inputs U: S_k y is the change
of the state x_k to first order, G_k y that of the constraints C_k. The equations of an iteration,

    H δy − G_L δL = …,   −G_Lᵀ δy − 2W δL = …   with  H = ½ S_Kᵀ S_K + Σ_k G_kᵀ E_k G_k,  G_L = −2 Σ_k S_kᵀ Q,

are therefore those of a control problem along the linearised drive, with stage costs E_k, a terminal cost of
½ and L as a parameter, in which it is concave. Inputs are eliminated stage by stage, the last one first.

The coordinates of a stage are changes of the goal, of its state, of the input before, and of its own input:
(L_x, L_y, L_ψ, p_x, p_y, ψ, v, ω before, a before, ω, a).
"""

from typing import NamedTuple

import numpy as np

from agent.solve.compiled import kernel
from agent.solve.vehicle import Array

GOAL, P_X, P_Y, HEADING, SPEED, BEFORE, INPUT = 0, 3, 4, 5, 6, 7, 9
COORDINATES = 11
QUANTITIES = 7
"""Limited from both sides: p_x, p_y, v, ω, a, and the rates of change of ω and a."""
LEAST_CURVATURE = 1e-10
"""Added along every input, since H is singular where too few limits explain anything."""


class Drive(NamedTuple):
    """Eq. 8 linearised along the observed stretch, and the weights of the goal."""

    motion: Array
    """How p_x and p_y of the next state change with ψ, then with v, shape (K, 4)."""
    step_s: float
    weights: Array
    """Diagonal of Q, shape (4,)."""
    nearness: Array
    """Diagonal of W, shape (3,)."""


class StageCosts(NamedTuple):
    """E_k in the limited quantities: diag(squares) + product in p_x p_y − rank_one rank_oneᵀ."""

    squares: Array
    """Shape (K, 7)."""
    product: Array
    """Shape (K,)."""
    rank_one: Array
    """Shape (K, 7)."""


class Recursion(NamedTuple):
    """The equations with inputs and goal eliminated, for solving them with any right-hand side."""

    gains: Array
    """How each input, the last one first, depends on the coordinates before it, shape (K, 2, 10)."""
    curvatures: Array
    """Along each of them, shape (K, 2)."""
    goal_gains: Array
    """The same for the goal, L_ψ first, shape (3, 10)."""
    goal_curvatures: Array
    """Shape (3,), negative."""


@kernel
def drive_through(states: Array, step_s: float, weights: Array, nearness: Array) -> Drive:
    """The linearised drive through observed states of shape (K + 1, 4).

    ψ turns a step as it was observed, v stretches it along ψ.
    """
    motion = np.empty((len(states) - 1, 4))
    for k in range(len(motion)):
        motion[k, 0] = states[k, 1] - states[k + 1, 1]
        motion[k, 1] = states[k + 1, 0] - states[k, 0]
        motion[k, 2] = step_s * np.cos(states[k, 2])
        motion[k, 3] = step_s * np.sin(states[k, 2])
    return Drive(motion, step_s, weights, nearness)


@kernel
def empty_stage_costs(stages: int) -> StageCosts:
    """Room for the costs of so many stages."""
    return StageCosts(np.empty((stages, QUANTITIES)), np.empty(stages), np.empty((stages, QUANTITIES)))


@kernel
def quantities(coordinates: Array, step_s: float, out: Array) -> None:
    """The limited quantities of a stage, into ``out`` (7,)."""
    out[0], out[1], out[2] = coordinates[P_X], coordinates[P_Y], coordinates[SPEED]
    for j in range(2):
        out[3 + j] = coordinates[INPUT + j]
        out[5 + j] = (coordinates[INPUT + j] - coordinates[BEFORE + j]) / step_s


@kernel
def add_quantities(loads: Array, step_s: float, out: Array) -> None:
    """The transpose of ``quantities``: add loads (7,) on the quantities to those on coordinates (11,)."""
    out[P_X] += loads[0]
    out[P_Y] += loads[1]
    out[SPEED] += loads[2]
    for j in range(2):
        rate = loads[5 + j] / step_s
        out[INPUT + j] += loads[3 + j] + rate
        out[BEFORE + j] -= rate


@kernel
def advance(motion: Array, step_s: float, now: Array, ahead: Array) -> None:
    """The coordinates of the next stage but its input, into ``ahead``, from those of one with this motion."""
    ahead[P_X] = now[P_X] + motion[0] * now[HEADING] + motion[2] * now[SPEED]
    ahead[P_Y] = now[P_Y] + motion[1] * now[HEADING] + motion[3] * now[SPEED]
    for j in range(2):
        ahead[HEADING + j] = now[HEADING + j] + step_s * now[INPUT + j]
        ahead[BEFORE + j] = now[INPUT + j]
    for j in range(GOAL, GOAL + 3):
        ahead[j] = now[j]


@kernel
def pull_back(motion: Array, step_s: float, loads: Array) -> None:
    """The transpose of ``advance``: make loads on the next stage, none on its input, those on this one."""
    for j in range(2):
        loads[INPUT + j] = step_s * loads[HEADING + j] + loads[BEFORE + j]
        loads[BEFORE + j] = 0.0
    loads[HEADING] += motion[0] * loads[P_X] + motion[1] * loads[P_Y]
    loads[SPEED] += motion[2] * loads[P_X] + motion[3] * loads[P_Y]


@kernel
def factorise(drive: Drive, costs: StageCosts) -> Recursion:
    """Eliminate all inputs, then the goal."""
    stages = len(drive.motion)
    recursion = Recursion(
        np.empty((stages, 2, COORDINATES - 1)),
        np.empty((stages, 2)),
        np.empty((3, COORDINATES - 1)),
        np.empty(3),
    )
    # Symmetric, but for the goal's rows, of which nothing beyond the goal itself is ever used.
    matrix, vector = np.zeros((COORDINATES, COORDINATES)), np.empty(COORDINATES)
    for j in range(3):
        matrix[GOAL + j, GOAL + j] = -2.0 * drive.nearness[j]
    for j in range(P_X, P_X + 4):
        matrix[j, j] = 0.5
    for k in range(stages - 1, -1, -1):
        motion = drive.motion[k]
        for i in range(P_X, INPUT):
            pull_back(motion, drive.step_s, matrix[i])
        for j in range(COORDINATES):
            pull_back(motion, drive.step_s, matrix[:, j])
        _add_stage_cost(drive, costs, k, matrix, vector)
        for j in range(2):
            last = INPUT + 1 - j
            recursion.curvatures[k, j] = _eliminate(matrix, last, recursion.gains[k, j])
    for j in range(3):
        recursion.goal_curvatures[j] = _eliminate(matrix, GOAL + 2 - j, recursion.goal_gains[j])
    return recursion


@kernel
def _add_stage_cost(drive: Drive, costs: StageCosts, k: int, matrix: Array, vector: Array) -> None:
    """Add E_k and, from −G_L, the coupling 2Q of state and goal."""
    for j in range(3):
        matrix[P_X + j, GOAL + j] += 2.0 * drive.weights[j]
    squares = costs.squares[k]
    matrix[P_X, P_X] += squares[0]
    matrix[P_Y, P_Y] += squares[1]
    matrix[P_X, P_Y] += costs.product[k]
    matrix[P_Y, P_X] += costs.product[k]
    matrix[SPEED, SPEED] += squares[2]
    for j in range(2):
        now, before = INPUT + j, BEFORE + j
        rate = squares[5 + j] / drive.step_s**2
        matrix[now, now] += squares[3 + j] + rate + LEAST_CURVATURE
        matrix[before, before] += rate
        matrix[now, before] -= rate
        matrix[before, now] -= rate
    vector.fill(0.0)
    add_quantities(costs.rank_one[k], drive.step_s, vector)
    for i in range(P_X, COORDINATES):
        row, share = matrix[i], vector[i]
        for j in range(P_X, COORDINATES):
            row[j] -= share * vector[j]


@kernel
def _eliminate(matrix: Array, last: int, gains: Array) -> float:
    """Take coordinate ``last`` out of those before it; returns the curvature along it."""
    pivot_row = matrix[last]
    inverse = 1.0 / pivot_row[last]
    for i in range(last):
        gains[i] = pivot_row[i] * inverse
    for i in range(last):
        row, share = matrix[i], gains[i]
        for j in range(last):
            row[j] -= share * pivot_row[j]
    return float(pivot_row[last])


@kernel
def solve(drive: Drive, recursion: Recursion, loads: Array, end: Array, changes: Array) -> None:
    """Solve the equations for a right-hand side.

    Args:
        drive: of K stages.
        recursion: from ``factorise``.
        loads: right-hand side by the coordinates of each stage, shape (K, 11).
        end: by those of the last state, shape (11,); destroyed.
        changes: receives the coordinates of each stage, shape (K + 1, 11).
    """
    stages = len(loads)
    for k in range(stages - 1, -1, -1):
        pull_back(drive.motion[k], drive.step_s, end)
        for j in range(COORDINATES):
            end[j] += loads[k, j]
        for j in range(2):
            last = INPUT + 1 - j
            changes[k, last] = _reduce(end, last, recursion.gains[k, j], recursion.curvatures[k, j])
    now = changes[0]
    for j in range(P_X, INPUT):
        now[j] = 0.0
    for j in range(3):
        last = GOAL + 2 - j
        now[last] = _reduce(end, last, recursion.goal_gains[j], recursion.goal_curvatures[j])
    for j in range(2, -1, -1):
        _substitute(now, GOAL + 2 - j, recursion.goal_gains[j])
    for k in range(stages):
        for j in range(1, -1, -1):
            _substitute(changes[k], INPUT + 1 - j, recursion.gains[k, j])
        advance(drive.motion[k], drive.step_s, changes[k], changes[k + 1])


@kernel
def _reduce(loads: Array, last: int, gains: Array, curvature: float) -> float:
    """Take coordinate ``last`` out of the loads; returns its value where all before it are zero."""
    load = loads[last]
    for i in range(last):
        loads[i] -= gains[i] * load
    return float(load / curvature)


@kernel
def _substitute(coordinates: Array, last: int, gains: Array) -> None:
    """Complete the value of coordinate ``last`` by those before it."""
    value = coordinates[last]
    for i in range(last):
        value -= gains[i] * coordinates[i]
    coordinates[last] = value
