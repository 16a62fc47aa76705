"""Where a process can be watched, and how it is asked there."""

import http.client
import os

HOST = "127.0.0.1"
"""Watching is for this machine: nothing there asks who somebody is."""
LIVE, READY, METRICS = "/live", "/ready", "/metrics"
VARIABLE = "UNSPOKEN_WATCH_PORT"
HELP = f"Port on {HOST} at which to tell over HTTP how this process is: {LIVE}, {READY}, {METRICS}."
PATIENCE_S = 3.0


class WatchPortError(Exception):
    """A watch port that cannot be used; the text says why and what to do."""


def port_told() -> int:
    """The port that the environment tells.

    Raises:
        WatchPortError: it tells none.
    """
    told = os.environ.get(VARIABLE, "")
    if told.isdecimal() and 0 < int(told) < 2**16:
        return int(told)
    raise WatchPortError(f"{VARIABLE} is {told!r}; the port at which the process can be watched is expected")


def ask(port: int, path: str) -> tuple[bool, str]:
    """Ask a process on this machine how it is.

    Args:
        port: its watch port.
        path: ``LIVE`` or ``READY``.

    Returns:
        Whether it says yes, and what it says.

    Raises:
        WatchPortError: nobody answers.
    """
    connection = http.client.HTTPConnection(HOST, port, timeout=PATIENCE_S)
    try:
        connection.request("GET", path)
        answer = connection.getresponse()
        return answer.status == http.client.OK, answer.read(1000).decode(errors="replace").strip()
    except (OSError, http.client.HTTPException) as error:
        raise WatchPortError(f"nobody answers at http://{HOST}:{port}{path}: {error}") from error
    finally:
        connection.close()
