"""Inverse optimal control (eq. 6): the goal for which an observed stretch of driving was closest to optimal.

The last K_E observed steps are taken as the solution of the shortest-path problem (eq. 2) between their ends.
Its optimality conditions (eq. 5) are linear in the goal L and in the multipliers, so the goal follows from a
convex quadratic program: stationarity and λ ≥ 0 as constraints, multipliers and complementarity in the
objective.
"""

from dataclasses import dataclass

import casadi as ca
import numpy as np

from agent.estimation.constant_acceleration import ConstantAcceleration
from agent.estimation.interface import goal_inside
from agent.memory import Memory
from agent.vehicle import Array, recovered_inputs, sensitivities
from protocol.scene import Area, Scene
from protocol.vehicle import Limits

OBSERVABLE = 3
"""Components of L that are estimated: p_x, p_y, ψ. The goal speed is known to be zero."""
NEARNESS = np.array([1e-6, 1e-6, 1.0])
"""Weight of the goal's distance from the present pose, in m⁻², m⁻² and rad⁻². Among positions that explain a
stretch equally well, such as those beside the path of a robot that stands, the nearest is taken. The heading
needs more: its small weight in the cost would otherwise let goals many turns away explain every bend."""


@dataclass(frozen=True)
class InverseProblem:
    """The quadratic program of eq. 6 for one robot.

    min Σ λ² + ‖ν‖² + Σ_k (λ_kᵀ C_k)² + nearness over L, λ ≥ 0, ν
    subject to  goal_gradient·(L − x_t) + Σ_k gradients_kᵀ λ_k + terminalᵀ ν + cost_gradient = 0.
    """

    values: Array
    """C_k, shape (K, n): one row a stage, one column a constraint; negative inside."""
    gradients: Array
    """∂C_k/∂U, shape (K, n, 2K)."""
    terminal: Array
    """∂x_t/∂U, shape (4, 2K)."""
    cost_gradient: Array
    """Gradient of the cost in U for a goal at the present pose, shape (2K,)."""
    goal_gradient: Array
    """How that gradient changes with L, shape (2K, 3)."""


@dataclass(frozen=True)
class InverseSolution:
    """Its solution: the offset of L from the present pose, the multipliers, and whether it was found."""

    goal_offset: Array
    multipliers: Array
    terminal_multipliers: Array
    stationarity_multipliers: Array
    solved: bool


class InverseOptimalControl:
    """The publication's estimator; the simple model stands in until K_E steps of a robot were seen."""

    goals_are_shared = False

    def __init__(self, scene: Scene) -> None:
        self._scene = scene
        self._simple = ConstantAcceleration(scene)
        self._programs = InversePrograms()

    def estimate(self, memory: Memory) -> dict[str, Array]:
        """See :class:`agent.estimation.interface.GoalEstimator`."""
        return {robot: self._estimate_one(memory, robot) for robot in memory.robots}

    def _estimate_one(self, memory: Memory, robot: str) -> Array:
        stages = self._scene.horizons.estimation_steps + 1
        states = memory.states(robot, stages)
        if len(states) < stages:
            return self._simple.estimate_one(memory, robot)
        problem = inverse_problem(self._scene, memory, robot)
        solution = self._programs.solve(problem)
        if not solution.solved:
            return self._simple.estimate_one(memory, robot)
        present = states[-1]
        return goal_inside(self._scene.area, present[:OBSERVABLE] + solution.goal_offset)


def inverse_problem(scene: Scene, memory: Memory, robot: str) -> InverseProblem:
    """Write eq. 6 for one robot from the last K_E + 1 observed states of everybody.

    The input before the stretch is known if one more state is; else the robot is taken to have stood.
    """
    steps = scene.horizons.estimation_steps
    states = memory.states(robot, steps + 1)
    inputs = recovered_inputs(memory.states(robot, steps + 2), scene.step_s)
    before = inputs[:-steps][-1:] if len(inputs) > steps else np.zeros((1, 2))
    inputs = inputs[-steps:]
    effect = sensitivities(states, scene.step_s).reshape(steps + 1, 4, 2 * steps)
    limits = scene.robot(robot).limits
    rows = [
        *_area_rows(scene.area, states, effect),
        _both_sides(states[:-1, 3], effect[:-1, 3], limits.speed_mps),
        *_input_rows(limits, inputs, before, scene.step_s),
        *(
            _distance_row(
                states, effect, memory.states(other, steps + 1), scene.safety_distance_m(robot, other)
            )
            for other in memory.robots
            if other != robot
        ),
    ]
    weights = np.array(scene.weights.as_tuple())
    to_present = states[:-1] - np.array([*states[-1, :3], 0.0])
    return InverseProblem(
        values=np.concatenate([values for values, _ in rows], axis=1),
        gradients=np.concatenate([gradients for _, gradients in rows], axis=1),
        terminal=effect[-1],
        cost_gradient=2.0 * np.einsum("kcu,c,kc->u", effect[:-1], weights, to_present),
        goal_gradient=-2.0 * np.einsum("kcu,c->uc", effect[:-1], weights)[:, :OBSERVABLE],
    )


Rows = tuple[Array, Array]
"""Constraint values of shape (K, m) with their gradients of shape (K, m, 2K)."""


