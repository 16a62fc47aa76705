"""Files written by hand in YAML: read whole, validated, or refused with a line for every mistake."""

from pathlib import Path
from typing import TypeVar

from pydantic import BaseModel, ValidationError

from protocol.mistakes import expected_map, tell
from protocol.yaml_tree import Item, YamlProblems, read_tree

MAX_FILE_BYTES = 1024 * 1024

M = TypeVar("M", bound=BaseModel)


class YamlFileError(Exception):
    """A file that cannot be used; the text says where, what was found and what was expected."""


def read_as(path: Path, model: type[M], what: str) -> M:
    """Read a YAML file.

    Args:
        path: of the file.
        model: what it holds.
        what: its name for people.

    Raises:
        YamlFileError: the file cannot be read, is no single YAML map, or is not valid. One line a problem,
            with file, line and field.
    """
    return validated(model, tree_of(read_text(path), path, model, what), path)


def read_text(path: Path) -> str:
    """The text of a file of bounded size.

    Raises:
        YamlFileError: it cannot be read, is too large, or is not UTF-8.
    """
    try:
        with path.open("rb") as file:
            content = file.read(MAX_FILE_BYTES + 1)
    except OSError as error:
        raise YamlFileError(f"{path}: the file cannot be read: {error.strerror}") from None
    if len(content) > MAX_FILE_BYTES:
        raise YamlFileError(f"{path}: the file is larger than {MAX_FILE_BYTES} bytes, which is too much")
    try:
        return content.decode("utf-8")
    except UnicodeDecodeError as error:
        line = content.count(b"\n", 0, error.start) + 1
        raise YamlFileError(
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
        YamlFileError: it is no single YAML document, or empty.
    """
    try:
        tree = read_tree(text)
    except YamlProblems as error:
        raise YamlFileError("\n".join(f"{path}:{line}: {problem}" for line, problem in error.found)) from None
    except RecursionError:
        raise YamlFileError(f"{path}: nested too deep; a {what} has five levels at most") from None
    if tree is None:
        raise YamlFileError(f"{path}: the file is empty; a {what} needs {expected_map(model)}")
    return tree


def validated(model: type[M], tree: Item, path: Path) -> M:
    """The content as a model.

    Raises:
        YamlFileError: it is not valid.
    """
    try:
        return model.model_validate(tree.value)
    except ValidationError as error:
        raise YamlFileError(tell(path, tree, model, error.errors(include_url=False))) from None
