"""Inverse optimal control (eq. 6): the goal for which an observed stretch of driving was closest to optimal.

The last K = K_E observed steps are taken as the solution of the shortest-path problem (eq. 2) between their
ends. Its optimality conditions (eq. 5) are linear in the goal L, in the multipliers λ ≥ 0 of the constraints
and in ν of the fixed end, so that eq. 6 is a convex quadratic program:

    min  Σ_k λ_kᵀλ_k + (λ_kᵀC_k)²  +  νᵀν  +  LᵀWL         over L, λ ≥ 0 and ν
    s.t. Σ_k S_kᵀ 2Q (x_k − L)  +  Σ_k G_kᵀλ_k  +  S_Kᵀν  =  0   with S = ∂x/∂z, G = ∂C/∂z

L counts from the present pose. In place of the inputs U stand the headings and speeds z = (ψ_K, v_K, ψ_{K−1},
…, v_1), whose differences they are: what is stationary in the one is so in the other, and G becomes simple.

Stage k = 0…K−1 has n constraints C_k ≤ 0 (eqs. 9 and 10): q − highest, then lowest − q for the quantities
q = (p_x, p_y, v, ω, a, rate of ω, rate of a), in the units of table 1, then d − ‖p − p_j‖ for each other
robot j, empty while j was not seen.
"""

from collections.abc import Sequence
from functools import lru_cache, partial
from typing import NamedTuple

import numpy as np

from agent.estimate.goals import ConstantAcceleration, goal_inside
from agent.remember.memory import Memory
from agent.solve.compiled import kernel
from agent.solve.realtime.factorisation import factorise, solve_transposed, solve_upper
from agent.solve.vehicle import Array, Integers
from protocol.scene import Scene

NEARNESS = np.array([1e-6, 1e-6, 1.0])
"""Diagonal of W, in m⁻², m⁻² and rad⁻². Among positions that explain a stretch equally well, such as those
beside the path of a robot that stands, the nearest is taken. The heading needs more: its small weight in the
cost would otherwise let goals many turns away explain every bend."""
ITERATIONS = 100
"""Allowed for each robot. About 12 are usual, and 40 where limits are wider by orders of magnitude."""
GIVEN = 4
"""Behind z stand ψ and v of stage 0 and of the one before, on which input rates depend; they are given."""
QUANTITIES = 7
FIRST_DISTANCE = 2 * QUANTITIES
"""Row of the first distance."""
FIRST_MULTIPLIER, FIRST_SLACK = 0.02, 0.5
COMPLEMENTARITY = 1e-13
"""Mean of λ∘s at which the program counts as solved; L is then exact to 1e-6 m even where W alone decides."""
INFEASIBILITY = 1e-10
"""Share of the first residuals at which the equations count as fulfilled."""
TO_BOUNDARY = 0.995
"""Part of the way to the nearest λ or s that would become zero; more of it near the solution."""
LEAST_CURVATURE = 1e-10
"""Added along every y, since their matrix is singular where too few limits explain anything."""


class InverseProblem(NamedTuple):
    """What eq. 6 needs to know of a robot."""

    states: Array
    """Observed, shape (K + 1, 4), the last one present."""
    values: Array
    """C_k, shape (K, n)."""
    bearings: Array
    """Unit vectors from the other robots, shape (K, n − 14, 2); zero where nothing was seen."""
    weights: Array
    """Diagonal of Q, shape (4,)."""
    step_s: float


class InverseSolution(NamedTuple):
    """The solution of eq. 6."""

    goal_offset: Array
    """L in p_x, p_y, ψ, from the present pose, shape (3,)."""
    multipliers: Array
    """λ, shape (K, n)."""
    terminal_multipliers: Array
    """ν, shape (4,)."""
    solved: bool


