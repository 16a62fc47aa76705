"""Keys of a device: what is read of good ones, and what is told of every kind of bad ones."""

import re
import shutil
import ssl
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
from protocol.device_keys import check_name, date_text, load_device_keys
from protocol.keys import BENCH_NAME, WORLD_NAME, checked_name

NOW = datetime(2026, 5, 1, 12, tzinfo=UTC)
SECOND = timedelta(seconds=1)
END = NOW + timedelta(days=DAYS)
FILES = ["authority.pem", "certificate.pem", "key.pem"]


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    return keys_of("7", tmp_path, new_authority(NOW), NOW)


def complaint(folder: Path, now: datetime = NOW) -> str:
    with pytest.raises(Refusal) as raised:
        load_device_keys(folder, now)
    return str(raised.value)


@pytest.mark.parametrize("name", ["7", "Robot_2-b", WORLD_NAME, BENCH_NAME])
def test_good_keys_tell_whose_they_are_until_when_and_where_the_files_lie(tmp_path: Path, name: str) -> None:
    folder = keys_of(name, tmp_path, new_authority(NOW), NOW)
    keys = load_device_keys(folder, NOW)
    assert (keys.name, keys.expires, keys.folder) == (name, END, folder)


@pytest.mark.parametrize("name", [WORLD_NAME, BENCH_NAME])
def test_no_robot_can_have_the_name_of_the_world_or_the_bench(name: str) -> None:
    with pytest.raises(ValueError, match="found"):
        checked_name(name)


def test_a_missing_folder_is_told_with_what_is_expected_in_it(tmp_path: Path) -> None:
    assert complaint(tmp_path / "none") == (
        f"{tmp_path}/none: there is no such folder; the keys of this device are expected in it, as 'unspoken "
        "keys create' makes them"
    )


def test_a_path_that_leads_through_a_file_is_told(folder: Path) -> None:
    assert complaint(folder / "key.pem" / "keys") == f"{folder}/key.pem/keys: cannot be read: Not a directory"


@pytest.mark.parametrize("sign", [";", "?"])
def test_a_path_that_zenoh_would_tear_apart_is_told(folder: Path, sign: str) -> None:
    torn = folder.rename(folder.with_name(f"a{sign}b"))
    assert complaint(torn).endswith(
        f": Zenoh opens no keys at a path with '{sign}'; choose another name for the folder"
    )


@pytest.mark.parametrize("file", FILES)
def test_a_missing_file_is_named(folder: Path, file: str) -> None:
    (folder / file).unlink()
    assert complaint(folder).startswith(f"{folder}/{file}: this file is missing; copy the folder here again")


@pytest.mark.parametrize("file", FILES)
def test_a_file_that_cannot_be_read_is_named_with_the_reason(folder: Path, file: str) -> None:
    (folder / file).unlink()
    (folder / file).mkdir()
    assert complaint(folder) == f"{folder}/{file}: cannot be read: Is a directory"


@pytest.mark.parametrize("mode", [0o640, 0o604, 0o755, 0o620])
def test_a_private_key_that_others_may_use_is_told_with_its_mode_and_the_remedy(
    folder: Path, mode: int
) -> None:
    moved = folder.rename(folder.with_name("my keys"))
    (moved / "key.pem").chmod(mode)
    assert complaint(moved) == (
        f"{moved}/key.pem: others may use this private key, its mode is {mode:04o}, 0600 is expected; "
        f"run: chmod 600 '{moved}/key.pem'"
    )


@pytest.mark.parametrize("mode", [0o600, 0o400])
def test_a_private_key_for_its_owner_alone_is_taken(folder: Path, mode: int) -> None:
    (folder / "key.pem").chmod(mode)
    assert load_device_keys(folder, NOW).name == "7"


@pytest.mark.parametrize(
    "content",
    [b"", b"hello", b"\xff\x00", b"-----BEGIN CERTIFICATE-----\n", b"-----BEGIN PRIVATE KEY-----\n"],
)
@pytest.mark.parametrize("file", FILES)
def test_a_file_that_is_no_pem_is_named(folder: Path, file: str, content: bytes) -> None:
    (folder / file).write_bytes(content)
    kind = "private key in PEM without password" if file == "key.pem" else "certificate in PEM"
    assert complaint(folder).startswith(f"{folder}/{file}: this is no {kind}; copy")


def test_a_private_key_in_the_place_of_a_certificate_is_told(folder: Path) -> None:
    shutil.copy(folder / "key.pem", folder / "certificate.pem")
    assert complaint(folder).startswith(f"{folder}/certificate.pem: this is no certificate in PEM;")


