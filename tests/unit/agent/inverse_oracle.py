"""Eq. 6 written down and solved in another way: CasADi differentiates eq. 2, PIQP solves it.

Nothing of the estimator is used but the weight with which it prefers near goals. The inputs U are the
variables here, where the estimator takes headings and speeds. What a noisy step was observed to do beside
the model turns with its heading.
"""

from dataclasses import dataclass
from functools import lru_cache

import casadi as ca
import numpy as np
from agent_helpers import STEP_S

from agent.estimate.inverse_optimal_control import NEARNESS
from agent.solve.vehicle import Array
from protocol.scene import Scene


@dataclass(frozen=True)
class DenseProblem:
    """min Σ λ² + ‖ν‖² + Σ_k (λ_kᵀ C_k)² + Lᵀ W L over L, the offset from the present pose, λ ≥ 0 and ν.

    Subject to by_goal·L + Σ_k gradients_kᵀ λ_k + terminalᵀ ν + slope = 0.
    """

    slope: Array
    """Gradient of the cost in U for a goal at the present pose, shape (2K,)."""
    by_goal: Array
    """Its change with L, shape (2K, 3)."""
    values: Array
    """C_k, shape (K, n)."""
    gradients: Array
    """∂C_k/∂U, shape (K, n, 2K)."""
    terminal: Array
    """∂x_K/∂U, shape (4, 2K)."""

    def residual(self, goal_offset: Array, multipliers: Array, terminal_multipliers: Array) -> Array:
        """What is missing to stationarity, shape (2K,)."""
        constraints = np.einsum("knu,kn->u", self.gradients, multipliers)
        return self.slope + self.by_goal @ goal_offset + constraints + self.terminal.T @ terminal_multipliers

    def objective(self, goal_offset: Array, multipliers: Array, terminal_multipliers: Array) -> float:
        complementarity = np.einsum("kn,kn->k", multipliers, self.values)
        squares = [multipliers, terminal_multipliers, complementarity, np.sqrt(NEARNESS) * goal_offset]
        return float(sum((each**2).sum() for each in squares))


def dense_problem(scene: Scene, tracks: dict[str, Array], robot: str) -> DenseProblem:
    """Eq. 6 of a robot from states (n, 4) of everybody up to the present, its own at least K_E + 1."""
    steps = scene.horizons.estimation_steps
    states = tracks[robot][-steps - 1 :]
    earlier = tracks[robot][-steps - 2 : -steps - 1]
    before = (states[0] - earlier[0])[2:] / STEP_S if len(earlier) else np.zeros(2)
    others = {other: track[-steps - 1 :] for other, track in sorted(tracks.items()) if other != robot}
    limits, area = scene.robot(robot).limits, scene.area
    headings, speeds = states[:-1, 2:].T
    directions = np.column_stack([np.cos(headings), np.sin(headings)])
    noise = np.diff(states[:, :2], axis=0) - STEP_S * speeds[:, None] * directions
    positions, seen = np.zeros((steps, len(others), 2)), np.zeros((steps, len(others)))
    for column, track in enumerate(others.values()):
        first = steps + 1 - len(track)
        positions[first:, column], seen[first:, column] = track[:-1, :2], 1.0
    results = _derivatives(steps, len(others))(
        np.diff(states[:, 2:], axis=0).T / STEP_S,
        states[-1, :3],
        states[0],
        headings,
        noise.T,
        before,
        positions.reshape(steps, -1).T,
        seen.T,
        [scene.safety_distance_m(robot, other) for other in others],
        [
            limits.speed_mps,
            limits.turn_rate_radps,
            limits.acceleration_mps2,
            limits.turn_acceleration_radps2,
            limits.jerk_mps3,
        ],
        [area.x_min_m, area.x_max_m, area.y_min_m, area.y_max_m],
        scene.weights.as_tuple(),
    )
    slope, by_goal, values, gradients, terminal = (each.full() for each in results)
    return DenseProblem(
        slope.ravel(), by_goal, values.reshape(steps, -1), gradients.reshape(steps, -1, 2 * steps), terminal
    )


