"""Passwords in files: only their owner can read them, and whatever is wrong with one is told."""

import os
from collections.abc import Iterator
from pathlib import Path

import pytest

from chassis.refusal import Refusal
from protocol.identity import Login, new_passwords, read_password, read_users, write_password, write_users


@pytest.fixture
def _umask() -> Iterator[None]:
    """The most careless user."""
    before = os.umask(0)
    yield
    os.umask(before)


@pytest.mark.usefixtures("_umask")
def test_what_is_written_can_be_read_back_and_by_nobody_else(tmp_path: Path) -> None:
    passwords = new_passwords(["@bench", "1", "a-b_c"])
    users, one = tmp_path / "users", tmp_path / "one"
    write_users(users, passwords)
    write_password(one, passwords["1"])
    assert read_users(users) == ("@bench", "1", "a-b_c")
    assert read_password(one) == passwords["1"]
    assert [path.stat().st_mode & 0o777 for path in (users, one)] == [0o600, 0o600]


def test_passwords_differ_and_cannot_be_guessed() -> None:
    names = [str(n) for n in range(100)]
    passwords = {*new_passwords(names).values(), *new_passwords(names).values()}
    assert len(passwords) == 200
    assert min(map(len, passwords)) >= 32
    assert not any(":" in password for password in passwords)


def test_an_existing_file_is_not_written_over(tmp_path: Path) -> None:
    path = tmp_path / "one"
    path.write_text("mine")
    with pytest.raises(FileExistsError):
        write_password(path, "other")
    assert path.read_text() == "mine"


@pytest.mark.parametrize("read", [read_users, read_password])
@pytest.mark.parametrize("mode", [0o640, 0o604, 0o660, 0o644])
def test_a_file_that_others_can_read_is_refused(tmp_path: Path, mode: int, read: object) -> None:
    path = tmp_path / "file"
    path.write_text("1:secret\n")
    path.chmod(mode)
    with pytest.raises(Refusal, match=rf"others can read .*mode {mode:04o}.*chmod 600") as raised:
        read(path)  # type: ignore[operator]
    assert "secret" not in str(raised.value)


@pytest.mark.parametrize(
    ("text", "told"),
    [("", "0 lines found"), ("a\nb\n", "2 lines found"), ("\n", "1 lines found, one line with the password")],
)
def test_a_password_is_one_line(tmp_path: Path, text: str, told: str) -> None:
    with pytest.raises(Refusal, match=told):
        read_password(private(tmp_path, text))


@pytest.mark.parametrize("line", ["secret", ":secret", "1:", ""])
def test_a_line_of_users_is_a_name_and_a_password(tmp_path: Path, line: str) -> None:
    with pytest.raises(Refusal, match="line 2: name:password is expected") as raised:
        read_users(private(tmp_path, f"2:other\n{line}\n3:more\n"))
    assert "secret" not in str(raised.value)


def test_a_missing_or_unreadable_file_is_told(tmp_path: Path) -> None:
    with pytest.raises(Refusal, match="No such file"):
        read_password(tmp_path / "none")
    path = private(tmp_path, "")
    path.write_bytes(b"\xff\xfe")
    with pytest.raises(Refusal, match="not a text file"):
        read_users(path)


def test_a_login_does_not_show_its_password() -> None:
    assert "secret" not in f"{Login('1', 'secret')!r} {Login('1', 'secret')}"


def private(folder: Path, text: str) -> Path:
    path = folder / "file"
    path.write_text(text)
    path.chmod(0o600)
    return path
