"""Files: written whole or not at all, and read from YAML that people write, with a line for every mistake."""

import os
import re
import secrets
import shutil
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from difflib import get_close_matches
from pathlib import Path
from typing import Any, TypeVar, get_args

import yaml
from pydantic import BaseModel, ConfigDict, ValidationError
from pydantic_core import ErrorDetails, PydanticCustomError

from chassis.refusal import Refusal

MAX_FILE_BYTES = 1024 * 1024
MAX_PROBLEMS = 5
"""Described one by one; the others are only counted."""

_CORE = "tag:yaml.org,2002:"
_TEXT, _NOTHING = _CORE + "str", _CORE + "null"
_NUMBER = re.compile(r"[-+]?(\d+\.?\d*|\.\d+)(e[-+]?\d+)?", re.IGNORECASE)
_SHOWN = 40
_INCOMPLETE = ("missing", "union_tag_invalid", "union_tag_not_found")
"""Errors at a field that a map lacks, or that says of what kind the map is."""
_PLAIN = {_TEXT, _NOTHING, *(_CORE + kind for kind in ("int", "float", "bool", "timestamp", "map", "seq"))}

Location = tuple[str | int, ...]
Problem = tuple[int, str]
"""A line, from 1, and what is wrong there."""
M = TypeVar("M", bound=BaseModel)


class Record(BaseModel):
    """Base of what is said on the bus, written by hand or kept: exactly these fields, only finite numbers."""

    model_config = ConfigDict(frozen=True, extra="forbid", strict=True, allow_inf_nan=False)


def write_private(path: Path, text: str) -> None:
    """Write a new file that only its owner can read, from its first byte on and whatever the umask.

    Raises:
        OSError: it exists, or cannot be written.
    """
    descriptor = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600)
    with os.fdopen(descriptor, "w", encoding="utf-8") as file:
        file.write(text)


def write_whole(path: Path, content: str | bytes) -> None:
    """Write a file that is there with all of its content, or else stays as it was.

    Raises:
        OSError: it cannot be written.
    """
    part = path.with_name(path.name + ".part")
    try:
        with part.open("wb") as file:
            file.write(content.encode() if isinstance(content, str) else content)
            file.flush()
            os.fsync(file.fileno())
        os.replace(part, path)
    finally:
        part.unlink(missing_ok=True)


def empty_directory(directory: Path) -> None:
    """Make a directory if need be; one that holds something is refused, so that nothing is lost.

    Raises:
        Refusal: it holds something, or cannot be made.
    """
    try:
        directory.mkdir(parents=True, exist_ok=True)
        if any(directory.iterdir()):
            raise Refusal(f"{directory} is not empty; choose another directory with --out, or remove it")
    except OSError as error:
        raise Refusal(f"{directory} cannot be used for the output: {error.strerror}") from error


@contextmanager
def new_directory(directory: Path, if_taken: str) -> Iterator[Path]:
    """A directory to fill in the block; it takes its place at the end of the block, or is gone.

    Args:
        directory: its place, where nothing or an empty directory is.
        if_taken: what people can do where something is.

    Raises:
        Refusal: something is there, or it is the working directory.
        OSError: it cannot be written.
    """
    directory = directory.resolve()
    if directory == Path.cwd():
        raise Refusal(f"{directory} is where you are; name a new directory in it")
    if directory.exists() and any(directory.iterdir()):
        raise Refusal(f"{directory} is not empty; {if_taken}")
    beside = directory.with_name(f".{directory.name}-{secrets.token_hex(4)}")
    try:
        beside.mkdir(parents=True)
        yield beside
        beside.rename(directory)
    finally:
        shutil.rmtree(beside, ignore_errors=True)


def mistake_at(where: str, what: str) -> PydanticCustomError:
    """A mistake of the whole that a validator finds at one place, such as ``robots.2.goal``."""
    return PydanticCustomError("mistake", "{what}", {"where": where, "what": what})


