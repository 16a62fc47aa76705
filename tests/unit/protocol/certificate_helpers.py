"""Keys for tests, made as ``unspoken keys`` makes them."""

from datetime import datetime
from pathlib import Path

from fleet.keys.authority import LOCAL_HOSTS, Authority, Device
from fleet.keys.folders import write_device
from protocol.keys import WORLD_NAME

DAYS = 30


def new_authority(now: datetime, days: int = 10 * DAYS) -> Authority:
    return Authority.new(now, days)


def keys_of(name: str, beside: Path, authority: Authority, now: datetime, *hosts: str) -> Path:
    """A device's folder, valid for ``DAYS``; a world without hosts is at those of this machine."""
    places = hosts or (LOCAL_HOSTS if name == WORLD_NAME else ())
    device = Device(name, places)
    write_device(beside, authority, device, now, DAYS)
    return beside / device.folder
