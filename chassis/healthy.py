"""``python -m chassis.healthy [ready|live]``: asks the process of this environment how it is.

For the health checks of containers, which have no other tool for it. The port is that of
``UNSPOKEN_WATCH_PORT``. Exit status: 0 it is, 1 it is not, told in a line; 2 wrong usage.
"""

import sys

from chassis.watching import LIVE, READY, WatchPortError, ask, port_told

PATHS = {"ready": READY, "live": LIVE}


def main(arguments: list[str]) -> int:
    """Ask, tell the answer, and return the exit status."""
    what = arguments[0] if arguments else "ready"
    if len(arguments) > 1 or what not in PATHS:
        print(f"{' '.join(arguments)!r} found, nothing, ready or live is expected", file=sys.stderr)
        return 2
    try:
        is_so, said = ask(port_told(), PATHS[what])
    except WatchPortError as error:
        is_so, said = False, str(error)
    print(said)
    return 0 if is_so else 1


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
