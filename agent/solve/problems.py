"""From what a robot remembers to the problems it solves, and where their solution starts."""

from collections.abc import Mapping, Sequence

import numpy as np

from agent.solve.problem import JointProblem, Solution, Start
from agent.solve.starts import cold_starts, shifted
from agent.solve.vehicle import Array
from protocol.scene import Scene
from protocol.vehicle import Input


def joint_problem(
    scene: Scene,
    states: Mapping[str, Array],
    goals: Mapping[str, Array],
    paths: Mapping[str, Array],
    inputs: Mapping[str, Input],
    cautions_m: Mapping[str, float] = {},
) -> JointProblem:
    """The problem of the robots in ``goals``, with those in ``paths`` as moving obstacles.

    Args:
        scene: limits, distances, weights, horizons.
        states: present ones, shape (4,), at least of the robots in ``goals``.
        goals: goal state (4,) of each robot that is free to move.
        paths: positions (K + 1, 2) of each robot that moves as told.
        inputs: the last input of each free robot.
        cautions_m: by which more than the safety distance to keep from robots in ``paths``.
    """
    steps = scene.horizons.prediction_steps
    robots = list(goals)
    distances_m = np.array(scene.safety_distances_m(robots, (*robots, *paths)))
    distances_m[:, len(robots) :] += [cautions_m.get(robot, 0.0) for robot in paths]
    return JointProblem(
        states=np.array([states[robot] for robot in robots]),
        previous_inputs=np.array([inputs[robot] for robot in robots]),
        goals=np.array(list(goals.values())),
        limits=tuple(scene.robot(robot).limits for robot in robots),
        obstacles=np.array(list(paths.values())).reshape(-1, steps + 1, 2),
        safety_distances=distances_m,
        area=np.array([[scene.area.x_min_m, scene.area.y_min_m], [scene.area.x_max_m, scene.area.y_max_m]]),
        weights=np.array(scene.weights.as_tuple()),
        steps=steps,
        step_s=scene.step_s,
    )


class WarmStarts:
    """The last solution of each robot: where the next solution starts, one step on."""

    def __init__(self) -> None:
        self._last: dict[str, tuple[Array, Array, Array]] = {}

    def starts(self, problem: JointProblem, robots: Sequence[str], steps_on: int = 1) -> list[Start]:
        """The last solution, so many steps on; where a robot has none, each of the cold starts for it."""
        known = {
            index: [shifted(each, steps_on) for each in self._last[robot]]
            for index, robot in enumerate(robots)
            if robot in self._last
        }
        if len(known) == len(robots):
            inputs, forces, pressures = (np.array(each) for each in zip(*known.values(), strict=True))
            return [Start(inputs, forces, pressures, warm=True)]
        starts = cold_starts(problem)
        for start in starts:
            for index, parts in known.items():
                start.inputs[index], start.forces[index], start.pressures[index] = parts
        return starts

    def keep(self, robots: Sequence[str], solution: Solution) -> None:
        """Remember a solution; all earlier ones are forgotten."""
        parts = zip(solution.inputs, solution.forces, solution.pressures, strict=True)
        self._last = dict(zip(robots, parts, strict=True))

    def forget(self) -> None:
        """Start cold next time."""
        self._last = {}
