"""Which commands of a step the world takes; what the log says of others, missing ones, and other versions."""

import time
from collections import Counter
from collections.abc import Callable, Iterable
from typing import Generic, TypeVar

from structlog.typing import FilteringBoundLogger

from protocol.codec import MessageError, OtherVersionError, decode
from protocol.messages import Command, Joining, Refusal, Refusals
from protocol.version import PROTOCOL_VERSION, disagreement
from world.world import BaseWorld

MOST_TOLD = 256
"""Lines about other versions: a robot that says something else each time cannot fill the log."""

MISSES_EVERY_S = 5.0
"""How often at most the log tells of missed commands."""

R = TypeVar("R", bound=str)


class RefusalNotices(Generic[R]):
    """What is refused of robots: each robot and reason is logged once, all are counted."""

    def __init__(self, log: FilteringBoundLogger, event: str) -> None:
        self._log = log
        self._event = event
        self._counts: dict[str, Counter[R]] = {}

    @property
    def counts(self) -> dict[str, dict[R, int]]:
        """How many were refused, by robot and reason."""
        return {robot: dict(reasons) for robot, reasons in self._counts.items()}

    def add(self, robot: str, reason: R, detail: str) -> None:
        """Something was refused."""
        counts = self._counts.setdefault(robot, Counter())
        if reason not in counts:
            self._log.warning(self._event, robot=robot, reason=reason, detail=detail)
        counts[reason] += 1


class Judge:
    """Takes of each robot the first command that answers the present step, and refuses and counts the rest.

    Attributes:
        answers: the commands taken at this step, by robot.
    """

    def __init__(self, world: BaseWorld, log: FilteringBoundLogger) -> None:
        self._world = world
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
            self._world.heed(robot, command)
        else:
            self._refusals.add(
                robot,
                reason,
                f"command of robot {command.robot}, epoch {command.epoch}, step {command.step} "
                f"at step {self._world.step}",
            )


class Misses:
    """Missed commands, summed up over a few seconds."""

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


class Versions:
    """Remembers what each robot has said last; the log gets a line for each that differs, once.

    The policy lets a robot ask for the scene on its own key only, so none can say this of another.
    """

    def __init__(self, log: FilteringBoundLogger) -> None:
        self._log = log
        self._told: set[tuple[str, str]] = set()
        self._differing: dict[str, str] = {}

    def hear(self, questions: Iterable[tuple[str, bytes]]) -> None:
        """Robots have asked for the scene."""
        for robot, payload in questions:
            try:
                decode(Joining, payload)
            except OtherVersionError as error:
                self._differs(robot, disagreement(robot, error.version, PROTOCOL_VERSION))
            except MessageError as error:
                unknown = f"robot {robot} does not say which version of the protocol it speaks"
                self._differs(robot, f"{unknown}: {error}")
            else:
                self._differing.pop(robot, None)

    def account(self, missing: Iterable[str]) -> str:
        """What is to be said of those missing robots that differ, as sentences; empty if there are none."""
        told = (self._differing[robot] for robot in missing if robot in self._differing)
        return "".join(f" {text[0].upper()}{text[1:]}." for text in told)

    def _differs(self, robot: str, text: str) -> None:
        self._differing[robot] = text
        if (robot, text) not in self._told and len(self._told) < MOST_TOLD:
            self._log.warning(text, robot=robot)
            self._told.add((robot, text))