def read_as(
    path: Path,
    model: type[M],
    what: str,
    check: Callable[[M], object] = lambda _found: None,
    text: str | None = None,
) -> M:
    """Read a YAML file.

    Args:
        path: of the file.
        model: what it holds.
        what: its name for people.
        check: of the whole; it may raise :func:`mistake_at`.
        text: of the file, where it has been read already.

    Raises:
        Refusal: the file cannot be read, is too large, is no single YAML map, or is not valid. One line a
            problem, with file, line and field.
    """
    text = _text_of(path) if text is None else text
    root: yaml.Node | None = None
    problems: list[Problem]
    try:
        root = yaml.compose(text, Loader=yaml.SafeLoader)
        if root is None:
            raise Refusal(f"{path}: the file is empty; a {what} needs {_map_of(model)}")
        problems = list(_made_plain(root, set()))
        if not problems:
            found = model.model_validate(yaml.constructor.SafeConstructor().construct_document(root))
            check(found)
            return found
    except RecursionError:
        raise Refusal(f"{path}: nested too deep; a {what} has five levels at most") from None
    except yaml.MarkedYAMLError as error:
        line = error.problem_mark.line + 1 if error.problem_mark else 1
        why = ", ".join(part for part in (error.context, error.problem) if part)
        problems = [(line, f"one YAML document is expected: {why}")]
    except yaml.reader.ReaderError as error:
        line = text.count("\n", 0, error.position) + 1
        problems = [(line, f"the character U+{error.character:04X} is not allowed")]
    except ValidationError as error:
        problems = list(_located(root, model, error.errors(include_url=False)))
    except PydanticCustomError as error:
        whole = ErrorDetails(type=error.type, loc=(), msg="", input=None, ctx=error.context or {})
        problems = list(_located(root, model, [whole]))
    lines = [f"{path}:{line}: {problem}" for line, problem in sorted(problems)]
    rest = [f"and {len(lines) - MAX_PROBLEMS} more"] if len(lines) > MAX_PROBLEMS else []
    raise Refusal("\n".join(lines[:MAX_PROBLEMS] + rest))


def _text_of(path: Path) -> str:
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
        found = f"the byte 0x{content[error.start]:02x}"
        raise Refusal(f"{path}:{line}: UTF-8 text is expected, found {found}") from None


def _made_plain(node: yaml.Node, done: set[yaml.Node]) -> Iterator[Problem]:
    """Make every key of a document text and merge what ``<<`` names, once for each node, however often used.

    Yields:
        Keys given twice, of which YAML readers silently take the last, and all that makes no plain value.
    """
    if node in done:
        return
    done.add(node)
    if node.tag not in _PLAIN:
        kind = node.tag.replace(_CORE, "!!")
        yield _line(node), f"the tag {kind} is not allowed: plain maps, lists, numbers and text are expected"
    elif isinstance(node, yaml.SequenceNode):
        for child in node.value:
            yield from _made_plain(child, done)
    elif isinstance(node, yaml.MappingNode):
        yield from _made_plain_map(node, done)
    else:
        try:
            yaml.constructor.SafeConstructor().construct_object(node)
        # PyYAML matches '2026-13-45' or '!!bool maybe' to a type and lets escape whatever that type raises.
        except Exception:
            yield _line(node), f"'{_short(node.value)}' cannot be read as {node.tag.replace(_CORE, '!!')}"


def _made_plain_map(node: yaml.MappingNode, done: set[yaml.Node]) -> Iterator[Problem]:
    own: dict[str, tuple[yaml.Node, yaml.Node]] = {}
    merged: dict[str, tuple[yaml.Node, yaml.Node]] = {}
    for key, child in node.value:
        yield from _made_plain(child, done)
        if not isinstance(key, yaml.ScalarNode):
            yield _line(key), "a key must be text, found a map or a list"
        elif key.value in own:
            what = f"'{_short(key.value)}' is given twice, first in line {_line(own[key.value][0])}"
            yield _line(key), f"{what}: keep one of the two"
        else:
            own[key.value] = key, child
            if key.tag == _CORE + "merge":  # of several maps, the first one wins; over all, the own fields
                for source in reversed(child.value if isinstance(child, yaml.SequenceNode) else [child]):
                    if isinstance(source, yaml.MappingNode):
                        merged |= {each.value: (each, value) for each, value in source.value}
                    else:
                        yield _line(source), "'<<' merges maps, found something else"
            else:
                key.tag = _TEXT
    node.value = [pair for pair in (merged | own).values() if pair[0].tag == _TEXT]


def _located(root: yaml.Node | None, model: type[BaseModel], errors: list[ErrorDetails]) -> Iterator[Problem]:
    """Each error at its place in the file."""
    assert root is not None
    unknown = [error["loc"] for error in errors if _is_unknown(error)]
    meant = {(*loc[:-1], _nearest(str(loc[-1]), _fields_beside(model, loc))) for loc in unknown}
    for error in errors:
        kind, location, context = error["type"], error["loc"], error.get("ctx", {})
        if kind == "missing" and location in meant:
            continue  # said at the misspelt key
        if where := context.get("where"):
            location = tuple(int(part) if part.isdigit() else part for part in str(where).split("."))
        if kind in _INCOMPLETE[1:]:
            location = (*location, "kind")
        place, node, line = Location(), root, _line(root)
        for part in location:  # pydantic also names the kind that it takes a map for
            if found := _parts(node).get(part):
                place, line, node = (*place, part), _line(found[0]), found[1]
        if kind in _INCOMPLETE and place[-1:] != location[-1:]:
            place = (*place, location[-1])
        what = _what(model, error, node)
        named = "".join(f"[{part}]" if isinstance(part, int) else f".{part}" for part in place).lstrip(".")
        yield line if _is_unknown(error) else _line(node), f"{named}: {what}" if named else what


