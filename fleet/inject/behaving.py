"""How a robot behaves while a fault is on its behaviour; the algorithm is that of all others."""

from typing import Any, Generic, TypeVar

from protocol.faults import Chases, Ignores, OtherCost, StopsDead, TurnsBack
from protocol.messages import Command, Observation, State
from protocol.scene import Goal, Scene
from protocol.vehicle import Input, braking_input

F = TypeVar("F")


class Behaviour(Generic[F]):
    """What is put between a robot's senses, its algorithm and its command; here, nothing.

    Args:
        fault: that makes it behave so.
        robot: its id.
        home: where it was first seen.
    """

    def __init__(self, fault: F, robot: str, home: Goal) -> None:
        self._fault = fault
        self._robot = robot
        self._home = home

    def scene(self, scene: Scene) -> Scene:
        """What it takes the scene for."""
        return scene

    def view(self, seen: Observation) -> Observation:
        """What it takes notice of."""
        return seen

    def goal(self, _seen: Observation) -> Goal | None:
        """Where it drives; None: where it drove before."""
        return None

    def input(self, _state: State, _previous: Input, _scene: Scene) -> Input | None:
        """What it drives instead of what it decided; None: just that.

        Args:
            state: its own.
            previous: the input that it gave before.
            scene: of the run.
        """
        return None


class _Stops(Behaviour[StopsDead]):
    def input(self, state: State, previous: Input, scene: Scene) -> Input:
        return braking_input(scene.robot(self._robot).limits, previous, state.speed_mps, scene.step_s)


class _Ignores(Behaviour[Ignores]):
    def view(self, seen: Observation) -> Observation:
        return _alone(seen, self._robot)


class _TurnsBack(Behaviour[TurnsBack]):
    def goal(self, _seen: Observation) -> Goal:
        return self._home


class _Chases(Behaviour[Chases]):
    def view(self, seen: Observation) -> Observation:
        return _alone(seen, self._robot)

    def goal(self, seen: Observation) -> Goal | None:
        chased = seen.robots.get(self._fault.seen)
        return None if chased is None else place_of(chased)


class _OtherCost(Behaviour[OtherCost]):
    def scene(self, scene: Scene) -> Scene:
        return scene.model_copy(update={"weights": self._fault.weights})


BEHAVIOURS: dict[type[Any], type[Behaviour[Any]]] = {
    StopsDead: _Stops,
    Ignores: _Ignores,
    TurnsBack: _TurnsBack,
    Chases: _Chases,
    OtherCost: _OtherCost,
}
"""The behaviour of each kind."""


def place_of(state: State) -> Goal:
    """A robot's pose as a goal."""
    return Goal(x_m=state.x_m, y_m=state.y_m, heading_rad=state.heading_rad)


def given_instead(decided: Command, wanted: Input) -> Command:
    """A command with another input, of which nothing follows for the step after."""
    turn_rate, acceleration = wanted
    return decided.model_copy(
        update={"turn_rate_radps": turn_rate, "acceleration_mps2": acceleration, "then": None}
    )


def _alone(seen: Observation, robot: str) -> Observation:
    return seen.model_copy(update={"robots": {robot: seen.robots[robot]}})
