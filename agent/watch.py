"""Whether and where this process can be watched."""

from contextlib import AbstractContextManager, nullcontext

from agent.health import RobotHealth


def watched(health: RobotHealth, port: int | None) -> AbstractContextManager[object]:
    """Let the process be watched at this port; None: nobody watches.

    Raises:
        WatchPortError: on entry, the port cannot be used.
    """
    if port is None:
        return nullcontext()
    # Imported for those only that are watched: it takes 0.1 s.
    from agent.metrics import RobotMetrics
    from protocol.watching import watch_port

    return watch_port(RobotMetrics(health), port)
