"""How a client of the world proves who it is: by a password on one machine, by keys across machines."""

import secrets
import stat
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from datetime import datetime
from ipaddress import ip_address
from pathlib import Path

from chassis.files import write_private
from chassis.refusal import Refusal
from protocol.device_keys import DeviceKeys, check_name, load_device_keys

ON_THIS_MACHINE = ("unixsock-stream/", "unixpipe/")
ENCRYPTED = "tls/"
PASSWORD_BYTES = 24


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
    """Refuse keys where nothing is encrypted, and encryption without keys.

    Args:
        endpoint: where the world listens.
        keys: the folder of this device's keys, if it is given.

    Raises:
        Refusal: the two do not go together, or the endpoint is one at which Zenoh cannot encrypt.
    """
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


@dataclass(frozen=True)
class Login:
    """A name and the password that proves it; the password shows up in no representation."""

    user: str
    password: str = field(repr=False)


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
        mode = stat.S_IMODE(path.stat().st_mode)
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
