"""From what a robot remembers to the problems it solves, and where their solution starts."""

from collections.abc import Mapping, Sequence

import numpy as np

from agent.memory import Memory
from agent.solver.problem import JointProblem
from agent.solver.starts import cold_start, shifted
from agent.vehicle import Array
from protocol.scene import Scene
from protocol.vehicle import Input


def joint_problem(
    scene: Scene,
    memory: Memory,
    goals: Mapping[str, Array],
    paths: Mapping[str, Array],
    inputs: Mapping[str, Input],
) -> JointProblem:
    """The problem of the robots in ``goals``, with those in ``paths`` as moving obstacles.

    Args:
        scene: limits, distances, weights, horizons.
        memory: present states.
        goals: goal state (4,) of each robot that is free to move.
        paths: positions (K + 1, 2) of each robot that moves as told.
        inputs: the last input of each free robot.
    """
    steps = scene.horizons.prediction_steps
    robots = list(goals)
    return JointProblem(
        states=np.array([memory.state(robot) for robot in robots]),
        previous_inputs=np.array([inputs[robot] for robot in robots]),
        goals=np.array(list(goals.values())),
        limits=tuple(scene.robot(robot).limits for robot in robots),
        obstacles=np.array(list(paths.values())).reshape(-1, steps + 1, 2),
        safety_distances=np.array(
            [[scene.safety_distance_m(one, other) for other in (*robots, *paths)] for one in robots]
        ),
        area=np.array([[scene.area.x_min_m, scene.area.y_min_m], [scene.area.x_max_m, scene.area.y_max_m]]),
        weights=np.array(scene.weights.as_tuple()),
        steps=steps,
        step_s=scene.step_s,
    )


class WarmStarts:
    """The last solution's inputs of each robot: where the next solution starts, one step on."""

    def __init__(self) -> None:
        self._inputs: dict[str, Array] = {}

    def start(self, problem: JointProblem, robots: Sequence[str]) -> Array:
        """Inputs (M, K, 2): the last ones shifted; the cold start for robots without any."""
        known = {index: robot for index, robot in enumerate(robots) if robot in self._inputs}
        all_known = len(known) == len(robots)
        inputs = np.empty((len(robots), problem.steps, 2)) if all_known else cold_start(problem)
        for index, robot in known.items():
            inputs[index] = shifted(self._inputs[robot])
        return inputs

    def keep(self, robots: Sequence[str], inputs: Array) -> None:
        """Remember the inputs (M, K, 2) of a solution; all others are forgotten."""
        self._inputs = dict(zip(robots, inputs, strict=True))

    def forget(self) -> None:
        """Start cold next time."""
        self._inputs = {}
