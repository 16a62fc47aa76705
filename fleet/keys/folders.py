"""The folders that ``unspoken keys`` makes, renews and checks: the authority's, and one for each device.

Whatever interrupts the making, a folder of a device is there with certificate and key that belong together,
or it is not there.
"""

import os
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from datetime import datetime
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Final

from cryptography.hazmat.primitives.asymmetric.ec import EllipticCurvePrivateKey

from chassis.files import new_directory
from chassis.refusal import Refusal
from fleet.interruption import Interruption
from fleet.keys.authority import LOCAL_HOSTS, Authority, Device, checked_host, folder_of, hosts_in, name_of
from protocol.identity import (
    AUTHORITY_FILE,
    CERTIFICATE_FILE,
    KEY_FILE,
    check_name,
    check_pair,
    check_time,
    holder_text,
    load_device_keys,
    read_certificate,
    read_key,
)
from protocol.keys import WORLD_NAME

AUTHORITY_FOLDER: Final = "authority"
FILES: Final = {AUTHORITY_FILE, CERTIFICATE_FILE, KEY_FILE}


def create(directory: Path, devices: Iterable[Device], now: datetime, days: int, authority_days: int) -> None:
    """Make an authority and the keys of these devices in a new or empty directory: all of them, or nothing.

    They are valid for so many days from ``now`` on, which is aware of its zone.

    Raises:
        Refusal: the directory holds something, or the authority does not last as long as the certificates.
        OSError: the directory cannot be written.
    """
    if_taken = (
        "choose another directory, or if it holds keys already, renew them and add some with "
        "'unspoken keys issue'"
    )
    with new_directory(directory, if_taken) as whole:
        whole.chmod(0o700)
        authority = Authority.new(now, authority_days)
        own = {AUTHORITY_FILE: authority.certificate_pem, KEY_FILE: authority.key_pem}
        _write_folder(whole / AUTHORITY_FOLDER, own)
        for device in devices:
            write_device(whole, authority, device, now, days)


def issue(directory: Path, devices: Sequence[Device], now: datetime, days: int) -> None:
    """Give these devices new keys and certificates of the authority that is there.

    All are written before the first takes the place of an older one.

    Raises:
        Refusal: there are no devices, the authority cannot be used or does not last so long, or a device's
            folder holds something else too, which would be lost.
        OSError: the directory cannot be written.
    """
    authority = read_authority(directory / AUTHORITY_FOLDER, now)
    if not devices:
        raise Refusal(f"{directory}: no device has keys here yet; name who shall get some, as with --robot 1")
    for device in devices:
        _refuse_foreign_files(directory / device.folder)
    with TemporaryDirectory(prefix=".issued-", dir=directory) as beside:
        new, old = Path(beside) / "new", Path(beside) / "old"
        new.mkdir()
        old.mkdir()
        for device in devices:
            write_device(new, authority, device, now, days)
        with Interruption():  # a Ctrl-C between the two steps waits for the second
            for device in devices:
                _replace(directory / device.folder, new / device.folder, old / device.folder)


def read_authority(folder: Path, now: datetime) -> Authority:
    """The authority in a folder, to sign with it.

    Raises:
        Refusal: it is missing, incomplete, open to others, not made by ``unspoken keys``, or expired.
    """
    if not folder.is_dir():
        raise Refusal(f"{folder}: there is no authority here; 'unspoken keys create' makes one")
    certificate, key = read_certificate(folder / AUTHORITY_FILE), read_key(folder / KEY_FILE)
    check_pair(key, certificate, folder)
    check_time(certificate, folder / AUTHORITY_FILE, now)
    if not isinstance(key, EllipticCurvePrivateKey):
        raise Refusal(
            f"{folder / KEY_FILE}: the key of an elliptic curve is expected, as 'unspoken keys' makes it"
        )
    return Authority(certificate, key)


def devices_in(directory: Path) -> list[str]:
    """Whose folders are there: the world, the bench, then the robots in the order of their ids."""
    names = [name for path in directory.iterdir() if path.is_dir() and (name := name_of(path.name))]

    def order(name: str) -> tuple[bool, bool, int, str]:
        number = int(name) if name.isdecimal() else 0  # 2 before 10
        return (not name.startswith("@"), name != WORLD_NAME, number, name)

    return sorted(names, key=order)


def hosts_of_world(directory: Path) -> tuple[str, ...]:
    """The hosts in the world's certificate, to be kept in the next one; those of one machine without it.

    Raises:
        Refusal: its certificate cannot be read, or holds other hosts than ``unspoken keys`` puts there.
    """
    path = directory / folder_of(WORLD_NAME) / CERTIFICATE_FILE
    if not path.parent.is_dir():
        return LOCAL_HOSTS
    try:
        return tuple(map(checked_host, hosts_in(read_certificate(path))))
    except (Refusal, ValueError) as error:
        raise Refusal(f"{error}; name the world's hosts with --host") from None


