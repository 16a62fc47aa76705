"""Where the log lines of a process go, and in which form."""

import os
import sys
from collections.abc import Mapping

import structlog
from structlog.typing import EventDict, WrappedLogger

PRIORITIES: Mapping[str, int] = {"debug": 7, "info": 6, "warning": 4, "error": 3, "critical": 2}
"""Of the journal, by the level of a line."""
STDERR = 2


def log_to_journal() -> None:
    """Under systemd's journal, write a line as ``<4>event="…" key=value …``, which keeps its priority.

    Whatever a value holds, it stays one line. Elsewhere lines stay as they are, for a terminal.
    """
    if not is_journal(STDERR):
        return
    structlog.configure(
        processors=[
            structlog.contextvars.merge_contextvars,
            structlog.processors.add_log_level,
            structlog.processors.format_exc_info,
            structlog.processors.LogfmtRenderer(key_order=["event"]),
            _with_priority,
        ],
        logger_factory=structlog.WriteLoggerFactory(sys.stderr),
        cache_logger_on_first_use=False,
    )


def is_journal(descriptor: int, environment: Mapping[str, str] = os.environ) -> bool:
    """Whether a stream of this process goes to the journal, as ``JOURNAL_STREAM`` says of it."""
    told = environment.get("JOURNAL_STREAM")
    if told is None:
        return False
    stream = os.fstat(descriptor)
    return told == f"{stream.st_dev}:{stream.st_ino}"


def _with_priority(_logger: WrappedLogger, name: str, line: EventDict | str) -> str:
    return f"<{PRIORITIES.get(name, PRIORITIES['info'])}>{line}"