class InverseOptimalControl:
    """The publication's estimator; the simple model stands in until K_E steps of a robot were seen."""

    goals_are_shared = False

    def __init__(self, scene: Scene) -> None:
        self._scene = scene
        self._simple = ConstantAcceleration(scene)
        self._rules = lru_cache(maxsize=8)(partial(_rules, scene))

    def estimate(self, memory: Memory) -> dict[str, Array]:
        """See :class:`agent.estimate.goals.GoalEstimator`."""
        goals = self._simple.estimate(memory)
        for robot, problem in self.problems(memory).items():
            solution = solve_inverse(problem, ITERATIONS)
            if solution.solved:
                goals[robot] = goal_inside(self._scene.area, problem.states[-1, :3] + solution.goal_offset)
        return goals

    def problems(self, memory: Memory) -> dict[str, InverseProblem]:
        """Eq. 6 of all robots seen at K + 1 consecutive steps up to now.

        Rates at the first stage need the input before it, from one more state; a robot not seen then is taken
        to have driven without input.
        """
        robots, stages, step_s = memory.robots, self._scene.horizons.estimation_steps, self._scene.step_s
        limits, distances, others = self._rules(tuple(robots))
        tracks = [memory.states(robot, stages + 2) for robot in robots]
        seen = np.array([len(track) for track in tracks])
        window = np.array([track[np.maximum(np.arange(-stages - 2, 0), -len(track))] for track in tracks])
        inputs = np.diff(window[:, :, 2:], axis=1) / step_s
        rates = np.diff(inputs, axis=1) / step_s
        quantities = np.concatenate([window[:, 1:-1, [0, 1, 3]], inputs[:, 1:], rates], axis=2)
        positions = window[:, 1:-1, :2]
        gaps = positions[:, :, None] - positions[others].swapaxes(1, 2)
        lengths = np.hypot(gaps[..., 0], gaps[..., 1])
        was_seen = np.arange(stages)[:, None] > stages - seen[others][:, None]
        shortfalls = np.where(was_seen, distances[:, None] - lengths, 0.0)
        bearings = np.where(was_seen[..., None], gaps / np.maximum(lengths, 1e-9)[..., None], 0.0)
        values = np.concatenate([quantities - limits[:, 1:], limits[:, :1] - quantities, shortfalls], axis=2)
        weights = np.array(self._scene.weights.as_tuple())
        return {
            robot: InverseProblem(window[i, 1:], values[i].copy(), bearings[i].copy(), weights, step_s)
            for i, robot in enumerate(robots)
            if seen[i] > stages
        }


def _rules(scene: Scene, robots: Sequence[str]) -> tuple[Array, Array, Integers]:
    """Lowest and highest q, shape (N, 2, 7); safety distances to and indices of the others, (N, N − 1)."""
    area, limits = scene.area, []
    for robot in robots:
        own = scene.robot(robot).limits
        inputs = [own.turn_rate_radps, own.acceleration_mps2]
        symmetric = np.array([own.speed_mps, *inputs, own.turn_acceleration_radps2, own.jerk_mps3])
        limits.append([[area.x_min_m, area.y_min_m, *-symmetric], [area.x_max_m, area.y_max_m, *symmetric]])
    apart, shape = ~np.eye(len(robots), dtype=bool), (len(robots), len(robots) - 1)
    distances = np.array(scene.safety_distances_m(robots, robots))[apart].reshape(shape)
    return np.array(limits), distances, np.nonzero(apart)[1].reshape(shape)


