"""docs/deploy.md: its commands can be given, and its file of options is one."""

import re
import shlex
from pathlib import Path

import pytest
from markdown_it import MarkdownIt
from typer.testing import CliRunner

import agent.cli
import fleet.cli
from agent.process.options import options_in

ROOT = Path(__file__).parents[2]
FENCES = [
    token
    for token in MarkdownIt().parse((ROOT / "docs" / "deploy.md").read_text(encoding="utf-8"))
    if token.type == "fence"
]
DEVICE, OPERATOR = "/opt/unspoken/bin/unspoken", ".venv/bin/unspoken"
COMMANDS = [
    line
    for fence in FENCES
    if fence.info != "yaml"
    for line in fence.content.splitlines()
    if line.startswith((DEVICE, OPERATOR))
]


def test_the_file_of_options_is_valid(tmp_path):
    [example] = [fence.content for fence in FENCES if fence.info == "yaml"]
    path = tmp_path / "robot.yaml"
    path.write_text(example, encoding="utf-8")
    path.chmod(0o600)
    options = options_in(path)
    assert options["robot"] == "1"
    assert options["keys"] == tmp_path / "robot-1"


def test_there_is_a_command_for_each_side():
    assert {shlex.split(line)[0] for line in COMMANDS} == {DEVICE, OPERATOR}


@pytest.mark.parametrize("line", COMMANDS)
def test_each_command_has_these_options(line):
    program, *words = shlex.split(line)
    command = words[: 2 if words[0] in ("keys", "bridge") else 1]
    result = CliRunner().invoke(agent.cli.app if program == DEVICE else fleet.cli.app, [*command, "--help"])
    assert result.exit_code == 0, result.output
    assert {word for word in words if word.startswith("--")} <= set(re.findall(r"--[a-z-]+", result.output))


def test_what_is_installed_from_is_there():
    folders = {
        folder for fence in FENCES for folder in re.findall(r"(?<= )\./(\S+)$", fence.content, re.MULTILINE)
    }
    assert folders == {"deploy/agent"}
    assert (ROOT / "deploy" / "agent" / "pyproject.toml").exists()
