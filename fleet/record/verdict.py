"""The end of a run on the terminal: a table of the robots and the verdict in words."""

from collections.abc import Mapping, Sequence

from rich import box
from rich.table import Table

from fleet.record.summary import Summary

NAMED_ROBOTS = 5
"""More robots than this are counted instead of named."""


def robot_table(summary: Summary, clipped_commands: Mapping[str, int]) -> Table:
    """One row a robot and one for the run; fits into 80 columns.

    Args:
        summary: the run.
        clipped_commands: commands outside the limits by robot (``Tally.clipped_commands``).
    """
    table = Table(box=box.SIMPLE_HEAD, show_footer=len(summary.robots) > 1)
    table.add_column("Robot", "all", overflow="fold")
    for header, total in (
        ("Arrived\nin s", _arrival(summary.duration_s)),
        ("Driven\nin m", f"{sum(robot.driven_m for robot in summary.robots):.2f}"),
        ("Solver\nfailures", _count(summary.solver_failures)),
        ("Deadline\nmisses", _count(summary.deadline_misses)),
        ("Commands\nclipped", _count(summary.clipped_commands)),
    ):
        table.add_column(header, total, justify="right")
    for robot in summary.robots:
        table.add_row(
            robot.id,
            _arrival(robot.arrived_s),
            f"{robot.driven_m:.2f}",
            _count(robot.solver_failures),
            _count(robot.deadline_misses),
            _count(clipped_commands[robot.id]),
        )
    return table


def verdict_line(summary: Summary, step_s: float) -> str:
    """How the run ended, in a sentence or two of plain text.

    Args:
        summary: the run.
        step_s: Δt in s; the summary counts steps.
    """
    opening = _OPENINGS.get(summary.verdict, summary.verdict.capitalize())
    if not summary.robots:
        return f"{opening} before the first step."
    collided = _collided(summary.collisions)
    if summary.verdict == "arrived" and summary.duration_s is not None:
        harm = f", but {collided} collided" if summary.collisions else ""
        return f"{_everybody(summary)} arrived after {summary.duration_s:.1f} s{harm}{_distance(summary)}."
    ended = f"after {summary.steps * step_s:.1f} s"
    if summary.verdict == "collision":
        return f"Collision of {collided}; {ended} {_progress(summary)}{_distance(summary)}."
    harm = f" {collided.capitalize()} collided." if summary.collisions else ""
    return f"{opening} {ended}: {_progress(summary)}{_distance(summary)}.{harm}"


_OPENINGS = {"timeout": "Out of time"}


def refusal_lines(summary: Summary) -> list[str]:
    """What was not taken of each robot's messages: nothing, as long as all behave."""
    return [
        f"Refused of robot {robot}: {', '.join(f'{count} × {reason}' for reason, count in reasons.items())}."
        for robot, reasons in summary.refused.items()
    ]


def degradation_lines(summary: Summary) -> list[str]:
    """How long each robot did not drive as it would, and why: nothing, as long as all is well."""
    return [
        f"Robot {robot} was degraded: {', '.join(f'{how} {time_s:g} s' for how, time_s in ways.items())}."
        for robot, ways in summary.degraded.items()
    ]


def _progress(summary: Summary) -> str:
    missing = [robot.id for robot in summary.robots if robot.arrived_s is None]
    if not missing:
        return f"{_everybody(summary).lower()} had arrived"
    verb = "never arrived" if summary.verdict == "deadlock" else "had not arrived"
    return f"{_named(missing, len(summary.robots))} {verb}"


def _collided(pairs: int) -> str:
    return "1 pair of robots" if pairs == 1 else f"{pairs} pairs of robots"


def _distance(summary: Summary) -> str:
    if summary.minimum_distance_m is None:
        return ""
    unharmed = " without collision" if summary.verdict == "arrived" and not summary.collisions else ""
    return f"{unharmed}; smallest distance {summary.minimum_distance_m:.2f} m"


def _everybody(summary: Summary) -> str:
    count = len(summary.robots)
    return {1: "The robot", 2: "Both robots"}.get(count, f"All {count} robots")


def _named(names: Sequence[str], of: int) -> str:
    if len(names) == 1:
        return f"robot {names[0]}"
    if len(names) > NAMED_ROBOTS:
        return f"{len(names)} of {of} robots"
    return f"robots {', '.join(names[:-1])} and {names[-1]}"


def _arrival(time_s: float | None) -> str:
    return "[red]–[/]" if time_s is None else f"{time_s:.1f}"


def _count(number: int) -> str:
    return f"[yellow]{number}[/]" if number else "0"
