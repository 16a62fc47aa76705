"""Sessions of Zenoh: their settings, the two qualities of service, and how one is waited for."""

import json
import os
import re
import threading
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from queue import Empty, SimpleQueue
from typing import Any, Final, TypedDict

import zenoh

from chassis.process import BEAT_S
from protocol.identity import AUTHORITY_FILE, CERTIFICATE_FILE, KEY_FILE, DeviceKeys, Identity, Login
from protocol.policy import AccessControl

LEASE_MS = 1000
"""Silence after which a peer counts as gone: a stopped process is noticed within about a second."""
MAX_MESSAGE_BYTES = 256 * 1024 + 1024
"""The largest payload of the codec and its key."""
MOST_SESSIONS = 1000


class Quality(TypedDict, total=False):
    """Of a publication: ``session.put(key, payload, **NEVER_DROP)``, and so for a publisher."""

    congestion_control: zenoh.CongestionControl
    priority: zenoh.Priority


LATEST_WINS: Final[Quality] = {
    "congestion_control": zenoh.CongestionControl.DROP,
    "priority": zenoh.Priority.REAL_TIME,
}
"""Of what the next one replaces, such as a pose: a slow reader holds nobody up."""
NEVER_DROP: Final[Quality] = {"congestion_control": zenoh.CongestionControl.BLOCK}
"""Of what each one counts, such as a command: a slow reader is waited for."""


@dataclass(frozen=True)
class SessionSettings:
    """One process's session, as Zenoh's own configuration; its representation shows no password."""

    config: Mapping[str, Any] = field(repr=False)

    def to_zenoh(self) -> zenoh.Config:
        """Zenoh's own object.

        Raises:
            zenoh.ZError: Zenoh does not accept an endpoint.
        """
        return zenoh.Config.from_json5(json.dumps(self.config))


def world_session(
    listen: str,
    access: AccessControl | None = None,
    proof: Path | DeviceKeys | None = None,
    most_sessions: int = MOST_SESSIONS,
) -> SessionSettings:
    """The world: a router that accepts connections at an endpoint such as ``tcp/127.0.0.1:7447``.

    Args:
        listen: that endpoint.
        access: who may do what; None: everybody everything.
        proof: how names are proven: file of names and passwords, or the world's own keys; None: not at all.
        most_sessions: how many may be connected at a time.
    """
    passwords = {"dictionary_file": str(proof)} if isinstance(proof, Path) else None
    config = {
        "mode": "router",
        "listen": {"endpoints": [listen]},
        "connect": {"endpoints": []},
        "transport": _transport("listen", proof, passwords, most_sessions),
        "scouting": _NO_SCOUTING,
    }
    if access is not None:
        config["access_control"] = access.model_dump(exclude_none=True)
    return SessionSettings(config)


def client_session(
    connect: str, identity: Identity = None, patience_s: float | None = None
) -> SessionSettings:
    """A robot or the bench: a client of the world at this endpoint.

    Args:
        connect: that endpoint.
        identity: what proves who this is.
        patience_s: after which it gives up on a world that is not there or does not let it in; None: never.
    """
    login = identity if isinstance(identity, Login) else None
    passwords = {"user": login.user, "password": login.password} if login else None
    return SessionSettings(
        {
            "mode": "client",
            "listen": {"endpoints": []},
            "connect": {
                "endpoints": [connect],
                "timeout_ms": -1 if patience_s is None else round(1000.0 * patience_s),
                "exit_on_failure": patience_s is not None,
                "retry": {"period_init_ms": 100, "period_max_ms": 500, "period_increase_factor": 1.5},
            },
            "transport": _transport("connect", identity, passwords),
            "scouting": _NO_SCOUTING,
        }
    )


_NO_SCOUTING: Final = {"delay": 0, "multicast": {"enabled": False}, "gossip": {"enabled": False}}
"""No discovery; no wait for it at the opening."""


