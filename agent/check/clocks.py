"""Whether the clocks of a device can be relied on: keys have a time, and decisions a deadline."""

import ctypes
import time
from collections.abc import Callable
from datetime import UTC, datetime
from pathlib import Path

from agent.check.findings import Finding
from protocol.device_keys import date_text

WALL, STEADY = "clock", "steady clock"
PAUSE_S = 0.05
"""In which the steady clock has to advance by about as much."""
MOST_S = 5.0
"""A busy device may wake up late."""
_TIMEX_BYTES = 512
"""More than the kernel's struct timex has anywhere."""
_TIME_ERROR = 5
"""What adjtimex returns as long as nobody keeps the clock right."""


def is_synchronised() -> bool | None:
    """Whether the kernel holds the clock for synchronised; None where it does not tell, as outside Linux."""
    adjtimex = getattr(ctypes.CDLL(None), "adjtimex", None)
    if adjtimex is None:
        return None
    state = adjtimex(ctypes.create_string_buffer(_TIMEX_BYTES))  # all zero: it asks, and sets nothing
    return None if state < 0 else state != _TIME_ERROR


def installed_at() -> datetime:
    """When the software came to this device, as its files tell."""
    return datetime.fromtimestamp(Path(__file__).stat().st_mtime, UTC)


def check_wall_clock(now: datetime, installed: datetime, synchronised: bool | None) -> Finding:
    """Whether the time of day can be right.

    Args:
        now: as the device has it.
        installed: it cannot be earlier than that.
        synchronised: as the kernel has it.
    """
    if now < installed:
        return Finding(
            WALL,
            "failed",
            f"it says {date_text(now)}, which is before this software was installed ({date_text(installed)})",
            "set the clock",
        )
    if synchronised is False:
        return Finding(
            WALL,
            "warning",
            f"it says {date_text(now)}, and nothing keeps it right",
            "let a time service run, such as chrony or systemd-timesyncd: keys are not valid at a wrong time",
        )
    how = "as the kernel says" if synchronised else "and the kernel does not tell whether it is kept right"
    state = "synchronised, " if synchronised else ""
    return Finding(WALL, "ok", f"{state}it says {date_text(now)}, {how}")


def check_steady_clock(
    now_s: Callable[[], float] = time.perf_counter, pause: Callable[[float], None] = time.sleep
) -> Finding:
    """Whether the clock that times decisions advances."""
    begin_s = now_s()
    pause(PAUSE_S)
    passed_s = now_s() - begin_s
    text = f"{1000.0 * passed_s:.0f} ms passed in a pause of {1000.0 * PAUSE_S:.0f} ms"
    if 0.9 * PAUSE_S <= passed_s <= MOST_S:
        return Finding(STEADY, "ok", text)
    return Finding(
        STEADY, "failed", text, "decisions cannot be timed; look at the clock source of this device"
    )
