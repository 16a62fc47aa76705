"""Where a robot's poses wait until it looks: only the newest counts."""

from collections.abc import Callable
from queue import Empty, SimpleQueue

from structlog.typing import FilteringBoundLogger

from chassis.process import BEAT_S
from protocol.codec import MessageError, OtherVersionError, decode
from protocol.messages import Observation


class Inbox:
    """Poses come in on any thread and are taken on one.

    Whatever is not newer than what has come before, such as a repetition, is dropped.

    Attributes:
        refused: how many poses were no valid messages.
    """

    def __init__(self, log: FilteringBoundLogger) -> None:
        self._log = log
        # None wakes whoever waits.
        self._payloads: SimpleQueue[bytes | None] = SimpleQueue()
        self._newest: Observation | None = None
        self._taken: Observation | None = None
        self._foreign: OtherVersionError | None = None
        self._closed = False
        self.refused = 0

    def store(self, payload: bytes) -> None:
        """A pose has come."""
        self._payloads.put(payload)

    def close(self) -> None:
        """No more poses are wanted."""
        self._closed = True
        self._payloads.put(None)

    def next(self, meanwhile: Callable[[], object] = lambda: None) -> Observation | OtherVersionError | None:
        """Wait for an observation newer than the last one taken, and take the newest; None once closed.

        What comes in another version of the protocol is told instead, where no newer observation is there.

        Args:
            meanwhile: called first, and at least every ``BEAT_S`` while nothing comes.
        """
        while not self._closed:
            meanwhile()
            if self.has_news():
                self._foreign = None
                self._taken = self._newest
                return self._taken
            if self._foreign is not None:
                foreign, self._foreign = self._foreign, None
                return foreign
            try:
                self._sort(self._payloads.get(timeout=BEAT_S))
            except Empty:
                continue
        return None

    def has_news(self) -> bool:
        """Whether an observation newer than the last one taken is there; does not wait."""
        for _ in range(self._payloads.qsize()):
            self._sort(self._payloads.get())
        return self._newest is not self._taken

    def _sort(self, payload: bytes | None) -> None:
        if payload is None:
            return
        try:
            observation = decode(Observation, payload)
        except MessageError as error:
            self.refused += 1
            self._log.warning("refused an observation", reason=str(error))
            if isinstance(error, OtherVersionError):
                self._foreign = error
            return
        newest = self._newest
        if newest is None or observation.epoch != newest.epoch or observation.step > newest.step:
            self._newest = observation
