"""What is told of versions."""

import tomllib
from importlib.metadata import PackageNotFoundError
from pathlib import Path

import pytest

from protocol import version
from protocol.version import disagreement, software_version

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


def test_whoever_is_behind_is_to_be_updated() -> None:
    assert disagreement("7", 1, 2) == (
        "robot 7 speaks version 1 of the protocol, the world version 2; update the software of robot 7"
    )
    assert disagreement("7", 2, 1).endswith("; update the software of the world")
