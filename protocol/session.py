"""A client's session that is waited for, with signs of life and within reach of a wish to end."""

import os
import re
import threading
import time
from collections.abc import Callable
from pathlib import Path
from queue import Empty, SimpleQueue
from typing import Literal

import zenoh
from pydantic import BaseModel, ConfigDict, Field

from chassis.health import BEAT_S
from protocol.device_keys import DeviceKeys
from protocol.identity import Identity
from protocol.policy import AccessControl

LEASE_MS = 1000
"""Silence after which a peer counts as gone: a stopped process is noticed within about a second."""
MAX_MESSAGE_BYTES = 256 * 1024 + 1024
"""The largest payload of the codec and its key."""


class _ZenohSettings(BaseModel):
    model_config = ConfigDict(frozen=True, extra="forbid")


class Switch(_ZenohSettings):
    """Something that can be on or off."""

    enabled: bool = False


class Scouting(_ZenohSettings):
    """No discovery; no wait for it at the opening."""

    delay: int = 0
    multicast: Switch = Switch()
    gossip: Switch = Switch()


class Unicast(_ZenohSettings):
    """Limits on connections being opened, in ms and in number, and on open ones.

    Idle sockets may not keep newcomers out, and an answer that never comes may not stop a reconnection.
    """

    open_timeout: int = 1000
    accept_timeout: int = 1000
    accept_pending: int = 1000
    max_sessions: int = 1000


class QueueSizes(_ZenohSettings):
    """Batches of 64 KiB that wait for a slow reader, at the priorities that are used; 16 is the most.

    Eight robots say a batch a step. The default of two loses messages as soon as a recorder pauses.
    """

    real_time: int = 16
    data: int = 16


class Queue(_ZenohSettings):
    """Of what is to be sent."""

    size: QueueSizes = QueueSizes()


class Sending(_ZenohSettings):
    """Keep-alive lease in ms, and room for messages."""

    lease: int = LEASE_MS
    queue: Queue = Queue()


class Receiving(_ZenohSettings):
    """Largest message in bytes."""

    max_message_size: int = MAX_MESSAGE_BYTES


class Tls(_ZenohSettings):
    """Files that prove who this is, and whom it believes; both sides must prove it."""

    root_ca_certificate: str
    listen_certificate: str | None = None
    listen_private_key: str | None = None
    connect_certificate: str | None = None
    connect_private_key: str | None = None
    enable_mtls: Literal[True] = True
    verify_name_on_connect: Literal[True] = True
    close_link_on_expiration: Literal[True] = True


class Link(_ZenohSettings):
    """Settings of one connection."""

    protocols: tuple[str, ...] | None = None
    """None: those of the endpoints."""
    tls: Tls | None = None

    tx: Sending = Sending()
    rx: Receiving = Receiving()


class Passwords(_ZenohSettings):
    """Who this is, for a client; who may connect, for the world."""

    user: str | None = None
    password: str | None = Field(default=None, repr=False)
    dictionary_file: str | None = None


class Authentication(_ZenohSettings):
    """How names are proven where there are no certificates."""

    usrpwd: Passwords


class Transport(_ZenohSettings):
    """Shared memory would bypass the size limit, so it is off."""

    unicast: Unicast = Unicast()
    link: Link = Link()
    shared_memory: Switch = Switch()
    auth: Authentication | None = None


class Listen(_ZenohSettings):
    """Where a world accepts connections."""

    endpoints: tuple[str, ...] = ()


class Retry(_ZenohSettings):
    """Pauses between attempts to connect."""

    period_init_ms: int = 100
    period_max_ms: int = 500
    period_increase_factor: float = 1.5


class Connect(_ZenohSettings):
    """Where a client connects to; it waits for a world that is not there yet."""

    endpoints: tuple[str, ...] = ()
    timeout_ms: int = -1
    exit_on_failure: bool = False
    retry: Retry = Retry()


class SessionSettings(_ZenohSettings):
    """One process's session."""

    mode: Literal["router", "client"]
    listen: Listen = Listen()
    connect: Connect = Connect()
    scouting: Scouting = Scouting()
    transport: Transport = Transport()
    access_control: AccessControl | None = None

    def to_zenoh(self) -> zenoh.Config:
        """Zenoh's own configuration object.

        Raises:
            zenoh.ZError: Zenoh does not accept an endpoint.
        """
        return zenoh.Config.from_json5(self.model_dump_json(exclude_none=True))


