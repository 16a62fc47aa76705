"""``unspoken keys show``, and what all of the commands have in common."""

import shutil
from collections.abc import Callable
from pathlib import Path

import pytest
from keys_helpers import Clock, keys, made, rows

pytestmark = pytest.mark.usefixtures("clock")


@pytest.mark.parametrize("command_name", ["issue", "show"])
def test_a_directory_that_is_not_there_is_refused(command_name: str) -> None:
    result = keys(command_name, "none")
    assert result.exit_code == 2
    assert "none" in result.stderr


def test_show_lists_robots_in_the_order_of_their_numbers_and_ends_well() -> None:
    keys("create", "mine", "--robot", 10, "--robot", 9, "--robot", "b", "--days", 365)
    result = keys("show", "mine")
    assert result.exit_code == 0
    found = rows(result)
    assert list(found) == ["authority", "world", "bench", "robot-b", "robot-9", "robot-10"]
    assert found["robot-9"][0] == "robot 9"
    assert found["robot-9"][1].startswith("2027-05-01")
    assert {row[-1] for row in found.values()} == {"ok"}


def test_show_warns_of_a_near_end_and_still_ends_well(clock: Clock) -> None:
    mine = made("--days", 20)
    clock.pass_days(7)
    result = keys("show", mine)
    assert result.exit_code == 0
    assert rows(result)["robot-1"][-1] == "soon"
    assert "mine/robot-1: these keys expire on 2026-05-21" in result.stdout


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


@pytest.mark.parametrize("spoil", [spoil_mode, spoil_name, spoil_authority, spoil_file])
def test_show_tells_what_is_wrong_with_one_robot_and_ends_with_1(
    spoil: Callable[[Path], str],
) -> None:
    mine = made()
    words = spoil(mine)
    result = keys("show", mine)
    assert result.exit_code == 1
    assert words in result.stdout
    found = rows(result)
    assert found["robot-1"][0] == "robot 1"
    assert {folder for folder, row in found.items() if row[-1] == "wrong"} == {"robot-1"}


def test_show_tells_what_is_wrong_with_the_authority() -> None:
    mine = made()
    (mine / "authority" / "key.pem").unlink()
    result = keys("show", mine)
    assert result.exit_code == 1
    assert "mine/authority/key.pem: this file is missing" in result.stdout


@pytest.mark.parametrize(
    ("folder", "who"), [("robot-1", "robot 1"), ("bench", "the bench"), ("authority", "the authority")]
)
def test_show_takes_a_single_folder_wherever_it_was_copied(folder: str, who: str) -> None:
    shutil.copytree(made() / folder, Path("elsewhere") / folder)
    result = keys("show", f"elsewhere/{folder}")
    assert result.exit_code == 0, result.output
    assert rows(result)["."][0] == who
    (Path("elsewhere") / folder / "key.pem").chmod(0o644)
    assert keys("show", f"elsewhere/{folder}").exit_code == 1


def test_show_of_a_directory_without_keys_is_wrong_usage() -> None:
    Path("empty").mkdir()
    result = keys("show", "empty")
    assert result.exit_code == 2
    assert "empty: there are no keys here" in result.stderr


@pytest.mark.parametrize("command_name", ["create", "issue", "show"])
def test_every_command_has_a_help_with_its_exit_status(command_name: str) -> None:
    result = keys(command_name, "--help")
    assert result.exit_code == 0
    assert "Exit status: 0" in result.stdout
