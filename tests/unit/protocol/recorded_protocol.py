"""All that robots, world and bench have to agree on, as data.

``python tests/unit/protocol/recorded_protocol.py`` records it as the present version of the protocol.
"""

import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from protocol import codec, messages
from protocol.keys import Keys
from protocol.policy import rights_of
from protocol.version import PROTOCOL_VERSION

RECORDS = Path(__file__).parent / "versions"
KEYS = Keys("RUN")


def record_of(version: int) -> Path:
    """Where a version is recorded."""
    return RECORDS / f"{version}.json"


def kinds(base: type[messages.Said] = messages.Said) -> Iterator[type[messages.Said]]:
    """Everything that is said."""
    for kind in base.__subclasses__():
        yield kind
        yield from kinds(kind)


def protocol() -> dict[str, Any]:
    """Messages by name, keys, who may use them, and the limits of the codec."""
    return {
        "messages": {
            kind.__name__: described(kind)
            for kind in kinds()
            if kind is not messages.Message and kind.__module__ == messages.__name__
        },
        "keys": {
            "pose": KEYS.pose("ROBOT"),
            "command": KEYS.command("ROBOT"),
            "alive": KEYS.alive("ROBOT"),
            "mind": KEYS.mind("ROBOT"),
            "scene": KEYS.scene,
            "scene_for": KEYS.scene_for("ROBOT"),
            "truth": KEYS.truth,
        },
        "rights": {name: rights._asdict() for name, rights in rights_of(KEYS, ["ROBOT"]).items()},
        "limits": {
            "items": codec.MAX_ITEMS,
            "text_bytes": codec.MAX_TEXT_BYTES,
            "depth": codec.MAX_DEPTH,
        },
    }


def described(kind: type[messages.Said]) -> dict[str, Any]:
    """All that a reader of this message relies on, without what only people read, such as docstrings."""
    return {"max_bytes": kind.MAX_BYTES, "schema": _bare(kind.model_json_schema())}


def as_text(content: dict[str, Any]) -> str:
    """As it is kept: the same content is the same text."""
    return json.dumps(content, indent=1, sort_keys=True, ensure_ascii=False) + "\n"


def _bare(schema: Any) -> Any:
    if isinstance(schema, list):
        return [_bare(part) for part in schema]
    if not isinstance(schema, dict):
        return schema
    told = {"title", "description"}
    return {
        name: _bare(part) for name, part in schema.items() if not (name in told and isinstance(part, str))
    }


if __name__ == "__main__":
    record_of(PROTOCOL_VERSION).write_text(as_text(protocol()), encoding="utf-8")
