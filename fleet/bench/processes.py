"""Sections of real processes: the bus alone, runs of a scenario, the start of agents, and compiling."""

import os
import resource
import socket
import subprocess
import sys
import time
from collections.abc import Iterable, Iterator
from contextlib import closing, suppress
from datetime import UTC, datetime
from enum import StrEnum
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Self

import psutil
import zenoh

from agent.process.options import DecisionOptions, RobotOptions
from agent.process.warm import warm_up
from chassis.refusal import ExitStatus, Refusal
from fleet.bench.decisions import BUNDLED
from fleet.bench.loops import circle
from fleet.bench.measuring import Cell, Distribution, Progress, Row, Settings
from fleet.keys.authority import LOCAL_HOSTS, Device, folder_of
from fleet.keys.folders import create
from fleet.record.experiment import Experiment, prepare
from fleet.record.recording import BusMessage
from fleet.record.report import MIB
from fleet.record.summary import Tally
from fleet.run.launch import Logins, run_processes
from fleet.run.processes import Processes
from protocol.identity import load_device_keys
from protocol.keys import WORLD_NAME, Keys
from protocol.messages import PublicScene, Truth
from protocol.policy import access_control, rights_of
from protocol.session import SessionSettings, world_session
from world.bus import Bus, Inbox
from world.clock import ClockKind
from world.world import World

RUN = "bench"
LOOK_S = 0.05
LOST_S = 5.0
"""A round that lasts longer has lost a message."""
LOOK_STEPS = 10
"""The agents' memory is looked at every so many steps."""
TOGETHER = 8
"""Agents that are started at once, unless fewer robots are wanted."""
MAKES_READY = warm_up.__module__


class Protection(StrEnum):
    """What protects a bus, and over which link; as the table names it."""

    NONE = "socket, open"
    PASSWORDS = "socket, policy by passwords"
    NONE_TCP = "TCP, open"
    CERTIFICATES = "TLS, policy by certificates"


def star(
    protection: Protection, directory: Path, keys: Keys, robots: list[str]
) -> tuple[SessionSettings, str, dict[str, dict[str, str]]]:
    """A bus that nobody has opened yet; the directory is for its socket, passwords or keys.

    Returns:
        The world's session; the endpoint at which robots reach it; and by robot the settings of its process
        that prove who it is.
    """
    rights = rights_of(keys, robots)
    endpoint = f"unixsock-stream/{directory}/world.sock"
    if protection in (Protection.NONE_TCP, Protection.CERTIFICATES):
        with closing(socket.create_server(("127.0.0.1", 0))) as free:
            port = free.getsockname()[1]
        endpoint = f"{'tls' if protection is Protection.CERTIFICATES else 'tcp'}/127.0.0.1:{port}"
    if protection is Protection.PASSWORDS:
        logins = Logins(directory, robots)
        users = Path(logins.of_world()["users"])
        world = world_session(endpoint, access_control(rights, "usernames"), users)
        return world, endpoint, {robot: logins.of_robot(robot) for robot in robots}
    if protection is Protection.CERTIFICATES:
        folder, now = directory / "keys", datetime.now(UTC)
        create(folder, [Device(WORLD_NAME, LOCAL_HOSTS), *map(Device, robots)], now, days=1, authority_days=2)
        own = load_device_keys(folder / folder_of(WORLD_NAME), now)
        world = world_session(endpoint, access_control(rights, "cert_common_names"), own)
        return world, endpoint, {robot: {"keys": str(folder / folder_of(robot))} for robot in robots}
    return world_session(endpoint), endpoint, {robot: {} for robot in robots}


class BusRow(Row):
    """Rounds with one number of robots, each in a process of its own."""

    title = "Bus alone: a step's observations out, all its commands back"
    headers = "Protection|Robots|Rounds|Wall ms\nmedian|\np99|\nmax"

    robots: int
    protection: str
    rounds: int
    wall: Distribution
    """From the first observation put until the last command is there: both ways, packing and checking of
    messages, and the waiting for a core included."""

    @classmethod
    def measure(cls, settings: Settings, progress: Progress) -> Iterator[Self]:
        """One row for each number of robots and each protection."""
        for robots in settings.robots:
            for protection in Protection:
                wall = Distribution.of(_rounds_ms(robots, protection, settings.rounds, progress))
                yield cls(robots=robots, protection=protection, rounds=settings.rounds, wall=wall)

    def lines(self) -> Iterable[Iterable[Cell]]:
        """Wall-clock time alone."""
        wall = self.wall
        yield self.protection, self.robots, self.rounds, wall.median_ms, wall.p99_ms, wall.max_ms


