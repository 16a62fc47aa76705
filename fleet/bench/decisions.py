"""Sections that need no other process: the joint prediction, both solvers compared, and whole decisions."""

import time
from collections import defaultdict
from collections.abc import Iterable, Iterator, Sequence
from typing import Self

from agent.process.options import DecisionOptions
from agent.solve.vehicle import Array
from chassis.files import Record
from fleet.bench.loops import (
    Solved,
    TimedSolver,
    circle,
    cost,
    drive,
    passed_alike,
    random_crossing,
    shortfall_m,
)
from fleet.bench.measuring import Cell, Distribution, Progress, Row, Settings, Times, clocks_ms
from fleet.record.report import number
from protocol.scenario import Scenario, load_scenario
from scenarios import find
from world.world import World

BUNDLED = {2: "2-crossing", 4: "4-crossing", 8: "8a"}
"""Scenarios by number of robots."""
PHASES = ("estimate", "predict", "plan")


class PredictionRow(Row):
    """Closed loops of one kind with one number of robots, by the real-time solver."""

    title = "Joint prediction alone, real-time solver"
    headers = (
        "Scenario|Robots|Loops|CPU ms\nmedian|\np99|\nmax|Wall ms\np99|First\nCPU max|Un-\nsolved|"
        "Too close\npredicted m|driven\nm"
    )

    scenario: str
    """``8a``, ``circle`` or ``random``."""
    robots: int
    loops: int
    first: Times
    """First solves of the loops, from all cold starts."""
    later: Times
    """All others."""
    unsolved: int
    """Starts from which no solution was found, over all loops."""
    predicted_shortfall_m: float
    """By how much predicted robots came closer than their safety distance, at the worst."""
    driven_shortfall_m: float
    """The same of robots as they drove."""

    @classmethod
    def measure(cls, settings: Settings, progress: Progress) -> Iterator[Self]:
        """One row for scenario 8a, then two for each number of robots: random crossings and the circle."""
        if 8 in settings.robots:
            yield cls._of("8a", [load_scenario(find("8a"))], settings, progress)
        for robots in settings.robots:
            seeds = range(settings.seed, settings.seed + settings.crossings_of(robots))
            yield cls._of("random", (random_crossing(robots, seed) for seed in seeds), settings, progress)
            yield cls._of("circle", [circle(robots)], settings, progress)

    @classmethod
    def _of(cls, name: str, scenarios: Iterable[Scenario], settings: Settings, progress: Progress) -> Self:
        solver = TimedSolver("realtime")
        loops = [
            _whole(drive(scenario, solver, settings.steps), f"prediction alone: {scenario.name}", progress)
            for scenario in scenarios
        ]
        every = [solved for loop in loops for solved in loop]
        return cls(
            scenario=name,
            robots=len(every[0].problem.states),
            loops=len(loops),
            first=Times.of(loop[0].duration_ms for loop in loops),
            later=Times.of(solved.duration_ms for loop in loops for solved in loop[1:]),
            unsolved=sum(not solved.solution.solved for solved in every),
            predicted_shortfall_m=max(solved.solution.violation_m for solved in every),
            driven_shortfall_m=max(map(shortfall_m, loops)),
        )

    def lines(self) -> Iterable[Iterable[Cell]]:
        """Thread CPU time with wall-clock time beside it."""
        times = *_times(self.later), self.first.cpu.max_ms
        shortfalls_m = self.predicted_shortfall_m, self.driven_shortfall_m
        yield self.scenario, self.robots, self.loops, *times, self.unsolved, *shortfalls_m