@kernel
def solve_inverse(problem: InverseProblem, iterations: int) -> InverseSolution:
    """Solve eq. 6 by a primal-dual interior-point method (Mehrotra's predictor and corrector).

    With multipliers s of λ ≥ 0 and y of the stationarity equations, and B = −2 Σ_k S_kᵀQ, the solution
    fulfils the latter and

        2λ_k + 2C_k C_kᵀλ_k + G_k y = s_k,    λ∘s = 0,    ν = −½ S_K y,    2W L + Bᵀ y = 0.

    Newton's method on these, with λ∘s going to zero from above, leaves equations for y and L. The matrix of
    y, ½ S_KᵀS_K + Σ_k G_kᵀ E_k G_k with E_k⁻¹ = 2 + diag(s/λ) + 2C_k C_kᵀ, is factorised as RᵀR; that of L
    is 2W + VᵀV with V = R⁻ᵀB. The solution is proportional to the cost, which is scaled to one. It is not
    solved where anything is not finite or the iterations do not suffice.
    """
    values, size = problem.values, 2 * len(problem.values)
    jacobian, stationarity, by_goal, terminal, scale = _linearised(problem)
    stationarity /= scale if scale > 0.0 else 1.0
    fixed = LEAST_CURVATURE * np.eye(size + GIVEN)
    for row in terminal:
        fixed = fixed + 0.5 * row[:, None] * row
    multipliers, slacks = np.full(values.shape, FIRST_MULTIPLIER), np.full(values.shape, FIRST_SLACK)
    residuals = 2.0 * multipliers - slacks
    residuals += 2.0 * FIRST_MULTIPLIER * values.sum(axis=1)[:, None] * values
    stationarity += _pulls(problem, jacobian, multipliers).sum(axis=0)
    y, goal, matrix = np.zeros(size + GIVEN), np.zeros(3), np.empty(fixed.shape)
    change, change_s = np.zeros(values.shape), np.zeros(values.shape)
    left, solved = 1.0, False  # residuals are linear: each step leaves the same share of all of them
    for _ in range(iterations):
        product = _mean_product(multipliers, slacks, change, change_s, 0.0)
        solved = left < INFEASIBILITY and product < COMPLEMENTARITY
        if solved or not np.isfinite(product):
            break
        compliances = multipliers / (2.0 * multipliers + slacks)
        couplings = _couplings(values, compliances)
        _set_matrix(problem, jacobian, compliances, couplings, fixed, matrix)
        if not factorise(matrix, size):
            break
        halves, schur = by_goal.copy(), np.diag(2.0 * NEARNESS)
        for j in range(3):
            solve_transposed(matrix, size, halves[j])
            for i in range(j + 1):
                schur[i, j] += (halves[i] * halves[j]).sum()
        if not factorise(schur, 3):
            break
        gradient, targets = left * stationarity, -left * residuals - slacks
        centring, share = np.zeros(values.shape), 1.0
        for corrected in (False, True):
            right = targets + centring
            response = _response(values, compliances, couplings, right)
            change_y = gradient + _pulls(problem, jacobian, response).sum(axis=0)
            change_goal = _solve(matrix, size, halves, schur, change_y)
            rest = _less_changes(problem, jacobian, change_y, right)
            change = _response(values, compliances, couplings, rest)
            step = share / max(share, _set_slack_changes(multipliers, slacks, change, centring, change_s))
            if not corrected:
                after = _mean_product(multipliers, slacks, change, change_s, step)
                centring = (product * (after / product) ** 3 - change * change_s) / multipliers
                share = max(TO_BOUNDARY, 1.0 - 10.0 * product)
        y += step * change_y
        goal += step * change_goal
        multipliers += step * change
        slacks += step * change_s
        left *= 1.0 - step
    y *= scale
    end = -0.5 * (terminal * y).sum(axis=1)
    return InverseSolution(goal * scale, multipliers * scale, end, solved)


@kernel
def _linearised(problem: InverseProblem) -> tuple[Array, Array, Array, Array, float]:
    """How each of z moves all later positions, the gradient at L = 0, Bᵀ, S_K and the largest 2Q (x_k − x_K).

    Shapes (2K + 4, 2), (2K + 4,), (3, 2K + 4) and (4, 2K + 4). ψ_j turns the step from stage j as it was
    observed, and v_j lengthens it.
    """
    states, stages = problem.states, len(problem.values)
    size, x, y = 2 * stages + GIVEN, 0.0, 0.0
    jacobian, gradient = np.zeros((size, 2)), np.zeros(size)
    by_goal, terminal = np.zeros((3, size)), np.zeros((4, size))
    terminal[2, 0] = terminal[3, 1] = 1.0
    loads = states[:-1].copy()
    for j in range(stages - 1, -1, -1):
        loads[j, :3] -= states[-1, :3]
        loads[j] *= 2.0 * problem.weights
        psi, v = 2 * (stages - j), 2 * (stages - j) + 1
        if j > 0:
            jacobian[psi] = states[j, 1] - states[j + 1, 1], states[j + 1, 0] - states[j, 0]
            jacobian[v] = problem.step_s * np.cos(states[j, 2]), problem.step_s * np.sin(states[j, 2])
            gradient[psi : v + 1] = jacobian[psi : v + 1, 0] * x + jacobian[psi : v + 1, 1] * y + loads[j, 2:]
            by_goal[2, psi] = -2.0 * problem.weights[2]
        for c in range(2):
            by_goal[c, psi : v + 1] = -2.0 * problem.weights[c] * (stages - 1 - j) * jacobian[psi : v + 1, c]
        x, y = x + loads[j, 0], y + loads[j, 1]
    terminal[:2] = jacobian.T
    return jacobian, gradient, by_goal, terminal, np.abs(loads).max()


