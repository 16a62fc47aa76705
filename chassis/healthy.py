"""``python -m chassis.healthy [ready|live]``: asks the process of this environment how it is.

For the health checks of containers, which have no other tool for it. The port is that of
``UNSPOKEN_WATCH_PORT``. Exit status: 0 it is, 1 it is not, or nobody answers; 2 invalid usage.
"""

import http.client
import os
import sys

HOST = "127.0.0.1"
"""Watching is for this machine: nothing there asks who somebody is."""
LIVE, READY, METRICS = "/live", "/ready", "/metrics"
VARIABLE = "UNSPOKEN_WATCH_PORT"
HELP = f"HTTP port on {HOST} for health checks and metrics: {LIVE}, {READY}, {METRICS}."
PATIENCE_S = 3.0


def ask(port: str, path: str) -> tuple[bool, str]:
    """Ask a process on this machine how it is.

    Returns:
        Whether it answers yes, and its answer, or why there is none.
    """
    if not (port.isdecimal() and 0 < int(port) < 2**16):
        return False, f"{VARIABLE} is {port!r}; the port at which the process can be watched is expected"
    connection = http.client.HTTPConnection(HOST, int(port), timeout=PATIENCE_S)
    try:
        connection.request("GET", path)
        answer = connection.getresponse()
        return answer.status == http.client.OK, answer.read(1000).decode(errors="replace").strip()
    except (OSError, http.client.HTTPException) as error:
        return False, f"nobody answers at http://{HOST}:{port}{path}: {error}"
    finally:
        connection.close()


def main(arguments: list[str]) -> int:
    """Ask, print the answer, and return the exit status."""
    what = arguments[0] if arguments else "ready"
    if len(arguments) > 1 or what not in ("ready", "live"):
        print(f"{' '.join(arguments)!r} found, nothing, ready or live is expected", file=sys.stderr)
        return 2
    yes, answer = ask(os.environ.get(VARIABLE, ""), f"/{what}")
    print(answer)
    return 0 if yes else 1


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
