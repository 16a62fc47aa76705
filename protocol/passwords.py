"""Names and passwords, for runs on one machine. They are handed over in files that only their owner can read.

Across machines a password is no protection: use certificates.
"""

import secrets
import stat
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from pathlib import Path

from protocol.private_files import write_private

PASSWORD_BYTES = 24


class PasswordError(Exception):
    """A file of passwords that cannot be used; the text says why and what to do."""


@dataclass(frozen=True)
class Login:
    """A name and the password that proves it; the password shows up in no representation."""

    user: str
    password: str = field(repr=False)


def new_passwords(names: Iterable[str]) -> dict[str, str]:
    """A random password for each name."""
    return {name: secrets.token_urlsafe(PASSWORD_BYTES) for name in names}


def write_users(path: Path, passwords: Mapping[str, str]) -> None:
    """Write the file that tells a world who may connect, for its owner alone.

    Raises:
        OSError: it exists, or cannot be written.
    """
    write_private(path, "".join(f"{name}:{password}\n" for name, password in passwords.items()))


def write_password(path: Path, password: str) -> None:
    """Write the file that tells one participant its password, for its owner alone.

    Raises:
        OSError: it exists, or cannot be written.
    """
    write_private(path, password + "\n")


def read_users(path: Path) -> tuple[str, ...]:
    """The names in a file of a world's users.

    Raises:
        PasswordError: it cannot be read, can be read by others, or a line of it is not ``name:password``.
    """
    names = []
    for number, line in enumerate(_read_private(path).splitlines(), start=1):
        name, _, password = line.partition(":")
        if not name or not password:
            raise PasswordError(f"{path}, line {number}: name:password is expected on every line")
        names.append(name)
    return tuple(names)


def read_password(path: Path) -> str:
    """The password in a file.

    Raises:
        PasswordError: it cannot be read, can be read by others, or does not hold one line.
    """
    lines = _read_private(path).splitlines()
    if len(lines) != 1 or not lines[0]:
        raise PasswordError(f"{path}: {len(lines)} lines found, one line with the password is expected")
    return lines[0]


def _read_private(path: Path) -> str:
    try:
        mode = stat.S_IMODE(path.stat().st_mode)
        text = path.read_text(encoding="utf-8")
    except OSError as error:
        raise PasswordError(f"{path}: cannot be read: {error.strerror}") from error
    except UnicodeDecodeError:
        raise PasswordError(f"{path}: not a text file; passwords are expected in it") from None
    if mode & 0o077:
        raise PasswordError(
            f"{path}: others can read these passwords (mode {mode:04o}); do `chmod 600 {path}`, and make "
            "new passwords if others could have read them"
        )
    return text
