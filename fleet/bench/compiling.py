"""How long compiling takes from nothing, and loading what has been compiled, on one core."""

import os
import resource
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterable, Iterator

from rich.table import Table

from fleet.bench.settings import Settings
from fleet.bench.watch import Watch
from fleet.record.report_file import Record
from fleet.record.tables import new_table, number
from fleet.run.processes import ProcessFailedError

LOOK_S = 0.2
WARM_UP = """
import os
if hasattr(os, "sched_setaffinity"):
    os.sched_setaffinity(0, {min(os.sched_getaffinity(0))})
from agent.process.robot.warm import warm_up
warm_up('ioc', 'realtime')
"""


class CompilingRow(Record):
    """One process that makes all kernels ready and ends, its start included."""

    cache: str
    """``empty``, or ``full`` where another process has compiled before."""
    cpu_s: float
    wall_s: float


def measure(settings: Settings, watch: Watch) -> Iterator[CompilingRow]:
    """With a cache directory of its own, first empty and then full."""
    with tempfile.TemporaryDirectory(prefix="unspoken-bench-") as directory:
        for cache in ("empty", "full"):
            yield _row(cache, directory, watch)


def _row(cache: str, directory: str, watch: Watch) -> CompilingRow:
    before_s, begin_s = _children_cpu_s(), time.perf_counter()
    process = subprocess.Popen(
        [sys.executable, "-P", "-c", WARM_UP],
        env={**os.environ, "NUMBA_CACHE_DIR": directory},
        stdin=subprocess.DEVNULL,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.PIPE,
        start_new_session=True,  # Ctrl-C reaches the bench only
    )
    with process:
        try:
            while process.poll() is None:
                watch.tell(f"compiling with {cache} cache: {time.perf_counter() - begin_s:.0f} s")
                _wait(process)
        finally:
            process.kill()
        said = process.stderr.read().decode(errors="replace") if process.stderr else ""
    if process.returncode:
        raise ProcessFailedError(f"compiling ended with exit status {process.returncode}:\n{said}")
    return CompilingRow(cache=cache, cpu_s=_children_cpu_s() - before_s, wall_s=time.perf_counter() - begin_s)


def _wait(process: subprocess.Popen[bytes]) -> None:
    try:
        process.wait(LOOK_S)
    except subprocess.TimeoutExpired:
        return


def _children_cpu_s() -> float:
    """CPU time of all our children that have ended."""
    usage = resource.getrusage(resource.RUSAGE_CHILDREN)
    return usage.ru_utime + usage.ru_stime


def table(rows: Iterable[CompilingRow]) -> Table:
    """One row a state of the cache."""
    result = new_table("Making all kernels ready, one core", "Cache", "CPU s", "Wall s")
    for row in rows:
        result.add_row(row.cache, number(row.cpu_s), number(row.wall_s))
    return result
