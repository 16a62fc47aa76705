"""Eq. 6 of a robot, written down from the states that were observed of everybody.

    min Σ λ² + ‖ν‖² + Σ_k (λ_kᵀ C_k)² + (L − x_t)ᵀ W (L − x_t)   over L, λ ≥ 0, ν
    subject to  Σ_k S_kᵀ 2Q (x_k − L) + Σ_k G_kᵀ λ_k + S_Kᵀ ν = 0     with S = ∂x/∂U, G = ∂C/∂U

Every stage has the same constraints C_k ≤ 0 (eqs. 9 and 10), negative inside. First q − highest and lowest −
q for each of seven quantities q: p_x, p_y, v, ω, a, and the rates of change of ω and a, all in their physical
units (table 1). Then d − ‖p − p_j‖ for every other robot j, empty while j was not seen. All of them depend on
the inputs through q alone, so that G is never written out.
"""

import math
from collections.abc import Sequence
from functools import lru_cache, partial
from typing import NamedTuple

import numpy as np

from agent.estimate.linear_quadratic import QUANTITIES, StageCosts, add_quantities, quantities
from agent.remember.memory import Memory
from agent.solve.compiled import kernel
from agent.solve.vehicle import Array
from protocol.scene import Scene

NEARNESS = np.array([1e-6, 1e-6, 1.0])
"""Diagonal of W, in m⁻², m⁻² and rad⁻². Among positions that explain a stretch equally well, such as those
beside the path of a robot that stands, the nearest is taken. The heading needs more: its small weight in the
cost would otherwise let goals many turns away explain every bend."""
FIRST_DISTANCE = 2 * QUANTITIES
"""Row of the first distance."""


class InverseProblem(NamedTuple):
    """What eq. 6 needs to know of a robot over K = K_E steps; n rows a stage."""

    states: Array
    """Observed, shape (K + 1, 4), the last one present."""
    values: Array
    """C_k, shape (K, n)."""
    bearings: Array
    """Unit vectors from the other robots, shape (K, n − 14, 2); zero where nothing was seen."""
    weights: Array
    """Diagonal of Q, shape (4,)."""
    nearness: Array
    """Diagonal of W, shape (3,)."""
    step_s: float


class InverseProblems:
    """Writes eq. 6 for every robot that was seen for long enough."""

    def __init__(self, scene: Scene) -> None:
        self._stages = scene.horizons.estimation_steps
        self._step_s = scene.step_s
        self._weights = np.array(scene.weights.as_tuple())
        self._rules = lru_cache(maxsize=8)(partial(_rules, scene))

    def of(self, memory: Memory) -> dict[str, InverseProblem]:
        """The problems of all robots seen at K + 1 consecutive steps up to now.

        Rates at the first stage need the input before it, from one more state; a robot not seen then is taken
        to have driven without input.
        """
        robots = memory.robots
        limits, distances = self._rules(tuple(robots))
        tracks = [memory.states(robot, self._stages + 2) for robot in robots]
        seen = np.array([len(track) for track in tracks])
        window = np.empty((len(robots), self._stages + 2, 4))
        for states, track in zip(window, tracks, strict=True):
            states[-len(track) :] = track
            states[: -len(track)] = track[0]
        problems = {}
        for index, robot in enumerate(robots):
            if seen[index] > self._stages:
                values, bearings = _rows(window, seen, index, limits[index], distances[index], self._step_s)
                problems[robot] = InverseProblem(
                    window[index, 1:], values, bearings, self._weights, NEARNESS, self._step_s
                )
        return problems


def _rules(scene: Scene, robots: Sequence[str]) -> tuple[Array, Array]:
    """Lowest and highest value of each quantity, shape (N, 2, 7), and safety distances, shape (N, N)."""
    area = scene.area
    limits = []
    for robot in robots:
        own = scene.robot(robot).limits
        symmetric = [
            own.speed_mps,
            own.turn_rate_radps,
            own.acceleration_mps2,
            own.turn_acceleration_radps2,
            own.jerk_mps3,
        ]
        lowest = [area.x_min_m, area.y_min_m, *(-bound for bound in symmetric)]
        limits.append([lowest, [area.x_max_m, area.y_max_m, *symmetric]])
    return np.array(limits), np.array(scene.safety_distances_m(robots, robots))


