"""Files written by hand in YAML: read whole, validated, or refused with a line for every mistake."""

from dataclasses import dataclass, field, replace
from difflib import get_close_matches
from pathlib import Path
from typing import Any, TypeVar, get_args

import yaml
from pydantic import BaseModel, ValidationError
from pydantic_core import ErrorDetails, PydanticCustomError

from chassis.refusal import Refusal

_CORE = "tag:yaml.org,2002:"
_MAP, _LIST, _MERGE = _CORE + "map", _CORE + "seq", _CORE + "merge"
_SCALARS = {_CORE + kind for kind in ("str", "int", "float", "bool", "null", "timestamp")}
_SHOWN = 40


class YamlProblems(Exception):
    """Text that is not one plain YAML document; ``found`` holds the line and a text for each problem."""

    def __init__(self, found: list[tuple[int, str]]) -> None:
        super().__init__(found)
        self.found = found


@dataclass(frozen=True)
class Item:
    """A value, the lines of itself and of its key (from 1), its description, and what it holds."""

    value: Any
    line: int
    key_line: int
    described: str
    parts: dict[str | int, "Item"] = field(default_factory=dict)

    def at(self, location: tuple[str | int, ...]) -> "Item":
        """The item at a path of keys and indices, or the last one on the way that exists."""
        item = self
        for part in location:
            if part not in item.parts:
                break
            item = item.parts[part]
        return item


def read_tree(text: str) -> Item | None:
    """The one document of a YAML text; None if there is nothing in it.

    Aliases and merge keys mean what they mean in YAML. A key given twice, of which YAML readers silently
    take the last, and tags that make anything but plain values are refused.

    Raises:
        YamlProblems: the text is not YAML, holds several documents, or something refused.
        RecursionError: it is nested too deep, or an alias stands inside what it stands for.
    """
    try:
        root = yaml.compose(text, Loader=yaml.SafeLoader)
    except yaml.MarkedYAMLError as error:
        line = error.problem_mark.line + 1 if error.problem_mark else 1
        what = ", ".join(part for part in (error.context, error.problem) if part)
        raise YamlProblems([(line, f"one YAML document is expected: {what}")]) from None
    except yaml.reader.ReaderError as error:
        line = text.count("\n", 0, error.position) + 1
        raise YamlProblems([(line, f"the character U+{error.character:04X} is not allowed")]) from None
    if root is None:
        return None
    builder = _Builder()
    tree = builder.item(root)
    if builder.problems:
        raise YamlProblems(sorted(builder.problems))
    return tree


class _Builder:
    """Turns YAML nodes into items; an anchored node becomes one item, however often it is used."""

    def __init__(self) -> None:
        self.problems: list[tuple[int, str]] = []
        self._done: dict[yaml.Node, Item] = {}
        self._constructor = yaml.constructor.SafeConstructor()

    def item(self, node: yaml.Node) -> Item:
        if node not in self._done:
            self._done[node] = self._build(node)
        return self._done[node]

    def _build(self, node: yaml.Node) -> Item:
        line = _line(node)
        if isinstance(node, yaml.MappingNode) and node.tag == _MAP:
            fields = self._fields(node)
            return Item({key: item.value for key, item in fields.items()}, line, line, "a map", fields)
        if isinstance(node, yaml.SequenceNode) and node.tag == _LIST:
            items = [self.item(child) for child in node.value]
            described = f"a list of {len(items)}"
            return Item([item.value for item in items], line, line, described, dict(enumerate(items)))
        value = self._scalar(node)
        return Item(value, line, line, _described(node, value))

    def _fields(self, node: yaml.MappingNode) -> dict[str | int, Item]:
        """The fields of a map: first those merged into it, then its own, which win."""
        merged: dict[str | int, Item] = {}
        own: dict[str | int, Item] = {}
        lines: dict[str, int] = {}
        for key, child in node.value:
            line = _line(key)
            if not isinstance(key, yaml.ScalarNode):
                self.problems.append((line, "a key must be text, found a map or a list"))
            elif key.value in lines:
                what = f"'{_short(key.value)}' is given twice, first in line {lines[key.value]}"
                self.problems.append((line, f"{what}: keep one of the two"))
            else:
                lines[key.value] = line
                if key.tag == _MERGE:
                    merged = self._merged(child)
                else:
                    own[key.value] = replace(self.item(child), key_line=line)
        return merged | own

    def _merged(self, node: yaml.Node) -> dict[str | int, Item]:
        """What ``<<`` brings: the fields of a map, or of several, the first of which wins."""
        fields: dict[str | int, Item] = {}
        for source in reversed(node.value if isinstance(node, yaml.SequenceNode) else [node]):
            if isinstance(source, yaml.MappingNode):
                fields.update(self.item(source).parts)
            else:
                self.problems.append((_line(source), "'<<' merges maps, found something else"))
        return fields

    def _scalar(self, node: yaml.Node) -> Any:
        kind = node.tag.replace(_CORE, "!!")
        if node.tag not in _SCALARS:
            what = f"the tag {kind} is not allowed: plain maps, lists, numbers and text are expected"
            self.problems.append((_line(node), what))
            return None
        try:
            return self._constructor.construct_object(node)
        # PyYAML matches '2026-13-45' or '!!bool maybe' to a type and lets escape whatever that type raises.
        except Exception:
            self.problems.append((_line(node), f"'{_short(node.value)}' cannot be read as {kind}"))
            return None


