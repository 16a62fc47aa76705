"""``unspoken keys create``: what it makes, with which modes, and what it refuses."""

import os
import re
import stat
from datetime import timedelta
from pathlib import Path

import pytest
from keys_helpers import NOW, content, keys, made, rows

from fleet.keys import folders
from protocol.device_keys import load_device_keys, read_certificate
from protocol.keys import BENCH_NAME, WORLD_NAME

pytestmark = pytest.mark.usefixtures("clock")


def test_create_makes_a_folder_for_each_device_and_tells_what_to_do_with_them() -> None:
    result = keys("create", "new/mine", "--scenario", "2-crossing", "--robot", "x")
    assert result.exit_code == 0, result.output
    folders_made = ["authority", "bench", "robot-1", "robot-2", "robot-x", "world"]
    assert sorted(path.name for path in Path("new/mine").iterdir()) == folders_made
    assert sorted(rows(result)) == folders_made
    assert (
        "Copy each folder to its device and nowhere else. Keep new/mine/authority to yourself"
        in result.stdout
    )
    assert [path.name for path in Path("new").iterdir()] == ["mine"]


def test_each_folder_holds_good_keys_of_its_device() -> None:
    mine = made("--days", 90)
    for folder, name in (("world", WORLD_NAME), ("bench", BENCH_NAME), ("robot-1", "1"), ("robot-2", "2")):
        loaded = load_device_keys(mine / folder, NOW)
        assert (loaded.name, loaded.expires) == (name, NOW + timedelta(days=90))
        assert sorted(path.name for path in (mine / folder).iterdir()) == [
            "authority.pem",
            "certificate.pem",
            "key.pem",
        ]


def test_the_authoritys_private_key_is_in_no_devices_folder() -> None:
    mine = made()
    secret = (mine / "authority" / "key.pem").read_bytes()
    assert [path for path, held in content(mine).items() if held == secret] == ["mine/authority/key.pem"]


@pytest.mark.usefixtures("umask")
def test_whatever_the_umask_private_keys_are_for_their_owner_alone() -> None:
    mine = made()
    assert keys("issue", mine, "--robot", 1, "--robot", 3).exit_code == 0
    for path in (mine, *mine.rglob("*")):
        mode = stat.S_IMODE(path.stat().st_mode)
        assert mode == 0o700 if path.is_dir() else mode == 0o600 or path.name != "key.pem", (path, oct(mode))


@pytest.mark.usefixtures("umask")
def test_no_private_key_is_open_to_others_for_a_moment(monkeypatch: pytest.MonkeyPatch) -> None:
    """Seen right after each file is opened, before anything is written to it."""
    opened: dict[str, int] = {}
    real = os.open

    def watched(path: str, flags: int, mode: int = 0o777, *, dir_fd: int | None = None) -> int:
        descriptor = real(path, flags, mode, dir_fd=dir_fd)
        opened[os.path.join(*Path(path).parts[-2:])] = stat.S_IMODE(os.fstat(descriptor).st_mode)
        return descriptor

    monkeypatch.setattr(folders.os, "open", watched)
    made()
    private = {path: mode for path, mode in opened.items() if path.endswith("key.pem")}
    assert private == {
        f"{folder}/key.pem": 0o600 for folder in ("authority", "world", "bench", "robot-1", "robot-2")
    }


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (("mine",), ("--scenario", "--robot")),
        (("mine", "--robot", "@world"), ("--robot", "'@world' found", "a letter or a digit first")),
        (("mine", "--robot", "a/b"), ("'a/b' found",)),
        (("mine", "--scenario", "9z"), ("9z: there is no such file and no bundled scenario",)),
        (("mine", "--robot", "1", "--host", "tls/lab:7447"), ("--host", "'tls/lab:7447' found")),
        (("mine", "--robot", "1", "--host", "::1"), ("'::1' found", "IPv6")),
        (("mine", "--robot", "1", "--days", "0"), ("--days",)),
        (("mine", "--robot", "1", "--days", "99999"), ("--days",)),
        (("mine", "--robot", "1", "--days", "400", "--authority-days", "300"), ("--days 300 is the most",)),
        ((".", "--robot", "1"), ("is where you are",)),
        ((), ("DIR",)),
    ],
)
def test_wrong_usage_is_refused_and_nothing_is_written(
    options: tuple[str, ...], words: tuple[str, ...]
) -> None:
    result = keys("create", *options)
    assert result.exit_code == 2
    for word in words:
        assert word in result.stderr
    assert "Traceback" not in result.output
    assert list(Path().iterdir()) == []


def test_keys_that_are_there_are_never_overwritten() -> None:
    before = content(made())
    result = keys("create", "mine", "--robot", 1)
    assert result.exit_code == 2
    assert re.search(r"mine is not empty; .*'unspoken keys issue'", result.stderr)
    assert content(Path("mine")) == before


def test_a_directory_that_cannot_be_made_is_told() -> None:
    Path("file").touch()
    result = keys("create", "file/mine", "--robot", 1)
    assert result.exit_code == 3
    assert re.fullmatch(r"\S*file: cannot be used: (Not a directory|File exists)\n", result.stderr)


def test_certificates_hold_their_times_to_the_second() -> None:
    certificate = read_certificate(made() / "bench" / "certificate.pem")
    assert certificate.not_valid_before_utc == NOW - timedelta(days=1)
