"""Listens to a run as its bench does, and says nothing."""

import socket
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from queue import Empty, SimpleQueue
from typing import Final

import zenoh

from chassis.refusal import ExitStatus, Refusal
from fleet.interruption import Interruption
from fleet.record.recording import BusMessage
from fleet.run.launch import Address
from fleet.run.listening import Decoder, Mailbox, Received
from fleet.status.standing import Standing, Status
from protocol.codec import MessageError
from protocol.identity import Identity
from protocol.keys import Keys
from protocol.session import Opening, client_session, reason_of

POLL_S: Final = 0.1
CONNECT_S: Final = 5.0
"""For the world to let us in, and to answer."""
REFRESH_S: Final = 0.5
ONCE_S: Final = 2.0
"""Time to listen before a single look: times and rates are of what came."""
LAST_WORDS_S: Final = 1.0
"""Time for the verdict of a run that, as is known otherwise, has ended."""

GoesOn = Callable[[Status], bool]
"""Whether, as far as is known otherwise, the run goes on; asked at every look."""


class Listener:
    """One run, as far as it is heard in a session with its world."""

    def __init__(self, session: zenoh.Session, run: str, interruption: Interruption) -> None:
        self._standing = Standing(run)
        self._interruption = interruption
        self._session = session
        self._keys = Keys(run)
        self._decoder = Decoder(self._keys)
        self._mailbox = Mailbox(self._keys, time.monotonic_ns)
        self._presence: SimpleQueue[tuple[str, bool]] = SimpleQueue()
        # The literal key of all: robots know of this one reader only, and publish their minds for it.
        self._declared = (
            session.declare_subscriber(self._keys.everything, self._mailbox.put),
            session.liveliness().declare_subscriber(
                self._keys.everyone_alive, self._store_presence, history=True
            ),
        )

    def ask_for_scene(self) -> bool:
        """Take in the scene; whether the world has answered."""
        if (received := self._mailbox.ask_for_scene(self._session)) is not None:
            self._take(received)
        return received is not None

    def look(self) -> Status:
        """One look, after some listening."""
        until_s = time.monotonic() + ONCE_S
        while time.monotonic() < until_s and not self._is_over():
            self._listen(min(until_s, time.monotonic() + REFRESH_S))
        return self._standing.status(time.monotonic())

    def follow(self, goes_on: GoesOn, show: Callable[[Status], None]) -> bool:
        """Show the run until its verdict, or until an interruption.

        Returns:
            False where the run has ended without a verdict.
        """
        while True:
            self._listen(time.monotonic() + REFRESH_S)
            status = self._standing.status(time.monotonic())
            ended = not goes_on(status)
            if ended:
                self._listen(time.monotonic() + LAST_WORDS_S)
                status = self._standing.status(time.monotonic())
            show(status)
            if ended or self._is_over():
                return self._is_over()

    def _is_over(self) -> bool:
        return self._interruption.requested or self._standing.verdict is not None

    def _listen(self, until_s: float) -> None:
        """Take in what comes until a time of the monotonic clock, or until the verdict."""
        while self._standing.verdict is None and (remaining_s := until_s - time.monotonic()) > 0.0:
            while not self._presence.empty():
                robot, present = self._presence.get()
                self._standing.stands(robot, present=present)
            try:
                self._take(self._mailbox.get(min(remaining_s, POLL_S)))
            except Empty:
                continue

    def _take(self, received: Received) -> None:
        if self._keys.kind_of(received.key) == "pose":  # which says nothing about how anybody is
            return
        try:
            item = self._decoder.take(received)
        except (MessageError, KeyError):  # the bench reports it; here it changes nothing
            return
        if isinstance(item, BusMessage):
            self._standing.take(item.message, item.time_ns / 1e9)

    def _store_presence(self, sample: zenoh.Sample) -> None:
        robot = self._keys.robot_of(str(sample.key_expr))
        self._presence.put((robot, sample.kind == zenoh.SampleKind.PUT))


@contextmanager
def listening(address: Address, identity: Identity, interruption: Interruption) -> Iterator[Listener]:
    """Listen to a run for as long as the block lasts.

    Raises:
        Refusal: the world is not there, refuses us, or does not know the run.
        KeyboardInterrupt: an interruption came first.
    """

    def look() -> None:
        if interruption.requested:
            raise KeyboardInterrupt

    endpoint, opening = address.endpoint, Opening()
    try:
        opening.begin(client_session(endpoint, identity, CONNECT_S))
    except zenoh.ZError as error:
        sentence = f"the endpoint {endpoint} cannot be used: {reason_of(error)}"
        raise Refusal(sentence, ExitStatus.FAILED) from error
    try:
        session = opening.wait(look, every_s=POLL_S)
    except zenoh.ZError as error:  # a world that is not there, or one that refuses: Zenoh does not say which
        sentence = f"there is no world at {endpoint}"
        if is_listened_at(endpoint):
            sentence = (
                f"the world at {endpoint} refuses us: the bench's password, in --password-file, or its keys, "
                "in --keys, are expected"
            )
        raise Refusal(sentence, ExitStatus.FAILED) from error
    assert session is not None, "nobody stops this opening"
    with session:
        listener = Listener(session, address.run, interruption)
        give_up_s = time.monotonic() + CONNECT_S
        while not listener.ask_for_scene():
            look()
            if time.monotonic() > give_up_s:
                raise Refusal(
                    f"the world at {endpoint} does not answer for a run {address.run!r}: either its run has "
                    "another name, to be given in --run, or the password or keys are not the bench's",
                    ExitStatus.FAILED,
                )
            time.sleep(POLL_S)
        yield listener


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