class Side(Record):
    """What one of the two solvers achieved."""

    first_cpu_ms: float
    """The first solve, from all cold starts."""
    later: Times
    """The other problems of the loop that the real-time solver drove."""
    unsolved: int
    """Starts from which no solution was found, in these problems."""
    objective: float
    """Sum over the problems after the first."""
    predicted_shortfall_m: float
    """By how much predicted robots came closer than their safety distance, at the worst."""
    cost: float
    """Of its own closed loop (eq. 11)."""
    driven_shortfall_m: float
    """As predicted_shortfall_m, of the robots as they drove in that loop."""

    @classmethod
    def of(cls, problems: Sequence[Solved], loop: Sequence[Solved]) -> Self:
        """From the problems that both solved, and from a loop of its own."""
        return cls(
            first_cpu_ms=float(problems[0].duration_ms[0]),
            later=Times.of(each.duration_ms for each in problems[1:]),
            unsolved=sum(not each.solution.solved for each in problems),
            objective=sum(each.solution.objective for each in problems[1:]),
            predicted_shortfall_m=max(each.solution.violation_m for each in problems),
            cost=cost(loop),
            driven_shortfall_m=shortfall_m(loop),
        )

    def cells(self) -> Iterable[Cell]:
        """Its figures in the table."""
        cpu, wall = self.later.cpu, self.later.wall
        yield from (cpu.median_ms, cpu.p99_ms, wall.p99_ms, self.first_cpu_ms, self.unsolved)
        yield from (self.predicted_shortfall_m, self.driven_shortfall_m, "", f"{self.cost:.2f}")


class ComparisonRow(Row):
    """One scenario, solved by both solvers: the same problems, and each in a closed loop of its own."""

    title = "Real-time against reference solver: the same problems, and a closed loop of its own"
    headers = (
        "Scenario|Solver|CPU ms\nmedian|\np99|Wall ms\np99|First\nCPU ms|Un-\nsolved|"
        "Too close\npredicted m|driven\nm|Objec-\ntive|Cost of\nits loop|Same\nminimum"
    )
    names = 2

    scenario: str
    robots: int
    realtime: Side
    reference: Side
    times_faster_median: float
    """Ratio of the medians of thread CPU time."""
    times_faster_p99: float
    """Ratio of the 99th percentiles."""
    objective_difference_percent: float
    """Of the real-time solver's objective from the reference's; positive where it is worse."""
    cost_difference_percent: float
    """Of the cost of the real-time solver's closed loop from the reference's; positive where it is higher."""
    same_minimum: bool
    """Whether in both closed loops any two robots passed each other on the same side; if not, the costs say
    nothing about the solvers."""

    @classmethod
    def measure(cls, settings: Settings, progress: Progress) -> Iterator[Self]:
        """One row for each bundled scenario with a wanted number of robots; none without reference."""
        for robots, name in BUNDLED.items() if settings.reference else ():
            if robots in settings.robots:
                yield cls._of(load_scenario(find(name)), settings.steps, progress)

    @classmethod
    def _of(cls, scenario: Scenario, steps: int, progress: Progress) -> Self:
        what = f"comparison: {scenario.name},"
        fast, judge = TimedSolver("realtime"), TimedSolver("reference")
        own = _whole(drive(scenario, fast, steps), f"{what} real-time solver drives", progress)
        replayed = (judge.solve(each.problem, each.start) for each in own)
        same = _whole(replayed, f"{what} reference solver on the same problems", progress)
        # From where the other began: in symmetrical scenarios mirrored minima are equally good.
        first = own[0].solution.start(warm=False)
        others = _whole(drive(scenario, judge, steps, first), f"{what} reference solver drives", progress)
        ours, theirs = Side.of(own, own), Side.of(same, others)
        return cls(
            scenario=scenario.name,
            robots=len(scenario.robots),
            realtime=ours,
            reference=theirs,
            times_faster_median=theirs.later.cpu.median_ms / ours.later.cpu.median_ms,
            times_faster_p99=theirs.later.cpu.p99_ms / ours.later.cpu.p99_ms,
            objective_difference_percent=100.0 * (ours.objective / theirs.objective - 1.0),
            cost_difference_percent=100.0 * (ours.cost / theirs.cost - 1.0),
            same_minimum=passed_alike(own, others),
        )

    def lines(self) -> Iterable[Iterable[Cell]]:
        """One line a solver, and one with the real-time solver against the reference."""
        yield self.scenario, "real-time", *self.realtime.cells()
        yield "", "reference", *self.reference.cells()
        faster = (f"÷ {number(each)}" for each in (self.times_faster_median, self.times_faster_p99))
        differences = (self.objective_difference_percent, self.cost_difference_percent)
        same_minimum = "yes" if self.same_minimum else "no"
        yield "", "", *faster, *[""] * 5, *(f"{each:+.4f} %" for each in differences), same_minimum


