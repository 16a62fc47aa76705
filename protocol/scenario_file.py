"""Scenario files: YAML in, a valid scenario or one exception for people out; and the way back."""

import math
from pathlib import Path
from typing import Any

import yaml

from protocol.faults import MAX_FAULTS, FaultFile, unknown_robot
from protocol.mistakes import location_of, told_at
from protocol.scenario import Scenario
from protocol.yaml_file import YamlFileError, read_text, tree_of, validated

ScenarioError = YamlFileError
"""A scenario, or what goes with it, that cannot be used."""


def load_scenario(path: Path) -> Scenario:
    """Read a scenario file.

    Raises:
        ScenarioError: the file cannot be read, is no single YAML map, or is not a valid scenario. One line
            a problem, with file, line and field.
    """
    return parse_scenario(read_text(path), path)


def parse_scenario(text: str, path: Path) -> Scenario:
    """Read the text of a scenario file.

    Args:
        text: the content.
        path: of the file that holds it, for people.

    Raises:
        ScenarioError: as of ``load_scenario``.
    """
    return validated(Scenario, tree_of(text, path, Scenario, "scenario"), path)


def with_faults(scenario: Scenario, path: Path) -> Scenario:
    """A scenario with the faults of a file after its own.

    Raises:
        ScenarioError: as of ``load_scenario``; or the file names robots that the scenario lacks, or there are
            too many faults together.
    """
    tree = tree_of(read_text(path), path, FaultFile, "file of faults")
    faults = validated(FaultFile, tree, path).faults
    if found := unknown_robot(faults, [robot.id for robot in scenario.robots]):
        where, what = found
        raise ScenarioError(told_at(path, tree, location_of(where), what))
    merged = (*scenario.faults, *faults)
    if len(merged) > MAX_FAULTS:
        raise ScenarioError(
            f"{path}: {len(merged)} faults, those of the scenario included, are too many; at most "
            f"{MAX_FAULTS} can befall a run: leave some out"
        )
    return scenario.model_copy(update={"faults": merged})


def scenario_text(scenario: Scenario) -> str:
    """A file that ``load_scenario`` reads as this scenario: one line a robot or fault, defaults left out."""
    rules = scenario.model_dump(exclude_defaults=True)
    name, robots, faults = rules.pop("name"), rules.pop("robots"), rules.pop("faults", ())
    lines = [_yaml({key: value}, inline=False) for key, value in {"name": name, **_written(rules)}.items()]
    lines.append("robots:\n")
    for robot in _written(robots):
        in_order = {key: robot[key] for key in ("id", "start", "goal")} | robot
        lines.append(f"  - {_yaml(in_order, inline=True)}")
    if faults:
        lines.append("faults:\n")
    for fault in _written(faults):
        lines.append(f"  - {_yaml({'kind': fault['kind']} | fault, inline=True)}")
    return "".join(lines)


def _yaml(fields: dict[str, Any], *, inline: bool) -> str:
    """A map as YAML in one line: with its braces, or as a field of the file."""
    of_maps = any(isinstance(value, dict) for value in fields.values())
    style = True if inline else None if of_maps else False  # PyYAML: None puts the innermost maps into braces
    return yaml.dump(
        fields,
        Dumper=_Dumper,
        default_flow_style=style,
        sort_keys=False,
        allow_unicode=True,
        width=math.inf,
    )


class _Dumper(yaml.SafeDumper):
    """Writes the control character NEL by its escape: as it is, PyYAML reads another line break back."""


_Dumper.add_representer(
    str,
    lambda dumper, text: dumper.represent_scalar(
        "tag:yaml.org,2002:str", text, style='"' if "\x85" in text else None
    ),
)


def _written(value: Any) -> Any:
    """Numbers as a person writes them: 4 for 4.0, and the id 1 for '1'."""
    match value:
        case dict():
            return {key: _written(part) for key, part in value.items()}
        case list() | tuple():
            return [_written(part) for part in value]
        case str() if value.isdecimal() and str(int(value)) == value:
            return int(value)
        case float() if value.is_integer() and str(value) != "-0.0":  # there is no whole number −0
            return int(value)
    return value
