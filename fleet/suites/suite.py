"""A suite: the scenarios of a directory, a bundled set of them, or a single one."""

from pathlib import Path
from typing import NamedTuple

import scenarios
from protocol.scenario import Scenario
from protocol.scenario_file import ScenarioError, load_scenario

BUNDLED = Path(scenarios.__file__).parent


class Suite(NamedTuple):
    """Scenarios by the stems of their files."""

    name: str
    scenarios: tuple[tuple[str, Scenario], ...]


def load_suite(name_or_path: str) -> Suite:
    """Read a suite.

    Args:
        name_or_path: a directory of YAML files, the name of a bundled suite, or a single scenario.

    Raises:
        ScenarioError: there is no such suite, it is empty, or one of its scenarios is wrong.
    """
    for directory in (BUNDLED / name_or_path, Path(name_or_path)):
        if directory.is_dir():
            paths = sorted(directory.glob("*.yaml"))
            if not paths:
                raise ScenarioError(f"{directory}: no scenario is in it; files named *.yaml are expected")
            return Suite(directory.resolve().name, tuple((path.stem, load_scenario(path)) for path in paths))
    path = scenarios.find(name_or_path)
    return Suite(path.stem, ((path.stem, load_scenario(path)),))