def write_device(directory: Path, authority: Authority, device: Device, now: datetime, days: int) -> None:
    """Issue keys for a device and write its folder, which ``load_device_keys`` reads.

    Raises:
        Refusal: the authority does not last so long.
        OSError: it cannot be written.
    """
    credentials = authority.issue(device, now, days)
    files = {AUTHORITY_FILE: authority.certificate_pem, CERTIFICATE_FILE: credentials.certificate_pem}
    _write_folder(directory / device.folder, files | {KEY_FILE: credentials.key_pem})


def _write_folder(folder: Path, files: Mapping[str, bytes]) -> None:
    """Write new files that nobody else could read for a moment if private, and that are on the disk."""
    folder.mkdir(mode=0o700)
    for name, content in files.items():
        mode = 0o600 if name == KEY_FILE else 0o644
        with open(folder / name, "xb", opener=partial(os.open, mode=mode)) as file:
            file.write(content)
            file.flush()
            os.fsync(file.fileno())


def _replace(folder: Path, new: Path, old: Path) -> None:
    """Put a new folder where an old one may be; if that fails the old one is there again."""
    if folder.is_dir():
        folder.rename(old)
    try:
        new.rename(folder)
    except OSError:
        if old.is_dir():
            old.rename(folder)
        raise


def _refuse_foreign_files(folder: Path) -> None:
    if folder.is_symlink() or (folder.exists() and not folder.is_dir()):
        raise Refusal(f"{folder}: a folder is expected, or nothing; move it away")
    found = {path.name for path in folder.iterdir()} if folder.exists() else set()
    if foreign := sorted(found - FILES):
        raise Refusal(
            f"{folder}: the whole folder is replaced, and {foreign[0]} in it would be lost; move it away"
        )


@dataclass(frozen=True)
class Finding:
    """What was found in one folder."""

    holder: str
    """Whose it is, for people; for the world also at which hosts."""
    folder: Path
    expires: datetime | None
    """When its certificate ends; None if that cannot be read."""
    wrong: str = ""
    """Why it cannot be used; empty if it can."""
    warning: str = ""
    """What should be done soon; empty if nothing."""


def survey(directory: Path, now: datetime) -> list[Finding]:
    """Look through all that ``create`` has made, or through the folder of one device.

    Raises:
        Refusal: there are no keys.
    """
    if any((directory / file).exists() for file in FILES):
        if directory.name == AUTHORITY_FOLDER and not (directory / CERTIFICATE_FILE).exists():
            return [_authority_found(directory, now)]
        return [_device_found(directory, now)]
    authority = directory / AUTHORITY_FOLDER
    found = [_authority_found(authority, now)] if authority.exists() else []
    found += [_device_found(directory / folder_of(name), now, name) for name in devices_in(directory)]
    if not found:
        raise Refusal(
            f"{directory}: there are no keys here; a directory is expected as 'unspoken keys create' makes "
            "it, or the folder of one device"
        )
    return found


def _authority_found(folder: Path, now: datetime) -> Finding:
    wrong = ""
    try:
        read_authority(folder, now)
    except Refusal as refusal:
        wrong = str(refusal)
    return Finding("the authority", folder, _expires(folder / AUTHORITY_FILE), wrong)


def _device_found(folder: Path, now: datetime, name: str | None = None) -> Finding:
    """What a folder holds; one with a name must hold that device's keys, of the authority beside it."""
    path, authority = folder / CERTIFICATE_FILE, folder.parent / AUTHORITY_FOLDER
    holder = "unknown" if name is None else holder_text(name)
    try:
        keys = load_device_keys(folder, now)
        if name is not None:
            check_name(keys, name)
            trusted, ours = (each / AUTHORITY_FILE for each in (folder, authority))
            if authority.is_dir() and read_certificate(trusted) != read_certificate(ours):
                raise Refusal(
                    f"{trusted}: not the authority in {authority}, so this device is refused by the others; "
                    "renew its keys with 'unspoken keys issue'"
                )
    except Refusal as refusal:
        return Finding(holder, folder, _expires(path), wrong=str(refusal))
    hosts = ", ".join(hosts_in(read_certificate(path)))
    holder = holder_text(keys.name) + (f" at {hosts}" if hosts else "")
    return Finding(holder, folder, keys.expires, warning=keys.warning(now))


def _expires(path: Path) -> datetime | None:
    try:
        return read_certificate(path).not_valid_after_utc
    except Refusal:
        return None
