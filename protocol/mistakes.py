"""What is wrong with a file, one line a mistake: where, what was found and what was expected."""

from difflib import get_close_matches
from pathlib import Path
from typing import Any, get_args

from pydantic import BaseModel
from pydantic_core import ErrorDetails, PydanticCustomError

from protocol.yaml_tree import Item

MAX_PROBLEMS_TOLD = 5

Location = tuple[str | int, ...]

_EXPECTED = {
    "list_type": "a list",
    "tuple_type": "a list",
    "model_attributes_type": "a map with kind …",
    "string_type": "text",
    "string_pattern_mismatch": "1 to 32 letters, digits, '-' or '_', the first a letter or digit,",
    "string_too_short": "text of at least {min_length} character",
    "string_too_long": "text of at most {max_length} characters",
    "float_type": "a number",
    "finite_number": "a finite number",
    "int_type": "a whole number",
    "literal_error": "{expected}",
    "greater_than": "a number greater than {gt:g}",
    "greater_than_equal": "a number not less than {ge:g}",
    "less_than_equal": "a number not greater than {le:g}",
    "too_short": "a list of at least {min_length} item",
    "too_long": "a list of at most {max_length} items",
}
"""What was expected, by pydantic's kind of error."""


def mistake_at(where: str, what: str) -> PydanticCustomError:
    """A mistake of a whole file that belongs to one place in it.

    Args:
        where: such as ``robots.2.goal``.
        what: is wrong, and what was expected.
    """
    return PydanticCustomError("scenario", "{what}", {"where": where, "what": what})


def tell(path: Path, tree: Item, model: type[BaseModel], errors: list[ErrorDetails]) -> str:
    """One line a mistake, in the order of the file.

    Args:
        path: of the file.
        tree: its content.
        model: what the content was taken for.
        errors: that this led to.
    """
    renamed = {(*e["loc"][:-1], near) for e in errors if (near := _nearest_field(model, e))}
    problems = sorted(
        _problem(tree, model, error)
        for error in errors
        if not (error["type"] == "missing" and error["loc"] in renamed)  # said at the misspelt key
    )
    lines = [f"{path}:{line}: {text}" for line, text in problems[:MAX_PROBLEMS_TOLD]]
    if len(problems) > MAX_PROBLEMS_TOLD:
        lines.append(f"and {len(problems) - MAX_PROBLEMS_TOLD} more")
    return "\n".join(lines)


def told_at(path: Path, tree: Item, location: Location, what: str) -> str:
    """The line of one mistake."""
    return f"{path}:{tree.at(location).line}: {place_of(location)}: {what}"


def expected_map(model: type[BaseModel]) -> str:
    """A map with its required fields, or with all of them where none is required."""
    fields = model.model_fields
    required = [name for name, field in fields.items() if field.is_required()]
    names = ", ".join(required or fields)
    return f"a map with {names}{' …' if 0 < len(required) < len(fields) else ''}"


def place_of(location: Location) -> str:
    """A place as people write it: ``robots[1].goal``."""
    return "".join(f"[{part}]" if isinstance(part, int) else f".{part}" for part in location).lstrip(".")


def location_of(where: str) -> Location:
    """The place that a check of the whole file names: ``robots.1.goal``."""
    return tuple(int(part) if part.isdigit() else part for part in where.split("."))


def _problem(tree: Item, model: type[BaseModel], error: ErrorDetails) -> tuple[int, str]:
    """Line and text of one problem."""
    location = _location(tree, error)
    item = tree.at(location)
    line = item.key_line if error["type"] == "extra_forbidden" else item.line
    place, what = place_of(location), _what(model, error, item)
    return line, f"{place}: {what}" if place else what


def _location(tree: Item, error: ErrorDetails) -> Location:
    """Where an error belongs in the file; pydantic also names the kind that it takes a map for."""
    if where := error.get("ctx", {}).get("where"):
        return location_of(where)
    *way, last = error["loc"] or (None,)
    location: Location = ()
    for part in way:
        if part in tree.at(location).parts:
            location += (part,)
    if last is not None and (last in tree.at(location).parts or error["type"] == "missing"):
        location += (last,)
    if error["type"] in ("union_tag_invalid", "union_tag_not_found"):
        location += ("kind",)
    return location


