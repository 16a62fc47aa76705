"""How a client of the world proves who it is: by a password on one machine, by keys across machines.

A device keeps its keys in one folder. It is read and checked before a session is opened, since Zenoh refuses
a bad certificate without a word: everything that can be wrong with the files is found here.
"""

import os
import secrets
import shlex
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from datetime import datetime, timedelta
from ipaddress import ip_address
from pathlib import Path
from typing import Final

from cryptography import x509
from cryptography.exceptions import InvalidSignature, UnsupportedAlgorithm
from cryptography.hazmat.primitives.asymmetric.types import PrivateKeyTypes
from cryptography.hazmat.primitives.serialization import load_pem_private_key
from cryptography.x509.oid import NameOID

from chassis.files import write_private
from chassis.refusal import Refusal
from protocol.keys import BENCH_NAME, WORLD_NAME

AUTHORITY_FILE: Final = "authority.pem"
"""The certificate of the authority that the device trusts."""
CERTIFICATE_FILE: Final = "certificate.pem"
"""The device's own certificate."""
KEY_FILE: Final = "key.pem"
"""The private key that belongs to it."""
SOON: Final = timedelta(days=14)
"""Before the end of a certificate is warned of so long."""
RENEW: Final = (
    "renew them with 'unspoken keys issue' where the authority is kept, and copy the folder here again"
)
ON_THIS_MACHINE = ("unixsock-stream/", "unixpipe/")
ENCRYPTED = "tls/"
PASSWORD_BYTES = 24
_DAMAGED = (
    ValueError,
    UnsupportedAlgorithm,
    x509.DuplicateExtension,
    x509.InvalidVersion,
    x509.UnsupportedGeneralNameType,
)
"""What the library raises for a certificate that it cannot read."""
_SEPARATORS = ";?"
"""Zenoh hands the paths on in one text, in which these stand between them."""
_COPY_AGAIN = "copy the folder here again as 'unspoken keys' made it"
_NEW_AUTHORITY = "make new keys for everybody with 'unspoken keys create'"


@dataclass(frozen=True)
class Login:
    """A name and the password that proves it; the password shows up in no representation."""

    user: str
    password: str = field(repr=False)


@dataclass(frozen=True)
class DeviceKeys:
    """Keys of one device that were whole, its own and valid when they were loaded."""

    folder: Path
    name: str
    """Whose they are: a robot's id, ``WORLD_NAME`` or ``BENCH_NAME``."""
    expires: datetime
    """When they cease to be accepted: the end of the certificate, or of its authority if that is earlier."""

    def expire_soon(self, now: datetime) -> bool:
        """Whether they expire within ``SOON``."""
        return self.expires - now <= SOON

    def warning(self, now: datetime) -> str:
        """That they expire soon, for people; empty if they do not."""
        expire = f"{self.folder}: these keys expire on {date_text(self.expires)}; {RENEW}"
        return expire if self.expire_soon(now) else ""


Identity = Login | DeviceKeys | None
"""None: a world that asks for nothing."""


def client_identity(
    name: str, endpoint: str, password_file: Path | None, keys: Path | None, now: datetime
) -> Identity:
    """What a client proves its name with.

    Args:
        name: a robot's id or that of the bench.
        endpoint: of the world.
        password_file: with its password, if it has one.
        keys: folder with its keys, if it has some.
        now: the time, aware of its zone.

    Raises:
        Refusal: they do not fit the endpoint or this name, cannot be used, or both are given.
    """
    if password_file is not None and keys is not None:
        raise Refusal("a password and keys are given; one of them is expected")
    check_keys_fit(endpoint, keys)
    if keys is not None:
        identity = load_device_keys(keys, now)
        check_name(identity, name)
        return identity
    return None if password_file is None else Login(name, read_password(password_file))


def is_local(endpoint: str) -> bool:
    """Whether only processes on this machine can reach it: a socket in the file system, or loopback."""
    if endpoint.startswith(ON_THIS_MACHINE):
        return True
    host = endpoint.partition("/")[2].rpartition(":")[0].strip("[]")
    if host == "localhost":
        return True
    try:
        return ip_address(host).is_loopback
    except ValueError:
        return False