def world_session(
    listen: str,
    access: AccessControl | None = None,
    proof: Path | DeviceKeys | None = None,
    most_sessions: int = 1000,
) -> SessionSettings:
    """The world: a router that accepts connections at an endpoint such as ``tcp/127.0.0.1:7447``.

    Args:
        listen: that endpoint.
        access: who may do what; None: everybody everything.
        proof: how names are proven: file of names and passwords, or the world's own keys; None: not at all.
        most_sessions: how many may be connected at a time.
    """
    unicast = Unicast(max_sessions=most_sessions)
    transport = Transport(unicast=unicast)
    if isinstance(proof, DeviceKeys):
        certificate, key = str(proof.certificate), str(proof.key)
        tls = Tls(
            root_ca_certificate=str(proof.authority), listen_certificate=certificate, listen_private_key=key
        )
        transport = Transport(unicast=unicast, link=Link(protocols=("tls",), tls=tls))
    elif proof is not None:
        auth = Authentication(usrpwd=Passwords(dictionary_file=str(proof)))
        transport = Transport(unicast=unicast, auth=auth)
    listening = Listen(endpoints=(listen,))
    return SessionSettings(mode="router", listen=listening, transport=transport, access_control=access)


def client_session(connect: str, identity: Identity = None) -> SessionSettings:
    """A robot or the bench: a client of the world at this endpoint.

    Args:
        connect: that endpoint.
        identity: what proves who this is.
    """
    transport = Transport()
    if isinstance(identity, DeviceKeys):
        certificate, key = str(identity.certificate), str(identity.key)
        tls = Tls(
            root_ca_certificate=str(identity.authority),
            connect_certificate=certificate,
            connect_private_key=key,
        )
        transport = Transport(link=Link(protocols=("tls",), tls=tls))
    elif identity is not None:
        auth = Authentication(usrpwd=Passwords(user=identity.user, password=identity.password))
        transport = Transport(auth=auth)
    return SessionSettings(mode="client", connect=Connect(endpoints=(connect,)), transport=transport)


def brief_session(connect: str, identity: Identity, patience_s: float) -> SessionSettings:
    """A client that gives up on a world that does not let it in, instead of waiting for it.

    Args:
        connect: endpoint of the world.
        identity: what proves who this is.
        patience_s: after which it gives up.
    """
    waiting = client_session(connect, identity)
    brief = waiting.connect.model_copy(
        update={"timeout_ms": round(1000.0 * patience_s), "exit_on_failure": True}
    )
    return waiting.model_copy(update={"connect": brief})


def receive_on_threads(count: int) -> None:
    """Let this process receive from so many connections at once; to be called before the first session.

    Zenoh has two such threads. Two robots whose messages wait to be taken would hold up all the others.
    Zenoh reads this from the environment and nowhere else.
    """
    os.environ["ZENOH_RUNTIME"] = f"(rx: (worker_threads: {count}))"


def reason_of(error: zenoh.ZError) -> str:
    """What Zenoh complains about, without the places in its own source."""
    return re.sub(r" at /\S+?\.rs:\d+\.?", "", str(error))


def open_in_background(
    settings: SessionSettings, deliver: Callable[[zenoh.Session | zenoh.ZError], None]
) -> None:
    """Open a session without blocking: a client's opening waits for its world and lets no signal through.

    Args:
        settings: of the session.
        deliver: gets the open session, or why it could not be opened, on another thread.

    Raises:
        zenoh.ZError: Zenoh does not accept the settings.
    """
    config = settings.to_zenoh()

    def open_session() -> None:
        try:
            opened = zenoh.open(config)
        except zenoh.ZError as error:
            deliver(error)
        else:
            deliver(opened)

    threading.Thread(target=open_session, daemon=True).start()


PATIENCE_S = 10.0
"""After this time without a router, and every so often, its absence is told."""


class Opening:
    """Of one session; Zenoh does not tell a router that is not there from one that refuses."""

    def __init__(self) -> None:
        self._came_to: SimpleQueue[zenoh.Session | zenoh.ZError | None] = SimpleQueue()

    def begin(self, settings: SessionSettings) -> None:
        """Open it in the background.

        Raises:
            zenoh.ZError: Zenoh does not accept the settings.
        """
        open_in_background(settings, self._came_to.put)

    def stop(self) -> None:
        """It is not wanted any more; may be called from any thread."""
        self._came_to.put(None)

    def wait(self, beat: Callable[[], object], tell_absence: Callable[[], object]) -> zenoh.Session | None:
        """What the opening has come to.

        Args:
            beat: called at least every ``BEAT_S``.
            tell_absence: called every ``PATIENCE_S``.

        Returns:
            None if it is not wanted any more.

        Raises:
            zenoh.ZError: Zenoh cannot use the endpoint.
        """
        told_s = time.monotonic()
        while True:
            beat()
            try:
                found = self._came_to.get(timeout=BEAT_S)
            except Empty:
                if time.monotonic() - told_s >= PATIENCE_S:
                    told_s += PATIENCE_S
                    tell_absence()
                continue
            if isinstance(found, zenoh.ZError):
                raise found
            return found
