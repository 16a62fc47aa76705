"""Whole decisions: estimate, predict and plan, in closed loops with goals by inverse optimal control."""

import time
from collections import defaultdict
from collections.abc import Iterable, Iterator

from rich.table import Table

from agent.agent import Agent
from fleet.bench.crossings import random_crossing
from fleet.bench.durations import Distribution, Duration, Timer, Times
from fleet.bench.settings import Settings
from fleet.bench.watch import Watch
from fleet.record.report_file import Record
from fleet.record.tables import new_table, number
from protocol.scenario import Scenario, load_scenario
from scenarios import find
from world.world import World

PHASES = ("estimate", "predict", "plan")
BUNDLED = {2: "2-crossing", 4: "4-crossing", 8: "8a"}
"""By number of robots; others drive a random crossing."""


class DecisionRow(Record):
    """One closed loop in virtual time. Robots that have arrived decide nothing and do not count."""

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


def measure(settings: Settings, watch: Watch) -> Iterator[DecisionRow]:
    """One row for each number of robots."""
    for robots in settings.robots:
        bundled = BUNDLED.get(robots)
        scenario = load_scenario(find(bundled)) if bundled else random_crossing(robots, settings.seed)
        yield _row(scenario, settings.decisions, watch)


def _row(scenario: Scenario, most: int, watch: Watch) -> DecisionRow:
    world, scene = World(scenario, seed=0, epoch=0), scenario.scene(with_goals=False)
    agents = {
        robot.id: Agent.of(
            robot.id, robot.goal_pose(), scene, goals="ioc", solver="realtime", clock=time.thread_time
        )
        for robot in scenario.robots
    }
    first: list[Duration] = []
    later: list[Duration] = []
    phases_ms: defaultdict[str, list[float]] = defaultdict(list)
    failures = dict.fromkeys(agents, 0)
    while not world.over and (world.step < 2 or len(later) < most):
        observations, commands = world.observations(), {}
        for robot, agent in agents.items():
            watch.tell(f"whole decisions: {scenario.name}, step {world.step}")
            timer = Timer()
            decision = agent.decide(observations[robot])
            duration = timer.read()
            if decision is None:
                continue
            commands[robot] = decision.command
            failures[robot] = decision.mind.solver_failures
            if decision.mind.arrived:
                continue
            (later if world.step else first).append(duration)
            if world.step:
                for phase in PHASES:
                    phases_ms[phase].append(getattr(decision.mind.timings_ms, phase))
        world.advance(commands)
    return DecisionRow(
        scenario=scenario.name,
        robots=len(agents),
        steps=world.step,
        first=Times.of(first),
        later=Times.of(later),
        phases_cpu={phase: Distribution.of(values_ms) for phase, values_ms in phases_ms.items()},
        unsolved=sum(failures.values()),
        verdict=world.truth().verdict,
    )


def table(rows: Iterable[DecisionRow]) -> Table:
    """Thread CPU time with wall-clock time beside it."""
    result = new_table(
        "Whole decisions, goals by inverse optimal control",
        "Scenario",
        "Robots",
        "Deci-\nsions",
        "CPU ms\nmedian",
        "\np99",
        "\nmax",
        "Wall ms\np99",
        "First\nCPU max",
        "Estimate\np99",
        "Predict\np99",
        "Plan\np99",
        "Un-\nsolved",
        "Verdict",
    )
    for row in rows:
        cpu = row.later.cpu
        result.add_row(
            row.scenario,
            str(row.robots),
            str(row.first.count + row.later.count),
            *map(number, (cpu.median_ms, cpu.p99_ms, cpu.max_ms, row.later.wall.p99_ms)),
            number(row.first.cpu.max_ms),
            *(number(row.phases_cpu[phase].p99_ms) for phase in PHASES),
            str(row.unsolved),
            row.verdict or "–",
        )
    return result
