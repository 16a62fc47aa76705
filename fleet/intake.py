"""Which of the messages that reach the bench are recorded: of each robot, one of a kind for a step."""

from fleet.mailbox import Letter
from fleet.stream import KINDS, BusMessage, RefusedMind
from protocol.codec import MessageError, decode
from protocol.keys import Keys
from protocol.messages import Command, Message, Mind, PublicScene, Refusal, Truth


class Intake:
    """Decodes and judges what comes, in its order.

    A robot may put anything on its command and its mind key, as often as it likes; the bench keeps the first
    valid message of each kind for a step, of the present world, under the robot's own name. Of what is not
    taken, minds are told; commands are counted by the world, which takes by the same rule.

    Args:
        keys: of the run.
    """

    def __init__(self, keys: Keys) -> None:
        self._keys = keys
        self._epoch: int | None = None
        self._past_epochs: set[int | None] = set()
        self._step = 0
        self._last: dict[str, int] = {}

    def take(self, letter: Letter) -> BusMessage | RefusedMind | None:
        """The message, if it is to be recorded, or a mind that is not.

        Raises:
            MessageError: the world itself said something that is not valid.
        """
        kind = KINDS[self._keys.kind_of(letter.key)]
        if not issubclass(kind, Command | Mind):
            message = decode(kind, letter.payload)
            if message.epoch in self._past_epochs:  # it came late: that world is gone
                return None
            self._follow(message)
            return BusMessage(letter.key, message, letter.time_ns)
        robot = self._keys.robot_of(letter.key)
        judged = self._judge(kind, robot, letter)
        if isinstance(judged, Message):
            return BusMessage(letter.key, judged, letter.time_ns)
        return RefusedMind(robot, judged) if kind is Mind else None

    def _follow(self, message: Message) -> None:
        """The world says which epoch and which step it is."""
        if isinstance(message, PublicScene | Truth) and message.epoch != self._epoch:
            self._past_epochs.add(self._epoch)
            self._epoch = message.epoch
            self._step = 0
            self._last.clear()
        if isinstance(message, Truth):
            self._step = message.step

    def _judge(self, kind: type[Command | Mind], robot: str, letter: Letter) -> Command | Mind | Refusal:
        try:
            message = decode(kind, letter.payload)
        except MessageError:
            return "not a valid message"
        if message.robot != robot:
            return "names another robot"
        if message.epoch != self._epoch:
            return "answers another epoch"
        # The truth of a step comes after its poses, so a quick answer can be here before it.
        if message.step > self._step + 1:
            return "answers another step"
        if message.step <= self._last.get(letter.key, -1):
            return "answers a step again"
        self._last[letter.key] = message.step
        return message