def test_a_private_key_with_a_password_is_told(folder: Path) -> None:
    locked = Ed25519PrivateKey.generate().private_bytes(
        Encoding.PEM, PrivateFormat.PKCS8, BestAvailableEncryption(b"secret")
    )
    (folder / "key.pem").write_bytes(locked)
    assert "this is no private key in PEM without password" in complaint(folder)


def test_two_certificates_in_a_file_are_told(folder: Path) -> None:
    both = (folder / "certificate.pem").read_bytes() + (folder / "authority.pem").read_bytes()
    (folder / "authority.pem").write_bytes(both)
    assert complaint(folder).startswith(f"{folder}/authority.pem: one certificate is expected, found 2;")


def test_a_private_key_of_another_certificate_is_told(folder: Path, tmp_path: Path) -> None:
    other = keys_of("8", tmp_path, new_authority(NOW), NOW)
    shutil.copy(other / "key.pem", folder)
    assert complaint(folder).startswith(
        f"{folder}/key.pem: not the private key of the certificate beside it; copy the folder here again"
    )


def test_a_certificate_of_another_authority_is_told(folder: Path, tmp_path: Path) -> None:
    other = keys_of("8", tmp_path, new_authority(NOW), NOW)
    shutil.copy(other / "authority.pem", folder)
    assert complaint(folder) == (
        f"{folder}/certificate.pem: not signed by the authority in authority.pem beside it; the keys of all "
        "devices must come from one 'unspoken keys create'; copy the folder here again"
    )


def test_an_authority_of_the_same_name_with_another_key_does_not_help(folder: Path, tmp_path: Path) -> None:
    """The signature counts, not the name."""
    forged = _with_the_name_of(folder / "authority.pem", NOW)
    (folder / "authority.pem").write_bytes(forged)
    assert "not signed by the authority" in complaint(folder)


def _with_the_name_of(path: Path, now: datetime) -> bytes:
    name, key = x509.load_pem_x509_certificate(path.read_bytes()).subject, generate_private_key(SECP256R1())
    builder = x509.CertificateBuilder(name, name, key.public_key(), x509.random_serial_number())
    builder = builder.not_valid_before(now - SECOND).not_valid_after(now + timedelta(days=DAYS))
    return builder.sign(key, SHA256()).public_bytes(Encoding.PEM)


def test_keys_of_tomorrow_are_told_with_the_clock(folder: Path) -> None:
    early = NOW - timedelta(days=1)
    assert load_device_keys(folder, early).expires == END
    assert complaint(folder, early - SECOND) == (
        f"{folder}/authority.pem: not valid before {date_text(early)}, and the clock here says "
        f"{date_text(early - SECOND)}; set the clock"
    )


def test_keys_are_good_to_their_last_second_and_then_told_as_expired(folder: Path) -> None:
    assert load_device_keys(folder, END).expires == END
    assert complaint(folder, END + SECOND) == (
        f"{folder}/certificate.pem: expired on {date_text(END)}, and the clock here says "
        f"{date_text(END + SECOND)}; if the clock is right, renew them with 'unspoken keys issue' where the "
        "authority is kept, and copy the folder here again"
    )


def test_an_expired_authority_is_told_with_what_helps(folder: Path) -> None:
    later = NOW + timedelta(days=10 * DAYS) + SECOND
    assert re.match(
        rf"{re.escape(str(folder))}/authority\.pem: expired on .*; if the clock is right, make new keys for "
        r"everybody with 'unspoken keys create'$",
        complaint(folder, later),
    )


@pytest.mark.parametrize(
    ("left", "warned"), [(timedelta(days=14) + SECOND, False), (timedelta(days=14), True), (SECOND, True)]
)
def test_a_near_end_is_warned_of(folder: Path, left: timedelta, warned: bool) -> None:
    now = END - left
    keys = load_device_keys(folder, now)
    assert keys.expire_soon(now) is warned
    expected = (
        f"{folder}: these keys expire on {date_text(END)}; renew them with 'unspoken keys issue' where the "
        "authority is kept, and copy the folder here again"
    )
    assert keys.warning(now) == (expected if warned else "")


@pytest.mark.parametrize(
    ("expected", "words"),
    [
        ("8", "those of robot 8 are expected"),
        (WORLD_NAME, "those of the world are expected"),
        (BENCH_NAME, "those of the bench are expected"),
    ],
)
def test_the_keys_of_somebody_else_are_told(folder: Path, expected: str, words: str) -> None:
    keys = load_device_keys(folder, NOW)
    with pytest.raises(
        Refusal, match=f"^{re.escape(str(folder))}: these are the keys of robot 7, {words}; copy"
    ):
        check_name(keys, expected)


def test_the_devices_own_keys_pass(folder: Path) -> None:
    check_name(load_device_keys(folder, NOW), "7")


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
