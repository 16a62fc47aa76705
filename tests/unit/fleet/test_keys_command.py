"""``unspoken keys``: keys are made for their owners alone, checked, and renewed, all of them whole."""

import os
import re
import shutil
import signal
import stat
from collections.abc import Callable, Iterator
from datetime import UTC, datetime, timedelta
from pathlib import Path

import pytest
from click.testing import Result
from hypothesis import given, settings
from hypothesis import strategies as st
from typer.testing import CliRunner

from chassis.refusal import Refusal
from fleet.cli import app
from fleet.keys import command, folders
from fleet.keys.authority import Authority, Device, checked_host, folder_of, hosts_in, name_of
from protocol.identity import load_device_keys
from protocol.keys import BENCH_NAME, WORLD_NAME

NOW = datetime(2026, 5, 1, 12, tzinfo=UTC)
pytestmark = pytest.mark.usefixtures("clock")


class Clock:
    """The time as the commands see it: it stands still."""

    now = NOW

    def pass_days(self, days: float) -> None:
        self.now += timedelta(days=days)


@pytest.fixture
def clock(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Clock:
    """In an empty directory."""
    monkeypatch.chdir(tmp_path)
    for name in ("COLUMNS", "TERMINAL_WIDTH"):
        monkeypatch.setenv(name, "200")
    clock = Clock()
    monkeypatch.setattr(command, "_now", lambda: clock.now)
    return clock


@pytest.fixture(params=[0o000, 0o077], ids=oct)
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
        (("new",), "--scenario"),
        (("new", "--robot", "@world"), "'@world'"),
        (("new", "--robot", "1", "--host", "tls/lab:7447"), "'tls/lab:7447'"),
        (("mine", "--robot", "1"), "renew them and add some with 'unspoken keys issue'"),
        ((".", "--robot", "1"), "is where you are"),
    ],
)
def test_wrong_usage_is_refused_and_nothing_is_written(options: tuple[str, ...], told: str) -> None:
    before = content(made())
    result = keys("create", *options)
    assert result.exit_code == 2
    assert told in result.stderr
    assert content(Path()) == before


def test_show_warns_of_a_near_end(clock: Clock) -> None:
    mine = made("--days", 20)
    assert {row[-1] for row in rows(keys("show", mine)).values()} == {"ok"}
    clock.pass_days(7)
    result = keys("show", mine)
    assert result.exit_code == 0
    assert rows(result)["robot-2"] == ["robot 2", rows(result)["world"][1], "soon"]


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


def spoil_authoritys_file(mine: Path) -> str:
    (mine / "authority" / "key.pem").unlink()
    return "mine/authority/key.pem: this file is missing"


@pytest.mark.parametrize("spoil", [spoil_mode, spoil_name, spoil_authority, spoil_authoritys_file])
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
    ("error", "asked"),
    [
        (OSError(28, "No space left on device"), ("create", "mine", "--robot", 9)),
        (OSError(28, "No space left on device"), ("issue", "there")),
        (KeyboardInterrupt(), ("issue", "there")),
    ],
)
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
    assert result.exit_code == 3 if isinstance(error, OSError) else result.exit_code != 0
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


def test_issue_renews_everybodys_keys_even_expired_ones_and_leaves_the_authority(clock: Clock) -> None:
    mine = made("--days", 90)
    before = content(mine)
    clock.pass_days(100)
    assert keys("show", mine).exit_code == 1
    result = keys("issue", mine, "--days", 50)
    assert result.exit_code == 0, result.output
    for folder in ("world", "bench", "robot-1", "robot-2"):
        assert load_device_keys(mine / folder, clock.now).expires == clock.now + timedelta(days=50)
    after = content(mine)
    assert before.keys() == after.keys()
    kept = {path for path in before if before[path] == after[path]}
    assert kept == {
        path for path in before if path.startswith("mine/authority/") or path.endswith("authority.pem")
    }
    assert keys("show", mine).exit_code == 0


