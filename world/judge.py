"""Which commands of a step the world takes, and what the log says of the others and of missing ones."""

import time
from collections import Counter
from collections.abc import Callable, Iterable
from typing import Generic, Protocol, TypeVar

from structlog.typing import FilteringBoundLogger

from protocol.codec import MessageError, decode
from protocol.messages import Command, Refusal, Refusals

MISSES_EVERY_S = 5.0
"""How often at most the log tells of missed commands."""
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


R = TypeVar("R", bound=str)


class RefusalNotices(Generic[R]):
    """What is refused of robots: each robot and reason is logged once, all are counted.

    Args:
        log: for people.
        event: what a line in it begins with.
    """

    def __init__(self, log: FilteringBoundLogger, event: str) -> None:
        self._log = log
        self._event = event
        self._counts: dict[str, Counter[R]] = {}

    @property
    def counts(self) -> dict[str, dict[R, int]]:
        """How many were refused, by robot and reason."""
        return {robot: dict(reasons) for robot, reasons in self._counts.items()}

    def add(self, robot: str, reason: R, detail: str) -> None:
        """Something was refused.

        Args:
            robot: whose key it came on.
            reason: the same for all of this kind.
            detail: more about this one.
        """
        counts = self._counts.setdefault(robot, Counter())
        if reason not in counts:
            self._log.warning(self._event, robot=robot, reason=reason, detail=detail)
        counts[reason] += 1


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
        self.take(robot, command)
        return command

    def take(self, robot: str, command: Command) -> None:
        """A command has come from a robot, which may be refused."""
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


class Misses:
    """Missed commands, summed up over a few seconds.

    Args:
        log: where the sums go.
        now_s: a monotonic clock.
    """

    def __init__(self, log: FilteringBoundLogger, now_s: Callable[[], float] = time.monotonic) -> None:
        self._log = log
        self._now_s = now_s
        self._counts: Counter[str] = Counter()
        self._told_s: float | None = None

    def add(self, robots: Iterable[str]) -> None:
        """These robots had no command at a step; the first miss is told at once."""
        self._counts.update(robots)
        if self._told_s is None or self._now_s() - self._told_s >= MISSES_EVERY_S:
            self.tell()

    def tell(self) -> None:
        """Log what has not been told yet."""
        if self._counts:
            self._log.warning("commands missed", steps_by_robot=dict(self._counts))
            self._counts.clear()
            self._told_s = self._now_s()
