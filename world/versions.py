"""Which robots speak another version of the protocol than the world, by what they say when they join."""

from collections.abc import Iterable

from structlog.typing import FilteringBoundLogger

from protocol.codec import MessageError, OtherVersionError, decode
from protocol.messages import Joining
from protocol.version import PROTOCOL_VERSION, disagreement

MOST_TOLD = 256
"""Lines: a robot that says something else each time cannot fill the log."""


class Versions:
    """Remembers what each robot has said last; the log gets a line for each that differs, once.

    The policy lets a robot ask for the scene on its own key only, so none can say this of another.

    Args:
        log: for people.
    """

    def __init__(self, log: FilteringBoundLogger) -> None:
        self._log = log
        self._told: set[tuple[str, str]] = set()
        self._differing: dict[str, str] = {}

    def hear(self, questions: Iterable[tuple[str, bytes]]) -> None:
        """Robots have asked for the scene.

        Args:
            questions: the robot of the key and the payload of its question.
        """
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
