"""Sections of real processes: runs of a scenario, the start of agents, and the compiling of the kernels."""

import os
import resource
import subprocess
import sys
import time
from collections.abc import Iterable, Iterator
from contextlib import closing, suppress
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import NamedTuple, Self

import psutil
import zenoh

from agent.process.options import DecisionOptions
from agent.process.warm import warm_up
from chassis.refusal import ExitStatus, Refusal
from fleet.bench.bus import RUN, await_robots
from fleet.bench.decisions import BUNDLED
from fleet.bench.loops import circle
from fleet.bench.measuring import Cell, Progress, Row, Settings
from fleet.record.experiment import Experiment, prepare
from fleet.record.recording import BusMessage
from fleet.record.report import MIB
from fleet.record.summary import Tally
from fleet.run.launch import run_processes
from fleet.run.processes import Processes
from protocol.keys import Keys
from protocol.messages import PublicScene, Truth
from protocol.session import world_session
from world.bus import Bus, Inbox
from world.clock import ClockKind

LOOK_STEPS = 10
"""The agents' memory is looked at every so many steps."""
TOGETHER = 8
"""Agents that are started at once, unless fewer robots are wanted."""
LOOK_S = 0.2
WARM_UP = f"""
import os
if hasattr(os, "sched_setaffinity"):
    os.sched_setaffinity(0, {{min(os.sched_getaffinity(0))}})
from {warm_up.__module__} import warm_up
warm_up("ioc", "realtime")
"""


class Usage(NamedTuple):
    """What a process has used so far."""

    resident_mib: float
    cpu_s: float


def agents_usage() -> list[Usage]:
    """That of each process ``python -m agent`` among our children."""
    usages = []
    for child in psutil.Process().children():
        with suppress(psutil.NoSuchProcess):  # it has ended meanwhile
            if child.cmdline()[-2:] == ["-m", "agent"]:
                times = child.cpu_times()
                usages.append(Usage(child.memory_info().rss / MIB, times.user + times.system))
    return usages


class RunRow(Row):
    """One run with goals by inverse optimal control; the bench listens, as in ``unspoken run``."""

    title = "Runs in real processes, goals by inverse optimal control"
    headers = (
        "Scenario|Clock|Robots|Verdict|Steps|Steps\na second|Deadline\nmisses|in %|"
        "Decide wall\nms, median|\np99|Un-\nsolved|Largest\nagent MiB"
    )

    scenario: str
    clock: str
    robots: int
    verdict: str
    steps: int
    steps_per_s: float
    """From the first truth to the last."""
    deadline_misses: int
    deadline_misses_percent: float
    """Of all commands that were due."""
    collisions: int
    not_arrived: int
    """Robots."""
    unsolved: int
    """Problems, over all robots."""
    decide_p50_ms: float | None
    """Wall-clock time of a whole decision; with more processes than cores it holds the others' time too."""
    decide_p99_ms: float | None
    agent_resident_mib: float
    """Of the largest agent at any time of the run."""

    @classmethod
    def measure(cls, settings: Settings, progress: Progress) -> Iterator[Self]:
        """One row a clock, of the largest bundled scenario with a number of robots that is wanted."""
        if wanted := BUNDLED.keys() & set(settings.robots):
            for clock in ClockKind:
                experiment = prepare(
                    BUNDLED[max(wanted)],
                    DecisionOptions(goals="ioc"),
                    clock=clock.value,
                    seed=0,
                    policy=True,
                )
                yield cls._of(experiment, progress)

    @classmethod
    def _of(cls, experiment: Experiment, progress: Progress) -> Self:
        tally, times_ns, resident_mib = Tally(), list[int](), 0.0
        what = f"run in processes: {experiment.scenario.name}, {experiment.facts.clock}"
        progress.begin(f"{what}, starting")
        with TemporaryDirectory(prefix="unspoken-bench-") as directory:
            stream = run_processes(experiment, Path(directory) / "logs", progress.interruption)
            with closing(stream):  # type: ignore[type-var]  # a generator, whose closing ends the processes
                for item in stream:
                    if not isinstance(item, BusMessage):
                        continue
                    tally.add(item.message)
                    if isinstance(item.message, Truth):
                        progress.begin(f"{what}, step {item.message.step}")
                        if len(times_ns) % LOOK_STEPS == 0:
                            largest_mib = max((each.resident_mib for each in agents_usage()), default=0.0)
                            resident_mib = max(resident_mib, largest_mib)
                        times_ns.append(item.time_ns)
        summary = tally.summary(experiment.facts)
        robots = len(summary.robots)
        return cls(
            scenario=summary.scenario,
            clock=summary.clock,
            robots=robots,
            verdict=summary.verdict,
            steps=summary.steps,
            steps_per_s=summary.steps / (1e-9 * (times_ns[-1] - times_ns[0])),
            deadline_misses=summary.deadline_misses,
            deadline_misses_percent=100.0 * summary.deadline_misses / (robots * summary.steps),
            collisions=summary.collisions,
            not_arrived=sum(robot.arrived_s is None for robot in summary.robots),
            unsolved=summary.solver_failures,
            decide_p50_ms=summary.phases_ms.decide.p50,
            decide_p99_ms=summary.phases_ms.decide.p99,
            agent_resident_mib=resident_mib,
        )

    def lines(self) -> Iterable[Iterable[Cell]]:
        """Wall-clock time alone."""
        yield (
            *(self.scenario, self.clock, self.robots, self.verdict, self.steps, self.steps_per_s),
            *(self.deadline_misses, self.deadline_misses_percent, self.decide_p50_ms, self.decide_p99_ms),
            *(self.unsolved, self.agent_resident_mib),
        )