def check_keys_fit(endpoint: str, keys: Path | None) -> None:
    """Refuse keys where nothing is encrypted, encryption without keys, and where Zenoh cannot encrypt."""
    encrypted = endpoint.startswith(ENCRYPTED)
    if keys is not None and not encrypted:
        raise Refusal(
            f"{endpoint} is not encrypted, so keys prove nothing there; an endpoint such as "
            "tls/world.local:7447 is expected with --keys"
        )
    if encrypted and keys is None:
        raise Refusal(
            f"{endpoint} is encrypted; the folder with the keys of this device is expected in --keys, as "
            "'unspoken keys create' makes it"
        )
    if endpoint.startswith(f"{ENCRYPTED}["):
        raise Refusal(
            f"{endpoint}: Zenoh encrypts nothing at an IPv6 address; a host name or an IPv4 one is expected"
        )


def new_passwords(names: Iterable[str]) -> dict[str, str]:
    """A random password for each name."""
    return {name: secrets.token_urlsafe(PASSWORD_BYTES) for name in names}


def write_users(path: Path, passwords: Mapping[str, str]) -> None:
    """Write a new file that tells a world who may connect, for its owner alone."""
    write_private(path, "".join(f"{name}:{password}\n" for name, password in passwords.items()))


def write_password(path: Path, password: str) -> None:
    """Write a new file with the password of one participant, for its owner alone."""
    write_private(path, password + "\n")


def read_users(path: Path) -> tuple[str, ...]:
    """The names in a file of a world's users; refused if others can read it, or a line is wrong."""
    names = []
    for number, line in enumerate(_read_private(path).splitlines(), start=1):
        name, _, password = line.partition(":")
        if not name or not password:
            raise Refusal(f"{path}, line {number}: name:password is expected on every line")
        names.append(name)
    return tuple(names)


def read_password(path: Path) -> str:
    """The password in a file; refused if others can read it, or if it does not hold one line."""
    lines = _read_private(path).splitlines()
    if len(lines) != 1 or not lines[0]:
        raise Refusal(f"{path}: {len(lines)} lines found, one line with the password is expected")
    return lines[0]


def _read_private(path: Path) -> str:
    try:
        mode = path.stat().st_mode & 0o777
        text = path.read_text(encoding="utf-8")
    except OSError as error:
        raise Refusal(f"{path}: cannot be read: {error.strerror}") from error
    except UnicodeDecodeError:
        raise Refusal(f"{path}: not a text file; passwords are expected in it") from None
    if mode & 0o077:
        raise Refusal(
            f"{path}: others can read these passwords (mode {mode:04o}); do `chmod 600 {path}`, and make "
            "new passwords if others could have read them"
        )
    return text


def load_device_keys(folder: Path, now: datetime) -> DeviceKeys:
    """Read the keys of a device and check all that Zenoh would refuse later without saying why.

    Args:
        folder: with ``authority.pem``, ``certificate.pem`` and ``key.pem``.
        now: the device's time, aware of its zone.

    Raises:
        Refusal: a file is missing, not what it should be or open to others, Zenoh takes no such path, the
            files do not belong together, or a certificate is not valid now.
    """
    _check_folder(folder)
    authority = read_certificate(folder / AUTHORITY_FILE)
    certificate = read_certificate(folder / CERTIFICATE_FILE)
    check_pair(read_key(folder / KEY_FILE), certificate, folder)
    _check_issuer(certificate, authority, folder)
    check_time(authority, folder / AUTHORITY_FILE, now)
    check_time(certificate, folder / CERTIFICATE_FILE, now)
    expires = min(certificate.not_valid_after_utc, authority.not_valid_after_utc)
    return DeviceKeys(folder, name_in(certificate, folder / CERTIFICATE_FILE), expires)


def check_name(keys: DeviceKeys, expected: str) -> None:
    """Refuse the keys of another device than a robot, by its id, ``WORLD_NAME`` or ``BENCH_NAME``."""
    if keys.name != expected:
        raise Refusal(
            f"{keys.folder}: these are the keys of {holder_text(keys.name)}, those of "
            f"{holder_text(expected)} are expected; copy the right folder here"
        )


