"""A run as a stream of bus messages, the same whether it comes from processes or from virtual time."""

from typing import Final, Literal, NamedTuple

from protocol.messages import Command, Message, Mind, Observation, PublicScene, Refusal, Truth

KINDS: dict[str, type[Message]] = {
    "pose": Observation,
    "command": Command,
    "scene": PublicScene,
    "truth": Truth,
    "mind": Mind,
}
"""The message that each kind of key carries."""


class BusMessage(NamedTuple):
    """One message as it was on the bus."""

    key: str
    message: Message
    time_ns: int
    """Unix time of arrival for real processes; simulated time since step 0 in virtual time."""


TOO_MANY: Final = "too many at once"
"""Why minds are not recorded that come faster than the bench takes them."""


class RefusedMind(NamedTuple):
    """Minds of a robot that were not recorded."""

    robot: str
    reason: Refusal | Literal["too many at once"]
    how_many: int = 1


class Restarted(NamedTuple):
    """A process of the run was started again."""

    process: str


StreamItem = BusMessage | RefusedMind | Restarted
"""What a run tells."""
