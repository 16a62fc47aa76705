"""Where the bench's messages wait until it takes them."""

import threading
from collections import Counter
from queue import SimpleQueue
from typing import NamedTuple

MOST_WAITING_BYTES = 8 * 1024 * 1024
"""Of one robot's messages: hundreds of steps. A robot that says more than the bench takes loses its own."""
OVERHEAD_BYTES = 512
"""What a message takes beside its payload, so that empty ones count too."""


class Letter(NamedTuple):
    """A message as it came."""

    key: str
    payload: bytes
    time_ns: int


class Mailbox:
    """Messages come in on any thread and are taken on one, in their order.

    What the world says is never lost. Of each robot's messages a bounded amount waits.
    """

    def __init__(self) -> None:
        self._letters: SimpleQueue[tuple[str | None, Letter]] = SimpleQueue()
        self._lock = threading.Lock()
        self._waiting_bytes: Counter[str] = Counter()
        self._lost: Counter[str] = Counter()

    @property
    def lost(self) -> dict[str, int]:
        """How many messages found no room, by robot."""
        with self._lock:
            return dict(self._lost)

    def put(self, sender: str | None, letter: Letter) -> None:
        """A message has come; None: from the world."""
        if sender is not None:
            with self._lock:
                if self._waiting_bytes[sender] > MOST_WAITING_BYTES:
                    self._lost[sender] += 1
                    return
                self._waiting_bytes[sender] += _size(letter)
        self._letters.put((sender, letter))

    def get(self, timeout_s: float) -> Letter:
        """Wait for the next message.

        Raises:
            Empty: none came in time.
        """
        sender, letter = self._letters.get(timeout=timeout_s)
        if sender is not None:
            with self._lock:
                self._waiting_bytes[sender] -= _size(letter)
        return letter

    def empty(self) -> bool:
        """Whether nothing waits."""
        return self._letters.empty()


def _size(letter: Letter) -> int:
    return len(letter.payload) + OVERHEAD_BYTES