class StartupRow(Row):
    """Agents with goals by inverse optimal control and the real-time solver, compiled before."""

    title = "From the start of agents to readiness, everything compiled before"
    headers = "Agents at once|Starts|Ready after s|CPU s\nof one|Resident MiB\nof one"

    together: int
    """Agents that were started at the same time."""
    starts: int
    ready_s: float
    """Wall-clock time until all of them are on the bus: the longest of the starts."""
    cpu_s: float
    """Of one agent until then, at the most."""
    resident_mib: float
    """Of one agent then, at the most."""

    @classmethod
    def measure(cls, settings: Settings, progress: Progress) -> Iterator[Self]:
        """One row for an agent alone, one for several at once."""
        yield cls._of(1, settings.starts, progress)
        yield cls._of(min(TOGETHER, max(settings.robots)), 1, progress)

    @classmethod
    def _of(cls, together: int, starts: int, progress: Progress) -> Self:
        begun = [_start(together, progress) for _ in range(starts)]
        ready_s, cpu_s, resident_mib = (max(values) for values in zip(*begun, strict=True))
        return cls(together=together, starts=starts, ready_s=ready_s, cpu_s=cpu_s, resident_mib=resident_mib)

    def lines(self) -> Iterable[Iterable[Cell]]:
        """All of it."""
        yield self.together, self.starts, self.ready_s, self.cpu_s, self.resident_mib


def _start(count: int, progress: Progress) -> tuple[float, float, float]:
    """Start so many agents in a world that answers for its scene and never begins.

    Returns:
        Time until all are ready in s; CPU time in s and resident memory in MiB of one, at the most.
    """
    scenario = circle(count)
    inbox = Inbox(robot.id for robot in scenario.robots)
    scene = PublicScene(epoch=0, scene=scenario.scene(with_goals=False))
    with TemporaryDirectory(prefix="unspoken-bench-") as directory, Processes(Path(directory)) as processes:
        endpoint = f"unixsock-stream/{directory}/world.sock"
        with zenoh.open(world_session(endpoint).to_zenoh()) as session:
            _bus = Bus(session, Keys(RUN), scene, (), inbox)
            begin_s = time.perf_counter()
            for robot in scenario.robots:
                goal = robot.goal_pose()
                options = {"goal": f"{goal.x_m!r},{goal.y_m!r},{goal.heading_rad!r}", "robot": robot.id}
                options |= {"connect": endpoint, "run": RUN, "goals": "ioc", "solver": "realtime"}
                processes.start(f"robot-{robot.id}", "agent", options)

            def beat() -> None:
                progress.begin(f"start-up of {count}: {time.perf_counter() - begin_s:.1f} s")

            await_robots(count, inbox, processes, beat)
            ready_s, usages = time.perf_counter() - begin_s, agents_usage()
    return ready_s, max(each.cpu_s for each in usages), max(each.resident_mib for each in usages)


class CompilingRow(Row):
    """One process, bound to one core, that makes all kernels ready and ends; its start is included."""

    title = "Making all kernels ready, one core"
    headers = "Cache|CPU s|Wall s"

    cache: str
    """``empty``, or ``full`` where another process has compiled before."""
    cpu_s: float
    wall_s: float

    @classmethod
    def measure(cls, settings: Settings, progress: Progress) -> Iterator[Self]:
        """With a cache directory of its own, first empty and then full."""
        with TemporaryDirectory(prefix="unspoken-bench-") as directory:
            for cache in ("empty", "full"):
                before_s, begin_s = _children_cpu_s(), time.perf_counter()
                _compile(directory, f"compiling with {cache} cache", progress)
                wall_s = time.perf_counter() - begin_s
                yield cls(cache=cache, cpu_s=_children_cpu_s() - before_s, wall_s=wall_s)

    def lines(self) -> Iterable[Iterable[Cell]]:
        """All of it."""
        yield self.cache, self.cpu_s, self.wall_s


def _compile(cache: str, what: str, progress: Progress) -> None:
    begin_s = time.perf_counter()
    process = subprocess.Popen(
        [sys.executable, "-P", "-c", WARM_UP],
        env={**os.environ, "NUMBA_CACHE_DIR": cache},
        stdin=subprocess.DEVNULL,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.PIPE,
        start_new_session=True,  # Ctrl-C reaches the bench only
    )
    with process:
        try:
            while process.poll() is None:
                progress.begin(f"{what}: {time.perf_counter() - begin_s:.0f} s")
                with suppress(subprocess.TimeoutExpired):
                    process.wait(LOOK_S)
        finally:
            process.kill()
        said = process.stderr.read().decode(errors="replace") if process.stderr else ""
    if process.returncode:
        raise Refusal(f"compiling ended with exit status {process.returncode}:\n{said}", ExitStatus.FAILED)


def _children_cpu_s() -> float:
    """CPU time of all our children that have ended."""
    usage = resource.getrusage(resource.RUSAGE_CHILDREN)
    return usage.ru_utime + usage.ru_stime
