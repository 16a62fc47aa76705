"""Makes the runs of an evaluation in parallel: on worker processes of this machine, or on a Dask cluster."""

import logging
import queue
import signal
import tempfile
import time
import traceback
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from functools import cache
from multiprocessing import resource_tracker
from pathlib import Path
from typing import TypeVar

import dask
from distributed import Client, Future, KilledWorker, LocalCluster

from agent.estimate import GoalsName
from agent.process.warm import compile_in_background, warm_up
from agent.solve import SolverName
from chassis.refusal import ExitStatus, Refusal
from fleet.evaluate.evaluation import Run
from fleet.evaluate.results import DIED, Row
from fleet.interruption import Interruption
from fleet.record.summary import Tally
from fleet.run.virtual import EPOCH, closed_loop
from protocol.messages import PublicScene

CONNECT_S = 10.0
"""How long to wait for a scheduler and for its first worker."""
LOOK_S = 0.1
"""How often a wait for a run looks whether it is still wanted."""
FETCH_S = 10.0
"""For one result. With less, Dask on a busy machine takes the time-out for an error of the run."""
ONE_AT_A_TIME = {"distributed.scheduler.worker-saturation": 1.0}
"""No run waits at a worker that is busy with another one, and is suspected when that one kills it."""
QUIET = logging.CRITICAL + 1
J = TypeVar("J")
R = TypeVar("R")


def execute(run: Run) -> Row:
    """Drive a scenario to its verdict in this process; an exception on the way becomes a failed row."""
    try:
        make_ready(run.key.method, run.key.solver)
        tally = Tally()
        tally.add(PublicScene(epoch=EPOCH, scene=run.scenario.scene(with_goals=False)))
        cpu_s, wall_s = time.thread_time(), time.perf_counter()
        for moment in closed_loop(run.scenario, run.facts, time.thread_time):
            tally.add(moment.truth)
            for decision in moment.decisions.values():
                tally.add(decision.mind)
        cpu_s, wall_s = time.thread_time() - cpu_s, time.perf_counter() - wall_s
        return Row.finished(run, tally.summary(run.facts), cpu_s, wall_s)
    except Exception as error:  # whatever it is, the other runs go on
        return Row.without_result(run, described(error))


@cache
def make_ready(goals: GoalsName, solver: SolverName) -> None:
    """Load all that robots need, once in a process, so that no run is charged with it."""
    compile_in_background(unwanted=lambda: False)
    warm_up(goals, solver)


def described(error: Exception) -> str:
    """What went wrong, and where."""
    place = traceback.extract_tb(error.__traceback__)[-1]
    return f"{type(error).__name__}: {error} ({Path(place.filename).name}:{place.lineno})"


@contextmanager
def local_cluster(workers: int) -> Iterator[Client]:
    """Worker processes of one thread each, which talk over loopback and end with the block."""
    with (
        dask.config.set(ONE_AT_A_TIME),
        tempfile.TemporaryDirectory(prefix="unspoken-evaluation-") as directory,
    ):
        with _signals_kept_from_children():
            cluster = LocalCluster(
                n_workers=workers,
                threads_per_worker=1,
                processes=True,
                host="127.0.0.1",
                dashboard_address="127.0.0.1:0",  # none at all would take the usual port, or warn
                memory_limit=0,
                local_directory=directory,
                silence_logs=QUIET,
            )
        with cluster, Client(cluster) as client:
            yield client


@contextmanager
def existing_cluster(address: str) -> Iterator[Client]:
    """A cluster that somebody else has started, and that stays.

    Raises:
        Refusal: no scheduler answers there, or it has no workers.
    """
    for name in ("distributed", "distributed.client"):  # the latter has a level of its own
        logging.getLogger(name).setLevel(QUIET)
    try:
        client = Client(address, timeout=CONNECT_S, set_as_default=False)
    except (OSError, ValueError) as error:
        raise Refusal(
            f"no Dask scheduler answers at {address}: {error}; the address that `dask scheduler` prints at "
            "its start is expected in --dask, such as tcp://127.0.0.1:8786"
        ) from None
    with client:
        try:
            client.wait_for_workers(1, timeout=CONNECT_S)
        except TimeoutError:
            raise Refusal(
                f"the Dask scheduler at {address} has no workers; start some with `dask worker {address} "
                "--nthreads 1`, where the same version of unspoken is installed"
            ) from None
        yield client


def outcomes(
    client: Client,
    jobs: Iterable[J],
    make: Callable[[J], R],
    without_result: Callable[[J, str], R],
    interruption: Interruption,
) -> Iterator[R]:
    """What comes of these jobs, in the order in which they are finished.

    A worker does ``make`` of a job. A job whose worker dies is done again elsewhere; after some times, Dask
    gives it up, and what comes of it is ``without_result`` of the job and the reason.

    Raises:
        KeyboardInterrupt: an interruption came.
        Refusal: the cluster has gone, or has dropped the jobs.
    """
    jobs_by_future = {client.submit(make, job, pure=False): job for job in jobs}
    finished: queue.SimpleQueue[Future[R]] = queue.SimpleQueue()
    for future in jobs_by_future:
        future.add_done_callback(finished.put)
    try:
        while jobs_by_future:
            if interruption.requested:
                raise KeyboardInterrupt
            if client.status != "running":
                raise Refusal("the Dask cluster has gone", ExitStatus.FAILED)
            try:
                future = finished.get(timeout=LOOK_S)
            except queue.Empty:
                continue
            try:
                outcome = _outcome(future, jobs_by_future[future], without_result)
            except TimeoutError:  # it has to be fetched or, its worker having died, done again
                finished.put(future)
            else:
                del jobs_by_future[future]
                yield outcome
    finally:
        if client.status == "running":
            client.cancel(list(jobs_by_future))


def _outcome(future: "Future[R]", job: J, without_result: Callable[[J, str], R]) -> R:
    if future.cancelled():
        raise Refusal("the Dask cluster has dropped the runs", ExitStatus.FAILED)
    try:
        return future.result(timeout=FETCH_S)
    except TimeoutError:
        raise
    except KilledWorker:
        return without_result(job, DIED)
    except Exception as error:  # such as one from a worker that lacks this software
        return without_result(job, f"on the worker: {type(error).__name__}: {error}")


@contextmanager
def _signals_kept_from_children() -> Iterator[None]:
    """Processes begun meanwhile never get Ctrl-C, which a terminal sends to all: this one ends them.

    Nor do the threads begun meanwhile, and the processes that these begin later.
    """
    resource_tracker.ensure_running()  # otherwise it begins later, and then lets these signals through again
    former = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT, signal.SIGHUP})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, former)
