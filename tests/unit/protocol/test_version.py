"""The version of the software, from whichever distribution is installed."""

import tomllib
from importlib.metadata import PackageNotFoundError
from pathlib import Path

import pytest

from protocol import version
from protocol.version import software_version

ROOT = Path(__file__).parents[3]
DISTRIBUTIONS = [
    tomllib.loads(path.read_text())["project"]["name"]
    for path in (ROOT / "pyproject.toml", *sorted(ROOT.glob("deploy/*/pyproject.toml")))
]


def installed(monkeypatch: pytest.MonkeyPatch, *names: str) -> None:
    def look_up(name: str) -> str:
        if name not in names:
            raise PackageNotFoundError(name)
        return f"version of {name}"

    monkeypatch.setattr(version, "version", look_up)


@pytest.mark.parametrize("name", DISTRIBUTIONS)
def test_the_software_is_installed_whole_or_in_part(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    installed(monkeypatch, name)
    assert software_version() == f"version of {name}"
    installed(monkeypatch)
    assert software_version() == "not installed"
