"""The same bus with and without what keeps it silent: nothing, the policy with passwords, certificates."""

import socket
from collections.abc import Iterator, Mapping
from contextlib import closing
from datetime import UTC, datetime
from enum import StrEnum
from pathlib import Path
from typing import NamedTuple

from fleet.keys.authority import LOCAL_HOSTS, Device, folder_of
from fleet.keys.folders import create
from fleet.run.launch import Logins
from protocol.device_keys import load_device_keys
from protocol.keys import WORLD_NAME, Keys
from protocol.policy import access_control, rights_of
from protocol.session import SessionSettings, world_session

VALID_DAYS = 1


class Protection(StrEnum):
    """What protects a bus, and over which link."""

    NONE = "socket, open"
    PASSWORDS = "socket, policy by passwords"
    NONE_TCP = "TCP, open"
    CERTIFICATES = "TLS, policy by certificates"


class Star(NamedTuple):
    """A world's session to be opened, and how robots reach it."""

    world: SessionSettings
    connect: str
    proofs: Mapping[str, dict[str, str]]
    """By robot, the settings of its process that prove who it is."""


def star(protection: Protection, directory: Path, keys: Keys, robots: list[str]) -> Star:
    """A bus that nobody has opened yet.

    Args:
        protection: of it.
        directory: for its socket, passwords or keys.
        keys: of the run.
        robots: their ids.
    """
    rights, nothing = rights_of(keys, robots), {robot: dict[str, str]() for robot in robots}
    endpoint = f"unixsock-stream/{directory}/world.sock"
    match protection:
        case Protection.NONE:
            return Star(world_session(endpoint), endpoint, nothing)
        case Protection.NONE_TCP:
            endpoint = f"tcp/127.0.0.1:{_free_port()}"
            return Star(world_session(endpoint), endpoint, nothing)
        case Protection.PASSWORDS:
            logins = Logins(directory, robots)
            users = Path(logins.of_world()["users"])
            world = world_session(endpoint, access_control(rights, "usernames"), users)
            return Star(world, endpoint, {robot: logins.of_robot(robot) for robot in robots})
        case Protection.CERTIFICATES:
            endpoint, folder, now = f"tls/127.0.0.1:{_free_port()}", directory / "keys", datetime.now(UTC)
            create(folder, _devices(robots), now, VALID_DAYS, VALID_DAYS + 1)
            own = load_device_keys(folder / folder_of(WORLD_NAME), now)
            world = world_session(endpoint, access_control(rights, "cert_common_names"), own)
            proofs = {robot: {"keys": str(folder / folder_of(robot))} for robot in robots}
            return Star(world, endpoint, proofs)


def _devices(robots: list[str]) -> Iterator[Device]:
    yield Device(WORLD_NAME, LOCAL_HOSTS)
    yield from (Device(robot, ()) for robot in robots)


def _free_port() -> int:
    with closing(socket.socket()) as free:
        free.bind(("127.0.0.1", 0))
        port: int = free.getsockname()[1]
        return port
