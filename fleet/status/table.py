"""The status of a run as a table that fits the terminal."""

from collections.abc import Callable, Sequence
from typing import Final, Literal, NamedTuple

from rich.console import Group, RenderableType
from rich.table import Table
from rich.text import Text

from fleet.status.standing import RobotState, RobotStatus, Spread, Status, WorldStatus

COLOURS: Final[dict[RobotState, str]] = {
    "lost": "red",
    "quiet": "red",
    "missing": "yellow",
    "degraded": "yellow",
    "present": "",
    "ready": "green",
    "arrived": "cyan",
}
"""First the states that need attention first."""
AROUND: Final = 6
"""Lines that are no robot's."""
MEDIUM: Final = 56
WIDE: Final = 96


class Column(NamedTuple):
    """One column of the robots' table."""

    header: str
    cell: Callable[[RobotStatus], str | Text]
    from_width: int = 0
    """Of the terminal; a narrower one does without."""
    justify: Literal["left", "right"] = "right"


def shown(status: Status, width: int, height: int | None) -> RenderableType:
    """As much of the status as fits.

    Args:
        status: of a run.
        width: of the terminal, in columns.
        height: of the terminal, in lines; None: unlimited.
    """
    robots = list(status.robots)
    room = len(robots) if height is None else max(height - AROUND, 1)
    lines: list[RenderableType] = [Text(_world(status.world), overflow="fold")]
    if len(robots) > room:
        order = list(COLOURS)
        robots.sort(key=lambda robot: order.index(robot.state))
    lines.append(_table(robots[:room], width))
    if hidden := [robot.state for robot in robots[room:]]:
        counts = ", ".join(f"{hidden.count(state)} {state}" for state in COLOURS if state in hidden)
        lines.append(Text(f"and {len(hidden)} more: {counts}", style="dim"))
    return Group(*lines)


def _world(world: WorldStatus) -> str:
    if world.step is None:
        return "world waits for robots"
    state = f"ended: {world.verdict}" if world.verdict else world.state
    parts = [f"world {state}", f"step {world.step}", f"{world.time_s:.1f} s"]
    parts += [f"{_number(world.rate_hz)} steps/s", f"{world.arrived} arrived"]
    if world.minimum_distance_m is not None:
        parts.append(f"closest {world.minimum_distance_m:.2f} m")
    if world.collisions:
        parts.append(f"{world.collisions} collided")
    return " · ".join(parts)


def _table(robots: Sequence[RobotStatus], width: int) -> Table:
    table = Table(box=None, pad_edge=False, header_style="bold")
    columns = [column for column in COLUMNS if width >= column.from_width]
    for column in columns:
        table.add_column(column.header, justify=column.justify, no_wrap=bool(column.header))
    for robot in robots:
        table.add_row(*(column.cell(robot) for column in columns))
    return table


def _remarks(robot: RobotStatus) -> str:
    counts = {
        "solver failures": robot.solver_failures,
        "interventions": robot.interventions,
        "refused": robot.refused,
    }
    return ", ".join([*robot.degraded, *(f"{count} {what}" for what, count in counts.items() if count)])


def _number(value: float | None) -> str:
    return "–" if value is None else f"{value:.1f}"


def _spread(spread: Spread | None) -> str:
    return "–" if spread is None else f"{spread.p50:.1f} / {spread.p99:.1f}"


COLUMNS: Final = (
    Column("robot", lambda robot: robot.robot, justify="left"),
    Column("state", lambda robot: Text(robot.state, style=COLOURS[robot.state]), justify="left"),
    Column("step", lambda robot: "–" if robot.step is None else str(robot.step)),
    Column("decisions/s", lambda robot: _number(robot.rate_hz), MEDIUM),
    Column("decide ms", lambda robot: _spread(robot.decide_ms), MEDIUM),
    Column("lag ms", lambda robot: _spread(robot.lag_ms), MEDIUM),
    Column("missed", lambda robot: str(robot.missed), WIDE),
    Column("", _remarks, WIDE, justify="left"),
)
