"""Which commands of a step the world takes."""

from collections.abc import Callable
from typing import Protocol

from structlog.typing import FilteringBoundLogger

from protocol.codec import MessageError, decode
from protocol.messages import Command, Refusal, Refusals
from world.notices import RefusalNotices

Heed = Callable[[str, Command], object]
"""Told of each command that is taken, with the robot that it came from, as soon as it is."""


class Answered(Protocol):
    """A world as far as commands answer it."""

    @property
    def step(self) -> int:
        """The present step."""

    def refusal(self, robot: str, command: Command) -> Refusal | None:
        """Why a command that came from this robot does not answer the present step, None if it does."""


def refusal_at(step: int, epoch: int, robot: str, command: Command) -> Refusal | None:
    """Why a command that came from a robot does not answer this step of this epoch, None if it does."""
    if command.robot != robot:
        return "names another robot"
    if command.epoch != epoch:
        return "answers another epoch"
    if command.step != step:
        return "answers another step"
    return None


class Judge:
    """Takes of each robot the first command that answers the present step, and refuses and counts the rest.

    Args:
        world: whose present step is to be answered.
        log: for people.
        heed: for worlds that do not wait for the end of the step.

    Attributes:
        answers: the commands taken at this step, by robot.
    """

    def __init__(
        self, world: Answered, log: FilteringBoundLogger, heed: Heed = lambda _robot, _command: None
    ) -> None:
        self._world = world
        self._heed = heed
        self._refusals = RefusalNotices[Refusal](log, "command refused")
        self.answers: dict[str, Command] = {}

    @property
    def refused(self) -> Refusals:
        """How many were refused so far, by robot and reason."""
        return self._refusals.counts

    def begin_step(self) -> None:
        """Nothing has been taken at this step yet."""
        self.answers = {}

    def judge(self, robot: str, payload: bytes) -> Command | None:
        """A payload has come from a robot.

        Returns:
            The command that it is, taken or not; None for one that is no valid message.
        """
        try:
            command = decode(Command, payload)
        except MessageError as error:
            self._refusals.add(robot, "not a valid message", str(error))
            return None
        reason = self._world.refusal(robot, command)
        if reason is None and robot in self.answers:
            reason = "answers a step again"
        if reason is None:
            self.answers[robot] = command
            self._heed(robot, command)
        else:
            self._refusals.add(
                robot,
                reason,
                f"command of robot {command.robot}, epoch {command.epoch}, step {command.step} "
                f"at step {self._world.step}",
            )
        return command
