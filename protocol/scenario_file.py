"""Scenario files: YAML in, a valid scenario or one exception for people out; and the way back."""

import math
from difflib import get_close_matches
from pathlib import Path
from typing import Any

import yaml
from pydantic import BaseModel, ValidationError
from pydantic_core import ErrorDetails

from protocol.scenario import Scenario
from protocol.yaml_tree import Item, YamlProblems, read_tree

MAX_FILE_BYTES = 1024 * 1024
MAX_PROBLEMS_TOLD = 5

Location = tuple[str | int, ...]

_EXPECTED = {
    "list_type": "a list",
    "string_type": "text",
    "string_pattern_mismatch": "1 to 32 letters, digits, '-' or '_', the first a letter or digit,",
    "string_too_short": "text of at least {min_length} character",
    "string_too_long": "text of at most {max_length} characters",
    "float_type": "a number",
    "finite_number": "a finite number",
    "int_type": "a whole number",
    "greater_than": "a number greater than {gt:g}",
    "greater_than_equal": "a number not less than {ge:g}",
    "less_than_equal": "a number not greater than {le:g}",
    "too_short": "a list of at least {min_length} item",
    "too_long": "a list of at most {max_length} items",
}
"""What was expected, by pydantic's kind of error."""


class ScenarioError(Exception):
    """A scenario that cannot be used; the text says where, what was found and what was expected."""


def load_scenario(path: Path) -> Scenario:
    """Read a scenario file.

    Raises:
        ScenarioError: the file cannot be read, is no single YAML map, or is not a valid scenario. One line
            a problem, with file, line and field.
    """
    return parse_scenario(_read_text(path), path)


def parse_scenario(text: str, path: Path) -> Scenario:
    """Read the text of a scenario file.

    Args:
        text: the content.
        path: of the file that holds it, for people.

    Raises:
        ScenarioError: as of ``load_scenario``.
    """
    try:
        tree = read_tree(text)
    except YamlProblems as error:
        raise ScenarioError("\n".join(f"{path}:{line}: {what}" for line, what in error.found)) from None
    except RecursionError:
        raise ScenarioError(f"{path}: nested too deep; a scenario has five levels at most") from None
    if tree is None:
        raise ScenarioError(f"{path}: the file is empty; a scenario needs {_expected_map(())}")
    try:
        return Scenario.model_validate(tree.value)
    except ValidationError as error:
        raise ScenarioError(_tell(path, tree, error.errors(include_url=False))) from None


def scenario_text(scenario: Scenario) -> str:
    """A file that ``load_scenario`` reads as this scenario: one line a robot, defaults left out."""
    rules = scenario.model_dump(exclude_defaults=True)
    name, robots = rules.pop("name"), rules.pop("robots")
    lines = [_yaml({key: value}, inline=False) for key, value in {"name": name, **_written(rules)}.items()]
    lines.append("robots:\n")
    for robot in _written(robots):
        in_order = {key: robot[key] for key in ("id", "start", "goal")} | robot
        lines.append(f"  - {_yaml(in_order, inline=True)}")
    return "".join(lines)


def _yaml(fields: dict[str, Any], *, inline: bool) -> str:
    """A map as YAML in one line: with its braces, or as a field of the file."""
    of_maps = any(isinstance(value, dict) for value in fields.values())
    style = True if inline else None if of_maps else False  # PyYAML: None puts the innermost maps into braces
    return yaml.safe_dump(
        fields, default_flow_style=style, sort_keys=False, allow_unicode=True, width=math.inf
    )


def _written(value: Any) -> Any:
    """Numbers as a person writes them: 4 for 4.0, and the id 1 for '1'."""
    match value:
        case dict():
            return {key: _written(part) for key, part in value.items()}
        case list():
            return [_written(part) for part in value]
        case str() if value.isdecimal() and str(int(value)) == value:
            return int(value)
        case float() if value.is_integer() and str(value) != "-0.0":  # there is no whole number −0
            return int(value)
    return value


