"""What the repository says about itself is true, and it says nothing of the machines it was made on."""

import re
import subprocess
import tomllib
from functools import cache
from pathlib import Path

import pytest
from markdown_it import MarkdownIt
from typer.testing import CliRunner

from fleet.cli import app

ROOT = Path(__file__).parents[2]
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
DOCUMENTS = [ROOT / "README.md", *sorted((ROOT / "docs").glob("*.md"))]
OPTION = re.compile(r"--[a-z][a-z-]*")
PATH = re.compile(r"`((?:agent|chassis|deploy|docs|fleet|protocol|scenarios|tests|world)/[\w./-]+)`")

# In parts, so that this file does not hold what it looks for.
REGISTRY_HOSTS = [
    name.replace(" ", ".")
    for name in (
        *("pypi org", "pythonhosted org", "deb debian org", "snapshot debian org", "archive ubuntu com"),
        *("npmjs org", "npmjs com", "anaconda org", "crates io", "proxy golang org", "hub docker com"),
        *("ghcr io", "quay io"),
    )
]
PLACES_OF_A_MACHINE = ["/".join(("", *parts, "")) for parts in [("root",), ("work", "main"), ("opt", "pypi")]]


def files_in_git():
    """All files of the repository, also those that are not committed yet."""
    listed = subprocess.run(
        ["git", "ls-files", "-z", "--cached", "--others", "--exclude-standard"],
        cwd=ROOT,
        check=True,
        capture_output=True,
        text=True,
    )
    paths = [ROOT / name for name in listed.stdout.split("\0") if name]
    return [path for path in paths if path.is_file()]


def commands_in(document, program):
    """What follows a program's name wherever a document shows it at the start of a line of code."""
    found = []
    for block in MarkdownIt().parse(document.read_text()):
        for token in [block, *(block.children or ())]:
            if token.type in ("fence", "code_block", "code_inline"):
                for line in token.content.splitlines():
                    words = line.partition("#")[0].removeprefix("$ ").split()
                    if words and Path(words[0]).name == program:
                        found.append(words[1:])
    return found


@cache
def help_of(*command):
    """What ``unspoken`` says about a command."""
    said = CliRunner().invoke(app, [*command, "--help"])
    assert said.exit_code == 0, said.output
    return said.output


def test_no_file_names_a_package_registry_or_a_place_on_the_machine_it_was_made_on():
    files = files_in_git()
    assert ROOT / "pyproject.toml" in files
    names = re.compile("|".join(map(re.escape, REGISTRY_HOSTS + PLACES_OF_A_MACHINE)).encode())
    found = {str(path): names.findall(path.read_bytes().lower()) for path in files}
    assert {path: each for path, each in found.items() if each} == {}


def test_the_newest_entry_of_the_changelog_is_this_version():
    versions = re.findall(r"^## \[?(\d+\.\d+\.\d+)\]?", (ROOT / "CHANGELOG.md").read_text(), re.MULTILINE)
    assert versions[0] == PROJECT["version"]


@pytest.mark.parametrize("document", DOCUMENTS, ids=lambda path: str(path.relative_to(ROOT)))
def test_the_commands_and_options_that_a_document_names_exist(document):
    for words in commands_in(document, "make"):
        planned = subprocess.run(["make", "--dry-run", *words], cwd=ROOT, capture_output=True, text=True)
        assert planned.returncode == 0, planned.stderr
    for words in commands_in(document, "unspoken"):
        command = words[: 2 if words[:1] in (["scenarios"], ["keys"], ["bridge"]) else 1]
        options = set(OPTION.findall(" ".join(words[len(command) :])))
        assert options <= set(OPTION.findall(help_of(*command))), words


@pytest.mark.parametrize("document", DOCUMENTS, ids=lambda path: str(path.relative_to(ROOT)))
def test_the_files_that_a_document_names_are_there(document):
    named = set(PATH.findall(document.read_text())) - {"fleet/NAME/command.py"}
    assert {name for name in named if not (ROOT / name).exists()} == set()
