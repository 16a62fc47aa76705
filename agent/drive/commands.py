"""The commands that a robot has given, and what it has therefore driven."""

from collections import deque
from typing import NamedTuple

from agent.solve.planning import Plan
from agent.solve.vehicle import Array
from protocol.messages import Command
from protocol.vehicle import STANDSTILL, Input, Limits, braking_input, reachable_inputs

LONGEST_BRAKING_STEPS = 1000
"""After so many steps without a command a robot is taken to stand."""

SAME = 1e-6
"""Relative to the limit, inputs that differ by no more are the same."""


def first_input(plan: Plan, limits: Limits, previous: Input, speed_mps: float, step_s: float) -> Input:
    """The receding horizon: only the plan's first input is driven.

    Solvers keep limits to a tolerance; what is commanded keeps those of inputs and rates exactly, and that of
    the speed as far as they allow.
    """
    return _within_limits(plan.inputs[0], limits, previous, speed_mps, step_s)


def second_input(plan: Plan, limits: Limits, first: Input, speed_mps: float, step_s: float) -> Input | None:
    """What follows the first input, for a step that gets no command in time; in the same limits.

    Args:
        plan: whose second input it is.
        limits: of the vehicle.
        first: what is commanded for this step.
        speed_mps: at this step.
        step_s: Δt.

    Returns:
        None where the plan goes no further than one step.
    """
    if len(plan.inputs) < 2:
        return None
    return _within_limits(plan.inputs[1], limits, first, speed_mps + step_s * first.acceleration_mps2, step_s)


def driven_last(given: Command, speed_mps: float, missed_steps: int, limits: Limits, step_s: float) -> Input:
    """What a robot drove at the last of some steps for which it gave no command in time.

    At the first of them that is the `then` of its last command, from there on or without it braking: what the
    world does, and so exactly what was driven, up to the noise in the speed.

    Args:
        given: the last command in time.
        speed_mps: at the step that it answers.
        missed_steps: steps since then without one; with 0, it is the command itself that was driven.
        limits: of the vehicle.
        step_s: Δt.
    """
    driven, fallback = given.input, given.then
    for _ in range(min(missed_steps, LONGEST_BRAKING_STEPS)):
        speed_mps += step_s * driven.acceleration_mps2
        driven = Input(*fallback) if fallback else braking_input(limits, driven, speed_mps, step_s)
        fallback = None
    return driven


def is_same_input(one: Input, other: Input, limits: Limits) -> bool:
    """Whether two inputs are equal, up to what is lost when they are recovered from poses."""
    return (
        abs(one.turn_rate_radps - other.turn_rate_radps) <= SAME * limits.turn_rate_radps
        and abs(one.acceleration_mps2 - other.acceleration_mps2) <= SAME * limits.acceleration_mps2
    )


def without_a_plan(limits: Limits, previous: Input, speed_mps: float, step_s: float) -> Input:
    """The publication's rule for a step at which a problem was not solved.

    Going forward (or standing), the lowest reachable acceleration and turn rate; in reverse, the highest.
    """
    lowest, highest = reachable_inputs(limits, previous, step_s)
    return lowest if speed_mps >= 0 else highest


def _within_limits(planned: Array, limits: Limits, previous: Input, speed_mps: float, step_s: float) -> Input:
    turn_rate, acceleration = planned.tolist()
    slowest, fastest = ((bound - speed_mps) / step_s for bound in (-limits.speed_mps, limits.speed_mps))
    wanted = Input(turn_rate, min(max(acceleration, slowest), fastest))
    return reachable_inputs(limits, previous, step_s).clip(wanted)


DOUBTFUL = 3
"""So many of the last commands may have come too late without anything that showed it."""


class _Given(NamedTuple):
    """A command that was given, with the speed at its step in m/s."""

    command: Command
    speed_mps: float


class GivenCommands:
    """The last commands of one robot that came in time, as far as it knows.

    Args:
        limits: of the robot.
        step_s: Δt in s.
    """

    def __init__(self, limits: Limits, step_s: float) -> None:
        self._limits = limits
        self._step_s = step_s
        self._given: deque[_Given] = deque(maxlen=DOUBTFUL + 1)

    def add(self, command: Command, speed_mps: float) -> None:
        """A command is given at its step, at which the robot drives at this speed."""
        self._given.append(_Given(command, speed_mps))

    def withdraw(self) -> None:
        """The last command came too late to be given."""
        self._given.pop()

    def withdraw_late(self, seen: Input, step: int) -> None:
        """Take back the commands that were not driven, as far as the robot's own motion shows it.

        Noise can hide that; then all of them count as driven.

        Args:
            seen: the input that has led to the state of a step, from states seen at both its ends.
            step: that step.
        """
        possible = [*(self._driven(given, step) for given in reversed(self._given)), STANDSTILL]
        for late, driven in enumerate(possible):
            if is_same_input(seen, driven, self._limits):
                for _ in range(late):
                    self.withdraw()
                return

    def driven_before(self, step: int) -> Input | None:
        """What the robot drove at the step before; None: it has given no command that would tell."""
        return self._driven(self._given[-1], step) if self._given else None

    def _driven(self, given: _Given, step: int) -> Input:
        """What it drove before a step if this was its last command in time."""
        missed_steps = step - given.command.step - 1
        return driven_last(given.command, given.speed_mps, missed_steps, self._limits, self._step_s)
