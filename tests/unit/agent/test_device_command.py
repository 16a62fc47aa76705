"""The command of a device, which has no bench."""

import subprocess
import sys
from types import ModuleType

import pytest
from typer.testing import CliRunner

from agent.cli import app
from agent.entry import main


class Interrupted(ModuleType):
    """A module during whose import Ctrl-C is pressed."""

    def __getattr__(self, name: str) -> object:
        raise KeyboardInterrupt


def test_ctrl_c_during_the_imports_ends_quietly(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setitem(sys.modules, "agent.cli", Interrupted("agent.cli"))
    with pytest.raises(SystemExit) as ended:
        main()
    assert ended.value.code == 1
    assert capsys.readouterr() == ("", "")


def test_it_tells_the_version_of_the_software_and_of_the_protocol() -> None:
    told = CliRunner().invoke(app, ["--version"])
    assert (told.exit_code, told.output.split()[0]) == (0, "unspoken")
    assert told.output.rstrip().endswith("protocol 1")


def test_the_agent_is_a_command_of_it() -> None:
    assert "--robot" in CliRunner().invoke(app, ["agent", "--help"]).output


def test_it_needs_neither_the_world_nor_the_bench() -> None:
    script = "import sys, agent.cli; print({'world', 'fleet', 'scenarios'} & {*sys.modules})"
    told = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=True)
    assert told.stdout.strip() == "set()"