@kernel
def _rows(
    window: Array, seen: Array, robot: int, limits: Array, distances: Array, step_s: float
) -> tuple[Array, Array]:
    """C_k and bearings of one robot.

    Args:
        window: states of all robots, shape (N, K + 2, 4), the last one present.
        seen: how many of them were observed, shape (N,).
        robot: index of the robot.
        limits: lowest and highest quantities, shape (2, 7).
        distances: d to each robot, shape (N,).
        step_s: Δt.
    """
    states = window[robot]
    stages, others = len(states) - 2, len(window) - 1
    values = np.zeros((stages, FIRST_DISTANCE + others))
    bearings = np.zeros((stages, others, 2))
    drive = np.empty(QUANTITIES)
    for k in range(stages):
        before, now, ahead = states[k], states[k + 1], states[k + 2]
        drive[0], drive[1], drive[2] = now[0], now[1], now[3]
        for j in range(2):
            drive[3 + j] = (ahead[2 + j] - now[2 + j]) / step_s
            drive[5 + j] = (drive[3 + j] - (now[2 + j] - before[2 + j]) / step_s) / step_s
        for j in range(QUANTITIES):
            values[k, 2 * j] = drive[j] - limits[1, j]
            values[k, 2 * j + 1] = limits[0, j] - drive[j]
        for i in range(others):
            other = i if i < robot else i + 1
            if k + 1 >= stages + 2 - seen[other]:
                gap_x, gap_y = now[0] - window[other, k + 1, 0], now[1] - window[other, k + 1, 1]
                length = math.hypot(gap_x, gap_y)
                values[k, FIRST_DISTANCE + i] = distances[other] - length
                bearings[k, i, 0] = gap_x / max(length, 1e-9)
                bearings[k, i, 1] = gap_y / max(length, 1e-9)
    return values, bearings


@kernel
def add_loads(problem: InverseProblem, multipliers: Array, loads: Array) -> None:
    """Add G_kᵀ λ_k to the loads on the coordinates of each stage, shape (K, 11)."""
    on_quantities = np.empty(QUANTITIES)
    for k in range(len(multipliers)):
        row, bearings = multipliers[k], problem.bearings[k]
        for j in range(QUANTITIES):
            on_quantities[j] = row[2 * j] - row[2 * j + 1]
        for i in range(len(bearings)):
            on_quantities[0] -= row[FIRST_DISTANCE + i] * bearings[i, 0]
            on_quantities[1] -= row[FIRST_DISTANCE + i] * bearings[i, 1]
        add_quantities(on_quantities, problem.step_s, loads[k])


@kernel
def slopes(problem: InverseProblem, changes: Array, out: Array) -> None:
    """G_k y, into ``out`` (K, n), for the coordinates of each stage that y leads to, shape (K + 1, 11)."""
    change = np.empty(QUANTITIES)
    for k in range(len(out)):
        row, bearings = out[k], problem.bearings[k]
        quantities(changes[k], problem.step_s, change)
        for j in range(QUANTITIES):
            row[2 * j], row[2 * j + 1] = change[j], -change[j]
        for i in range(len(bearings)):
            row[FIRST_DISTANCE + i] = -bearings[i, 0] * change[0] - bearings[i, 1] * change[1]


@kernel
def stage_costs(problem: InverseProblem, compliances: Array, couplings: Array, costs: StageCosts) -> None:
    """G_kᵀ (diag(e_k) − s_k (e_k∘C_k)(e_k∘C_k)ᵀ) G_k in the limited quantities.

    Args:
        problem: C_k and G_k.
        compliances: e_k, shape (K, n).
        couplings: s_k, shape (K,).
        costs: receives the result.
    """
    for k in range(len(couplings)):
        e, values, bearings = compliances[k], problem.values[k], problem.bearings[k]
        squares, rank_one = costs.squares[k], costs.rank_one[k]
        for j in range(QUANTITIES):
            squares[j] = e[2 * j] + e[2 * j + 1]
            rank_one[j] = e[2 * j] * values[2 * j] - e[2 * j + 1] * values[2 * j + 1]
        product = 0.0
        for i in range(len(bearings)):
            share, x, y = e[FIRST_DISTANCE + i], bearings[i, 0], bearings[i, 1]
            squares[0] += share * x * x
            squares[1] += share * y * y
            product += share * x * y
            rank_one[0] -= share * values[FIRST_DISTANCE + i] * x
            rank_one[1] -= share * values[FIRST_DISTANCE + i] * y
        costs.product[k] = product
        root = math.sqrt(couplings[k])
        for j in range(QUANTITIES):
            rank_one[j] *= root
