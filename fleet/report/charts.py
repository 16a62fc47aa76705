"""The publication's four box plots, drawn from the runs of one level of noise."""

from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from itertools import combinations

from fleet.report import published
from fleet.report.boxes import Chart, Series
from fleet.report.measures import (
    DRIVEN,
    DURATION,
    ROBOT_DRIVEN,
    ROBOT_DURATION,
    SMALLEST_DISTANCE,
    Group,
    Measure,
    all_arrived,
    cpu_time,
)
from protocol.scenario import Scenario

FAR = 1.5
"""Robots that never come nearer than so many of the largest safety distance do not meet."""
MEDIAN_MARK = f"median of {published.SOURCE}"


def charts(groups: Sequence[Group], scenarios: Collection[Scenario]) -> dict[str, Chart]:
    """By a short name for files.

    Args:
        groups: the methods at one level of noise.
        scenarios: what they drove.
    """
    methods = {group.method: _arrived(group) for group in groups}
    collided = {group.method: group.collided for group in groups}

    def chart(title: str, axis: str, series: Sequence[Series], **more: object) -> Chart:
        settings: Mapping[str, object] = {"published": MEDIAN_MARK, **more}
        return Chart(title, axis, methods, series, collided, **settings)  # type: ignore[arg-type]

    collision_m = collision_distance_m(scenarios)
    safe_m = max(2.0 * (r.radius_m + each.safety_margin_m) for each in scenarios for r in each.robots)
    return {
        "duration": chart(
            "How long it took until all had arrived",
            "duration in s",
            [
                _series("until all robots had arrived", DURATION, groups),
                _series("until one robot had, on average", ROBOT_DURATION, groups),
            ],
        ),
        "driven": chart(
            "How far they drove",
            "distance driven in m",
            [
                _series("by all robots together", DRIVEN, groups),
                _series("by one robot, on average", ROBOT_DRIVEN, groups),
            ],
        ),
        "distance": chart(
            "How near two robots came",
            "smallest distance of two centres in m",
            [
                _series(
                    "smallest distance",
                    SMALLEST_DISTANCE,
                    groups,
                    published.smallest_distance_m,
                )
            ],
            published=f"smallest of all scenarios of {published.SOURCE}",
            line=None if collision_m is None else (collision_m, f"collision below {collision_m:.2f} m"),
            most=FAR * safe_m,
        ),
        "times": chart(
            "What a decision costs",
            "CPU time of one robot in one step in ms, median of a run",
            [
                _time_series("planning", "plan", groups),
                _time_series("joint prediction", "predict", groups),
                _time_series("estimating goals", "estimate", groups),
            ],
            published=f"median of {published.SOURCE}: wall-clock means, other computer",
            logarithmic=True,
        ),
    }


def collision_distance_m(scenarios: Iterable[Scenario]) -> float | None:
    """Centres nearer than this have collided; None without pairs, or if it is not the same for all pairs."""
    distances_m = {
        round(one.radius_m + other.radius_m, 9)
        for scenario in scenarios
        for one, other in combinations(scenario.robots, 2)
    }
    return distances_m.pop() if len(distances_m) == 1 else None


def _series(
    label: str,
    measure: Measure,
    groups: Sequence[Group],
    published_of: Callable[[str], float | None] | None = None,
) -> Series:
    of = published_of or (lambda method: published.median_of(method, measure.column))
    known = {group.method: of(group.method) for group in groups}
    return Series(
        label,
        {group.method: group.by_scenario(measure) for group in groups},
        {method: value for method, value in known.items() if value is not None},
    )


def _time_series(label: str, phase: str, groups: Sequence[Group]) -> Series:
    return _series(
        label, cpu_time(phase, "p50"), groups, lambda method: published.solve_time_ms(method, phase)
    )


def _arrived(group: Group) -> str:
    arrived = sum(all_arrived(row) for row in group.rows)
    if arrived == len(group.rows):
        return f"all arrived in {arrived} runs" if arrived > 1 else "all arrived in 1 run"
    return f"all arrived in {arrived} of {len(group.rows)} runs"
