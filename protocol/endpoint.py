"""What a Zenoh endpoint such as ``tcp/127.0.0.1:7447`` says of who can reach it."""

from ipaddress import ip_address

ON_THIS_MACHINE = ("unixsock-stream/", "unixpipe/")
ENCRYPTED = "tls/"


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


def is_encrypted(endpoint: str) -> bool:
    """Whether both sides prove who they are by certificates, and nobody can listen in."""
    return endpoint.startswith(ENCRYPTED)
