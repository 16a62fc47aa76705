"""Who a client is: endpoints that others can reach, passwords in files, and what proves a name."""

import os
from datetime import UTC, datetime
from pathlib import Path

import pytest
from certificate_helpers import keys_of, new_authority

from chassis.refusal import Refusal
from protocol.device_keys import DeviceKeys
from protocol.identity import (
    Login,
    client_identity,
    is_local,
    new_passwords,
    read_password,
    read_users,
    write_password,
    write_users,
)
from protocol.session import client_session

NOW = datetime.now(UTC).replace(microsecond=0)
TCP, TLS = "tcp/127.0.0.1:7447", "tls/127.0.0.1:7447"
LOCAL = ("tcp/127.1.2.3:1", "tcp/localhost:1", "tcp/[::1]:1", TCP, TLS, "unixsock-stream//tmp/u/world.sock")
ELSEWHERE = ("tcp/0.0.0.0:1", "tcp/[::]:1", "tcp/192.168.1.7:1", "tcp/world.local:1", "tls/0.0.0.0:1")
ODD = ("udp/128.0.0.1:1", "serial/dev/ttyS0", "nonsense", "")


def test_only_loopback_and_sockets_in_the_file_system_are_local() -> None:
    assert all(map(is_local, LOCAL))
    assert not any(map(is_local, ELSEWHERE + ODD))


@pytest.fixture
def keys(tmp_path: Path) -> Path:
    return keys_of("7", tmp_path, new_authority(NOW), NOW)


def private(folder: Path, text: str | bytes, mode: int = 0o600) -> Path:
    path = folder / "file"
    path.write_bytes(text.encode() if isinstance(text, str) else text)
    path.chmod(mode)
    return path


def test_a_password_keys_or_nothing_is_what_a_client_proves_itself_with(keys: Path, tmp_path: Path) -> None:
    assert client_identity("7", TCP, None, None, NOW) is None
    password_file = private(tmp_path, "secret\n")
    assert client_identity("7", TCP, password_file, None, NOW) == Login("7", "secret")
    own = client_identity("7", TLS, None, keys, NOW)
    assert isinstance(own, DeviceKeys)
    tls = client_session(TLS, own).config["transport"]["link"]["tls"]
    assert tls["root_ca_certificate"] == str(keys / "authority.pem")
    assert tls["connect_private_key"] == str(keys / "key.pem")
    assert "listen_private_key" not in tls


def test_what_cannot_prove_it_is_refused(keys: Path, tmp_path: Path) -> None:
    for name, endpoint, password, folder, sentence in (
        ("7", TLS, tmp_path, keys, "one of them is expected"),
        ("7", TCP, None, keys, "keys prove nothing there"),
        ("7", TLS, None, None, "expected in --keys"),
        ("7", "tls/[::1]:7447", None, keys, "IPv6"),
        ("8", TLS, None, keys, "the keys of robot 7, those of robot 8 are expected"),
        ("7", TCP, Path("/nowhere/password"), None, "cannot be read"),
    ):
        with pytest.raises(Refusal, match=sentence):
            client_identity(name, endpoint, password, folder, NOW)


def test_passwords_can_be_read_back_and_by_nobody_else(tmp_path: Path) -> None:
    passwords = new_passwords(["@bench", "1", "a-b_c"])
    users, one = tmp_path / "users", tmp_path / "one"
    before = os.umask(0)  # of the most careless user
    try:
        write_users(users, passwords)
        write_password(one, passwords["1"])
    finally:
        os.umask(before)
    assert read_users(users) == ("@bench", "1", "a-b_c")
    assert read_password(one) == passwords["1"]
    assert [path.stat().st_mode & 0o777 for path in (users, one)] == [0o600, 0o600]
    with pytest.raises(FileExistsError):
        write_password(one, "other")
    assert read_password(one) == passwords["1"]


def test_passwords_differ_and_cannot_be_guessed() -> None:
    names = [str(n) for n in range(100)]
    passwords = {*new_passwords(names).values(), *new_passwords(names).values()}
    assert len(passwords) == 200
    assert min(map(len, passwords)) >= 32
    assert not any(":" in password for password in passwords)


@pytest.mark.parametrize("read", [read_users, read_password])
@pytest.mark.parametrize("mode", [0o640, 0o604, 0o660, 0o644])
def test_a_file_that_others_can_read_is_refused(tmp_path: Path, mode: int, read: object) -> None:
    path = private(tmp_path, "1:secret\n", mode)
    with pytest.raises(Refusal, match=rf"others can read .*mode {mode:04o}.*chmod 600") as raised:
        read(path)  # type: ignore[operator]
    assert "secret" not in str(raised.value)


@pytest.mark.parametrize(
    ("read", "content", "sentence"),
    [
        (read_password, "", "0 lines found"),
        (read_password, "a\nb\n", "2 lines found"),
        (read_password, "\n", "1 lines found, one line with the password"),
        *(
            (read_users, f"2:other\n{line}\n3:more\n", "line 2: name:password is expected")
            for line in ("secret", ":secret", "1:", "")
        ),
        (read_users, b"\xff\xfe", "not a text file"),
    ],
)
def test_a_file_without_passwords_is_refused(
    tmp_path: Path, read: object, content: str | bytes, sentence: str
) -> None:
    with pytest.raises(Refusal, match=sentence) as raised:
        read(private(tmp_path, content))  # type: ignore[operator]
    assert "secret" not in str(raised.value)


def test_no_representation_shows_a_password() -> None:
    login = Login("1", "secret")
    assert "secret" not in f"{login!r} {login} {client_session(TCP, login)!r}"
