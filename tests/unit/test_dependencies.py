"""What is installed is declared, explained and pinned."""

import ast
import sys
import tomllib
from importlib.metadata import packages_distributions, requires, version
from pathlib import Path

import pytest
from packaging.requirements import Requirement
from packaging.utils import canonicalize_name

ROOT = Path(__file__).parents[2]
PACKAGES = ("chassis", "protocol", "world", "agent", "fleet", "scenarios")
PYPROJECT = (ROOT / "pyproject.toml").read_text()
PROJECT = tomllib.loads(PYPROJECT)["project"]
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


def distributions_imported_by(package):
    """Installed distributions whose modules a package imports directly."""
    names = set()
    for path in (ROOT / package).rglob("*.py"):
        for node in ast.walk(ast.parse(path.read_text())):
            if isinstance(node, ast.Import):
                names |= {alias.name.partition(".")[0] for alias in node.names}
            elif isinstance(node, ast.ImportFrom):
                names.add(node.module.partition(".")[0])
    distributions = packages_distributions()
    outside = names - sys.stdlib_module_names - set(PACKAGES)
    return {canonicalize_name(distributions[name][0]) for name in outside}


def test_every_installed_dependency_is_pinned_to_its_version_and_nothing_else_is():
    pinned = {name: str(requirement.specifier) for name, requirement in pins().items()}
    assert pinned == {name: f"=={found}" for name, found in installed_with(NEEDED_TO_TEST).items()}


def test_pins_name_no_place_to_download_from():
    assert not any(requirement.url for requirement in pins().values())
    assert "://" not in (ROOT / "constraints.txt").read_text()


def test_the_pinned_versions_are_ones_that_the_project_accepts():
    for requirement in map(Requirement, NEEDED_TO_TEST):
        pinned = pins()[canonicalize_name(requirement.name)]
        assert requirement.specifier.contains(str(pinned.specifier).removeprefix("==")), requirement


@pytest.mark.parametrize("requirement", NEEDED_TO_TEST)
def test_every_dependency_says_why_it_is_wanted(requirement):
    (line,) = [line for line in PYPROJECT.splitlines() if f'"{requirement}"' in line]
    _, _, reason = line.partition("#")
    assert reason.strip(), line


@pytest.mark.parametrize("package", PACKAGES)
def test_every_imported_distribution_is_declared(package):
    declared = {canonicalize_name(Requirement(text).name) for text in WITH_EXTRAS}
    assert distributions_imported_by(package) <= declared | PART_OF_ANOTHER


def test_every_declared_dependency_is_imported():
    imported = set().union(*map(distributions_imported_by, PACKAGES))
    assert {canonicalize_name(Requirement(text).name) for text in WITH_EXTRAS} <= imported


def own_distribution(folder):
    """The project and the packages of deploy/<folder>/pyproject.toml."""
    settings = tomllib.loads((ROOT / "deploy" / folder / "pyproject.toml").read_text())
    return settings["project"], settings["tool"]["setuptools"]


@pytest.mark.parametrize(("folder", "packages"), OWN_DISTRIBUTIONS.items())
def test_a_distribution_of_its_own_needs_what_its_packages_import_in_the_versions_of_the_whole(
    folder, packages
):
    project, _ = own_distribution(folder)
    optional = [text for extra in project.get("optional-dependencies", {}).values() for text in extra]
    assert {*project["dependencies"], *optional} <= set(WITH_EXTRAS)
    imported = set().union(*map(distributions_imported_by, packages)) - PART_OF_ANOTHER
    assert {
        canonicalize_name(Requirement(text).name) for text in [*project["dependencies"], *optional]
    } == imported


@pytest.mark.parametrize(("folder", "packages"), OWN_DISTRIBUTIONS.items())
def test_a_distribution_of_its_own_is_of_this_version_and_carries_its_packages_whole(folder, packages):
    project, setuptools = own_distribution(folder)
    for what in ("version", "requires-python", "license"):
        assert project[what] == PROJECT[what]
    all_packages = tomllib.loads(PYPROJECT)["tool"]["setuptools"]["packages"]
    assert sorted(setuptools["packages"]) == sorted(
        name for name in all_packages if name.partition(".")[0] in packages
    )
    assert setuptools["package-dir"] == {name: f"../../{name}" for name in packages}