def _read_text(path: Path) -> str:
    try:
        with path.open("rb") as file:
            content = file.read(MAX_FILE_BYTES + 1)
    except OSError as error:
        raise ScenarioError(f"{path}: the file cannot be read: {error.strerror}") from None
    if len(content) > MAX_FILE_BYTES:
        raise ScenarioError(f"{path}: the file is larger than {MAX_FILE_BYTES} bytes: this is no scenario")
    try:
        return content.decode("utf-8")
    except UnicodeDecodeError as error:
        line = content.count(b"\n", 0, error.start) + 1
        raise ScenarioError(
            f"{path}:{line}: UTF-8 text is expected, found the byte 0x{content[error.start]:02x}"
        ) from None


def _tell(path: Path, tree: Item, errors: list[ErrorDetails]) -> str:
    """One line a problem, in the order of the file."""
    renamed = {(*e["loc"][:-1], near) for e in errors if (near := _nearest_field(e))}
    problems = sorted(
        _problem(tree, error)
        for error in errors
        if not (error["type"] == "missing" and error["loc"] in renamed)  # said at the misspelt key
    )
    lines = [f"{path}:{line}: {text}" for line, text in problems[:MAX_PROBLEMS_TOLD]]
    if len(problems) > MAX_PROBLEMS_TOLD:
        lines.append(f"and {len(problems) - MAX_PROBLEMS_TOLD} more")
    return "\n".join(lines)


def _problem(tree: Item, error: ErrorDetails) -> tuple[int, str]:
    """Line and text of one problem."""
    location = _location(error)
    item = tree.at(location)
    line = item.key_line if error["type"] == "extra_forbidden" else item.line
    place = "".join(f"[{part}]" if isinstance(part, int) else f".{part}" for part in location).lstrip(".")
    return line, f"{place}: {_what(error, item)}" if place else _what(error, item)


def _location(error: ErrorDetails) -> Location:
    """Where an error belongs; a check of the whole scenario names its place in the context."""
    where = error.get("ctx", {}).get("where")
    if where is None:
        return error["loc"]
    return tuple(int(part) if part.isdigit() else part for part in where.split("."))


def _what(error: ErrorDetails, item: Item) -> str:
    kind, context = error["type"], error.get("ctx", {})
    if kind == "scenario":
        return str(context["what"])
    if kind == "value_error":
        return str(context["error"])
    if kind == "extra_forbidden":
        return _unknown_field(error)
    if kind == "missing":
        return "this field is missing"
    if kind == "model_type":
        return f"{_expected_map(error['loc'])} is expected, found {item.described}"
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


def _unknown_field(error: ErrorDetails) -> str:
    near = _nearest_field(error)
    if near:
        return f"there is no such field; did you mean '{near}'?"
    return (
        f"there is no such field; the fields here are {', '.join(_model_at(error['loc'][:-1]).model_fields)}"
    )


def _nearest_field(error: ErrorDetails) -> str | None:
    """The right field for a misspelt one."""
    if error["type"] != "extra_forbidden":
        return None
    *parents, key = error["loc"]
    near = get_close_matches(str(key).lower(), _model_at(tuple(parents)).model_fields, n=1, cutoff=0.5)
    return near[0] if near else None


def _expected_map(location: Location) -> str:
    """A map with its required fields, or with all of them where none is required."""
    fields = _model_at(location).model_fields
    required = [name for name, field in fields.items() if field.is_required()]
    names = ", ".join(required or fields)
    return f"a map with {names}{' …' if 0 < len(required) < len(fields) else ''}"


def _model_at(location: Location) -> type[BaseModel]:
    """The model that describes this place of a scenario."""
    model: type[BaseModel] = Scenario
    for part in location:
        if isinstance(part, str):
            model = _model_in(model.model_fields[part].annotation)
    return model


def _model_in(annotation: Any) -> type[BaseModel]:
    """The model itself, or the one inside ``list[…]`` or ``… | None``."""
    inside = (annotation, *getattr(annotation, "__args__", ()))
    return next(kind for kind in inside if isinstance(kind, type) and issubclass(kind, BaseModel))
