"""Whether the world is there, lets this robot in, and fits it."""

import re
import socket
import ssl
import time
from contextlib import ExitStack, suppress

import zenoh

from agent.check import Finding
from agent.process.options import RobotOptions
from agent.process.robot import agent_in, ask_for_scene, make_agent
from chassis.refusal import Refusal, said_by
from protocol.codec import MessageError
from protocol.identity import AUTHORITY_FILE, CERTIFICATE_FILE, KEY_FILE, DeviceKeys, Identity
from protocol.keys import Keys
from protocol.scene import Scene
from protocol.session import client_session, reason_of
from protocol.version import PROTOCOL_VERSION

PATIENCE_S = 3.0
"""In this time a connection has to come about, then a session, then an answer."""
REFUSED_S = 0.5
"""In this time a world that does not believe a certificate says so; it hangs up on silence after 1 s."""
PAUSE_S = 0.1
"""Between two questions."""
_SOCKET = "unixsock-stream/"
_ADDRESS = re.compile(r"^(?:tcp|tls)/(?P<host>\[[^\]]+\]|[^:\[\]]+):(?P<port>\d{1,5})$")
_NOBODY = "nobody listens there; start the world, or give its endpoint in --connect"
_UNREACHED: dict[type[OSError], str] = {
    socket.gaierror: "this device knows no host of that name; give the world's address in --connect",
    ConnectionRefusedError: _NOBODY,
    FileNotFoundError: _NOBODY,
    TimeoutError: f"no answer within {PATIENCE_S:g} s; look at the network, at firewalls, and whether this "
    "is the world's address",
}


def look_at(endpoint: str, keys: DeviceKeys | None) -> None:
    """Connect, by TLS where there are keys, and hang up; an endpoint of another kind is left to Zenoh.

    Raises:
        Refusal: nobody listens, or one side does not believe the other's certificate.
    """
    plain = re.split("[?#]", endpoint)[0]
    with said_by(endpoint):
        if plain.startswith(_SOCKET):
            _connection(plain.removeprefix(_SOCKET)).close()
        elif address := _ADDRESS.match(plain):
            host = address["host"].strip("[]")
            with _connection((host, int(address["port"]))) as connection:
                if keys is not None:
                    _shake_hands(connection, host, keys)


def _connection(address: tuple[str, int] | str) -> socket.socket:
    """To a host and port, or to a socket in the file system."""
    try:
        if isinstance(address, tuple):
            return socket.create_connection(address, PATIENCE_S)
        with ExitStack() as stack:
            connection = stack.enter_context(socket.socket(socket.AF_UNIX))
            connection.settimeout(PATIENCE_S)
            connection.connect(address)
            stack.pop_all()
            return connection
    except (OSError, OverflowError) as error:
        for kind, sentence in _UNREACHED.items():
            if isinstance(error, kind):
                raise Refusal(sentence) from None
        reason = getattr(error, "strerror", None) or str(error)
        raise Refusal(f"cannot be reached: {reason}; look at the network") from None


def _shake_hands(connection: socket.socket, host: str, keys: DeviceKeys) -> None:
    context = ssl.SSLContext(ssl.PROTOCOL_TLS_CLIENT)
    context.load_verify_locations(keys.folder / AUTHORITY_FILE)
    context.load_cert_chain(keys.folder / CERTIFICATE_FILE, keys.folder / KEY_FILE)
    try:
        with context.wrap_socket(connection, server_hostname=host) as encrypted:
            encrypted.settimeout(REFUSED_S)
            # In TLS 1.3 the other side judges our certificate after the handshake; silence is consent.
            with suppress(TimeoutError):
                if not encrypted.recv(1):
                    raise EOFError
    except ssl.SSLCertVerificationError as error:
        raise Refusal(
            "TLS refused here: the certificate of whoever listens there is not believed: "
            f"{error.verify_message}; it needs one by the same authority that names this host: see 'unspoken "
            "keys create --host'"
        ) from None
    except (OSError, EOFError) as error:  # ssl.SSLError is an OSError
        reason = getattr(error, "reason", None) or getattr(error, "strerror", None) or "it hung up"
        raise Refusal(
            f"TLS refused there: {reason}; the world must listen at tls/… with keys by the same authority as "
            "those of this device"
        ) from None


def check_world(options: RobotOptions, identity: Identity, *, proven: bool) -> tuple[Finding, Scene | None]:
    """Ask the world for its scene, and nothing else: no presence, no interest, no command.

    Where the credentials are not ``proven``, only somebody who listens is looked for.
    """
    item, connect = "world", options.connect
    try:
        look_at(connect, identity if isinstance(identity, DeviceKeys) else None)
        if not proven:
            text = f"somebody listens at {connect}; not asked, since the credentials have failed"
            return Finding(item, "warning", text), None
        with _session(options, identity) as session:
            begin_s = time.perf_counter()
            scene = _scene(options, session)
            took_ms = 1000.0 * (time.perf_counter() - begin_s)
        agent_in(scene, options, make_agent)
    except Refusal as refusal:
        return Finding(item, "failed", str(refusal)), None
    count = len(scene.robots)
    robots = "1 robot" if count == 1 else f"{count} robots"
    text = (
        f"{connect} answers in {took_ms:.0f} ms: run {options.run!r} with {robots}, protocol version "
        f"{PROTOCOL_VERSION} like here"
    )
    return Finding(item, "ok", text), scene


def _session(options: RobotOptions, identity: Identity) -> zenoh.Session:
    try:
        config = client_session(options.connect, identity, PATIENCE_S).to_zenoh()
    except zenoh.ZError as error:
        raise Refusal(
            f"the endpoint {options.connect} cannot be used: {reason_of(error)}; one such as "
            "tcp/127.0.0.1:7447 is expected in --connect"
        ) from None
    try:
        return zenoh.open(config)
    except zenoh.ZError:
        proofs = {"the password": options.password_file, "the certificate": options.keys}
        proof = next((name for name, path in proofs.items() if path), "no credentials")
        raise Refusal(
            f"somebody listens at {options.connect} and does not let robot {options.robot} in with {proof}: "
            "refused, or that is no world; compare them with what the world was given"
        ) from None


def _scene(options: RobotOptions, session: zenoh.Session) -> Scene:
    """A world that was started just now answers a moment after it can be reached."""
    connect, run, robot = options.connect, options.run, options.robot
    until_s = time.monotonic() + PATIENCE_S
    while (remaining_s := until_s - time.monotonic()) > 0.0:
        try:
            public = ask_for_scene(session, Keys(run), robot, remaining_s)
        except MessageError as error:
            raise Refusal(f"{connect} answers what is no scene: {error}") from error
        if public is not None:
            return public.scene
        time.sleep(PAUSE_S)
    raise Refusal(
        f"{connect} lets this robot in and tells it nothing: its run is not {run!r}, or it grants nothing to "
        f"a robot {robot!r}; compare --run and --robot with those of the world"
    )
