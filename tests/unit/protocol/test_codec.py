"""Messages survive the wire; whatever else arrives gives one kind of exception that names what is wrong."""

import math
import tracemalloc
from collections.abc import Iterable
from functools import partial
from types import UnionType
from typing import Annotated, Any, Literal, Union, get_args, get_origin

import msgpack
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pydantic import BaseModel, ValidationError

from protocol.codec import MAX_ITEMS, MessageError, decode, encode
from protocol.messages import (
    MAX_PAYLOAD_BYTES,
    Command,
    Message,
    Mind,
    Observation,
    PublicScene,
    Truth,
)
from protocol.scene import MAX_ROBOTS

KINDS: list[type[Message]] = [Observation, Command, PublicScene, Truth, Mind]


def anything(kind: Any, metadata: Iterable[Any] = ()) -> st.SearchStrategy[Any]:
    """Every value that a type of the messages allows; collections only of a few items."""
    origin, inner = get_origin(kind), get_args(kind)
    if origin is Annotated:
        return anything(inner[0], [part for each in inner[1:] for part in getattr(each, "metadata", (each,))])
    if origin is Literal:
        return st.sampled_from(inner)
    if origin in (Union, UnionType):
        return st.one_of(*map(anything, inner))
    if origin is dict:
        least = max((getattr(each, "min_length", 0) for each in metadata), default=0)
        return st.dictionaries(*map(anything, inner), min_size=least, max_size=4)
    if origin is tuple:
        if inner[-1] is ...:
            return st.lists(anything(inner[0]), max_size=2).map(tuple)
        return st.tuples(*map(anything, inner))
    if isinstance(kind, type) and issubclass(kind, BaseModel):
        fields = {name: anything(each.annotation, each.metadata) for name, each in kind.model_fields.items()}
        return st.fixed_dictionaries(fields).map(partial(_made, kind)).filter(lambda made: made is not None)
    return _scalar(kind, metadata)


def _scalar(kind: Any, metadata: Iterable[Any]) -> st.SearchStrategy[Any]:
    names = ("ge", "gt", "le", "lt", "pattern")
    limits = {n: limit for each in metadata for n in names if (limit := getattr(each, n, None)) is not None}
    low, high = limits.get("ge", limits.get("gt")), limits.get("le", limits.get("lt"))
    if kind is float:
        return st.floats(low, high, exclude_min="gt" in limits)
    if kind is int:
        return st.integers(low, high - ("lt" in limits))
    return st.from_regex(limits["pattern"], fullmatch=True) if kind is str else st.from_type(kind)


def _made(kind: type[BaseModel], fields: dict[str, Any]) -> BaseModel | None:
    try:
        return kind(**fields)
    except ValidationError:  # an area that is empty
        return None


MESSAGES = st.one_of(*map(anything, KINDS))

COMMAND: dict[str, Any] = {
    "schema_version": 1,
    "epoch": 5,
    "robot": "a",
    "step": 7,
    "turn_rate_radps": 0.25,
    "acceleration_mps2": -0.5,
    "withheld": False,
}
OBSERVATION: dict[str, Any] = {"schema_version": 1, "epoch": 5, "step": 7, "time_s": 0.7}
STATE = {"x_m": 1, "y_m": 2.0, "heading_rad": 0.5, "speed_mps": 0.0}  # whole numbers are numbers, too


def packed(content: Any) -> bytes:
    payload: bytes = msgpack.packb(content)
    return payload


def refusal(kind: type[Message], payload: bytes) -> str:
    """What the one exception says; any other exception fails the test."""
    with pytest.raises(MessageError) as raised:
        decode(kind, payload)
    return str(raised.value)


def decodes_or_is_refused(kind: type[Message], payload: bytes) -> bool:
    """Whether there is nothing but a message of the kind or the one exception, short and naming the kind."""
    try:
        return type(decode(kind, payload)) is kind
    except MessageError as error:
        return str(error).startswith(f"{kind.__name__}: ") and len(str(error)) < 400


@settings(max_examples=50)
@given(MESSAGES)
def test_every_kind_of_message_comes_back_as_it_was_sent(message: Message) -> None:
    assert decode(type(message), encode(message)) == message


def test_on_the_wire_a_message_is_a_msgpack_map_of_its_fields() -> None:
    command = Command(epoch=5, robot="a", step=7, turn_rate_radps=0.25, acceleration_mps2=-0.5)
    assert msgpack.unpackb(encode(command)) == COMMAND
    assert decode(Command, packed(COMMAND)) == command
    assert tuple(command.input) == (0.25, -0.5)


@settings(max_examples=50)
@given(MESSAGES, st.data())
def test_a_message_cut_short_or_lengthened_is_refused_and_one_with_changed_bytes_if_it_is_none(
    message: Message, data: st.DataObject
) -> None:
    payload = bytearray(encode(message))
    cut = data.draw(st.integers(0, len(payload) - 1))
    for spoilt in (payload[:cut], payload + b"\xc0"):
        assert "not readable as msgpack" in refusal(type(message), bytes(spoilt))
    for _ in range(data.draw(st.integers(1, 4))):
        payload[data.draw(st.integers(0, len(payload) - 1))] = data.draw(st.integers(0, 255))
    assert decodes_or_is_refused(type(message), bytes(payload))


