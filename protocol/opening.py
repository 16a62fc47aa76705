"""A client's session that is waited for, with signs of life and within reach of a wish to end."""

import time
from collections.abc import Callable
from queue import Empty, SimpleQueue

import zenoh

from protocol.session import SessionSettings, open_in_background
from protocol.vital_signs import BEAT_S

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
