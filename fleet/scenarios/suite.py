"""Suites: read from scenario files, made of a family, and written."""

import secrets
import shutil
from collections import Counter
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np

from chassis.refusal import Refusal
from fleet.inject.scenario import Scenario, load_scenario
from fleet.scenarios.families import FAMILIES, FamilyName
from protocol.scenario import scenario_text
from scenarios import find_suite


class Suite(NamedTuple):
    """Scenarios by the stems of their files, in the order of these."""

    name: str
    scenarios: tuple[tuple[str, Scenario], ...]


def load_suite(name_or_path: str) -> Suite:
    """Read a directory of scenario files (``*.yaml``), or a single file as a suite of one.

    Args:
        name_or_path: a bundled suite or scenario, a directory or a file.

    Raises:
        Refusal: there is no such suite, it is empty, or files in it are wrong: the text says for each
            of them what ``load_scenario`` says.
    """
    path = find_suite(name_or_path)
    if not path.is_dir():
        return Suite(path.stem, ((path.stem, load_scenario(path)),))
    scenarios, problems = [], []
    for file in sorted(path.glob("*.yaml"), key=lambda file: file.stem):
        try:
            scenarios.append((file.stem, load_scenario(file)))
        except Refusal as error:
            problems.append(str(error))
    if problems:
        raise Refusal("\n".join(problems))
    if not scenarios:
        raise Refusal(f"{path}: a suite needs at least one scenario file, and no *.yaml is there")
    return Suite(path.resolve().name, tuple(scenarios))


def generate(family: FamilyName, robots: Sequence[int], count: int, seed: int) -> dict[str, Scenario]:
    """Scenarios by name, such as ``circle-8-03``: of this family, the third with eight robots.

    Each has draws of its own, so with a larger count the robots of the first ones stay the same.

    Args:
        family: of all of them.
        robots: numbers of robots, which are gone through in turn.
        count: of scenarios.
        seed: of their draws.

    Raises:
        Refusal: the family cannot place so many robots.
    """
    made: dict[str, Scenario] = {}
    drawn = Counter[int]()
    for index in range(count):
        number = robots[index % len(robots)]
        drawn[number] += 1
        # Zeros in front, so that the order of names is that of numbers.
        name = f"{family}-{number:0{len(str(max(robots)))}}-{drawn[number]:0{len(str(count))}}"
        scenario = FAMILIES[family](number, np.random.default_rng((seed, index)))
        made[name] = scenario.model_copy(update={"name": name})
    return made


def write_suite(directory: Path, scenarios: Mapping[str, Scenario], comment: str) -> None:
    """Write a file for each scenario: all of them, or nothing.

    Args:
        directory: new or empty.
        scenarios: by the stems of their files.
        comment: one line, the first of each file.

    Raises:
        Refusal: the directory holds something or cannot be written.
    """
    directory = directory.resolve()
    beside = directory.parent / f".{directory.name}-{secrets.token_hex(4)}"
    try:
        if directory == Path.cwd():
            raise Refusal(f"{directory} is where you are; name a new directory in it with --out")
        if directory.exists() and any(directory.iterdir()):
            raise Refusal(f"{directory} is not empty; choose another directory with --out, or remove it")
        beside.mkdir(parents=True)
        for name, scenario in scenarios.items():
            text = f"# {comment}\n{scenario_text(scenario)}"
            (beside / f"{name}.yaml").write_text(text, encoding="utf-8")
        beside.rename(directory)
    except OSError as error:
        raise Refusal(f"{directory} cannot be used for the output: {error.strerror}") from error
    finally:
        shutil.rmtree(beside, ignore_errors=True)