PLAIN = st.recursive(
    st.none() | st.booleans() | st.integers(-(2**63), 2**64 - 1) | st.floats() | st.text() | st.binary(),
    lambda inner: st.lists(inner, max_size=4) | st.dictionaries(st.text() | st.binary(), inner, max_size=4),
    max_leaves=12,
)


@settings(max_examples=50)
@given(st.sampled_from(KINDS), st.binary(max_size=200), PLAIN)
def test_random_bytes_and_random_msgpack_are_refused(
    kind: type[Message], payload: bytes, content: Any
) -> None:
    fields = {"schema_version": 1, "epoch": 1, "step": content, "robots": content}
    for each in (payload, packed(content), packed(fields)):
        assert decodes_or_is_refused(kind, each)


@pytest.mark.parametrize("depth", [8, 1020, 100_000])
@pytest.mark.parametrize("field", ["schema_version", "step", "unknown"])
def test_deep_nesting_is_refused(field: str, depth: int) -> None:
    inside = packed(field) + b"\x91" * depth + b"\x01"
    version = packed("schema_version") + b"\x01"
    told = refusal(Mind, b"\x81" + inside if field == "schema_version" else b"\x82" + version + inside)
    assert "nested deeper than 8 levels" in told or "not readable as msgpack: StackError" in told


def test_a_huge_declared_length_is_refused_before_memory_is_taken_for_it() -> None:
    tracemalloc.start()
    try:
        for kind in b"\xdd\xdf\xdb\xc6":  # an array, a map, a text, bytes
            told = refusal(Command, b"\x81" + packed("step") + bytes([kind]) + b"\xff" * 4)
            assert told.startswith("Command: not readable as msgpack: ValueError: ")
        assert tracemalloc.get_traced_memory()[1] < 4 * MAX_PAYLOAD_BYTES
    finally:
        tracemalloc.stop()


def test_too_many_items_and_too_many_bytes_are_refused() -> None:
    assert "exceeds max_array_len" in refusal(Mind, packed({"step": [0] * (MAX_ITEMS + 1)}))
    many = {str(n): 0 for n in range(MAX_ITEMS + 1)}
    assert "exceeds max_map_len" in refusal(Mind, packed({"step": many}))
    for kind in KINDS:
        most = kind.MAX_BYTES
        told = refusal(kind, bytes(most + 1))
        assert told == f"{kind.__name__}: {most + 1} bytes, at most {most} are allowed"
    assert Command.MAX_BYTES < 2000 < Mind.MAX_BYTES == MAX_PAYLOAD_BYTES


def test_a_message_that_no_reader_would_accept_is_not_sent() -> None:
    path = tuple((0.5, 0.5) for _ in range(201))
    mind = Mind.model_construct(prediction={f"r{n}": path for n in range(128)})
    with pytest.raises(MessageError, match=rf"Mind: \d+ bytes, at most {MAX_PAYLOAD_BYTES} are allowed"):
        encode(mind)


@pytest.mark.parametrize("version", [0, 2, 1.0, True, None, [1] * 500])
def test_another_schema_version_is_refused(version: Any) -> None:
    told = refusal(Command, packed({**COMMAND, "schema_version": version}))
    assert told.startswith("Command: schema_version: ")
    assert told.endswith(" found, 1 expected")
    assert len(told) < 200


@pytest.mark.parametrize(
    ("kind", "field", "value", "told"),
    [
        (Command, "turn_rate_radps", math.nan, "should be a finite number, found nan"),
        (Command, "acceleration_mps2", 1e7, "found 10000000.0"),
        (Command, "acceleration_mps2", "1.0", "should be a valid number, found '1.0'"),
        (Command, "step", True, "should be a valid integer, found True"),
        (Command, "epoch", 2**63, "found 9223372036854775808"),
        (Command, "robot", "a\n", "should match pattern"),
        (Command, "speed", 1.0, "Extra inputs are not permitted, found 1.0"),
        (Command, "step", ..., "Field required"),
        (Observation, "robots.a.speed_mps", {"a": {**STATE, "speed_mps": math.nan}}, "a finite number"),
        (Observation, "robots.a/b", {"a/b": STATE}, "should match pattern"),
        (Observation, "robots", {f"r{n}": STATE for n in range(MAX_ROBOTS + 1)}, "at most"),
    ],
)
def test_a_wrong_field_is_named_with_its_path_and_what_was_found(
    kind: type[Message], field: str, value: Any, told: str
) -> None:
    right = COMMAND if kind is Command else OBSERVATION
    content = {n: each for n, each in {**right, field.partition(".")[0]: value}.items() if each is not ...}
    line = refusal(kind, packed(content))
    assert line.startswith(f"{kind.__name__}: {field}")
    assert told in line
