"""``unspoken keys issue``: keys are renewed and added, all of them whole."""

import shutil
import signal
from datetime import timedelta
from pathlib import Path

import pytest
from keys_helpers import Clock, content, keys, made, rows

from fleet.keys import folders
from protocol.identity import load_device_keys

pytestmark = pytest.mark.usefixtures("clock")


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
        assert f"{asked[1]}: cannot be used: No space left on device" in result.stderr
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


def test_issue_renews_everybodys_keys_even_expired_ones_and_leaves_the_authority(clock: Clock) -> None:
    mine = made("--days", 90)
    before = content(mine)
    clock.pass_days(100)
    assert keys("show", mine).exit_code == 1
    result = keys("issue", mine, "--days", 50)
    assert result.exit_code == 0, result.output
    assert list(rows(result)) == ["world", "bench", "robot-1", "robot-2"]
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


def hosts_shown() -> str:
    return rows(keys("show", "mine"))["world"][0]


def test_the_world_keeps_its_hosts_until_others_are_named() -> None:
    mine = made("--host", "lab.example", "--host", "10.0.0.7")
    keys("issue", mine)
    assert hosts_shown() == "the world at lab.example, 10.0.0.7"
    keys("issue", mine, "--world", "--host", "lab-2")
    assert hosts_shown() == "the world at lab-2"


def test_a_lost_world_gets_local_keys_and_an_unreadable_one_does_when_its_hosts_are_named() -> None:
    mine = made()
    shutil.rmtree(mine / "world")
    assert keys("issue", mine, "--world").exit_code == 0
    assert hosts_shown() == "the world at localhost, 127.0.0.1"
    (mine / "world" / "certificate.pem").write_text("?")
    result = keys("issue", mine)
    assert result.exit_code == 2
    assert "name the world's hosts with --host" in result.stderr
    assert keys("issue", mine, "--host", "lab").exit_code == 0
    assert hosts_shown() == "the world at lab"


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


def test_issue_needs_somebody_and_an_authority_that_is_whole_and_in_its_time(clock: Clock) -> None:
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
    (others / "authority" / "key.pem").chmod(0o600)
    for folder in ("world", "bench", "robot-1"):
        shutil.rmtree(others / folder)
    assert "name who shall get some, as with --robot 1" in keys("issue", others).stderr
    shutil.rmtree(mine / "authority")
    result = keys("issue", mine)
    assert result.exit_code == 2
    assert "mine/authority: there is no authority here; 'unspoken keys create' makes one" in result.stderr
