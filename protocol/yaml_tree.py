"""YAML whose every value knows its line: plain maps, lists, numbers and text, refused where ambiguous."""

from dataclasses import dataclass, field, replace
from typing import Any

import yaml

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
