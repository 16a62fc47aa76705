"""The commands that a robot has given, and what it has therefore driven."""

from collections import deque
from typing import NamedTuple

from agent.acting import driven_last, is_same_input
from protocol.messages import Command
from protocol.vehicle import STANDSTILL, Input, Limits

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
