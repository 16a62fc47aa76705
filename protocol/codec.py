"""Messages to bytes and back. Whatever the bytes, decoding gives a valid message or one kind of exception."""

from typing import Any, TypeVar

import msgpack
from pydantic import ValidationError

from protocol.messages import Said

MAX_ITEMS = 32 * 1024
MAX_TEXT_BYTES = 64
MAX_DEPTH = 8

M = TypeVar("M", bound=Said)


class MessageError(Exception):
    """A payload that is not a valid message; the text names the kind of message and what is wrong."""


class OtherVersionError(MessageError):
    """A message of another version of the protocol.

    Attributes:
        version: that one.
    """

    def __init__(self, name: str, version: int, expected: int) -> None:
        super().__init__(f"{name}: schema_version: {version!r:.80} found, {expected} expected")
        self.version = version


def encode(message: Said) -> bytes:
    """Pack a message.

    Raises:
        MessageError: the message would be larger than any reader accepts.
    """
    payload: bytes = msgpack.packb(message.model_dump(mode="python"))
    _check_size(type(message), payload)
    return payload


def decode(kind: type[M], payload: bytes) -> M:
    """Unpack and validate a message of the expected kind.

    Raises:
        OtherVersionError: another schema version.
        MessageError: too large, too deep, not msgpack, a missing, unknown or wrongly typed field, NaN, an
            infinity or a value out of range.
    """
    name = kind.__name__
    _check_size(kind, payload)
    content = _unpack(name, payload)
    if not isinstance(content, dict):
        raise MessageError(f"{name}: a map is expected, found {type(content).__name__}")
    _check_depth(name, content)
    version = content.get("schema_version")
    if type(version) is not int:
        raise MessageError(f"{name}: schema_version: {version!r:.80} found, {kind.VERSION} expected")
    if version != kind.VERSION:
        raise OtherVersionError(name, version, kind.VERSION)
    try:
        return kind.model_validate(content)
    except ValidationError as error:
        first = error.errors(include_url=False, include_context=False)[0]
        where = ".".join(str(part) for part in first["loc"])
        raise MessageError(f"{name}: {where}: {first['msg']}, found {first['input']!r:.80}") from None


def _check_size(kind: type[Said], payload: bytes) -> None:
    if len(payload) > kind.MAX_BYTES:
        raise MessageError(f"{kind.__name__}: {len(payload)} bytes, at most {kind.MAX_BYTES} are allowed")


def _unpack(name: str, payload: bytes) -> Any:
    """Msgpack to Python with bounded sizes; arrays become tuples."""
    try:
        return msgpack.unpackb(
            payload,
            use_list=False,
            strict_map_key=True,
            max_str_len=MAX_TEXT_BYTES,
            max_bin_len=0,
            max_ext_len=0,
            max_array_len=MAX_ITEMS,
            max_map_len=MAX_ITEMS,
        )
    # msgpack documents that hostile bytes raise its own errors, ValueError and also TypeError,
    # UnicodeDecodeError, RecursionError and others: all of them mean the same here.
    except Exception as error:
        raise MessageError(
            f"{name}: not readable as msgpack: {type(error).__name__}: {error!s:.80}"
        ) from None


def _check_depth(name: str, content: Any) -> None:
    level, depth = [content], 0
    while level:
        depth += 1
        if depth > MAX_DEPTH:
            raise MessageError(f"{name}: nested deeper than {MAX_DEPTH} levels")
        level = [
            child
            for item in level
            if isinstance(item, dict | tuple)
            for child in (item.values() if isinstance(item, dict) else item)
        ]