def _what(model: type[BaseModel], error: ErrorDetails, item: Item) -> str:
    kind, context = error["type"], error.get("ctx", {})
    if kind == "scenario":
        return str(context["what"])
    if kind == "value_error":
        return str(context["error"])
    if kind == "extra_forbidden":
        return _unknown_field(model, error)
    if kind == "missing":
        return f"this {'item' if isinstance(error['loc'][-1], int) else 'field'} is missing"
    if kind == "model_type":
        return f"{expected_map(_model_at(model, error['loc']))} is expected, found {item.described}"
    if kind == "union_tag_invalid":
        return _unknown_kind(context["tag"], _kinds_at(model, error))
    if kind == "union_tag_not_found":
        return f"this field is missing; {_listed(_kinds_at(model, error))}"
    if kind in _EXPECTED:
        return f"{_EXPECTED[kind].format(**context)} is expected, found {item.described}{_hint(kind, item)}"
    return f"{error['msg']}, found {item.described}"


def _hint(kind: str, item: Item) -> str:
    """What to do where YAML reads a value as another type than a person does."""
    if kind == "string_type" and not isinstance(item.value, dict | list | None):
        return "; put it in quotes to make it text"
    if kind in ("float_type", "int_type") and isinstance(item.value, str) and _is_number(item.value):
        return "; to make it a number write it without quotes, and powers of ten as 1.0e+3"
    return ""


def _is_number(text: str) -> bool:
    try:
        float(text)
    except ValueError:
        return False
    return True


def _unknown_field(model: type[BaseModel], error: ErrorDetails) -> str:
    near = _nearest_field(model, error)
    if near:
        return f"there is no such field; did you mean '{near}'?"
    fields = ", ".join(_model_at(model, error["loc"][:-1]).model_fields)
    return f"there is no such field; the fields here are {fields}"


def _nearest_field(model: type[BaseModel], error: ErrorDetails) -> str | None:
    """The right field for a misspelt one."""
    if error["type"] != "extra_forbidden":
        return None
    *parents, key = error["loc"]
    return _nearest(str(key), list(_model_at(model, tuple(parents)).model_fields))


def _unknown_kind(found: str, kinds: list[str]) -> str:
    near = _nearest(found, kinds)
    return f"there is no kind {found!r}; {_listed(kinds) if near is None else f'did you mean {near!r}?'}"


def _kinds_at(model: type[BaseModel], error: ErrorDetails) -> list[str]:
    """What the kind of a map can be where it tells none, or none that there is."""
    return [kind for each in _models_at(model, error["loc"]) if (kind := _kind_of(each))]


def _listed(kinds: list[str]) -> str:
    return f"the kinds are {', '.join(kinds)}"


def _nearest(text: str, possible: list[str]) -> str | None:
    return next(iter(get_close_matches(text.lower(), possible, n=1, cutoff=0.5)), None)


def _model_at(model: type[BaseModel], location: Location) -> type[BaseModel]:
    """The model that describes this place of a file."""
    [found] = _models_at(model, location)
    return found


def _models_at(model: type[BaseModel], location: Location) -> list[type[BaseModel]]:
    """The models of which one describes this place: several where a kind is still to choose."""
    models = [model]
    for part in location:
        if isinstance(part, str):
            by_kind = {_kind_of(each): each for each in models}
            chosen = by_kind.get(part) if len(models) > 1 else None
            models = [chosen] if chosen else _models_in(models[0].model_fields[part].annotation)
    return models


def _kind_of(model: type[BaseModel]) -> str | None:
    """What the field ``kind`` of a model says, where the model is one of several."""
    field = model.model_fields.get("kind")
    return field and next(iter(get_args(field.annotation)), None)


def _models_in(annotation: Any) -> list[type[BaseModel]]:
    """The models in ``list[…]``, ``… | None``, ``tuple[A | B, …]`` and so on."""
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        return [annotation]
    return [model for part in get_args(annotation) for model in _models_in(part)]
