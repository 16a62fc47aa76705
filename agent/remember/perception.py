"""Of what was observed, what is believed: kinematic gate, dead reckoning where it refuses, and arrivals."""

import math
from collections.abc import Callable, Mapping, Sequence
from typing import Literal, NamedTuple

import numpy as np

from agent.remember.memory import LONGEST_GAP, Memory
from agent.solve.vehicle import rollout
from protocol.messages import Accuracy, Observation, State
from protocol.scene import Goal, Scene
from protocol.vehicle import Input, Limits, has_arrived

MISMATCH = 1 / 3
"""By what part of a step's change headings and speeds may be off what the limits allow, and positions by all
that limits allow within a step beside straight on: no vehicle is driven in exact Euler steps."""
SIGMAS = 5.0
REACQUIRED_AFTER = 3
"""So many sightings in a row that fit one another are believed, although they do not fit those before."""

Judgement = Literal["believed", "refused", "reacquired"]
"""Of a sighting: it follows from those before it; it does not; or it begins anew, after several refused ones
that fit one another."""


class _Sighting(NamedTuple):
    step: int
    state: State


class Gate:
    """Judges each sighting of a robot by the last one that was believed.

    Between two sightings a vehicle can neither speed up, turn nor move by more than its limits allow, and it
    moves as fast as it says. A sighting that breaks this is refused: a jump, or a place held at speed. After
    ``REACQUIRED_AFTER`` refused ones in a row that fit one another, the last one is believed, as where the
    robot now is. Only who has not been seen for ``LONGEST_GAP`` steps, believed or not, is believed at once.
    """

    def __init__(self, step_s: float, limits_of: Callable[[str], Limits]) -> None:
        self._step_s = step_s
        self._limits_of = limits_of
        self._believed: dict[str, _Sighting] = {}
        self._refused: dict[str, list[_Sighting]] = {}

    def judge(self, robot: str, step: int, state: State, accuracy: Accuracy) -> Judgement:
        """What to make of a robot's state as measured at a step; each sighting is judged once."""
        sighting = _Sighting(step, state)
        last, refused = self._believed.get(robot), self._refused.setdefault(robot, [])
        if last is not None and step <= last.step:
            return "believed"  # of an old view newer ones are known; it changes nothing
        judgement: Judgement = "believed"
        known = last is not None and step - last.step <= LONGEST_GAP
        doubted = bool(refused) and step - refused[-1].step <= LONGEST_GAP
        follows = last is not None and known and self._could_follow(robot, last, sighting, accuracy)
        if not follows and (known or doubted):
            if refused and not self._could_follow(robot, refused[-1], sighting, accuracy):
                refused.clear()
            refused.append(sighting)
            if len(refused) < REACQUIRED_AFTER:
                return "refused"
            judgement = "reacquired"
        refused.clear()
        self._believed[robot] = sighting
        return judgement

    def _could_follow(self, robot: str, before: _Sighting, after: _Sighting, accuracy: Accuracy) -> bool:
        """Whether a vehicle could have come from one sighting to the other."""
        limits, time_s = self._limits_of(robot), (after.step - before.step) * self._step_s
        one, two = before.state, after.state
        speed_sigma, turn_sigma = SIGMAS * accuracy.speed_mps, SIGMAS * accuracy.heading_rad
        margin_mps = MISMATCH * limits.acceleration_mps2 * self._step_s
        margin_rad = MISMATCH * limits.turn_rate_radps * self._step_s
        if abs(two.speed_mps) > limits.speed_mps + margin_mps + speed_sigma:
            return False
        speed_change = abs(two.speed_mps - one.speed_mps) - margin_mps - 1.5 * speed_sigma
        if speed_change > limits.acceleration_mps2 * time_s:
            return False
        turned = abs(math.remainder(two.heading_rad - one.heading_rad, math.tau))
        if turned - margin_rad - 1.5 * turn_sigma > limits.turn_rate_radps * time_s:
            return False
        return self._off_m(before, after, time_s) <= self._allowed_m(limits, one, time_s, accuracy)

    def _off_m(self, before: _Sighting, after: _Sighting, time_s: float) -> float:
        """How far a robot is from where it would be had it gone straight on at its speed."""
        way_m, heading = before.state.speed_mps * time_s, before.state.heading_rad
        return math.hypot(
            after.state.x_m - before.state.x_m - way_m * math.cos(heading),
            after.state.y_m - before.state.y_m - way_m * math.sin(heading),
        )

    def _allowed_m(self, limits: Limits, state: State, time_s: float, accuracy: Accuracy) -> float:
        """What acceleration, turning and noise can add to that."""
        turned = min(limits.turn_rate_radps * time_s, 2.0)
        sped_m = limits.acceleration_mps2 * time_s**2 / 2.0
        swerved_m = (abs(state.speed_mps) * time_s + sped_m) * turned / 2.0
        noise_mps = accuracy.speed_mps + abs(state.speed_mps) * accuracy.heading_rad
        beside_mps = self._step_s * (limits.acceleration_mps2 + limits.speed_mps * limits.turn_rate_radps)
        return (
            self._step_s * beside_mps
            + sped_m
            + swerved_m
            + SIGMAS * (1.5 * accuracy.position_m + time_s * noise_mps)
        )


