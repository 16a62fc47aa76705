"""What goal estimators give, and the simple ones: goals exchanged, unasked, or where speeding up leads."""

import math
from collections.abc import Mapping, Sequence
from typing import Protocol

import numpy as np

from agent.remember.memory import Memory
from agent.solve.compiled import kernel
from agent.solve.vehicle import Array
from protocol.scene import Area, Goal, Scene
from protocol.vehicle import Limits, nearest_turn


class GoalEstimator(Protocol):
    """Estimates the goal state of every robot in memory, the ego as the others see it included."""

    goals_are_shared: bool
    """Whether the estimates are everybody's true goals; the joint prediction is then the plan."""

    def estimate(self, memory: Memory) -> dict[str, Array]:
        """Goal states (p_x, p_y, ψ, 0), shape (4,), each heading within half a turn of the present one."""
        ...


class Exchanged:
    """Reads the goals from the scene; a robot whose goal is not in it is taken to stay where it is.

    Raises:
        ValueError: the scene holds no goals, because the world was not started for exchanged goals.
    """

    goals_are_shared = True

    def __init__(self, scene: Scene) -> None:
        if scene.goals is None:
            raise ValueError(
                "the scene holds no goals; exchanged goals need a world started with --exchange-goals"
            )
        self._goals: dict[str, Goal] = scene.goals

    def estimate(self, memory: Memory) -> dict[str, Array]:
        """See :class:`GoalEstimator`."""
        return {robot: self._goal(robot, memory.state(robot)) for robot in memory.robots}

    def _goal(self, robot: str, state: Array) -> Array:
        return known_goal(self._goals[robot], state) if robot in self._goals else np.array([*state[:3], 0.0])


class Unestimated:
    """Estimates nothing, for baselines that predict motions without asking where they lead."""

    goals_are_shared = False

    def estimate(self, memory: Memory) -> dict[str, Array]:
        """See :class:`GoalEstimator`."""
        return {}


class ConstantAcceleration:
    """Applies the maximum jerk within the limits over the prediction horizon; its end is the goal estimate.

    The publication's baseline, and its stand-in until enough states were seen for inverse optimal control.
    """

    goals_are_shared = False

    def __init__(self, scene: Scene) -> None:
        self._scene = scene

    def estimate(self, memory: Memory) -> dict[str, Array]:
        """See :class:`GoalEstimator`."""
        return goals_at(self._scene, memory, {robot: self.path(memory, robot)[-1] for robot in memory.robots})

    def path(self, memory: Memory, robot: str) -> Array:
        """Positions (K + 1, 2) of one robot at the present and the next K stages, in the area or not."""
        limits = self._scene.robot(robot).limits
        acceleration = memory.previous_input(robot).acceleration_mps2
        highest = (limits.speed_mps, limits.acceleration_mps2, limits.jerk_mps3)
        steps, step_s = self._scene.horizons.prediction_steps, self._scene.step_s
        return _speeding_up(memory.state(robot), acceleration, highest, steps, step_s)


def goal_inside(area: Area, pose: Array) -> Array:
    """A pose (p_x, p_y, ψ, …) as a goal state, its position moved into the drivable area, shape (4,)."""
    x = min(max(pose[0], area.x_min_m), area.x_max_m)
    y = min(max(pose[1], area.y_min_m), area.y_max_m)
    return np.array([x, y, pose[2], 0.0])


def way_m(limits: Limits) -> float:
    """On which a robot just reaches its top speed and comes to a stand again: v²/a + v a/j.

    The length by which estimators measure what one robot does.
    """
    speed, acceleration = limits.speed_mps, limits.acceleration_mps2
    return speed**2 / acceleration + speed * acceleration / limits.jerk_mps3


def sigmas_of(scene: Scene, robots: Sequence[str], parts: Array) -> Array:
    """σ of (p_x, p_y, ψ, v) of robots, shape (N, 4), from parts (4,) of way, radian and top speed."""
    every = [scene.robot(robot).limits for robot in robots]
    return np.array([[way_m(each), way_m(each), 1.0, each.speed_mps] for each in every]) * parts


def first_guess(scene: Scene, memory: Memory, robot: str) -> Array:
    """The position (2,), inside the area, where a goal is thought to lie at first: ahead on its course.

    That far away that it just reaches its top speed on the way; but if it would park there on the course of
    somebody else, it is thought to go on for the whole horizon.
    """
    way = way_m(scene.robot(robot).limits)
    near = _on_course(scene, memory, robot, way)
    for other in memory.robots:
        if other != robot:
            begin, end = memory.state(other)[:2], _on_course(scene, memory, other, _horizon_m(scene, other))
            if _distance_m(near, begin, end) < scene.collision_distance_m(robot, other):
                return _on_course(scene, memory, robot, max(way, _horizon_m(scene, robot)))
    return near


def _horizon_m(scene: Scene, robot: str) -> float:
    """How far a robot gets within the horizon at most."""
    return scene.robot(robot).limits.speed_mps * scene.horizons.prediction_steps * scene.step_s


def _on_course(scene: Scene, memory: Memory, robot: str, ahead_m: float) -> Array:
    """The position (2,) so far straight ahead of a robot, inside the area."""
    x, y, heading, _ = memory.state(robot)
    return inside(scene.area, np.array([x + ahead_m * math.cos(heading), y + ahead_m * math.sin(heading)]))


def _distance_m(point: Array, begin: Array, end: Array) -> float:
    """Of a point (2,) from a stretch between two others."""
    way = end - begin
    length_squared = float(way @ way)
    part = min(max(float((point - begin) @ way) / length_squared, 0.0), 1.0) if length_squared else 0.0
    return float(np.hypot(*(point - begin - part * way)))


def inside(area: Area, position: Array) -> Array:
    """A position (2,) moved into the area."""
    return goal_inside(area, np.append(position, 0.0))[:2]


def goals_at(scene: Scene, memory: Memory, positions: Mapping[str, Array]) -> dict[str, Array]:
    """Goal states at these positions (2,), with the present headings: of those of goals nothing is known."""
    return {
        robot: goal_inside(scene.area, np.append(position, memory.state(robot)[2]))
        for robot, position in positions.items()
    }


def known_goal(goal: Goal, present: Array) -> Array:
    """A known goal as a state, its heading within half a turn of that of the present state, shape (4,)."""
    x, y, heading, speed = goal.as_state()
    return np.array([x, y, nearest_turn(heading, present[2]), speed])


@kernel
def _speeding_up(
    state: Array, acceleration: float, highest: tuple[float, float, float], steps: int, step_s: float
) -> Array:
    """Positions (K + 1, 2) straight on, ever faster up to the highest speed, acceleration and jerk."""
    x, y, heading, speed = state
    speed_limit, acceleration_limit, jerk_limit = highest
    positions = np.empty((steps + 1, 2))
    positions[0] = state[:2]
    direction = -1.0 if speed < 0.0 else 1.0
    way = 0.0
    for k in range(1, steps + 1):
        way += step_s * speed
        positions[k, 0] = x + way * np.cos(heading)
        positions[k, 1] = y + way * np.sin(heading)
        faster = direction * acceleration + jerk_limit * step_s
        room = (speed_limit - direction * speed) / step_s
        acceleration = direction * min(faster, acceleration_limit, room)
        speed += step_s * acceleration
    return positions