def _line(node: yaml.Node) -> int:
    return node.start_mark.line + 1


def _described(node: yaml.Node, value: Any) -> str:
    """A scalar as it is written, text in quotes."""
    if value is None:
        return "nothing"
    return f"'{_short(value)}'" if isinstance(value, str) else _short(node.value)


def _short(text: str) -> str:
    """The beginning of a text, with unprintable characters escaped."""
    shown = text if len(text) <= _SHOWN else text[:_SHOWN] + "…"
    return shown if shown.isprintable() else ascii(shown)[1:-1]


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


MAX_FILE_BYTES = 1024 * 1024

M = TypeVar("M", bound=BaseModel)


def read_as(path: Path, model: type[M], what: str) -> M:
    """Read a YAML file.

    Args:
        path: of the file.
        model: what it holds.
        what: its name for people.

    Raises:
        Refusal: the file cannot be read, is no single YAML map, or is not valid. One line a problem,
            with file, line and field.
    """
    return validated(model, tree_of(read_text(path), path, model, what), path)


def read_text(path: Path) -> str:
    """The text of a file of bounded size.

    Raises:
        Refusal: it cannot be read, is too large, or is not UTF-8.
    """
    try:
        with path.open("rb") as file:
            content = file.read(MAX_FILE_BYTES + 1)
    except OSError as error:
        raise Refusal(f"{path}: the file cannot be read: {error.strerror}") from None
    if len(content) > MAX_FILE_BYTES:
        raise Refusal(f"{path}: the file is larger than {MAX_FILE_BYTES} bytes, which is too much")
    try:
        return content.decode("utf-8")
    except UnicodeDecodeError as error:
        line = content.count(b"\n", 0, error.start) + 1
        raise Refusal(
            f"{path}:{line}: UTF-8 text is expected, found the byte 0x{content[error.start]:02x}"
        ) from None


def tree_of(text: str, path: Path, model: type[BaseModel], what: str) -> Item:
    """The content of a file.

    Args:
        text: of the file.
        path: of the file, for people.
        model: what it should hold.
        what: its name for people.

    Raises:
        Refusal: it is no single YAML document, or empty.
    """
    try:
        tree = read_tree(text)
    except YamlProblems as error:
        raise Refusal("\n".join(f"{path}:{line}: {problem}" for line, problem in error.found)) from None
    except RecursionError:
        raise Refusal(f"{path}: nested too deep; a {what} has five levels at most") from None
    if tree is None:
        raise Refusal(f"{path}: the file is empty; a {what} needs {expected_map(model)}")
    return tree


def validated(model: type[M], tree: Item, path: Path) -> M:
    """The content as a model.

    Raises:
        Refusal: it is not valid.
    """
    try:
        return model.model_validate(tree.value)
    except ValidationError as error:
        raise Refusal(tell(path, tree, model, error.errors(include_url=False))) from None
