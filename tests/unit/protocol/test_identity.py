"""Who a client is: what is read of good passwords and keys, and what is told of every kind of bad ones."""

import os
import re
import ssl
from collections.abc import Callable
from datetime import UTC, datetime, timedelta
from pathlib import Path

import pytest
from certificate_helpers import DAYS, keys_of, new_authority
from cryptography import x509
from cryptography.hazmat.primitives.asymmetric.ec import SECP256R1, generate_private_key
from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PrivateKey
from cryptography.hazmat.primitives.hashes import SHA256
from cryptography.hazmat.primitives.serialization import BestAvailableEncryption, Encoding, PrivateFormat
from hypothesis import given
from hypothesis import strategies as st

from chassis.refusal import Refusal
from protocol.identity import (
    DeviceKeys,
    Login,
    client_identity,
    date_text,
    is_local,
    load_device_keys,
    new_passwords,
    read_password,
    read_users,
    write_password,
    write_users,
)
from protocol.keys import BENCH_NAME, WORLD_NAME
from protocol.session import client_session

NOW = datetime(2026, 5, 1, 12, tzinfo=UTC)
SECOND = timedelta(seconds=1)
END = NOW + timedelta(days=DAYS)
PEM_KINDS = (b"CERTIFICATE", b"PRIVATE KEY")
FILES = ["authority.pem", "certificate.pem", "key.pem"]


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    return keys_of("7", tmp_path, new_authority(NOW), NOW)


def complaint(folder: Path, now: datetime = NOW) -> str:
    with pytest.raises(Refusal) as raised:
        load_device_keys(folder, now)
    return str(raised.value)


@pytest.mark.parametrize("name", ["Robot_2-b", WORLD_NAME, BENCH_NAME])
def test_good_keys_tell_whose_they_are_until_when_and_where_the_files_lie(tmp_path: Path, name: str) -> None:
    folder = keys_of(name, tmp_path, new_authority(NOW), NOW)
    keys = load_device_keys(folder, NOW)
    assert (keys.name, keys.expires, keys.folder) == (name, END, folder)
    soon = END - timedelta(days=14)
    assert (keys.expire_soon(soon - SECOND), keys.warning(soon - SECOND)) == (False, "")
    assert keys.expire_soon(soon)
    assert f"{folder}: these keys expire on {date_text(END)}; renew them" in keys.warning(soon)


def test_a_folder_that_cannot_be_used_is_told(folder: Path) -> None:
    assert "there is no such folder" in complaint(folder / "none")
    for mode in (0o640, 0o604):  # a key that others may use
        (folder / "key.pem").chmod(mode)
        assert f"its mode is {mode:04o}, 0600 is expected; run: chmod 600" in complaint(folder)
    for sign in ";?":
        folder = folder.rename(folder.with_name(f"a {sign}b"))
        assert f"Zenoh opens no keys at a path with '{sign}'" in complaint(folder)


@pytest.mark.parametrize("file", FILES)
def test_a_file_that_is_missing_unreadable_or_no_pem_is_named(folder: Path, file: str) -> None:
    kind = "private key in PEM without password" if file == "key.pem" else "certificate in PEM"
    for content in (b"", b"\xff\0", *(b"-----BEGIN %s-----\n" % each for each in PEM_KINDS)):
        (folder / file).write_bytes(content)
        assert complaint(folder).startswith(f"{folder}/{file}: this is no {kind}; copy the folder here again")
    (folder / file).unlink()
    assert complaint(folder).startswith(f"{folder}/{file}: this file is missing; copy the folder here again")
    (folder / file).mkdir()
    assert complaint(folder) == f"{folder}/{file}: cannot be read: Is a directory"


def _locked(_folder: Path, _other: Path) -> bytes:
    encryption = BestAvailableEncryption(b"secret")
    return Ed25519PrivateKey.generate().private_bytes(Encoding.PEM, PrivateFormat.PKCS8, encryption)


def _both(folder: Path, _other: Path) -> bytes:
    return (folder / "certificate.pem").read_bytes() + (folder / "authority.pem").read_bytes()


