"""JSON schemas of the messages, complete for validators and readable for Foxglove."""

import json
from typing import Any

from protocol.messages import Message

_SCALARS = ("boolean", "string", "number", "integer")

Schema = dict[str, Any]


def message_schema(kind: type[Message]) -> bytes:
    """The JSON schema of a kind of message, as UTF-8 JSON.

    Foxglove builds its list of fields from ``type`` and ``properties`` alone and refuses a topic whose
    properties hold a reference, an alternative (``anyOf``) or an array of arrays. So these two keywords hold
    an outline of what it does read, and the whole schema stands beside them under ``allOf``, which a
    validator applies as well. A field that is missing in the outline is still shown with the message.
    """
    whole = kind.model_json_schema()
    definitions = whole.pop("$defs", {})
    schema = {"title": kind.__name__, **_outline(whole, definitions), "allOf": [whole], "$defs": definitions}
    return json.dumps(schema, ensure_ascii=False).encode()


def _outline(schema: Schema, definitions: Schema) -> Schema:
    """An object's fields as far as Foxglove can read them; of a map from ids, that it is an object."""
    fields = {name: _field(field, definitions) for name, field in schema.get("properties", {}).items()}
    return {"type": "object", "properties": {name: field for name, field in fields.items() if field}}


def _field(schema: Schema, definitions: Schema) -> Schema | None:
    """The outline of one field; None where Foxglove could not read any."""
    if "$ref" in schema:
        schema = definitions[schema["$ref"].rpartition("/")[2]]
    kind = schema.get("type")
    if kind in _SCALARS:
        return {"type": kind}
    if kind == "object":
        return _outline(schema, definitions)
    if kind == "array" and schema["items"].get("type") in _SCALARS:
        return {"type": "array", "items": {"type": schema["items"]["type"]}}
    return None
