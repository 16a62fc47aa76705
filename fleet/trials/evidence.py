"""What is kept of a run to judge it by."""

from collections.abc import Iterable
from dataclasses import dataclass, field

from protocol.messages import Degradation, Message, Mind, Truth


@dataclass
class Epoch:
    """One world from its start to its end."""

    truths: list[Truth] = field(default_factory=list)
    degraded: dict[tuple[int, str], tuple[Degradation, ...]] = field(default_factory=dict)
    """By step and robot, of every decision."""
    interventions: dict[str, int] = field(default_factory=dict)


class Evidence:
    """Gathers a run from its messages.

    Attributes:
        epochs: in their order.
    """

    def __init__(self, messages: Iterable[Message] = ()) -> None:
        self.epochs: list[Epoch] = []
        self._numbers: dict[int, Epoch] = {}
        for message in messages:
            self.add(message)

    def add(self, message: Message) -> None:
        """Take a truth or a mind; others say nothing more."""
        if isinstance(message, Truth):
            self._of(message.epoch).truths.append(message)
        elif isinstance(message, Mind):
            epoch = self._of(message.epoch)
            epoch.degraded[message.step, message.robot] = message.degraded
            epoch.interventions[message.robot] = message.interventions

    @property
    def end(self) -> Truth | None:
        """The last truth."""
        truths = self.epochs[-1].truths if self.epochs else []
        return truths[-1] if truths else None

    def _of(self, number: int) -> Epoch:
        if number not in self._numbers:
            self._numbers[number] = Epoch()
            self.epochs.append(self._numbers[number])
        return self._numbers[number]
