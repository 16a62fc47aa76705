"""Optimal reciprocal collision avoidance (ORCA), tracked by a differential drive: a baseline.

Van den Berg, Guy, Lin and Manocha 2011, "Reciprocal n-body collision avoidance": of the velocities that keep
clear of everybody for some time, if each of two robots does half of the avoiding, the one nearest to a
preferred velocity. As in Alonso-Mora et al. 2013, "Optimal reciprocal collision avoidance for multiple
non-holonomic robots", a robot that cannot take that velocity at once tracks it by heading and speed, and the
circles are larger than the bodies by what tracking may err; here by the safety margin.
"""

import math
from importlib.util import find_spec

import numpy as np

from agent.remember.memory import Memory
from agent.solve.planning import Plan, Planner, Room
from agent.solve.prediction import Prediction
from agent.solve.vehicle import Array, rollout
from protocol.scene import Scene
from protocol.vehicle import Input, Limits, braking_input, reachable_inputs, settling_rate, wrap_angle

PREFERRED_SPEED_MPS = 1.5
"""About the mean speed of robots that have told one another their goals."""
HORIZON_S = 2.0
"""For which velocities keep clear. With a longer one more crossings end in a deadlock; with a shorter
one robots that turn slowly come nearer than the safety distance."""
LEAN_RAD = 0.2
"""So far to the left of the goal the preferred velocity points: head-on, robots would wait for ever."""
PARKING_M = 1.5
"""So near to its goal a robot begins to park, which ORCA, without headings, cannot."""
STANDING_MPS = 0.05
"""A slower velocity says nothing about the heading."""


def is_available() -> bool:
    """Whether the library with ORCA is installed."""
    return find_spec("pyrvo") is not None


class OrcaPlanner:
    """Plans one step by ORCA from what this robot sees; near its goal it parks by the planner of eq. 1."""

    def __init__(self, scene: Scene, robot: str, parking: Planner) -> None:
        from pyrvo import RVOSimulator

        self._simulator = RVOSimulator
        self._scene = scene
        self._robot = robot
        self._parking = parking
        self._parks = False

    def plan(self, memory: Memory, goal: Array, previous: Input, prediction: Prediction, room: Room) -> Plan:
        """One step towards ORCA's velocity, or on the way into the goal pose."""
        state = memory.state(self._robot)
        self._parks = self._parks or math.dist(state[:2], goal[:2]) < PARKING_M
        if self._parks:
            return self._parking.plan(memory, goal, previous, prediction, room)
        velocity = self.velocity(memory, goal)
        limits, step_s = self._scene.robot(self._robot).limits, self._scene.step_s
        inputs = np.array([tracking_input(velocity, state, limits, previous, step_s)])
        return Plan(inputs, rollout(state, inputs, step_s), solved=True)

    def velocity(self, memory: Memory, goal: Array) -> Array:
        """ORCA's velocity for this robot in m/s, shape (2,)."""
        scene = self._scene
        robots = [self._robot, *(robot for robot in memory.robots if robot != self._robot)]
        highest_mps = scene.robot(self._robot).limits.speed_mps
        simulator = self._simulator()
        simulator.set_time_step(scene.step_s)
        for robot in robots:
            state = memory.state(robot)
            radius_m = scene.robot(robot).radius_m + scene.safety_margin_m
            far_m, count = math.inf, len(robots)
            position, moving = tuple(state[:2].tolist()), _polar(state[3], state[2])
            simulator.add_agent(position, far_m, count, HORIZON_S, HORIZON_S, radius_m, highest_mps, moving)
        x_m, y_m = (goal - memory.state(self._robot))[:2]
        direction_rad = math.atan2(y_m, x_m) + LEAN_RAD
        simulator.set_agent_pref_velocity(0, _polar(min(PREFERRED_SPEED_MPS, highest_mps), direction_rad))
        simulator.do_step()
        return np.array(simulator.get_agent_velocity(0).to_tuple())


def tracking_input(velocity: Array, state: Array, limits: Limits, previous: Input, step_s: float) -> Input:
    """Turn towards a velocity (2,) and drive its part along the heading, as quickly as both can settle."""
    size_mps = math.hypot(*velocity)
    turn_rad = wrap_angle(math.atan2(velocity[1], velocity[0]) - state[2])
    speed_error_mps = float(state[3]) - size_mps * math.cos(turn_rad)
    if size_mps < STANDING_MPS:
        turn_rad = 0.0
    wanted = Input(
        settling_rate(turn_rad / step_s, limits.turn_acceleration_radps2 * step_s),
        braking_input(limits, previous, speed_error_mps, step_s).acceleration_mps2,
    )
    return reachable_inputs(limits, previous, step_s).clip(wanted)


def _polar(size: float, direction_rad: float) -> tuple[float, float]:
    return size * math.cos(direction_rad), size * math.sin(direction_rad)
