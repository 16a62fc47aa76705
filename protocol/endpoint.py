"""What a Zenoh endpoint such as ``tcp/127.0.0.1:7447`` says of who can reach it."""

from ipaddress import ip_address
from pathlib import Path

ON_THIS_MACHINE = ("unixsock-stream/", "unixpipe/")
ENCRYPTED = "tls/"


class UnfitEndpointError(Exception):
    """An endpoint that does not go with the keys that are given; the text says why and what to do."""


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
        UnfitEndpointError: the two do not go together, or the endpoint is one at which Zenoh cannot encrypt.
    """
    encrypted = endpoint.startswith(ENCRYPTED)
    if keys is not None and not encrypted:
        raise UnfitEndpointError(
            f"{endpoint} is not encrypted, so keys prove nothing there; an endpoint such as "
            "tls/world.local:7447 is expected with --keys"
        )
    if encrypted and keys is None:
        raise UnfitEndpointError(
            f"{endpoint} is encrypted; the folder with the keys of this device is expected in --keys, as "
            "'unspoken keys create' makes it"
        )
    if endpoint.startswith(f"{ENCRYPTED}["):
        raise UnfitEndpointError(
            f"{endpoint}: Zenoh encrypts nothing at an IPv6 address; a host name or an IPv4 one is expected"
        )
