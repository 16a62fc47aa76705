"""Names of exit statuses that some rooms still use; see :class:`chassis.refusal.ExitStatus`."""

from enum import IntEnum


class ExitStatus(IntEnum):
    """How a world ends, and with it a run."""

    ARRIVED = 0
    ENDED_OTHERWISE = 1
    WRONG_USAGE = 2
    FAILED = 3