def _transport(
    side: str, proof: object, passwords: Mapping[str, str] | None, most_sessions: int = MOST_SESSIONS
) -> dict[str, Any]:
    """Connections, with the keys or passwords that prove names; the side is ``listen`` or ``connect``."""
    link: dict[str, Any] = {
        # Eight robots say a batch of 64 KiB a step; 16 that wait for a slow reader are the most. Zenoh's own
        # number is two, which loses messages as soon as a recorder pauses.
        "tx": {"lease": LEASE_MS, "queue": {"size": {"real_time": 16, "data": 16}}},
        "rx": {"max_message_size": MAX_MESSAGE_BYTES},
    }
    if isinstance(proof, DeviceKeys):
        link["protocols"] = ["tls"]
        link["tls"] = {
            "root_ca_certificate": str(proof.folder / AUTHORITY_FILE),
            f"{side}_certificate": str(proof.folder / CERTIFICATE_FILE),
            f"{side}_private_key": str(proof.folder / KEY_FILE),
            "enable_mtls": True,
            "verify_name_on_connect": True,
            "close_link_on_expiration": True,
        }
    transport: dict[str, Any] = {
        # Idle sockets may not keep newcomers out, and an answer that never comes may not stop a reconnection.
        "unicast": {
            "open_timeout": 1000,
            "accept_timeout": 1000,
            "accept_pending": 1000,
            "max_sessions": most_sessions,
        },
        "link": link,
        "shared_memory": {"enabled": False},  # it would bypass the size limit
    }
    return transport | ({"auth": {"usrpwd": passwords}} if passwords else {})


def receive_on_threads(count: int) -> None:
    """Let this process receive from so many connections at once; to be called before the first session.

    Zenoh has two such threads. Two robots whose messages wait to be taken would hold up all the others.
    Zenoh reads this from the environment and nowhere else.
    """
    os.environ["ZENOH_RUNTIME"] = f"(rx: (worker_threads: {count}))"


def reason_of(error: zenoh.ZError) -> str:
    """What Zenoh complains about, without the places in its own source."""
    return re.sub(r" at /\S+?\.rs:\d+\.?", "", str(error))


PATIENCE_S = 10.0
"""After this time without a router, and every so often, its absence is told."""


class Opening:
    """The opening of one session; Zenoh does not tell a router that is not there from one that refuses."""

    def __init__(self) -> None:
        self._came_to: SimpleQueue[zenoh.Session | zenoh.ZError | None] = SimpleQueue()

    def begin(self, settings: SessionSettings) -> None:
        """Open it in the background: a client's opening waits for its world and lets no signal through.

        Raises:
            zenoh.ZError: Zenoh does not accept the settings.
        """
        config = settings.to_zenoh()

        def open_session() -> None:
            try:
                self._came_to.put(zenoh.open(config))
            except zenoh.ZError as error:
                self._came_to.put(error)

        threading.Thread(target=open_session, daemon=True).start()

    def stop(self) -> None:
        """It is not wanted any more; may be called from any thread."""
        self._came_to.put(None)

    def wait(
        self,
        beat: Callable[[], object],
        tell_absence: Callable[[], object] = lambda: None,
        every_s: float = BEAT_S,
    ) -> zenoh.Session | None:
        """The session, once it is open.

        Args:
            beat: called again and again meanwhile; what it raises ends the waiting.
            tell_absence: called every ``PATIENCE_S``.
            every_s: the longest time between two beats.

        Returns:
            None if it is not wanted any more.

        Raises:
            zenoh.ZError: Zenoh cannot use the endpoint.
        """
        told_s = time.monotonic()
        while True:
            beat()
            try:
                found = self._came_to.get(timeout=every_s)
            except Empty:
                if time.monotonic() - told_s >= PATIENCE_S:
                    told_s += PATIENCE_S
                    tell_absence()
                continue
            if isinstance(found, zenoh.ZError):
                raise found
            return found
