"""A suite: the scenarios that an evaluation drives, read from a directory, a bundled one or a single file."""

from dataclasses import dataclass

from protocol.scenario import Scenario
from protocol.scenario_file import ScenarioError, load_scenario
from scenarios import find_suite


@dataclass(frozen=True)
class Suite:
    """Scenarios by the stems of their files, in the order of these."""

    name: str
    scenarios: tuple[tuple[str, Scenario], ...]


def load_suite(name_or_path: str) -> Suite:
    """Read a directory of scenario files (``*.yaml``), or a single file as a suite of one.

    Args:
        name_or_path: a bundled suite or scenario, a directory or a file.

    Raises:
        ScenarioError: there is no such suite, it is empty, or files in it are wrong: the text tells what
            ``load_scenario`` tells, for each of them.
    """
    path = find_suite(name_or_path)
    if not path.is_dir():
        return Suite(path.stem, ((path.stem, load_scenario(path)),))
    files = sorted(path.glob("*.yaml"), key=lambda file: file.stem)
    if not files:
        raise ScenarioError(f"{path}: a suite needs at least one scenario file, and no *.yaml is there")
    scenarios, problems = [], []
    for file in files:
        try:
            scenarios.append((file.stem, load_scenario(file)))
        except ScenarioError as error:
            problems.append(str(error))
    if problems:
        raise ScenarioError("\n".join(problems))
    return Suite(path.resolve().name, tuple(scenarios))
