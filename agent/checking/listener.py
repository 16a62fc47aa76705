"""Whether anybody listens at an endpoint, and by TLS, before Zenoh is asked, which does not tell why not."""

import re
import socket
import ssl
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager

from protocol.device_keys import DeviceKeys

LISTENS_S = 3.0
"""In this time a connection has to come about."""
REFUSED_S = 0.5
"""In this time a world that does not believe a certificate says so; it hangs up on silence after 1 s."""
_SOCKET = "unixsock-stream/"
_ADDRESS = re.compile(r"^(?:tcp|tls)/(?P<host>\[[^\]]+\]|[^:\[\]]+):(?P<port>\d{1,5})$")


class UnreachableError(Exception):
    """Nobody is reached there; the text says why and what to do."""


def look_at(endpoint: str, keys: DeviceKeys | None) -> None:
    """Connect, by TLS where the endpoint wants it, and hang up.

    An endpoint of another kind is left to Zenoh.

    Args:
        endpoint: of the world.
        keys: that prove who this is.

    Raises:
        UnreachableError: nobody listens, or one side does not believe the other's certificate.
    """
    plain = re.split("[?#]", endpoint)[0]
    if plain.startswith(_SOCKET):
        with _connected(plain.removeprefix(_SOCKET), endpoint):
            return
    address = _ADDRESS.match(plain)
    if address is None:
        return
    host = address["host"].strip("[]")
    with _connected((host, int(address["port"])), endpoint) as connection:
        if keys is not None:
            _shake_hands(connection, host, keys, endpoint)


@contextmanager
def _connected(address: tuple[str, int] | str, endpoint: str) -> Iterator[socket.socket]:
    """A connection to a host and port, or to a socket in the file system."""
    try:
        connection = _connect(address)
    except socket.gaierror:
        raise UnreachableError(
            f"{endpoint}: this device knows no host of that name; give the world's address in --connect"
        ) from None
    except (ConnectionRefusedError, FileNotFoundError):
        raise UnreachableError(
            f"{endpoint}: nobody listens there; start the world, or give its endpoint in --connect"
        ) from None
    except TimeoutError:
        raise UnreachableError(
            f"{endpoint}: no answer within {LISTENS_S:g} s; look at the network, at firewalls, and whether "
            "this is the world's address"
        ) from None
    except (OSError, OverflowError) as error:
        reason = getattr(error, "strerror", None) or str(error)
        raise UnreachableError(f"{endpoint}: cannot be reached: {reason}; look at the network") from None
    with connection:
        yield connection


def _connect(address: tuple[str, int] | str) -> socket.socket:
    if isinstance(address, tuple):
        return socket.create_connection(address, LISTENS_S)
    with ExitStack() as stack:
        connection = stack.enter_context(socket.socket(socket.AF_UNIX))
        connection.settimeout(LISTENS_S)
        connection.connect(address)
        stack.pop_all()
        return connection


def _shake_hands(connection: socket.socket, host: str, keys: DeviceKeys, endpoint: str) -> None:
    context = ssl.SSLContext(ssl.PROTOCOL_TLS_CLIENT)
    context.load_verify_locations(keys.authority)
    context.load_cert_chain(keys.certificate, keys.key)
    try:
        with context.wrap_socket(connection, server_hostname=host) as encrypted:
            encrypted.settimeout(REFUSED_S)
            _await_refusal(encrypted)
    except ssl.SSLCertVerificationError as error:
        raise UnreachableError(
            f"{endpoint}: TLS refused here: the certificate of whoever listens there is not believed: "
            f"{error.verify_message}; it needs one by the same authority that names this host: see 'unspoken "
            "keys create --host'"
        ) from None
    except (OSError, EOFError) as error:  # ssl.SSLError is an OSError
        reason = getattr(error, "reason", None) or getattr(error, "strerror", None) or "it hung up"
        raise UnreachableError(
            f"{endpoint}: TLS refused there: {reason}; the world must listen at tls/… with keys by the same "
            "authority as those of this device"
        ) from None


def _await_refusal(encrypted: ssl.SSLSocket) -> None:
    """In TLS 1.3 the other side judges our certificate after the handshake; silence is consent."""
    try:
        said = encrypted.recv(1)
    except TimeoutError:
        return
    if not said:
        raise EOFError
