"""Listens to a run as its bench does, and says nothing."""

import socket
import time
from collections.abc import Iterator
from contextlib import contextmanager
from queue import Empty, SimpleQueue
from typing import Final

import zenoh

from fleet.interruption import Interruption
from fleet.record.stream import BusMessage
from fleet.run.listening import Decoder, Mailbox, Received
from fleet.status.standing import Standing
from protocol.codec import MessageError
from protocol.identity import Identity
from protocol.keys import Keys
from protocol.session import Opening, client_session, reason_of

LOOK_S: Final = 0.1
CONNECT_S: Final = 5.0
"""For the world to let us in, and to answer."""
SCENE_TIMEOUT_S: Final = 1.0


class UnreachableError(Exception):
    """The world of a run cannot be listened to; the text says why and what to do."""


class Listener:
    """One run, as far as it is heard.

    Args:
        session: with the world.
        run: its name.
    """

    def __init__(self, session: zenoh.Session, run: str) -> None:
        self.standing = Standing(run)
        self._session = session
        self._keys = Keys(run)
        self._decoder = Decoder(self._keys)
        self._mailbox = Mailbox()
        self._presence: SimpleQueue[tuple[str, bool]] = SimpleQueue()
        # The literal key of all: robots are told of this one reader only, and say their minds for it.
        self._declared = (
            session.declare_subscriber(self._keys.everything, self._store),
            session.liveliness().declare_subscriber(
                self._keys.everyone_alive, self._store_presence, history=True
            ),
        )

    def ask_for_scene(self) -> bool:
        """Take in the scene; whether the world has answered."""
        for reply in self._session.get(self._keys.scene, timeout=SCENE_TIMEOUT_S):
            if reply.ok is not None:
                self._take(Received(self._keys.scene, reply.ok.payload.to_bytes(), time.monotonic_ns()))
                return True
        return False

    def listen(self, until_s: float) -> None:
        """Take in what comes until a time of the monotonic clock, or until the verdict."""
        while self.standing.verdict is None and (remaining_s := until_s - time.monotonic()) > 0.0:
            while not self._presence.empty():
                robot, present = self._presence.get()
                self.standing.stands(robot, present=present)
            try:
                self._take(self._mailbox.get(min(remaining_s, LOOK_S)))
            except Empty:
                continue

    def _take(self, letter: Received) -> None:
        try:
            item = self._decoder.take(letter)
        except (MessageError, KeyError):  # the bench tells of it; here it changes nothing
            return
        if isinstance(item, BusMessage):
            self.standing.take(item.message, item.time_ns / 1e9)

    def _store(self, sample: zenoh.Sample) -> None:
        key = str(sample.key_expr)
        kind = self._keys.kind_of(key)
        if kind != "pose":
            sender = self._keys.robot_of(key) if kind in ("command", "mind") else None
            self._mailbox.put(sender, Received(key, sample.payload.to_bytes(), time.monotonic_ns()))

    def _store_presence(self, sample: zenoh.Sample) -> None:
        robot = self._keys.robot_of(str(sample.key_expr))
        self._presence.put((robot, sample.kind == zenoh.SampleKind.PUT))


@contextmanager
def listening(endpoint: str, identity: Identity, run: str, interruption: Interruption) -> Iterator[Listener]:
    """Listen to a run for as long as the block lasts.

    Raises:
        UnreachableError: the world is not there, refuses us, or does not know the run.
        KeyboardInterrupt: an interruption came first.
    """
    with _connected(endpoint, identity, interruption) as session:
        listener = Listener(session, run)
        give_up_s = time.monotonic() + CONNECT_S
        while not listener.ask_for_scene():
            if interruption.requested:
                raise KeyboardInterrupt
            if time.monotonic() > give_up_s:
                raise UnreachableError(
                    f"the world at {endpoint} does not tell of a run {run!r}: it has another name, which is "
                    "expected in --run, or what was given does not prove the bench's name"
                )
            time.sleep(LOOK_S)
        yield listener


def _connected(endpoint: str, identity: Identity, interruption: Interruption) -> zenoh.Session:
    def look() -> None:
        if interruption.requested:
            raise KeyboardInterrupt

    opening = Opening()
    try:
        opening.begin(client_session(endpoint, identity, CONNECT_S))
    except zenoh.ZError as error:
        raise UnreachableError(f"the endpoint {endpoint} cannot be used: {reason_of(error)}") from error
    try:
        session = opening.wait(look, every_s=LOOK_S)
    except zenoh.ZError as error:
        raise UnreachableError(_why_unreachable(endpoint)) from error
    assert session is not None, "nobody stops this opening"
    return session


def _why_unreachable(endpoint: str) -> str:
    """Zenoh does not tell a world that is not there from one that refuses; whether anybody listens does."""
    if not is_listened_at(endpoint):
        return f"there is no world at {endpoint}"
    return (
        f"the world at {endpoint} refuses us: the bench's password, in --password-file, or its keys, in "
        "--keys, are expected"
    )


def is_listened_at(endpoint: str) -> bool:
    """Whether anybody accepts connections there, whoever that is."""
    kind, _, place = endpoint.partition("/")
    try:
        if kind == "unixsock-stream":
            with socket.socket(socket.AF_UNIX) as probe:
                probe.connect(place)
        else:
            host, _, port = place.rpartition(":")
            socket.create_connection((host.strip("[]"), int(port)), timeout=CONNECT_S).close()
    except (OSError, ValueError):
        return False
    return True