class Perception:
    """Takes observations into a robot's memory, through the gate and by dead reckoning where it must.

    From memory it judges who has arrived. Whoever was seen to arrive without noise has arrived for good, and
    stays parked in the way of the others; under noise it may only have looked like that, and counts as long
    as it does.

    Attributes:
        memory: what it believes of everybody.
    """

    def __init__(self, scene: Scene, robot: str) -> None:
        self._robot = robot
        self._step_s = scene.step_s
        self._tolerance = scene.arrival_tolerance
        self._reached: Goal | None = None
        self._parked: set[str] = set()

        def limits_of(each: str) -> Limits:
            return scene.robot(each).limits

        window = scene.horizons.estimation_steps + 2
        self._gate = Gate(scene.step_s, limits_of)
        self.memory = Memory(window, scene.step_s, owner=robot, limits_of=limits_of)

    def has_arrived(self, goal: Goal) -> bool:
        """Whether this robot is, or exactly seen was, at its goal."""
        for_good = self._reached == goal and self.memory.is_exact(self._robot)
        arrived = for_good or self._is_at(goal, self._robot)
        self._reached = goal if arrived else None
        return arrived

    def parked(self, goals: Mapping[str, Goal]) -> set[str]:
        """Those of the other robots that have arrived at these goals."""
        present = set(self.memory.robots)
        self._parked -= {robot for robot in present if not self.memory.is_exact(robot)}
        others = present & goals.keys() - {self._robot}
        self._parked |= {robot for robot in others if self._is_at(goals[robot], robot)}
        return self._parked & present

    def _is_at(self, goal: Goal, robot: str) -> bool:
        return has_arrived(self.memory.state(robot).tolist(), goal.as_state(), self._tolerance)

    def take_in(self, observation: Observation, driven: Input | None) -> set[str]:
        """Remember what is believed of an observation; one not newer than the last one changes nothing.

        With its own input at the step before, where that is known, a robot whose own pose is not believed
        takes itself to be where it should be by what it has driven.

        Returns:
            The robots whose sightings are not believed.
        """
        step = observation.step
        if step <= self.memory.step:
            return set()
        seen, refused = self._judged(observation)
        if self._robot in refused and driven is not None:
            inputs = np.tile(driven, (step - self.memory.step, 1))
            seen[self._robot] = rollout(self.memory.state(self._robot), inputs, self._step_s)[-1].tolist()
        sigmas, age_steps = observation.accuracy.as_tuple(), observation.age_steps
        self.memory.remember(step, seen, sigmas=sigmas, age_steps=age_steps, driven=driven)
        return refused

    def _judged(self, observation: Observation) -> tuple[dict[str, Sequence[float]], set[str]]:
        """What is believed, and of whom nothing is; what is believed anew leaves nothing of what was."""
        seen: dict[str, Sequence[float]] = {}
        refused = set()
        for robot, state in observation.robots.items():
            step = observation.step - (0 if robot == self._robot else observation.age_steps)
            judgement = self._gate.judge(robot, step, state, observation.accuracy)
            if judgement == "refused":
                refused.add(robot)
                continue
            if judgement == "reacquired":
                self.memory.forget(robot)
            seen[robot] = state.as_tuple()
        return seen, refused