@lru_cache
def _derivatives(steps: int, others: int) -> ca.Function:
    controls, goal = ca.SX.sym("U", 2, steps), ca.SX.sym("L", 3)
    state, before = ca.SX.sym("x", 4), ca.SX.sym("u", 2)
    headings, noise = ca.SX.sym("observed", steps), ca.SX.sym("noise", 2, steps)
    positions, seen = ca.SX.sym("p", 2 * others, steps), ca.SX.sym("seen", others, steps)
    distances, limits = ca.SX.sym("d", others), ca.SX.sym("limits", 5)
    area, weights = ca.SX.sym("area", 4), ca.SX.sym("Q", 4)
    stages = [state]
    for k in range(steps):
        x, y, heading, speed = ca.vertsplit(stages[-1])
        cos, sin = ca.cos(heading - headings[k]), ca.sin(heading - headings[k])
        x += STEP_S * speed * ca.cos(heading) + cos * noise[0, k] - sin * noise[1, k]
        y += STEP_S * speed * ca.sin(heading) + sin * noise[0, k] + cos * noise[1, k]
        stages.append(ca.vertcat(x, y, heading + STEP_S * controls[0, k], speed + STEP_S * controls[1, k]))
    cost = sum(ca.dot(weights, (stage - ca.vertcat(goal, 0)) ** 2) for stage in stages[:-1])
    rows = []
    for k, stage in enumerate(stages[:-1]):
        rate = (controls[:, k] - (controls[:, k - 1] if k else before)) / STEP_S
        quantities = ca.vertcat(stage[:2], stage[3], controls[:, k], rate)
        rows += [quantities - ca.vertcat(area[1], area[3], limits)]
        rows += [ca.vertcat(area[0], area[2], -limits) - quantities]
        for j in range(others):
            gap = stage[:2] - positions[2 * j : 2 * j + 2, k]
            rows.append(seen[j, k] * (distances[j] - ca.sqrt(ca.fmax(ca.sumsqr(gap), 1e-18))))
    flat, every = ca.vec(controls), ca.vertcat(*rows)
    gradient = ca.gradient(cost, flat)
    outputs = [gradient, ca.jacobian(gradient, goal), every, ca.jacobian(every, flat)]
    given = [
        controls,
        goal,
        state,
        headings,
        noise,
        before,
        positions,
        seen,
        distances,
        limits,
        area,
        weights,
    ]
    return ca.Function("eq6", given, [*outputs, ca.jacobian(stages[-1], flat)])


def solve_dense(problem: DenseProblem) -> tuple[Array, Array, Array]:
    """L, λ and ν by a public QP library.

    The variables are L, λ, ν and the products λ_kᵀ C_k, which keep the objective diagonal.
    """
    steps, each = problem.values.shape
    count = steps * each
    stage_of_row = np.repeat(np.arange(steps), each)
    complementarity = np.where(stage_of_row == np.arange(steps)[:, None], problem.values.ravel(), 0.0)
    equations = np.block(
        [
            [
                problem.by_goal,
                problem.gradients.reshape(count, -1).T,
                problem.terminal.T,
                np.zeros((2 * steps, steps)),
            ],
            [np.zeros((steps, 3)), complementarity, np.zeros((steps, 4)), -np.eye(steps)],
        ]
    )
    weights = np.concatenate([NEARNESS, np.ones(count + 4 + steps)])
    right = np.concatenate([-problem.slope, np.zeros(steps)])
    lowest = np.full(len(weights), -np.inf)
    lowest[3 : 3 + count] = 0.0
    rows = ca.sparsify(ca.DM(equations))
    structure = {"h": ca.Sparsity.diag(len(weights)), "a": rows.sparsity()}
    solver = ca.conic("oracle", "piqp", structure, OPTIONS)
    result = solver(h=ca.diag(2.0 * weights), a=rows, lba=right, uba=right, lbx=lowest)
    goal_offset, multipliers, terminal_multipliers, _ = np.split(
        result["x"].full().ravel(), np.cumsum([3, count, 4])
    )
    return goal_offset, multipliers.reshape(steps, each), terminal_multipliers


OPTIONS = {"piqp": {"eps_abs": 1e-12, "eps_rel": 1e-12, "eps_duality_gap_abs": 1e-14}}
"""Tighter than usual: W is so small that the usual accuracy leaves goals vague."""
