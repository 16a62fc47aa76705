"""``unspoken keys``."""

import os
import re
import shutil
import signal
import stat
from collections.abc import Iterator
from datetime import UTC, datetime, timedelta
from pathlib import Path

import pytest
from click.testing import Result
from typer.testing import CliRunner

from fleet.certificates import command, folders
from fleet.cli import app
from protocol.device_keys import load_device_keys, read_certificate
from protocol.keys import BENCH_NAME, WORLD_NAME

NOW = datetime(2026, 5, 1, 12, tzinfo=UTC)


class Clock:
    """The time as the commands see it."""

    now = NOW

    def pass_days(self, days: float) -> None:
        self.now += timedelta(days=days)


@pytest.fixture(autouse=True)
def clock(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Clock:
    """A clock that stands still, in an empty directory."""
    monkeypatch.chdir(tmp_path)
    for name in ("COLUMNS", "TERMINAL_WIDTH"):
        monkeypatch.setenv(name, "200")
    clock = Clock()
    monkeypatch.setattr(command, "_now", lambda: clock.now)
    return clock


@pytest.fixture(params=[0o000, 0o022, 0o077], ids=oct)
def umask(request: pytest.FixtureRequest) -> Iterator[None]:
    former = os.umask(request.param)
    yield
    os.umask(former)


def keys(*arguments: object) -> Result:
    return CliRunner().invoke(app, ["keys", *map(str, arguments)])


def made(*options: object) -> Path:
    """Keys of robots 1 and 2."""
    assert keys("create", "mine", "--robot", 1, "--robot", 2, *options).exit_code == 0
    return Path("mine")


def content(directory: Path) -> dict[str, bytes]:
    return {str(path): path.read_bytes() for path in sorted(directory.rglob("*")) if path.is_file()}


def rows(result: Result) -> dict[str, list[str]]:
    """The rows of the table by folder: who, when and state."""
    cells = [re.split(r"  +", line.strip()) for line in result.stdout.splitlines()]
    return {row[1]: [row[0], *row[2:]] for row in cells[2:] if len(row) == 4}


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
    assert re.fullmatch(r"unspoken: \S*file: cannot be used: (Not a directory|File exists)\n", result.stderr)


@pytest.mark.parametrize("error", [OSError(28, "No space left on device"), KeyboardInterrupt()])
@pytest.mark.parametrize("asked", [("create", "mine", "--robot", 9), ("issue", "there")])
def test_nothing_is_changed_when_writing_fails_halfway(
    monkeypatch: pytest.MonkeyPatch, error: BaseException, asked: tuple[object, ...]
) -> None:
    made().rename("there")
    before = content(Path())
    synced: list[int] = []

    def failing(descriptor: int) -> None:
        if len(synced) == 7:
            raise error
        synced.append(descriptor)

    monkeypatch.setattr(folders.os, "fsync", failing)
    result = keys(*asked)
    if isinstance(error, OSError):
        assert result.exit_code == 3
        assert re.fullmatch(r"unspoken: \S+: cannot be used: No space left on device\n", result.stderr)
    else:
        assert result.exit_code != 0
    assert len(synced) == 7
    assert content(Path()) == before
    assert [path.name for path in Path().iterdir()] == ["there"]


def test_the_old_keys_are_there_again_if_the_new_ones_cannot_take_their_place(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    before = content(made())
    real = Path.rename

    def failing(path: Path, target: Path) -> Path:
        if path.parent.name == "new" and path.name == "bench":
            raise OSError(5, "Input/output error", str(path))
        return real(path, target)

    monkeypatch.setattr(Path, "rename", failing)
    assert keys("issue", "mine", "--bench").exit_code == 3
    assert content(Path("mine")) == before


def test_ctrl_c_between_the_old_folder_and_the_new_one_waits_until_all_have_changed(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    before = content(made())
    real = Path.rename

    def interrupted(path: Path, target: Path) -> Path:
        moved = real(path, target)
        if moved.parent.name == "old":
            signal.raise_signal(signal.SIGINT)
        return moved

    monkeypatch.setattr(Path, "rename", interrupted)
    assert keys("issue", "mine").exit_code == 0
    after = content(Path("mine"))
    assert after.keys() == before.keys()
    assert [path for path in before if path.endswith("certificate.pem") and before[path] == after[path]] == []
    assert keys("show", "mine").exit_code == 0


def test_issue_renews_everybodys_keys_and_leaves_the_authority(clock: Clock) -> None:
    mine = made()
    before = content(mine)
    clock.pass_days(100)
    result = keys("issue", mine, "--days", 50)
    assert result.exit_code == 0, result.output
    assert list(rows(result)) == ["world", "bench", "robot-1", "robot-2"]
    assert "Copy each of these folders to its device, in the place of an older one." in result.stdout
    for folder in ("world", "bench", "robot-1", "robot-2"):
        assert load_device_keys(mine / folder, clock.now).expires == clock.now + timedelta(days=50)
    after = content(mine)
    assert before.keys() == after.keys()
    kept = {path for path in before if before[path] == after[path]}
    assert kept == {
        path for path in before if path.startswith("mine/authority/") or path.endswith("authority.pem")
    }


def test_issue_renews_expired_keys(clock: Clock) -> None:
    mine = made("--days", 10)
    clock.pass_days(11)
    assert keys("show", mine).exit_code == 1
    assert keys("issue", mine).exit_code == 0
    assert keys("show", mine).exit_code == 0


@pytest.mark.parametrize(
    ("options", "changed"),
    [
        (("--robot", "1"), {"robot-1"}),
        (("--robot", "1", "--robot", "3", "--robot", "3"), {"robot-1", "robot-3"}),
        (("--world",), {"world"}),
        (("--bench", "--robot", "2"), {"bench", "robot-2"}),
    ],
)
def test_issue_renews_or_adds_who_is_named_and_nobody_else(
    options: tuple[str, ...], changed: set[str]
) -> None:
    mine = made()
    before = content(mine)
    result = keys("issue", mine, *options)
    assert result.exit_code == 0, result.output
    assert {
        Path(path).parent.name for path, held in content(mine).items() if before.get(path) != held
    } == changed
    assert set(rows(result)) == changed
    assert keys("show", mine).exit_code == 0


def hosts_shown(mine: Path) -> str:
    return rows(keys("show", mine))["world"][0]


def test_the_world_keeps_its_hosts_until_others_are_named() -> None:
    mine = made("--host", "lab.example", "--host", "10.0.0.7")
    assert hosts_shown(mine) == "the world at lab.example, 10.0.0.7"
    keys("issue", mine)
    assert hosts_shown(mine) == "the world at lab.example, 10.0.0.7"
    keys("issue", mine, "--world", "--host", "lab-2")
    assert hosts_shown(mine) == "the world at lab-2"


def test_without_hosts_the_world_is_on_its_own_machine() -> None:
    assert hosts_shown(made()) == "the world at localhost, 127.0.0.1"


def test_hosts_for_anybody_but_the_world_are_refused() -> None:
    mine = made()
    before = content(mine)
    result = keys("issue", mine, "--robot", 1, "--host", "lab")
    assert result.exit_code == 2
    assert "add --world" in result.stderr
    assert content(mine) == before


def test_a_lost_world_gets_new_keys_and_an_unreadable_one_does_when_its_hosts_are_named() -> None:
    mine = made()
    shutil.rmtree(mine / "world")
    assert keys("issue", mine, "--world").exit_code == 0
    (mine / "world" / "certificate.pem").write_text("?")
    result = keys("issue", mine)
    assert result.exit_code == 2
    assert "name the world's hosts with --host" in result.stderr
    assert keys("issue", mine, "--host", "lab").exit_code == 0
    assert hosts_shown(mine) == "the world at lab"


def test_a_file_of_somebody_else_in_a_folder_is_not_lost() -> None:
    mine = made()
    (mine / "robot-1" / "thesis.tex").write_text("of great value")
    before = content(mine)
    result = keys("issue", mine)
    assert result.exit_code == 2
    assert "mine/robot-1: the whole folder is replaced, and thesis.tex in it would be lost; move it away" in (
        result.stderr
    )
    assert content(mine) == before


def test_issue_needs_an_authority_that_is_whole_and_in_its_time(clock: Clock) -> None:
    mine = made("--days", 5, "--authority-days", 20)
    others = Path("others")
    keys("create", others, "--robot", 1)
    clock.pass_days(15)
    assert "--days 5 is the most" in keys("issue", mine).stderr
    clock.pass_days(6)
    assert "mine/authority/authority.pem: expired on" in keys("issue", mine, "--days", 1).stderr
    shutil.copy(others / "authority" / "authority.pem", mine / "authority")
    assert "not the private key of the certificate beside it" in keys("issue", mine).stderr
    (others / "authority" / "key.pem").chmod(0o644)
    assert "its mode is 0644" in keys("issue", others).stderr
    shutil.rmtree(mine / "authority")
    result = keys("issue", mine)
    assert result.exit_code == 2
    assert "mine/authority: there is no authority here; 'unspoken keys create' makes one" in result.stderr


def test_issue_with_nobody_to_renew_asks_for_names() -> None:
    mine = made()
    for folder in ("world", "bench", "robot-1", "robot-2"):
        shutil.rmtree(mine / folder)
    result = keys("issue", mine)
    assert result.exit_code == 2
    assert "no device has keys here yet; name who shall get some" in result.stderr


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
def test_show_tells_what_is_wrong_with_one_robot_and_ends_with_1(spoil) -> None:  # type: ignore[no-untyped-def]
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


def test_certificates_hold_their_times_to_the_second() -> None:
    certificate = read_certificate(made() / "bench" / "certificate.pem")
    assert certificate.not_valid_before_utc == NOW - timedelta(days=1)


@pytest.mark.parametrize("command_name", ["create", "issue", "show"])
def test_every_command_has_a_help_with_its_exit_status(command_name: str) -> None:
    result = keys(command_name, "--help")
    assert result.exit_code == 0
    assert "Exit status: 0" in result.stdout
