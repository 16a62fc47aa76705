"""Who has which certificate, until when, and what is wrong with it."""

from dataclasses import dataclass, replace
from datetime import datetime
from pathlib import Path

from chassis.refusal import Refusal
from fleet.keys.authority import folder_of, hosts_in
from fleet.keys.folders import AUTHORITY_FOLDER, devices_in, read_authority
from protocol.device_keys import (
    AUTHORITY_FILE,
    CERTIFICATE_FILE,
    KEY_FILE,
    check_name,
    holder_text,
    load_device_keys,
    name_in,
    read_certificate,
)


@dataclass(frozen=True)
class Finding:
    """What was found in one folder."""

    holder: str
    """Whose it is, for people; of the world also at which hosts."""
    folder: Path
    expires: datetime | None
    """When its certificate ends; None if that cannot be read."""
    wrong: str = ""
    """Why it cannot be used; empty if it can."""
    warning: str = ""
    """What should be done soon; empty if nothing."""


def survey(directory: Path, now: datetime) -> list[Finding]:
    """Look through all that ``unspoken keys create`` made, or through the folder of one device.

    Args:
        directory: of the whole or of the one.
        now: the time, aware of its zone.

    Raises:
        Refusal: there are no keys.
    """
    if any((directory / file).exists() for file in (AUTHORITY_FILE, CERTIFICATE_FILE, KEY_FILE)):
        if not (directory / CERTIFICATE_FILE).exists() and directory.name == AUTHORITY_FOLDER:
            return [_authority(directory, now)]
        return [_device(directory, now)]
    found = [_authority(directory / AUTHORITY_FOLDER, now)] if (directory / AUTHORITY_FOLDER).exists() else []
    found += [_device_of(directory, name, now) for name in devices_in(directory)]
    if not found:
        raise Refusal(
            f"{directory}: there are no keys here; a directory is expected as 'unspoken keys create' makes "
            "it, or the folder of one device"
        )
    return found


def _authority(folder: Path, now: datetime) -> Finding:
    expires = _expires(folder / AUTHORITY_FILE)
    try:
        read_authority(folder, now)
    except Refusal as error:
        return Finding("the authority", folder, expires, wrong=str(error))
    return Finding("the authority", folder, expires)


def _device(folder: Path, now: datetime) -> Finding:
    path = folder / CERTIFICATE_FILE
    try:
        keys = load_device_keys(folder, now)
    except Refusal as error:
        return Finding(_holder(path), folder, _expires(path), wrong=str(error))
    return Finding(_holder(path), folder, keys.expires, warning=keys.warning(now))


def _device_of(directory: Path, name: str, now: datetime) -> Finding:
    """A device's folder beside the authority's: it has to be that device's, and of this authority."""
    found = _device(directory / folder_of(name), now)
    if found.wrong:
        return replace(found, holder=holder_text(name))
    try:
        check_name(load_device_keys(found.folder, now), name)
        if (directory / AUTHORITY_FOLDER).is_dir():
            _check_authority(found.folder, directory / AUTHORITY_FOLDER)
    except Refusal as error:
        return replace(found, holder=holder_text(name), wrong=str(error))
    return found


def _check_authority(folder: Path, authority: Path) -> None:
    trusted, ours = (read_certificate(path / AUTHORITY_FILE) for path in (folder, authority))
    if trusted != ours:
        raise Refusal(
            f"{folder / AUTHORITY_FILE}: not the authority in {authority}, so this device is refused by the "
            "others; renew its keys with 'unspoken keys issue'"
        )


def _holder(path: Path) -> str:
    try:
        certificate = read_certificate(path)
        holder = holder_text(name_in(certificate, path))
    except Refusal:
        return "unknown"
    return f"{holder} at {', '.join(hosts)}" if (hosts := hosts_in(certificate)) else holder


def _expires(path: Path) -> datetime | None:
    try:
        return read_certificate(path).not_valid_after_utc
    except Refusal:
        return None