@kernel
def _less_changes(problem: InverseProblem, jacobian: Array, z: Array, targets: Array) -> Array:
    """Targets − G_k z, shape (K, n)."""
    result, q = targets.copy(), np.zeros(QUANTITIES)
    for k in range(len(result)):
        ahead = 2 * (len(result) - k - 1)
        q[2] = z[ahead + 3]
        for c in range(2):
            before = q[3 + c]
            q[3 + c] = (z[ahead + c] - z[ahead + 2 + c]) / problem.step_s
            q[5 + c] = (q[3 + c] - before) / problem.step_s
        for j in range(QUANTITIES):
            result[k, j] -= q[j]
            result[k, QUANTITIES + j] += q[j]
        for i in range(problem.bearings.shape[1]):
            x, y = problem.bearings[k, i, 0], problem.bearings[k, i, 1]
            result[k, FIRST_DISTANCE + i] += x * q[0] + y * q[1]
        for u in range(ahead + 2, ahead + 4):
            q[0] += jacobian[u, 0] * z[u]
            q[1] += jacobian[u, 1] * z[u]
    return result


@kernel
def _pulls(problem: InverseProblem, jacobian: Array, multipliers: Array) -> Array:
    """G_kᵀ λ_k, shape (K, 2K + 4)."""
    result = np.zeros((len(multipliers), len(jacobian)))
    pulls = multipliers[:, :QUANTITIES] - multipliers[:, QUANTITIES:FIRST_DISTANCE]
    for k, pull in enumerate(pulls):
        ahead = 2 * (len(multipliers) - k - 1)
        for i in range(problem.bearings.shape[1]):
            pull[0] -= multipliers[k, FIRST_DISTANCE + i] * problem.bearings[k, i, 0]
            pull[1] -= multipliers[k, FIRST_DISTANCE + i] * problem.bearings[k, i, 1]
        for u in range(ahead + 4, len(jacobian)):
            result[k, u] = jacobian[u, 0] * pull[0] + jacobian[u, 1] * pull[1]
        result[k, ahead + 3] += pull[2]
        for c in range(2):
            once, twice = pull[3 + c] / problem.step_s, pull[5 + c] / problem.step_s**2
            result[k, ahead + c] += once + twice
            result[k, ahead + 2 + c] -= once + 2.0 * twice
            result[k, ahead + 4 + c] += twice
    return result


