"""The command ``unspoken`` of a device and of the bench: where it begins, and what it says of itself."""

import sys
from importlib import import_module
from types import ModuleType

import pytest
from typer.testing import CliRunner

from chassis.commands import lazy_app

PACKAGES = pytest.mark.parametrize("package", ["agent", "fleet"])


class Interrupted(ModuleType):
    """A module during whose import Ctrl-C is pressed."""

    def __getattr__(self, name: str) -> object:
        raise KeyboardInterrupt


@PACKAGES
def test_ctrl_c_during_the_imports_ends_quietly(
    package: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    entry = {"agent": "agent", "fleet": "fleet.entry"}[package]
    monkeypatch.setitem(sys.modules, f"{package}.cli", Interrupted("cli"))
    with pytest.raises(SystemExit) as ended:
        import_module(entry).main()
    assert ended.value.code == 1
    assert capsys.readouterr() == ("", "")


def test_ctrl_c_during_the_imports_of_a_command_ends_quietly(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "slow", Interrupted("slow"))
    app = lazy_app("A group.", {"slow": ("slow:main", "A command.")})
    result = CliRunner().invoke(app, ["slow"])
    assert (result.exit_code, result.output) == (1, "")


@PACKAGES
def test_it_prints_the_version_of_the_software_and_of_the_protocol(package: str) -> None:
    result = CliRunner().invoke(import_module(f"{package}.cli").app, ["--version"])
    assert (result.exit_code, result.output.split()[0]) == (0, "unspoken")
    assert result.output.rstrip().endswith("protocol 1")


@PACKAGES
def test_the_agent_is_a_command_of_it(package: str) -> None:
    assert "--robot" in CliRunner().invoke(import_module(f"{package}.cli").app, ["agent", "--help"]).output
