"""One robot: it sees poses, infers goals, predicts everybody, plans and drives (algorithm 1).

The thinking is the pure core ``Agent.decide``; ``python -m agent`` wraps it in a Zenoh session.
"""

import os

# One thread a process: robots share few cores, and the order of a sum must not depend on how many there are.
os.environ.setdefault("OMP_NUM_THREADS", "1")


def main() -> None:
    """The command ``unspoken`` of a device; its imports take a second, in which Ctrl-C is answered, too."""
    try:
        from agent.cli import app

        app()
    except KeyboardInterrupt:
        raise SystemExit(1) from None