def test_issue_renews_or_adds_who_is_named_and_nobody_else() -> None:
    mine = made()
    for options, changed in (
        (("--robot", "1", "--robot", "3", "--robot", "3"), {"robot-1", "robot-3"}),
        (("--world",), {"world"}),
        (("--bench", "--robot", "2"), {"bench", "robot-2"}),
    ):
        before = content(mine)
        result = keys("issue", mine, *options)
        assert result.exit_code == 0, result.output
        now = content(mine).items()
        assert {Path(path).parent.name for path, held in now if before.get(path) != held} == changed
        assert set(rows(result)) == changed
    assert keys("show", mine).exit_code == 0


def test_the_world_keeps_its_hosts_until_others_are_named() -> None:
    mine = made("--host", "lab.example", "--host", "10.0.0.7")
    for options, shown in (((), "lab.example, 10.0.0.7"), (("--world", "--host", "lab-2"), "lab-2")):
        keys("issue", mine, *options)
        assert rows(keys("show", mine))["world"][0] == f"the world at {shown}"


def test_hosts_for_anybody_but_the_world_and_files_that_would_be_lost_are_refused() -> None:
    mine = made()
    (mine / "robot-1" / "thesis.tex").write_text("of great value")
    before = content(mine)
    for options, words in (
        (("--robot", 1, "--host", "lab"), "add --world"),
        ((), "mine/robot-1: the whole folder is replaced, and thesis.tex in it would be lost; move it away"),
    ):
        result = keys("issue", mine, *options)
        assert result.exit_code == 2
        assert words in result.stderr
        assert content(mine) == before


def test_issue_needs_an_authority_that_is_whole_and_in_its_time(clock: Clock) -> None:
    mine, others = made("--days", 5, "--authority-days", 20), Path("others")
    keys("create", others, "--robot", 1)
    (others / "authority" / "key.pem").chmod(0o644)
    assert "its mode is 0644" in keys("issue", others).stderr
    clock.pass_days(21)
    assert "mine/authority/authority.pem: expired on" in keys("issue", mine, "--days", 1).stderr
    shutil.copy(others / "authority" / "authority.pem", mine / "authority")
    assert "not the private key of the certificate beside it" in keys("issue", mine).stderr


def test_no_certificate_outlasts_its_authority() -> None:
    authority = Authority.new(NOW, 300)
    authority.issue(Device("7"), NOW, 300)
    with pytest.raises(Refusal, match=r"after their authority, which expires on .*; --days 300 is the most"):
        authority.issue(Device("7"), NOW, 301)
    with pytest.raises(Refusal, match="make new keys for everybody with 'unspoken keys create'"):
        authority.issue(Device("7"), NOW + timedelta(days=299.5), 1)


LABELS = st.text("aZ09_-", min_size=1, max_size=63).filter(lambda text: text[0] != "-")
HOST_NAMES = st.lists(LABELS, min_size=1, max_size=4).map(".".join)


@settings(max_examples=8)
@given(st.sets(HOST_NAMES.filter(lambda text: not text[-1].isdigit()) | st.ip_addresses(v=4).map(str)))
def test_hosts_are_found_again_in_the_worlds_certificate(hosts: set[str]) -> None:
    device = Device(WORLD_NAME, tuple(map(checked_host, hosts)))
    assert set(hosts_in(Authority.new(NOW, 300).issue(device, NOW, 30).certificate)) == hosts


NO_HOSTS = ("", "a b", "tls/lab:7447", "lab.", "a..b", "300.1.1.1", "ä", "*.lab", "a" * 64, "a\n", "::1")


def test_what_is_no_host_is_refused() -> None:
    for text in NO_HOSTS:
        with pytest.raises(ValueError, match=r"expected|Zenoh connects to no IPv6 address"):
            checked_host(text)


def test_every_name_has_a_folder_of_its_own_and_other_folders_are_nobodys() -> None:
    for name in (WORLD_NAME, BENCH_NAME, "7", "world", "bench", "authority", "Robot-1_x"):
        assert name_of(folder_of(name)) == name
    for folder in ("authority", "robot-", "robot-@world", "robot-a b", ".issued-x", "@world"):
        assert name_of(folder) is None
