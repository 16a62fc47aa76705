"""A crossing in memory, to measure decisions on: everybody drives across a circle, past its centre."""

import math

import numpy as np

from agent.vehicle import Array, rollout
from protocol.messages import Observation, State
from protocol.scene import Goal, PublicRobot, Scene
from protocol.vehicle import Input

SMALLEST_RADIUS_M = 4.0
ELBOW_ROOM = 1.5
"""Between neighbours on the circle, as a multiple of the distance at which robots are safe."""
PAST_THE_CENTRE_RAD = 0.35
"""By so much everybody heads past the centre, all on the same side."""
SPEED_MPS = 1.5
ACCELERATION_MPS2 = 0.5


def scene_of(robot: str, count: int) -> Scene:
    """A scene as the defaults have it, for a robot among so many."""
    others = (name for number in range(1, count + 1) if (name := str(number)) != robot)
    names = [robot, *others][:count]
    return Scene(robots=dict.fromkeys(names, PublicRobot()))


class Crossing:
    """All robots of a scene on a circle; one drives as it decides, the others as they would alone.

    Args:
        scene: limits, bodies and Δt.
        robot: the one that decides.
        steps: for which it lasts.
    """

    def __init__(self, scene: Scene, robot: str, steps: int) -> None:
        self._scene = scene
        self._robot = robot
        self._names = list(scene.robots)
        angles = np.arange(len(self._names)) * math.tau / len(self._names)
        radius_m = self._radius_m()
        places = radius_m * np.stack([np.cos(angles), np.sin(angles)], axis=-1)
        headings = angles + math.pi + PAST_THE_CENTRE_RAD
        still = np.column_stack([places, headings, np.zeros(len(angles))])
        self._ways = rollout(
            still, np.stack([self._inputs(name, steps) for name in self._names]), scene.step_s
        )
        self._own: Array = still[self._names.index(robot)]
        ends = places + 2.0 * radius_m * math.cos(PAST_THE_CENTRE_RAD) * np.stack(
            [np.cos(headings), np.sin(headings)], axis=-1
        )
        self.goals = {
            name: Goal(x_m=float(x_m), y_m=float(y_m), heading_rad=float(heading))
            for name, (x_m, y_m), heading in zip(self._names, ends, headings, strict=True)
        }

    def observation(self, step: int) -> Observation:
        """What the deciding robot sees: everybody, exactly."""
        states = dict(zip(self._names, self._ways[:, step], strict=True)) | {self._robot: self._own}
        return Observation(
            epoch=0,
            step=step,
            time_s=self._scene.time_s(step),
            robots={name: State.of(*state.tolist()) for name, state in states.items()},
        )

    def drive(self, control: Input) -> None:
        """The deciding robot drives this for a step."""
        self._own = rollout(self._own, np.array([control]), self._scene.step_s)[-1]

    def _radius_m(self) -> float:
        widest_m = max(self._scene.safety_distance_m(one, one) for one in self._names)
        return max(SMALLEST_RADIUS_M, ELBOW_ROOM * widest_m * len(self._names) / math.tau)

    def _inputs(self, name: str, steps: int) -> Array:
        """Straight ahead, from standstill up to a speed, within the robot's limits."""
        limits, step_s = self._scene.robot(name).limits, self._scene.step_s
        acceleration = min(ACCELERATION_MPS2, limits.acceleration_mps2, limits.jerk_mps3 * step_s)
        speed_mps = min(SPEED_MPS, limits.speed_mps)
        inputs = np.zeros((steps, 2))
        inputs[: int(speed_mps / (acceleration * step_s)), 1] = acceleration
        return inputs
