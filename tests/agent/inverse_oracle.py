"""Eq. 6 set up and solved in another way: CasADi differentiates the Lagrangian, a dense solver does the rest.

Nothing of the estimator is used but the weight with which it prefers near goals.
"""

from dataclasses import dataclass

import casadi as ca
import numpy as np
from agent_helpers import STEP_S

from agent.estimation.inverse_optimal_control import NEARNESS
from agent.vehicle import Array
from protocol.scene import Scene


@dataclass(frozen=True)
class Oracle:
    """The solution of eq. 6: the goal pose (3,), ν (4,) and the least objective."""

    goal: Array
    terminal_multipliers: Array
    objective: float


def solve_inverse(scene: Scene, robot: str, states: Array, before: Array, others: dict[str, Array]) -> Oracle:
    """Eq. 6 of a robot.

    Args:
        scene: limits, distances, weights.
        robot: whose goal it is.
        states: of the robot, shape (K + 1, 4), headings without jumps.
        before: its input (2,) before these states.
        others: states of each other robot, at most K + 1 and up to the same present.
    """
    steps = len(states) - 1
    controls = ca.SX.sym("U", 2, steps)
    goal = ca.SX.sym("L", 3)
    stages = _stages(states[0], controls)
    weights = ca.DM(scene.weights.as_tuple())
    cost = 0
    for stage in stages[:-1]:
        cost += ca.dot(weights, (stage - ca.vertcat(goal, 0)) ** 2)
    constraints = [
        _constraints(scene, robot, k, stages[k], controls, before, _position(others, k - steps - 1))
        for k in range(steps)
    ]
    flat = ca.vec(controls)
    every = ca.vertcat(*constraints)
    gradient = ca.gradient(cost, flat)
    evaluate = ca.Function(
        "eq6",
        [controls, goal],
        [
            gradient,
            ca.jacobian(gradient, goal),
            every,
            ca.jacobian(every, flat),
            ca.jacobian(stages[-1], flat),
        ],
    )
    observed = np.diff(states[:, 2:], axis=0).T / STEP_S
    present = states[-1, :3]
    slope, by_goal, values, by_controls, terminal = (item.full() for item in evaluate(observed, present))
    sizes = [each.numel() for each in constraints]
    stage_of_row = np.repeat(np.arange(steps), sizes)
    complementarity = np.where(stage_of_row == np.arange(steps)[:, None], values.ravel(), 0.0)
    quadratic = np.diag(np.concatenate([NEARNESS, np.ones(sum(sizes) + 4)]))
    quadratic[3:-4, 3:-4] += complementarity.T @ complementarity
    lowest = np.concatenate([np.full(3, -np.inf), np.zeros(sum(sizes)), np.full(4, -np.inf)])
    equations = np.hstack([by_goal, by_controls.T, terminal.T])
    structure = {"h": ca.Sparsity.dense(*quadratic.shape), "a": ca.Sparsity.dense(*equations.shape)}
    solver = ca.conic("oracle", "daqp", structure)
    result = solver(h=2 * quadratic, a=equations, lba=-slope, uba=-slope, lbx=lowest)
    found = result["x"].full().ravel()
    return Oracle(present + found[:3], found[-4:], float(found @ quadratic @ found))


def _stages(state: Array, controls: ca.SX) -> list[ca.SX]:
    x, y, heading, speed = map(ca.SX, state.tolist())
    stages = [ca.vertcat(x, y, heading, speed)]
    for k in range(controls.shape[1]):
        x, y = x + STEP_S * speed * ca.cos(heading), y + STEP_S * speed * ca.sin(heading)
        heading, speed = heading + STEP_S * controls[0, k], speed + STEP_S * controls[1, k]
        stages.append(ca.vertcat(x, y, heading, speed))
    return stages


def _position(others: dict[str, Array], from_the_end: int) -> dict[str, Array]:
    """Where each other robot was at a stage counted from the end, if it was seen then."""
    return {robot: track[from_the_end, :2] for robot, track in others.items() if len(track) >= -from_the_end}


def _constraints(
    scene: Scene, robot: str, k: int, stage: ca.SX, controls: ca.SX, before: Array, others: dict[str, Array]
) -> ca.SX:
    """All C_k ≤ 0 of one stage (eq. 9 and eq. 10)."""
    limits, area = scene.robot(robot).limits, scene.area
    previous = controls[:, k - 1] if k else ca.DM(before)
    rate = (controls[:, k] - previous) / STEP_S
    bounded = [
        (stage[3], limits.speed_mps),
        (controls[0, k], limits.turn_rate_radps),
        (controls[1, k], limits.acceleration_mps2),
        (rate[0], limits.turn_acceleration_radps2),
        (rate[1], limits.jerk_mps3),
    ]
    return ca.vertcat(
        stage[0] - area.x_max_m,
        area.x_min_m - stage[0],
        stage[1] - area.y_max_m,
        area.y_min_m - stage[1],
        *(sign * value - bound for value, bound in bounded for sign in (1, -1)),
        *(
            scene.safety_distance_m(robot, other) - ca.norm_2(stage[:2] - ca.DM(position))
            for other, position in others.items()
        ),
    )
