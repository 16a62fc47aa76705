"""What faults make of a robot's view: other states than the world's, and older ones."""

import math
from collections.abc import Callable, Mapping
from typing import Any, Generic, TypeVar

import numpy as np

from fleet.inject.schedule import Scheduled
from protocol.faults import Bias, Delay, Fault, Ghost, Jitter, Jump, Stuck
from protocol.messages import Observation, State
from protocol.scene import Scene

FARTHEST_M = 1e6
"""Coordinates beyond cannot be told; what would be seen there is seen here."""

F = TypeVar("F", bound=Fault)


class SeenOtherwise(Generic[F]):
    """A fault by which one robot sees somebody in another state than the world says.

    Args:
        scheduled: the fault.
        robot: the observer.
        scene: of the run.
    """

    def __init__(self, scheduled: Scheduled[F], robot: str, scene: Scene) -> None:
        self.scheduled = scheduled
        self._fault = scheduled.fault
        self._robot = robot
        self._scene = scene

    def states(self, seen: Observation) -> Mapping[str, State]:
        """The states that take the place of those seen; called at each step that the fault strikes."""
        raise NotImplementedError


class _Stuck(SeenOtherwise[Stuck]):
    """Once the other robot is seen, its state stays; it stays in view as well."""

    _stuck: State | None = None

    def states(self, seen: Observation) -> Mapping[str, State]:
        robot = self._fault.seen
        if robot == self._robot:
            return {}
        self._stuck = self._stuck or seen.robots.get(robot)
        return {robot: self._stuck} if self._stuck else {}


class _Ghost(SeenOtherwise[Ghost]):
    """It is where its way from the beginning of the fault leads, as old as the view of all others is."""

    def states(self, seen: Observation) -> Mapping[str, State]:
        fault = self._fault
        steps = seen.step - seen.age_steps - self.scheduled.begin
        way_m = steps * self._scene.step_s * fault.speed_mps
        there = State.of(fault.x_m, fault.y_m, fault.heading_rad, fault.speed_mps)
        name = _free_name({*self._scene.robots, *seen.robots})
        return {name: moved(there, way_m * math.cos(fault.heading_rad), way_m * math.sin(fault.heading_rad))}


class _Jump(SeenOtherwise[Jump]):
    """Each time in a direction drawn anew."""

    def states(self, seen: Observation) -> Mapping[str, State]:
        fault = self._fault
        if fault.seen not in seen.robots:
            return {}
        direction_rad = luck(self.scheduled, self._robot, seen.step).uniform(-math.pi, math.pi)
        x_m, y_m = (fault.distance_m * turn(direction_rad) for turn in (math.cos, math.sin))
        return {fault.seen: moved(seen.robots[fault.seen], x_m, y_m)}


class _Bias(SeenOtherwise[Bias]):
    def states(self, seen: Observation) -> Mapping[str, State]:
        fault = self._fault
        if fault.seen not in seen.robots:
            return {}
        return {fault.seen: moved(seen.robots[fault.seen], fault.x_m, fault.y_m)}


SEEN_OTHERWISE: dict[type[Any], type[SeenOtherwise[Any]]] = {
    Stuck: _Stuck,
    Ghost: _Ghost,
    Jump: _Jump,
    Bias: _Bias,
}
"""What makes other states of each kind."""


def _delay_steps(scheduled: Scheduled[Delay], _robot: str, _step: int) -> int:
    return scheduled.fault.steps


def _jitter_steps(scheduled: Scheduled[Jitter], robot: str, step: int) -> int:
    return int(luck(scheduled, robot, step).integers(scheduled.fault.steps, endpoint=True))


LATE_BY_STEPS: dict[type[Any], Callable[[Scheduled[Any], str, int], int]] = {
    Delay: _delay_steps,
    Jitter: _jitter_steps,
}
"""How many steps older each kind makes a robot's view of the others at a step; they add up."""


def aged(now: Observation, then: Observation, robot: str) -> Observation:
    """What an observer sees whose view of the others is of an earlier step, and says so."""
    own = {robot: now.robots[robot]} if robot in now.robots else {}
    others = {name: state for name, state in then.robots.items() if name != robot}
    age_steps = now.step - then.step + then.age_steps
    return now.model_copy(update={"robots": {**others, **own}, "age_steps": age_steps})


def moved(state: State, x_m: float, y_m: float) -> State:
    """A state displaced by a way, as far as it can be told."""
    x_m, y_m = (min(max(each, -FARTHEST_M), FARTHEST_M) for each in (state.x_m + x_m, state.y_m + y_m))
    return state.model_copy(update={"x_m": x_m, "y_m": y_m})


def luck(scheduled: Scheduled[Any], robot: str, step: int) -> np.random.Generator:
    """What is random about how a fault strikes; independent of whether it does."""
    random = scheduled.random(robot, step)
    random.random()  # the lot by which it strikes
    return random


def _free_name(taken: set[str]) -> str:
    """A name of nobody, for a robot that does not exist."""
    names = ("ghost" if number == 1 else f"ghost-{number}" for number in range(1, len(taken) + 2))
    return next(name for name in names if name not in taken)