def _with_the_same_name(folder: Path, _other: Path) -> bytes:
    """Of another key: the signature counts, not the name."""
    name = x509.load_pem_x509_certificate((folder / "authority.pem").read_bytes()).subject
    key = generate_private_key(SECP256R1())
    builder = x509.CertificateBuilder(name, name, key.public_key(), x509.random_serial_number())
    builder = builder.not_valid_before(NOW - SECOND).not_valid_after(END)
    return builder.sign(key, SHA256()).public_bytes(Encoding.PEM)


@pytest.mark.parametrize(
    ("file", "content", "told"),
    [
        ("certificate.pem", lambda folder, _: (folder / "key.pem").read_bytes(), "no certificate in PEM"),
        ("key.pem", _locked, "no private key in PEM without password"),
        ("authority.pem", _both, "one certificate is expected, found 2"),
        ("key.pem", lambda _, other: (other / "key.pem").read_bytes(), "not the private key of the"),
        ("authority.pem", lambda _, other: (other / "authority.pem").read_bytes(), "not signed by the"),
        ("authority.pem", _with_the_same_name, "not signed by the authority in authority.pem beside it"),
    ],
)
def test_files_that_do_not_belong_together_are_told(
    folder: Path, tmp_path: Path, file: str, content: Callable[[Path, Path], bytes], told: str
) -> None:
    other = keys_of("8", tmp_path, new_authority(NOW), NOW)
    (folder / file).write_bytes(content(folder, other))
    assert told in complaint(folder)


def test_keys_are_good_from_their_first_to_their_last_second(folder: Path) -> None:
    early, authority_end = NOW - timedelta(days=1), NOW + timedelta(days=10 * DAYS)
    assert load_device_keys(folder, early).expires == load_device_keys(folder, END).expires == END
    for now, file, words in (
        (early - SECOND, "authority", f"not valid before {date_text(early)}, .*; set the clock"),
        (END + SECOND, "certificate", f"expired on {date_text(END)}, .* renew them with"),
        (authority_end + SECOND, "authority", "expired on .*, make new keys for everybody with"),
    ):
        assert re.match(rf"{re.escape(str(folder))}/{file}\.pem: {words}", complaint(folder, now))
        assert f"the clock here says {date_text(now)}" in complaint(folder, now)


