"""The command ``unspoken`` of a device and of the bench: where it begins, and what it says of itself."""

import sys
from importlib import import_module
from types import ModuleType

import pytest


class Interrupted(ModuleType):
    """A module during whose import Ctrl-C is pressed."""

    def __getattr__(self, name: str) -> object:
        raise KeyboardInterrupt


@pytest.mark.parametrize(("package", "entry"), [("agent", "agent"), ("fleet", "fleet.entry")])
def test_ctrl_c_during_the_imports_ends_quietly(
    package: str, entry: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setitem(sys.modules, f"{package}.cli", Interrupted("cli"))
    with pytest.raises(SystemExit) as ended:
        import_module(entry).main()
    assert ended.value.code == 1
    assert capsys.readouterr() == ("", "")