@kernel
def _set_matrix(
    problem: InverseProblem,
    jacobian: Array,
    compliances: Array,
    couplings: Array,
    fixed: Array,
    matrix: Array,
) -> None:
    """Set the upper triangle of the matrix of y to its fixed part and Σ_k G_kᵀ E_k G_k."""
    mixed = _pulls(problem, jacobian, compliances * problem.values)
    both = compliances[:, :QUANTITIES] + compliances[:, QUANTITIES:FIRST_DISTANCE]
    moved, size, xx, xy, yy = np.zeros(jacobian.shape), 2 * len(couplings), 0.0, 0.0, 0.0
    matrix[:] = fixed
    for first in range(0, size, 2):
        k = size // 2 - 1 - first // 2
        row, squares = mixed[k], both[k]
        for u in range(first + 2, first + 4):  # what E does with the positions of all later stages
            moved[u, 0] = xx * jacobian[u, 0] + xy * jacobian[u, 1]
            moved[u, 1] = xy * jacobian[u, 0] + yy * jacobian[u, 1]
        xx, yy = xx + squares[0], yy + squares[1]
        for i in range(problem.bearings.shape[1]):
            share = compliances[k, FIRST_DISTANCE + i]
            x, y = problem.bearings[k, i, 0], problem.bearings[k, i, 1]
            xx, xy, yy = xx + share * x * x, xy + share * x * y, yy + share * y * y
        matrix[first + 3, first + 3] += squares[2]
        for c in range(2):
            ahead, now, before = first + c, first + 2 + c, first + 4 + c
            once, twice = squares[3 + c] / problem.step_s**2, squares[5 + c] / problem.step_s**4
            matrix[ahead, ahead] += once + twice
            matrix[ahead, now] -= once + 2.0 * twice
            matrix[now, now] += once + 4.0 * twice
            matrix[ahead, before] += twice
            matrix[now, before] -= 2.0 * twice
            matrix[before, before] += twice
        for u in range(first, size, 2):
            one, other = matrix[u], matrix[u + 1]
            a, b = couplings[k] * row[u], couplings[k] * row[u + 1]
            for w in range(u, size):
                one[w] -= a * row[w]
                other[w] -= b * row[w]
    for u in range(size):
        for w in range(u, size):
            matrix[u, w] += moved[u, 0] * jacobian[w, 0] + moved[u, 1] * jacobian[w, 1]


@kernel
def _couplings(values: Array, compliances: Array) -> Array:
    """1 / (½ + C_kᵀ diag(compliances) C_k), shape (K,): what couples the rows of a stage in E_k."""
    couplings = np.empty(len(values))
    for k in range(len(values)):
        total = 0.5
        for i in range(values.shape[1]):
            total += compliances[k, i] * values[k, i] ** 2
        couplings[k] = 1.0 / total
    return couplings


@kernel
def _response(values: Array, compliances: Array, couplings: Array, targets: Array) -> Array:
    """E_k times targets, by the formula of Sherman and Morrison, shape (K, n)."""
    result = np.empty(values.shape)
    for k in range(len(values)):
        total = 0.0
        for i in range(values.shape[1]):
            total += values[k, i] * compliances[k, i] * targets[k, i]
        total *= couplings[k]
        for i in range(values.shape[1]):
            result[k, i] = compliances[k, i] * (targets[k, i] - total * values[k, i])
    return result


@kernel
def _solve(factor: Array, size: int, halves: Array, schur: Array, right: Array) -> Array:
    """Of the equations for y and L: replace the right-hand side by δy, and return δL."""
    goal = np.zeros(3)
    right[size:] = 0.0
    solve_transposed(factor, size, right)
    for j in range(3):
        for u in range(size):
            goal[j] -= halves[j, u] * right[u]
    solve_transposed(schur, 3, goal)
    solve_upper(schur, 3, goal)
    for j in range(3):
        for u in range(size):
            right[u] += goal[j] * halves[j, u]
    solve_upper(factor, size, right)
    return goal


@kernel
def _mean_product(multipliers: Array, slacks: Array, change: Array, change_s: Array, step: float) -> float:
    """The mean of λ∘s after a step."""
    total = 0.0
    for k in range(len(slacks)):
        for i in range(slacks.shape[1]):
            multiplier = multipliers[k, i] + step * change[k, i]
            total += multiplier * (slacks[k, i] + step * change_s[k, i])
    return total / slacks.size


@kernel
def _set_slack_changes(
    multipliers: Array, slacks: Array, change: Array, centring: Array, change_s: Array
) -> float:
    """Set δs = centring − s − (s/λ) δλ; returns the greatest rate at which any λ or s goes to zero."""
    fastest = np.zeros(slacks.shape[1])
    for k in range(len(slacks)):
        for i in range(len(fastest)):
            rate = -change[k, i] / multipliers[k, i]
            change_s[k, i] = centring[k, i] + slacks[k, i] * (rate - 1.0)
            fastest[i] = max(fastest[i], rate, -change_s[k, i] / slacks[k, i])
    return float(fastest.max())