class DecisionRow(Row):
    """One closed loop in virtual time. Robots that have arrived decide nothing and do not count."""

    title = "Whole decisions, goals by inverse optimal control"
    headers = (
        "Scenario|Robots|Deci-\nsions|CPU ms\nmedian|\np99|\nmax|Wall ms\np99|First\nCPU max|"
        "Estimate\np99|Predict\np99|Plan\np99|Un-\nsolved|Verdict"
    )

    scenario: str
    robots: int
    steps: int
    first: Times
    """Decisions at step 0, from all cold starts."""
    later: Times
    """All others."""
    phases_cpu: dict[str, Distribution]
    """Thread CPU time of estimate, predict and plan in the decisions after the first."""
    unsolved: int
    """Problems not solved."""
    verdict: str | None
    """The referee's; None where the loop ended before."""

    @classmethod
    def measure(cls, settings: Settings, progress: Progress) -> Iterator[Self]:
        """One row for each number of robots, in a bundled scenario where there is one."""
        for robots in settings.robots:
            bundled = BUNDLED.get(robots)
            scenario = load_scenario(find(bundled)) if bundled else random_crossing(robots, settings.seed)
            yield cls._of(scenario, settings.decisions, progress)

    @classmethod
    def _of(cls, scenario: Scenario, most: int, progress: Progress) -> Self:
        world, scene = World(scenario, seed=0, epoch=0), scenario.scene(with_goals=False)
        options = DecisionOptions(goals="ioc")
        agents = {
            robot.id: options.agent(robot.id, robot.goal_pose(), scene, time.thread_time)
            for robot in scenario.robots
        }
        first: list[Array] = []
        later: list[Array] = []
        phases_ms: defaultdict[str, list[float]] = defaultdict(list)
        failures = dict.fromkeys(agents, 0)
        while not world.over and (world.step < 2 or len(later) < most):
            observations, commands = world.observations(), {}
            for robot, agent in agents.items():
                progress.begin(f"whole decisions: {scenario.name}, step {world.step}")
                begin_ms = clocks_ms()
                decision = agent.decide(observations[robot])
                duration_ms = clocks_ms() - begin_ms
                if decision is None:
                    continue
                commands[robot], mind = decision.command, decision.mind
                failures[robot] = mind.solver_failures
                if not mind.arrived:
                    (later if world.step else first).append(duration_ms)
                    for phase in PHASES if world.step else ():
                        phases_ms[phase].append(getattr(mind.timings_ms, phase))
            world.advance(commands)
        return cls(
            scenario=scenario.name,
            robots=len(agents),
            steps=world.step,
            first=Times.of(first),
            later=Times.of(later),
            phases_cpu={phase: Distribution.of(values_ms) for phase, values_ms in phases_ms.items()},
            unsolved=sum(failures.values()),
            verdict=world.truth().verdict,
        )

    def lines(self) -> Iterable[Iterable[Cell]]:
        """Thread CPU time with wall-clock time beside it."""
        decisions = self.first.count + self.later.count
        times = *_times(self.later), self.first.cpu.max_ms
        phases = (self.phases_cpu[phase].p99_ms for phase in PHASES)
        yield self.scenario, self.robots, decisions, *times, *phases, self.unsolved, self.verdict


def _whole(loop: Iterable[Solved], what: str, progress: Progress) -> list[Solved]:
    """A closed loop to its end."""
    result = []
    for solved in loop:
        result.append(solved)
        progress.begin(f"{what}, step {len(result)}")
    return result


def _times(later: Times) -> Sequence[Cell]:
    return later.cpu.median_ms, later.cpu.p99_ms, later.cpu.max_ms, later.wall.p99_ms
