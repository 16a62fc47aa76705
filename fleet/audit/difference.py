"""Where a recording is not what its repetition gives, told exactly."""

import json
from itertools import zip_longest
from typing import Any, Literal, NamedTuple

from fleet.record.report_file import Record
from protocol.messages import Message

Part = Literal["key", "scene", "observation", "mind", "command", "truth"]
"""What differs."""
LONGEST_TOLD = 300
"""More characters of a value are not told."""
_NOTHING: Any = object()


class Difference(Record):
    """One place of a recording and what stands there."""

    part: Part
    robot: str | None = None
    """Whose it is; None where it is the world's."""
    step: int | None = None
    field: str = ""
    """Such as ``robots.2.x_m``; empty for a whole message."""
    recorded: str | None
    """In the recording: a value as JSON, or words; None for nothing."""
    repeated: str | None
    """In the repetition."""

    def __str__(self) -> str:
        """One line for people."""
        whose = [f"robot {self.robot}"] if self.robot is not None else []
        when = [f"step {self.step}"] if self.step is not None else []
        what = f"{self.part} {self.field}".strip()
        values = [value if value is not None else "nothing" for value in (self.recorded, self.repeated)]
        return f"{', '.join([*whose, *when, what])}: recorded {values[0]}, repeated {values[1]}"


class _Place(NamedTuple):
    field: tuple[str, ...]
    recorded: Any
    repeated: Any


def compared(
    part: Part,
    recorded: Message,
    repeated: Message,
    *,
    robot: str | None = None,
    without: frozenset[str] = frozenset(),
) -> Difference | None:
    """The first difference of two messages, bit for bit and in the order of their fields.

    Args:
        part: what they are.
        recorded: the one of the recording.
        repeated: the one that should be the same.
        robot: whose they are.
        without: fields that do not count, whether these messages have them or not.
    """
    one, other = (message.model_dump(mode="json", exclude=set(without)) for message in (recorded, repeated))
    place = _first(one, other, ())
    if place is None:
        return None
    return Difference(
        part=part,
        robot=robot,
        step=getattr(recorded, "step", None),
        field=".".join(place.field),
        recorded=_told(place.recorded),
        repeated=_told(place.repeated),
    )


def _first(recorded: Any, repeated: Any, field: tuple[str, ...]) -> _Place | None:
    if isinstance(recorded, dict) and isinstance(repeated, dict):
        names = [*recorded, *(name for name in repeated if name not in recorded)]
        pairs = [(name, recorded.get(name, _NOTHING), repeated.get(name, _NOTHING)) for name in names]
        # An order could carry something too.
        orders = _Place(field, list(recorded), list(repeated)) if list(recorded) != list(repeated) else None
        return _first_of(pairs, field) or orders
    if isinstance(recorded, list) and isinstance(repeated, list):
        both = enumerate(zip_longest(recorded, repeated, fillvalue=_NOTHING))
        return _first_of([(str(index), *values) for index, values in both], field)
    # Their texts tell 0.0 from -0.0, and all other numbers from each other.
    return None if _told(recorded) == _told(repeated) else _Place(field, recorded, repeated)


def _first_of(pairs: list[tuple[str, Any, Any]], field: tuple[str, ...]) -> _Place | None:
    places = (_first(recorded, repeated, (*field, name)) for name, recorded, repeated in pairs)
    return next(filter(None, places), None)


def _told(value: Any) -> str | None:
    if value is _NOTHING:
        return None
    text = json.dumps(value)
    return text if len(text) <= LONGEST_TOLD else f"{text[:LONGEST_TOLD]}…"
