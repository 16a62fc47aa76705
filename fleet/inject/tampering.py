"""What faults make of the bytes of an observation, so that no robot should take it."""

import math
from collections.abc import Callable
from typing import Any

import msgpack

from fleet.inject.observing import luck
from fleet.inject.schedule import Scheduled
from protocol.codec import encode
from protocol.faults import Garbage, NotANumber, WrongEpoch, WrongVersion
from protocol.messages import Observation

LONGEST_GARBAGE_BYTES = 256

Tampers = Callable[[Scheduled[Any], str, Observation], bytes]


def _not_a_number(scheduled: Scheduled[Any], robot: str, seen: Observation) -> bytes:
    """One robot, drawn each time anew, is at no place."""
    content = seen.model_dump(mode="python")
    victim = luck(scheduled, robot, seen.step).choice(sorted(seen.robots))
    content["robots"][str(victim)]["x_m"] = math.nan
    return _packed(content)


def _garbage(scheduled: Scheduled[Any], robot: str, seen: Observation) -> bytes:
    random = luck(scheduled, robot, seen.step)
    return random.bytes(int(random.integers(1, LONGEST_GARBAGE_BYTES, endpoint=True)))


def _wrong_version(_scheduled: Scheduled[Any], _robot: str, seen: Observation) -> bytes:
    return _packed(seen.model_dump(mode="python") | {"schema_version": seen.VERSION + 1})


def _wrong_epoch(_scheduled: Scheduled[Any], _robot: str, seen: Observation) -> bytes:
    return encode(seen.model_copy(update={"epoch": (seen.epoch + 1) % 2**63}))


def _packed(content: dict[str, Any]) -> bytes:
    """Without the checks of our own messages, which would not let this pass."""
    payload: bytes = msgpack.packb(content)
    return payload


TAMPERING: dict[type[Any], Tampers] = {
    NotANumber: _not_a_number,
    Garbage: _garbage,
    WrongVersion: _wrong_version,
    WrongEpoch: _wrong_epoch,
}
"""The bytes that each kind puts in the place of an observation for a robot."""