def read_certificate(path: Path) -> x509.Certificate:
    """The one certificate in a file; refused if it cannot be read, or holds none or several."""
    try:
        found = x509.load_pem_x509_certificates(_read(path)[0])
        for each in found:
            each.public_key(), each.subject, each.extensions  # read only now; damage is told here
    except _DAMAGED:
        raise Refusal(f"{path}: this is no certificate in PEM; {_COPY_AGAIN}") from None
    if len(found) != 1:
        raise Refusal(f"{path}: one certificate is expected, found {len(found)}; {_COPY_AGAIN}")
    return found[0]


def read_key(path: Path) -> PrivateKeyTypes:
    """The private key in a file; refused if others may use it, or if it holds none without a password."""
    content, mode = _read(path)
    if mode & 0o077:
        raise Refusal(
            f"{path}: others may use this private key, its mode is {mode:04o}, 0600 is expected; "
            f"run: chmod 600 {shlex.quote(str(path))}"
        )
    try:
        return load_pem_private_key(content, password=None)
    except (ValueError, TypeError, UnsupportedAlgorithm):  # TypeError: it is locked by a password
        raise Refusal(f"{path}: this is no private key in PEM without password; {_COPY_AGAIN}") from None


def check_pair(key: PrivateKeyTypes, certificate: x509.Certificate, folder: Path) -> None:
    """Refuse a private key that is not that of the certificate beside it in the folder."""
    if key.public_key() != certificate.public_key():
        raise Refusal(f"{folder / KEY_FILE}: not the private key of the certificate beside it; {_COPY_AGAIN}")


def check_time(certificate: x509.Certificate, path: Path, now: datetime) -> None:
    """Refuse a certificate that is not valid yet, or no longer."""
    begin, end = certificate.not_valid_before_utc, certificate.not_valid_after_utc
    if now < begin:
        raise Refusal(
            f"{path}: not valid before {date_text(begin)}, and the clock here says {date_text(now)}; "
            "set the clock"
        )
    if now > end:
        help_text = _NEW_AUTHORITY if path.name == AUTHORITY_FILE else RENEW
        raise Refusal(
            f"{path}: expired on {date_text(end)}, and the clock here says {date_text(now)}; if the clock is "
            f"right, {help_text}"
        )


def name_in(certificate: x509.Certificate, path: Path) -> str:
    """The common name in a certificate; refused unless there is exactly one."""
    names = certificate.subject.get_attributes_for_oid(NameOID.COMMON_NAME)
    if len(names) != 1:
        raise Refusal(f"{path}: one common name is expected in it, found {len(names)}; {_COPY_AGAIN}")
    return str(names[0].value)


def holder_text(name: str) -> str:
    """Whose keys these are, for people."""
    return {WORLD_NAME: "the world", BENCH_NAME: "the bench"}.get(name, f"robot {name}")


def date_text(time: datetime) -> str:
    """A time for people, in the time zone of this device."""
    return f"{time.astimezone():%Y-%m-%d %H:%M %Z}"


def _check_folder(folder: Path) -> None:
    try:
        folder.stat()
    except FileNotFoundError:
        raise Refusal(
            f"{folder}: there is no such folder; the keys of this device are expected in it, as "
            "'unspoken keys create' makes them"
        ) from None
    except OSError as error:
        raise Refusal(f"{folder}: cannot be read: {error.strerror}") from None
    if found := [sign for sign in _SEPARATORS if sign in str(folder)]:
        raise Refusal(
            f"{folder}: Zenoh opens no keys at a path with '{found[0]}'; choose another name for the folder"
        )


def _read(path: Path) -> tuple[bytes, int]:
    """Content and mode of a file."""
    try:
        with path.open("rb") as file:
            return file.read(), os.fstat(file.fileno()).st_mode & 0o777
    except FileNotFoundError:
        raise Refusal(f"{path}: this file is missing; {_COPY_AGAIN}") from None
    except OSError as error:
        raise Refusal(f"{path}: cannot be read: {error.strerror}") from None


def _check_issuer(certificate: x509.Certificate, authority: x509.Certificate, folder: Path) -> None:
    try:
        certificate.verify_directly_issued_by(authority)
    except (ValueError, TypeError, InvalidSignature, UnsupportedAlgorithm):
        raise Refusal(
            f"{folder / CERTIFICATE_FILE}: not signed by the authority in {AUTHORITY_FILE} beside it; the "
            "keys of all devices must come from one 'unspoken keys create'; copy the folder here again"
        ) from None