def _what(model: type[BaseModel], error: ErrorDetails, node: yaml.Node) -> str:
    """What is wrong: in own words where these help more than pydantic's."""
    kind, context = error["type"], error.get("ctx", {})
    if kind in ("mistake", "value_error"):
        return str(context.get("what") or context["error"])
    if kind == "missing":
        return f"this {'item' if isinstance(error['loc'][-1], int) else 'field'} is missing"
    if _is_unknown(error):
        fields = _fields_beside(model, error["loc"])
        return f"there is no such field; {_instead(str(error['loc'][-1]), 'fields here', fields)}"
    if kind == "model_attributes_type":
        return f"a map with kind … is expected, found {_shown(node)}"
    if kind == "model_type":
        return f"{_map_of(_models_at(model, error['loc'])[0])} is expected, found {_shown(node)}"
    if kind in _INCOMPLETE:
        kinds = [name for each in _models_at(model, error["loc"]) if (name := _kind_of(each))]
        tag = context.get("tag")
        said = f"there is no kind {tag!r}" if tag else "this field is missing"
        return f"{said}; {_instead(tag or '', 'kinds', kinds)}"
    hint = ""
    if kind == "string_type" and isinstance(node, yaml.ScalarNode) and node.tag != _NOTHING:
        hint = "; put it in quotes to make it text"
    elif kind in ("float_type", "int_type") and node.tag == _TEXT and _NUMBER.fullmatch(node.value):
        hint = "; to make it a number write it without quotes, and powers of ten as 1.0e+3"
    message = error["msg"].replace("tuple", "list").replace(" after validation", "")
    return f"{message[0].lower()}{message[1:]}, found {_shown(node)}{hint}"


def _instead(found: str, what: str, possible: list[str]) -> str:
    near = _nearest(found, possible)
    return f"did you mean {near!r}?" if near else f"the {what} are {', '.join(possible)}"


def _is_unknown(error: ErrorDetails) -> bool:
    return error["type"] == "extra_forbidden"


def _fields_beside(model: type[BaseModel], location: Location) -> list[str]:
    return list(_models_at(model, location[:-1])[0].model_fields)


def _nearest(text: str, possible: list[str]) -> str | None:
    return next(iter(get_close_matches(text.lower(), possible, n=1, cutoff=0.5)), None)


def _map_of(model: type[BaseModel]) -> str:
    """A map with its required fields, or with all of them where none is required."""
    fields = model.model_fields
    required = [name for name, field in fields.items() if field.is_required()]
    return f"a map with {', '.join(required or fields)}{' …' if 0 < len(required) < len(fields) else ''}"


def _models_at(model: type[BaseModel], location: Location) -> list[type[BaseModel]]:
    """The models of which one describes this place: several where a kind is still to choose."""
    models = [model]
    for part in location:
        if isinstance(part, str):
            chosen = {_kind_of(each): each for each in models}.get(part) if len(models) > 1 else None
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


def _parts(node: yaml.Node) -> dict[str | int, tuple[yaml.Node, yaml.Node]]:
    """What a map or a list holds: key and value by name, or item by index."""
    if isinstance(node, yaml.MappingNode):
        return {key.value: (key, child) for key, child in node.value}
    items = node.value if isinstance(node, yaml.SequenceNode) else ()
    return {index: (item, item) for index, item in enumerate(items)}


def _line(node: yaml.Node) -> int:
    return node.start_mark.line + 1


def _shown(node: yaml.Node) -> str:
    """A value for people: a scalar as it is written, text in quotes."""
    if not isinstance(node, yaml.ScalarNode):
        return "a map" if isinstance(node, yaml.MappingNode) else f"a list of {len(node.value)}"
    if node.tag == _NOTHING:
        return "nothing"
    return f"'{_short(node.value)}'" if node.tag == _TEXT else _short(node.value)


def _short(text: str) -> str:
    """The beginning of a text, with unprintable characters escaped."""
    shown = text if len(text) <= _SHOWN else text[:_SHOWN] + "…"
    return shown if shown.isprintable() else ascii(shown)[1:-1]