def _both_sides(values: Array, gradients: Array, bound: float) -> Rows:
    """|value| ≤ bound, of values (K,) with gradients (K, 2K), as two rows a stage (eq. 9)."""
    return (
        np.stack([values - bound, -values - bound], axis=1),
        np.stack([gradients, -gradients], axis=1),
    )


def _area_rows(area: Area, states: Array, effect: Array) -> list[Rows]:
    rows = []
    for axis, (low, high) in enumerate(((area.x_min_m, area.x_max_m), (area.y_min_m, area.y_max_m))):
        middle, half = (low + high) / 2.0, (high - low) / 2.0
        rows.append(_both_sides(states[:-1, axis] - middle, effect[:-1, axis], half))
    return rows


def _input_rows(limits: Limits, inputs: Array, before: Array, step_s: float) -> list[Rows]:
    """Limits of ω and a, and of their rates of change, each in its physical unit (table 1)."""
    steps = len(inputs)
    picks = np.eye(2 * steps).reshape(steps, 2, 2 * steps)
    rates = np.diff(np.concatenate([before, inputs]), axis=0) / step_s
    pick_rates = np.diff(np.concatenate([np.zeros_like(picks[:1]), picks]), axis=0) / step_s
    return [
        _both_sides(inputs[:, 0], picks[:, 0], limits.turn_rate_radps),
        _both_sides(inputs[:, 1], picks[:, 1], limits.acceleration_mps2),
        _both_sides(rates[:, 0], pick_rates[:, 0], limits.turn_acceleration_radps2),
        _both_sides(rates[:, 1], pick_rates[:, 1], limits.jerk_mps3),
    ]


def _distance_row(states: Array, effect: Array, other: Array, distance: float) -> Rows:
    """Rows d − ‖p_i − p_j‖ ≤ 0 (eq. 10) at the stages at which the other was seen; elsewhere empty ones."""
    steps = len(states) - 1
    values, gradients = np.zeros((steps, 1)), np.zeros((steps, 1, 2 * steps))
    seen = slice(steps + 1 - len(other), steps)
    gap = states[seen, :2] - other[:-1, :2]
    length = np.linalg.norm(gap, axis=1)
    values[seen, 0] = distance - length
    gradients[seen, 0] = -np.einsum("kc,kcu->ku", gap / np.maximum(length, 1e-9)[:, None], effect[seen, :2])
    return values, gradients


class InversePrograms:
    """Solves inverse problems with PIQP through CasADi; set-ups are kept by the problem's size."""

    def __init__(self) -> None:
        self._solvers: dict[tuple[int, int], ca.Function] = {}

    def solve(self, problem: InverseProblem) -> InverseSolution:
        """Solve eq. 6 over (L − x_t, λ, ν, λ_kᵀC_k), the last to keep the program sparse."""
        stages, each = problem.values.shape
        count = stages * each
        rows = _stationarity_and_complementarity(problem)
        weights = np.concatenate([NEARNESS, np.ones(count + 4 + stages)])
        if (stages, each) not in self._solvers:
            self._solvers[stages, each] = _conic_solver(stages, each)
        solver = self._solvers[stages, each]
        right = np.concatenate([-problem.cost_gradient, np.zeros(stages)])
        lowest = np.full(len(weights), -np.inf)
        lowest[OBSERVABLE : OBSERVABLE + count] = 0.0
        result = solver(h=ca.diag(2.0 * weights), a=rows, lba=right, uba=right, lbx=lowest)
        values = np.asarray(result["x"]).ravel()
        parts = np.split(values, np.cumsum([OBSERVABLE, count, 4]))
        return InverseSolution(
            goal_offset=parts[0],
            multipliers=parts[1].reshape(stages, each),
            terminal_multipliers=parts[2],
            stationarity_multipliers=np.asarray(result["lam_a"]).ravel()[: 2 * stages],
            solved=bool(solver.stats()["success"]),
        )


def _stationarity_and_complementarity(problem: InverseProblem) -> Array:
    stages, each = problem.values.shape
    count = stages * each
    stationarity = [
        problem.goal_gradient,
        problem.gradients.reshape(count, 2 * stages).T,
        problem.terminal.T,
        np.zeros((2 * stages, stages)),
    ]
    complementarity = [
        np.zeros((stages, OBSERVABLE)),
        (np.eye(stages)[:, :, None] * problem.values).reshape(stages, count),
        np.zeros((stages, 4)),
        -np.eye(stages),
    ]
    return np.block([stationarity, complementarity])


def _conic_solver(stages: int, each: int) -> ca.Function:
    """PIQP, set up for the entries that can differ from zero: a stage depends on earlier inputs only."""
    inputs = 2 * stages
    earlier = np.arange(inputs) // 2 <= np.arange(stages)[:, None]
    full = InverseProblem(
        values=np.ones((stages, each)),
        gradients=np.repeat(earlier[:, None].astype(float), each, axis=1),
        terminal=np.ones((4, inputs)),
        cost_gradient=np.ones(inputs),
        goal_gradient=np.ones((inputs, OBSERVABLE)),
    )
    rows = ca.sparsify(ca.DM(_stationarity_and_complementarity(full))).sparsity()
    structure = {"h": ca.Sparsity.diag(OBSERVABLE + stages * each + 4 + stages), "a": rows}
    return ca.conic("inverse", "piqp", structure, {"error_on_fail": False})