@pytest.fixture(scope="module")
def damageable(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return keys_of("7", tmp_path_factory.mktemp("damageable"), new_authority(NOW), NOW)


def outcome(folder: Path, file: str, content: bytes) -> str:
    """What comes of a file with this content: good, told or something else."""
    whole = (folder / file).read_bytes()
    (folder / file).write_bytes(content)
    try:
        keys = load_device_keys(folder, NOW)
    except Refusal as error:
        return "told" if str(error).startswith(f"{folder}/") else str(error)
    finally:
        (folder / file).write_bytes(whole)
    return "good" if (keys.name, keys.expires) == ("7", END) else f"{keys.name} until {keys.expires}"


@given(st.sampled_from(FILES), st.integers(0), st.binary(max_size=3))
def test_a_damaged_file_is_told_or_as_good_as_before(
    damageable: Path, file: str, at: int, instead: bytes
) -> None:
    whole = (damageable / file).read_bytes()
    at %= len(whole)
    assert outcome(damageable, file, whole[:at] + instead + whole[at + 1 :]) in ("good", "told")


@pytest.mark.filterwarnings("ignore:Parsed a serial number which wasn't positive")
@given(st.integers(0))
def test_no_changed_bit_makes_a_certificate_of_another_name_or_end(damageable: Path, at: int) -> None:
    raw = bytearray(ssl.PEM_cert_to_DER_cert((damageable / "certificate.pem").read_text()))
    raw[at // 8 % len(raw)] ^= 1 << at % 8
    changed = ssl.DER_cert_to_PEM_cert(bytes(raw)).encode()
    assert outcome(damageable, "certificate.pem", changed) in ("good", "told")


TCP, TLS = "tcp/127.0.0.1:7447", "tls/127.0.0.1:7447"
LOCAL = ("tcp/127.1.2.3:1", "tcp/localhost:1", "tcp/[::1]:1", TCP, TLS, "unixsock-stream//tmp/u/world.sock")
ELSEWHERE = ("tcp/0.0.0.0:1", "tcp/[::]:1", "tcp/192.168.1.7:1", "tcp/world.local:1", "tls/0.0.0.0:1")
ODD = ("udp/128.0.0.1:1", "serial/dev/ttyS0", "nonsense", "")


def test_only_loopback_and_sockets_in_the_file_system_are_local() -> None:
    assert all(map(is_local, LOCAL))
    assert not any(map(is_local, ELSEWHERE + ODD))


def private(folder: Path, text: str | bytes, mode: int = 0o600) -> Path:
    path = folder / "file"
    path.write_bytes(text.encode() if isinstance(text, str) else text)
    path.chmod(mode)
    return path


def test_a_client_proves_itself_with_a_password_or_with_keys(folder: Path, tmp_path: Path) -> None:
    assert client_identity("7", TCP, None, None, NOW) is None
    password_file = private(tmp_path, "secret\n")
    assert client_identity("7", TCP, password_file, None, NOW) == Login("7", "secret")
    own = client_identity("7", TLS, None, folder, NOW)
    assert isinstance(own, DeviceKeys)
    assert "listen_private_key" not in client_session(TLS, own).config["transport"]["link"]["tls"]


def test_what_cannot_prove_it_is_refused(folder: Path, tmp_path: Path) -> None:
    for name, endpoint, password, keys, sentence in (
        ("7", TLS, tmp_path, folder, "one of them is expected"),
        ("7", TCP, None, folder, "keys prove nothing there"),
        ("7", TLS, None, None, "expected in --keys"),
        ("7", "tls/[::1]:7447", None, folder, "IPv6"),
        ("8", TLS, None, folder, "the keys of robot 7, those of robot 8 are expected"),
        ("7", TCP, Path("/nowhere/password"), None, "cannot be read"),
    ):
        with pytest.raises(Refusal, match=sentence):
            client_identity(name, endpoint, password, keys, NOW)


def test_passwords_can_be_read_back_and_by_nobody_else(tmp_path: Path) -> None:
    passwords = new_passwords(["@bench", "1", "a-b_c"])
    assert len({*passwords.values(), *new_passwords(passwords).values()}) == 6
    assert all(len(password) >= 32 and ":" not in password for password in passwords.values())
    users, one = tmp_path / "users", tmp_path / "one"
    before = os.umask(0)  # of the most careless user
    try:
        write_users(users, passwords)
        write_password(one, passwords["1"])
    finally:
        os.umask(before)
    assert read_users(users) == ("@bench", "1", "a-b_c")
    login = Login("1", read_password(one))
    assert login.password == passwords["1"]
    assert login.password not in f"{login!r} {login} {client_session(TCP, login)!r}"
    assert [path.stat().st_mode & 0o777 for path in (users, one)] == [0o600, 0o600]
    with pytest.raises(FileExistsError):
        write_password(one, "other")
    for mode in (0o640, 0o604):
        one.chmod(mode)
        with pytest.raises(Refusal, match=rf"others can read .*mode {mode:04o}.*chmod 600"):
            read_password(one)


@pytest.mark.parametrize(
    ("read", "content", "sentence"),
    [
        (read_password, "", "0 lines found"),
        (read_password, "\n", "1 lines found, one line with the password"),
        (read_users, "2:other\nsecret\n3:more\n", "line 2: name:password is expected"),
        (read_users, b"\xff\xfe", "not a text file"),
    ],
)
def test_a_file_without_passwords_is_refused(
    tmp_path: Path, read: object, content: str | bytes, sentence: str
) -> None:
    with pytest.raises(Refusal, match=sentence) as raised:
        read(private(tmp_path, content))  # type: ignore[operator]
    assert "secret" not in str(raised.value)