def _rounds_ms(robots: int, protection: Protection, rounds: int, progress: Progress) -> list[float]:
    scenario, keys = circle(robots), Keys(RUN)
    scene = PublicScene(epoch=0, scene=scenario.scene(with_goals=False))
    observations = World(scenario, seed=0, epoch=0).observations()
    inbox, durations_ms = Inbox(observations), []
    with TemporaryDirectory(prefix="unspoken-bench-") as directory, Processes(Path(directory)) as processes:
        world, endpoint, proofs = star(protection, Path(directory), keys, list(observations))
        with zenoh.open(world.to_zenoh()) as session:
            bus = Bus(session, keys, scene, tuple(observations), inbox)
            for robot, proof in proofs.items():
                options = {"robot": robot, "run": RUN, "connect": endpoint, **proof}
                processes.start(f"echo-{robot}", "fleet.bench.echo", options)
            _await_robots(f"bus: waiting for {robots} robots", robots, inbox, processes, progress)
            for step in range(rounds):
                progress.begin(f"bus: {robots} robots, {protection}, round {step + 1}")
                now = {robot: each.model_copy(update={"step": step}) for robot, each in observations.items()}
                inbox.begin_step()
                begin_s = time.perf_counter()
                bus.publish_observations(now)
                gather(set(now), inbox)
                durations_ms.append(1e3 * (time.perf_counter() - begin_s))
    return durations_ms


def _await_robots(what: str, count: int, inbox: Inbox, processes: Processes, progress: Progress) -> None:
    """Return when so many robots are present at the world of this inbox."""
    begin_s = time.perf_counter()
    while len(inbox.take(LOOK_S).present) < count:
        progress.begin(f"{what}: {time.perf_counter() - begin_s:.1f} s")
        if ended := processes.ended():
            raise Refusal("\n".join(ended.values()), ExitStatus.FAILED)


def gather(awaited: set[str], inbox: Inbox) -> None:
    """Return when a command of each of these robots is there.

    Raises:
        Refusal: one is missing after ``LOST_S``.
    """
    until_s = time.monotonic() + LOST_S
    while awaited:
        awaited -= {robot for robot, _ in inbox.take(until_s - time.monotonic()).commands}
        if awaited and time.monotonic() >= until_s:
            missing = f"no answer of robot {', '.join(sorted(awaited))} within {LOST_S:g} s"
            raise Refusal(f"the bus lost a message: {missing}", ExitStatus.FAILED)


def agents_usage() -> tuple[float, float]:
    """The most resident memory in MiB, and CPU time in s, of any process ``python -m agent`` of ours."""
    mib, cpu_s = [0.0], [0.0]
    for child in psutil.Process().children():
        with suppress(psutil.NoSuchProcess):  # it has ended meanwhile
            if child.cmdline()[-2:] == ["-m", "agent"]:
                mib.append(child.memory_info().rss / MIB)
                cpu_s.append(sum(child.cpu_times()[:2]))
    return max(mib), max(cpu_s)


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
    decide_p50_ms: float | None
    """Wall-clock time of a whole decision; with more processes than cores it holds the others' time too."""
    decide_p99_ms: float | None
    unsolved: int
    """Problems, over all robots."""
    agent_resident_mib: float
    """Of the largest agent at any time of the run."""

    @classmethod
    def measure(cls, settings: Settings, progress: Progress) -> Iterator[Self]:
        """One row a clock, of the largest bundled scenario with a number of robots that is wanted."""
        if wanted := BUNDLED.keys() & set(settings.robots):
            name, decisions = BUNDLED[max(wanted)], DecisionOptions(goals="ioc")
            for clock in ClockKind:
                yield cls._of(prepare(name, decisions, clock=clock.value, seed=0, policy=True), progress)

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
                            resident_mib = max(resident_mib, agents_usage()[0])
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
        """Without what the verdict says already."""
        shown = dict(self)
        del shown["collisions"], shown["not_arrived"]
        yield shown.values()


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
        for together, starts in (1, settings.starts), (min(TOGETHER, max(settings.robots)), 1):
            begun = [_start(together, progress) for _ in range(starts)]
            ready_s, cpu_s, mib = (max(values) for values in zip(*begun, strict=True))
            yield cls(together=together, starts=starts, ready_s=ready_s, cpu_s=cpu_s, resident_mib=mib)


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
                own = RobotOptions(
                    robot=robot.id, goal=robot.goal_pose(), connect=endpoint, run=RUN, goals="ioc"
                )
                processes.start(f"robot-{robot.id}", "agent", own.as_environment())
            _await_robots(f"start-up of {count}", count, inbox, processes, progress)
            ready_s, (resident_mib, cpu_s) = time.perf_counter() - begin_s, agents_usage()
    return ready_s, cpu_s, resident_mib


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


def _compile(cache: str, what: str, progress: Progress) -> None:
    begin_s = time.perf_counter()
    process = subprocess.Popen(
        [sys.executable, "-P", "-c", f"import {MAKES_READY} as made; made.warm_up('ioc', 'realtime')"],
        env={**os.environ, "NUMBA_CACHE_DIR": cache},
        stdin=subprocess.DEVNULL,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.PIPE,
        start_new_session=True,  # Ctrl-C reaches the bench only
    )
    with process:
        try:
            if hasattr(os, "sched_setaffinity"):
                os.sched_setaffinity(process.pid, {min(os.sched_getaffinity(0))})
            while process.poll() is None:
                progress.begin(f"{what}: {time.perf_counter() - begin_s:.0f} s")
                time.sleep(LOOK_S)
        finally:
            process.kill()
        said = process.stderr.read().decode(errors="replace") if process.stderr else ""
    if process.returncode:
        raise Refusal(f"compiling ended with exit status {process.returncode}:\n{said}", ExitStatus.FAILED)


def _children_cpu_s() -> float:
    """CPU time of all our children that have ended."""
    return sum(resource.getrusage(resource.RUSAGE_CHILDREN)[:2])
