"""Which commands of a step the world takes."""

from structlog.typing import FilteringBoundLogger

from protocol.codec import MessageError, decode
from protocol.messages import Command, Refusals
from world.notices import RefusalNotices
from world.world import World


class Judge:
    """Takes of each robot the first command that answers the present step, and refuses and counts the rest.

    Args:
        world: whose present step is to be answered.
        log: for people.

    Attributes:
        answers: the commands taken at this step, by robot.
    """

    def __init__(self, world: World, log: FilteringBoundLogger) -> None:
        self._world = world
        self._refusals = RefusalNotices(log)
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
        else:
            self._refusals.add(
                robot,
                reason,
                f"command of robot {command.robot}, epoch {command.epoch}, step {command.step} "
                f"at step {self._world.step}",
            )
        return command
