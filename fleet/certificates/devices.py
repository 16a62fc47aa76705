"""Who gets a certificate, and the hosts at which a world is found."""

import re
from dataclasses import dataclass
from ipaddress import IPv4Address, IPv6Address, ip_address
from typing import Final, Self

from cryptography import x509

from protocol.keys import BENCH_NAME, WORLD_NAME, checked_name

_HOST_NAME: Final = re.compile(r"(?=.{1,253}\Z)(?![\d.]+\Z)\w[\w-]{0,62}(\.\w[\w-]{0,62})*", re.ASCII)
_ROBOT_FOLDER: Final = "robot-"
_FOLDERS: Final = {WORLD_NAME: "world", BENCH_NAME: "bench"}
_HOLDERS: Final = {folder: name for name, folder in _FOLDERS.items()}


@dataclass(frozen=True)
class Host:
    """Where robots find the world: a host name or an IPv4 address."""

    place: str | IPv4Address

    @classmethod
    def parse(cls, text: str) -> Self:
        """A host as a person writes it.

        Raises:
            ValueError: it is neither a host name nor an IPv4 address; told in plain words.
        """
        try:
            address = ip_address(text)
        except ValueError:
            if _HOST_NAME.fullmatch(text):
                return cls(text)
            raise ValueError(
                f"{text!r} found, a host name or an IPv4 address is expected, such as lab.example or "
                "192.168.1.7, without protocol and port"
            ) from None
        if isinstance(address, IPv6Address):  # Zenoh takes what stands before the first colon for the host
            raise ValueError(
                f"{text!r} found, but over TLS Zenoh connects to no IPv6 address; give the world a host name"
            )
        return cls(address)

    def to_general_name(self) -> x509.GeneralName:
        """As a certificate holds it."""
        return x509.DNSName(self.place) if isinstance(self.place, str) else x509.IPAddress(self.place)


LOCAL_HOSTS: Final = (Host("localhost"), Host(IPv4Address("127.0.0.1")))
"""Of a world that is found on its own machine only."""


@dataclass(frozen=True)
class Device:
    """Who gets a certificate."""

    name: str
    """A robot's id, ``WORLD_NAME`` or ``BENCH_NAME``: the common name."""
    hosts: tuple[Host, ...] = ()
    """Where it is found; for the world only."""

    @property
    def folder(self) -> str:
        """The name of the folder with its keys."""
        return folder_of(self.name)


def folder_of(name: str) -> str:
    """The name of the folder with the keys of a robot, the world or the bench."""
    return _FOLDERS.get(name, f"{_ROBOT_FOLDER}{name}")


def name_of(folder: str) -> str | None:
    """Whose keys a folder of this name holds; None if it is no device's."""
    if folder in _HOLDERS or not folder.startswith(_ROBOT_FOLDER):
        return _HOLDERS.get(folder)
    try:
        return checked_name(folder.removeprefix(_ROBOT_FOLDER))
    except ValueError:
        return None


def hosts_in(certificate: x509.Certificate) -> list[str]:
    """The hosts for which a certificate is valid, as people write them."""
    try:
        names = certificate.extensions.get_extension_for_class(x509.SubjectAlternativeName).value
    except x509.ExtensionNotFound:
        return []
    return [*names.get_values_for_type(x509.DNSName), *map(str, names.get_values_for_type(x509.IPAddress))]
