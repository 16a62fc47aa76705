"""``unspoken keys create`` and ``show``: what is made, with which modes, and what is found wrong later."""

import os
import shutil
import stat
from collections.abc import Callable
from datetime import timedelta
from pathlib import Path

import pytest
from keys_helpers import NOW, Clock, content, keys, made, rows

from fleet.keys import folders
from protocol.identity import load_device_keys, read_certificate
from protocol.keys import BENCH_NAME, WORLD_NAME

pytestmark = pytest.mark.usefixtures("clock")


def test_create_makes_a_folder_with_good_keys_for_each_device() -> None:
    result = keys("create", "new/mine", "--scenario", "2-crossing", "--robot", "x", "--days", 90)
    assert result.exit_code == 0, result.output
    mine = Path("new/mine")
    devices = {"world": WORLD_NAME, "bench": BENCH_NAME, "robot-1": "1", "robot-2": "2", "robot-x": "x"}
    assert {path.name for path in mine.iterdir()} == set(rows(result)) == {"authority", *devices}
    assert [path.name for path in Path("new").iterdir()] == ["mine"]
    for folder, name in devices.items():
        loaded = load_device_keys(mine / folder, NOW)
        assert (loaded.name, loaded.expires) == (name, NOW + timedelta(days=90))
        assert {path.name for path in (mine / folder).iterdir()} == folders.FILES
    certificate = read_certificate(mine / "bench" / "certificate.pem")
    assert certificate.not_valid_before_utc == NOW - timedelta(days=1)
    secret = (mine / "authority" / "key.pem").read_bytes()
    assert [path for path, held in content(mine).items() if held == secret] == ["new/mine/authority/key.pem"]


@pytest.mark.usefixtures("umask")
def test_whatever_the_umask_private_keys_are_for_their_owner_alone(monkeypatch: pytest.MonkeyPatch) -> None:
    """Also right after each file is opened, before anything is written to it."""
    opened: dict[str, int] = {}
    real = os.open

    def watched(path: str, flags: int, mode: int = 0o777, *, dir_fd: int | None = None) -> int:
        descriptor = real(path, flags, mode, dir_fd=dir_fd)
        opened[os.path.join(*Path(path).parts[-2:])] = stat.S_IMODE(os.fstat(descriptor).st_mode)
        return descriptor

    monkeypatch.setattr(folders.os, "open", watched)
    mine = made()
    assert {path: mode for path, mode in opened.items() if path.endswith("key.pem")} == {
        f"{folder}/key.pem": 0o600 for folder in ("authority", "world", "bench", "robot-1", "robot-2")
    }
    assert keys("issue", mine, "--robot", 1, "--robot", 3).exit_code == 0
    for path in (mine, *mine.rglob("*")):
        mode = stat.S_IMODE(path.stat().st_mode)
        assert mode == 0o700 if path.is_dir() else mode == 0o600 or path.name != "key.pem", (path, oct(mode))


@pytest.mark.parametrize(
    ("options", "told"),
    [
        (("mine",), "--scenario"),
        (("mine", "--robot", "@world"), "'@world'"),
        (("mine", "--scenario", "9z"), "9z"),
        (("mine", "--robot", "1", "--host", "tls/lab:7447"), "'tls/lab:7447'"),
        (("mine", "--robot", "1", "--days", "0"), "--days"),
        (("mine", "--robot", "1", "--days", "99999"), "--days"),
        (("mine", "--robot", "1", "--days", "400", "--authority-days", "300"), "--days 300 is the most"),
        ((".", "--robot", "1"), "is where you are"),
        ((), "DIR"),
    ],
)
def test_wrong_usage_is_refused_and_nothing_is_written(options: tuple[str, ...], told: str) -> None:
    result = keys("create", *options)
    assert result.exit_code == 2
    assert told in result.stderr
    assert "Traceback" not in result.output
    assert list(Path().iterdir()) == []


def test_keys_that_are_there_are_never_overwritten_and_a_file_is_no_place_for_them() -> None:
    before = content(made())
    result = keys("create", "mine", "--robot", 1)
    assert result.exit_code == 2
    assert "'unspoken keys issue'" in result.stderr
    Path("file").touch()
    result = keys("create", "file/mine", "--robot", 1)
    assert result.exit_code == 3
    assert "file: cannot be used" in result.stderr
    assert content(Path("mine")) == before


def test_show_lists_robots_in_the_order_of_their_numbers_and_warns_of_a_near_end(clock: Clock) -> None:
    keys("create", "mine", "--robot", 10, "--robot", 9, "--robot", "b", "--days", 20)
    result = keys("show", "mine")
    assert result.exit_code == 0
    found = rows(result)
    assert list(found) == ["authority", "world", "bench", "robot-b", "robot-9", "robot-10"]
    assert found["robot-9"][0] == "robot 9"
    assert found["robot-9"][1].startswith("2026-05-21")
    assert {row[-1] for row in found.values()} == {"ok"}
    clock.pass_days(7)
    result = keys("show", "mine")
    assert result.exit_code == 0
    assert rows(result)["robot-9"][-1] == "soon"
    assert "mine/robot-9: these keys expire on 2026-05-21" in result.stdout


def spoil_mode(mine: Path) -> str:
    (mine / "robot-1" / "key.pem").chmod(0o640)
    return "chmod 600 mine/robot-1/key.pem"


def spoil_name(mine: Path) -> str:
    shutil.rmtree(mine / "robot-1")
    shutil.copytree(mine / "robot-2", mine / "robot-1")
    return "mine/robot-1: these are the keys of robot 2, those of robot 1 are expected"


def spoil_authority(mine: Path) -> str:
    keys("create", "others", "--robot", 1)
    shutil.rmtree(mine / "robot-1")
    shutil.copytree("others/robot-1", mine / "robot-1")
    return "mine/robot-1/authority.pem: not the authority in mine/authority"


def spoil_file(mine: Path) -> str:
    (mine / "robot-1" / "certificate.pem").unlink()
    return "mine/robot-1/certificate.pem: this file is missing"


def spoil_authoritys_file(mine: Path) -> str:
    (mine / "authority" / "key.pem").unlink()
    return "mine/authority/key.pem: this file is missing"


@pytest.mark.parametrize(
    "spoil", [spoil_mode, spoil_name, spoil_authority, spoil_file, spoil_authoritys_file]
)
def test_show_says_what_is_wrong_with_one_folder_and_ends_with_1(spoil: Callable[[Path], str]) -> None:
    mine = made()
    words = spoil(mine)
    result = keys("show", mine)
    assert result.exit_code == 1
    assert words in result.stdout
    found = rows(result)
    assert found["robot-1"][0] == "robot 1"
    spoiled = "authority" if spoil is spoil_authoritys_file else "robot-1"
    assert {folder for folder, row in found.items() if row[-1] == "wrong"} == {spoiled}


@pytest.mark.parametrize(
    ("folder", "who"), [("robot-1", "robot 1"), ("bench", "the bench"), ("authority", "the authority")]
)
def test_show_takes_a_single_folder_wherever_it_was_copied(folder: str, who: str) -> None:
    shutil.copytree(made() / folder, Path("elsewhere") / folder)
    result = keys("show", f"elsewhere/{folder}")
    assert result.exit_code == 0, result.output
    assert rows(result)["."][0] == who


@pytest.mark.parametrize("command", ["issue", "show"])
def test_a_directory_that_is_not_there_or_without_keys_is_wrong_usage(command: str) -> None:
    Path("empty").mkdir()
    for directory in ("none", "empty"):
        result = keys(command, directory)
        assert result.exit_code == 2
        assert directory in result.stderr
