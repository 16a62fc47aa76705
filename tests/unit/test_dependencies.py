"""What is installed is declared, explained and pinned."""

import ast
import sys
import tomllib
from functools import cache
from importlib.metadata import packages_distributions, requires, version
from itertools import chain
from pathlib import Path

import pytest
from packaging.requirements import Requirement
from packaging.utils import canonicalize_name

ROOT = Path(__file__).parents[2]
PACKAGES = ("chassis", "protocol", "world", "agent", "fleet", "scenarios")
PYPROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text())
PROJECT = PYPROJECT["project"]
ALL_PACKAGES = PYPROJECT["tool"]["setuptools"]["packages"]
NEEDED_TO_RUN = PROJECT["dependencies"]
WITH_EXTRAS = NEEDED_TO_RUN + PROJECT["optional-dependencies"]["orca"]
NEEDED_TO_TEST = WITH_EXTRAS + PROJECT["optional-dependencies"]["dev"]
OWN_DISTRIBUTIONS = {
    "agent": ("agent", "protocol", "chassis"),
    "world": ("world", "protocol", "chassis", "scenarios"),
}
"""The folders in deploy/ that describe one, and the packages that it carries."""
PART_OF_ANOTHER = {"annotated-types", "pydantic-core"}
"""Not declared: pydantic fixes their versions and documents them as its own."""


def pins():
    """The exact versions in constraints.txt for this Python, by name."""
    lines = (ROOT / "constraints.txt").read_text().splitlines()
    requirements = [Requirement(line) for line in lines if line and not line.startswith("#")]
    return {
        canonicalize_name(requirement.name): requirement
        for requirement in requirements
        if requirement.marker is None or requirement.marker.evaluate()
    }


def installed_with(requirements):
    """Versions of everything that these requirements bring with them into this environment, by name."""
    found: dict[str, str] = {}
    waiting = [Requirement(text) for text in requirements]
    while waiting:
        requirement = waiting.pop()
        name = canonicalize_name(requirement.name)
        if name not in found:
            found[name] = version(name)
            brought = [Requirement(text) for text in requires(name) or ()]
            waiting += [
                each for each in brought if each.marker is None or each.marker.evaluate({"extra": ""})
            ]
    return found


DISTRIBUTIONS = packages_distributions()


@cache
def modules_imported_by(package):
    """Top-level modules that a package imports directly."""
    names = set()
    for path in (ROOT / package).rglob("*.py"):
        for node in ast.walk(ast.parse(path.read_text())):
            if isinstance(node, ast.Import):
                names |= {alias.name.partition(".")[0] for alias in node.names}
            elif isinstance(node, ast.ImportFrom):
                names.add(node.module.partition(".")[0])
    return names


def imported_by(packages):
    """Installed distributions that some packages import directly."""
    names = set().union(*map(modules_imported_by, packages))
    outside = names - sys.stdlib_module_names - set(PACKAGES)
    return {canonicalize_name(DISTRIBUTIONS[name][0]) for name in outside} - PART_OF_ANOTHER


def test_everything_installed_is_pinned_to_its_version_which_the_project_accepts_and_nothing_else_is():
    pinned = {name: str(requirement.specifier) for name, requirement in pins().items()}
    assert pinned == {name: f"=={found}" for name, found in installed_with(NEEDED_TO_TEST).items()}
    for requirement in map(Requirement, NEEDED_TO_TEST):
        assert requirement.specifier.contains(version(requirement.name)), requirement
    assert "://" not in (ROOT / "constraints.txt").read_text(), "it names no place to download from"


def test_what_is_imported_is_declared_and_what_is_declared_is_imported():
    declared = {canonicalize_name(Requirement(text).name) for text in WITH_EXTRAS}
    assert declared == imported_by(PACKAGES)


@pytest.mark.parametrize(("folder", "packages"), OWN_DISTRIBUTIONS.items())
def test_a_distribution_of_its_own_carries_its_packages_whole_and_needs_what_they_import(folder, packages):
    settings = tomllib.loads((ROOT / "deploy" / folder / "pyproject.toml").read_text())
    project, setuptools = settings["project"], settings["tool"]["setuptools"]
    needed = {*project["dependencies"], *chain(*project.get("optional-dependencies", {}).values())}
    assert needed <= set(WITH_EXTRAS), "in the versions of the whole"
    assert {canonicalize_name(Requirement(text).name) for text in needed} == imported_by(packages)
    for what in ("version", "requires-python", "license"):
        assert project[what] == PROJECT[what]
    whole = [name for name in ALL_PACKAGES if name.partition(".")[0] in packages]
    assert sorted(setuptools["packages"]) == sorted(whole)
    assert setuptools["package-dir"] == {name: f"../../{name}" for name in packages}
