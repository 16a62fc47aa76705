"""Real-time against reference solver: on the same problems, and each in a closed loop of its own."""

from collections.abc import Iterable, Iterator, Sequence

from rich.table import Table

from fleet.bench.closed_loop import Solved, TimedSolver, cost, drive, passed_alike, shortfall_m
from fleet.bench.durations import Times
from fleet.bench.settings import Settings
from fleet.bench.watch import Watch
from fleet.record.report_file import Record
from fleet.record.tables import new_table, number
from protocol.scenario import Scenario, load_scenario
from scenarios import find

COMPARED = ("2-crossing", "4-crossing", "8a")


class Side(Record):
    """What one of the two solvers came to."""

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


class ComparisonRow(Record):
    """One scenario, solved by both."""

    scenario: str
    robots: int
    realtime: Side
    reference: Side
    times_faster_median: float
    """Ratio of the medians of thread CPU time."""
    times_faster_p99: float
    """Ratio of the 99th percentiles."""
    objective_difference_percent: float
    """Of the real-time solver's objective against the reference's; positive where it is worse."""
    cost_difference_percent: float
    """Cost of the real-time solver's closed loop against the reference's; positive where it is dearer."""
    same_minimum: bool
    """Whether in both closed loops each two robots passed each other on the same side; if not, the costs say
    nothing about the solvers."""


def measure(settings: Settings, watch: Watch) -> Iterator[ComparisonRow]:
    """One row for each bundled scenario with a number of robots that is wanted; none without reference."""
    for name in COMPARED if settings.reference else ():
        scenario = load_scenario(find(name))
        if len(scenario.robots) in settings.robots:
            yield _compare(scenario, settings.steps, watch)


def _compare(scenario: Scenario, steps: int, watch: Watch) -> ComparisonRow:
    fast, judge = TimedSolver("realtime"), TimedSolver("reference")
    own = _followed(drive(scenario, fast, steps), f"{scenario.name}, real-time solver drives", watch)
    replayed = (judge.solve(each.problem, each.starts) for each in own)
    same = _followed(replayed, f"{scenario.name}, reference solver on the same problems", watch)
    # From where the other began: in symmetrical scenarios mirrored minima are equally good.
    first = own[0].solution.start(warm=False)
    others = _followed(
        drive(scenario, judge, steps, first), f"{scenario.name}, reference solver drives", watch
    )
    realtime, reference = _side(own, own), _side(same, others)
    ours, theirs = realtime.later.cpu, reference.later.cpu
    return ComparisonRow(
        scenario=scenario.name,
        robots=len(scenario.robots),
        realtime=realtime,
        reference=reference,
        times_faster_median=theirs.median_ms / ours.median_ms,
        times_faster_p99=theirs.p99_ms / ours.p99_ms,
        objective_difference_percent=_percent_more(realtime.objective, reference.objective),
        cost_difference_percent=_percent_more(realtime.cost, reference.cost),
        same_minimum=passed_alike(own, others),
    )


def _followed(loop: Iterable[Solved], what: str, watch: Watch) -> list[Solved]:
    result = []
    for solved in loop:
        result.append(solved)
        watch.tell(f"comparison: {what}, step {len(result)}")
    return result


def _side(problems: Sequence[Solved], loop: Sequence[Solved]) -> Side:
    return Side(
        first_cpu_ms=problems[0].duration.cpu_ms,
        later=Times.of(each.duration for each in problems[1:]),
        unsolved=sum(each.unsolved for each in problems),
        objective=sum(each.solution.objective for each in problems[1:]),
        predicted_shortfall_m=max(each.solution.violation_m for each in problems),
        cost=cost(loop),
        driven_shortfall_m=shortfall_m(loop),
    )


def _percent_more(value: float, reference: float) -> float:
    return 100.0 * (value / reference - 1.0)


def table(rows: Iterable[ComparisonRow]) -> Table:
    """Three rows a scenario: one a solver, and the real-time solver against the reference."""
    result = new_table(
        "Real-time against reference solver: the same problems, and a closed loop of its own",
        "Scenario",
        "Solver",
        "CPU ms\nmedian",
        "\np99",
        "Wall ms\np99",
        "First\nCPU ms",
        "Un-\nsolved",
        "Too close\npredicted m",
        "driven\nm",
        "Objec-\ntive",
        "Cost of\nits loop",
        "Same\nminimum",
        names=2,
    )
    for row in rows:
        result.add_row(row.scenario, "real-time", *_cells(row.realtime))
        result.add_row("", "reference", *_cells(row.reference))
        result.add_row(
            "",
            "",
            f"÷ {number(row.times_faster_median)}",
            f"÷ {number(row.times_faster_p99)}",
            *[""] * 5,
            f"{row.objective_difference_percent:+.4f} %",
            f"{row.cost_difference_percent:+.4f} %",
            "yes" if row.same_minimum else "no",
            end_section=True,
        )
    return result


def _cells(side: Side) -> Sequence[str]:
    times = side.later
    return (
        *map(number, (times.cpu.median_ms, times.cpu.p99_ms, times.wall.p99_ms, side.first_cpu_ms)),
        str(side.unsolved),
        number(side.predicted_shortfall_m),
        number(side.driven_shortfall_m),
        "",
        f"{side.cost:.2f}",
    )
