"""Shows a run to a person or a program, once or until it ends."""

import time
from collections.abc import Callable, Sequence
from typing import Final

from rich.console import Console, Group, RenderableType
from rich.live import Live
from rich.table import Table
from rich.text import Text

from fleet.interruption import Interruption
from fleet.status.listener import Listener
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
"""Those first that want to be looked at first."""
WIDE: Final = 96
"""Columns of a terminal that holds everything."""
MEDIUM: Final = 56
"""Columns of one that holds the times."""
AROUND: Final = 6
"""Lines that are no robot's."""


def shown(status: Status, width: int, height: int | None) -> RenderableType:
    """The status as fits.

    Args:
        status: of a run.
        width: of the terminal, in columns.
        height: of the terminal, in lines; None: without end.
    """
    robots = list(status.robots)
    room = len(robots) if height is None else max(height - AROUND, 1)
    lines: list[RenderableType] = [Text(_world(status.world), overflow="fold")]
    if len(robots) > room:
        order = list(COLOURS)
        robots.sort(key=lambda robot: order.index(robot.state))
        hidden = robots[room:]
        robots = robots[:room]
        lines += [_table(robots, width), Text(_hidden(hidden), style="dim")]
    else:
        lines.append(_table(robots, width))
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
    table.add_column("robot", no_wrap=True)
    table.add_column("state", no_wrap=True)
    table.add_column("step", justify="right", no_wrap=True)
    if width >= MEDIUM:
        table.add_column("decisions/s", justify="right", no_wrap=True)
        table.add_column("decide ms", justify="right", no_wrap=True)
        table.add_column("lag ms", justify="right", no_wrap=True)
    if width >= WIDE:
        table.add_column("missed", justify="right", no_wrap=True)
        table.add_column("")
    for robot in robots:
        cells: list[str | Text] = [
            robot.robot,
            Text(robot.state, style=COLOURS[robot.state]),
            _step(robot.step),
        ]
        if width >= MEDIUM:
            cells += [_number(robot.rate_hz), _spread(robot.decide_ms), _spread(robot.lag_ms)]
        if width >= WIDE:
            cells += [str(robot.missed), _remarks(robot)]
        table.add_row(*cells)
    return table


def _remarks(robot: RobotStatus) -> str:
    counts = {
        "solver failures": robot.solver_failures,
        "interventions": robot.interventions,
        "refused": robot.refused,
    }
    return ", ".join([*robot.degraded, *(f"{count} {what}" for what, count in counts.items() if count)])


def _hidden(robots: Sequence[RobotStatus]) -> str:
    states = [robot.state for robot in robots]
    counts = ", ".join(f"{states.count(state)} {state}" for state in COLOURS if state in states)
    return f"and {len(robots)} more: {counts}"


def _step(step: int | None) -> str:
    return "–" if step is None else str(step)


def _number(value: float | None) -> str:
    return "–" if value is None else f"{value:.1f}"


def _spread(spread: Spread | None) -> str:
    return "–" if spread is None else f"{spread.p50:.1f} / {spread.p99:.1f}"


REFRESH_S: Final = 0.5
ONCE_S: Final = 2.0
"""How long is listened before a single look: times and rates are of what came."""
LAST_WORDS_S: Final = 1.0
"""How long the verdict of a run may take that has ended by what else is known."""


class Follower:
    """Looks at a run again and again.

    Args:
        listener: to it.
        interruption: the wish to leave.
        goes_on: whether, as far as is known otherwise, the run goes on; asked at every look.
    """

    def __init__(
        self, listener: Listener, interruption: Interruption, goes_on: Callable[[Status], bool]
    ) -> None:
        self._listener = listener
        self._interruption = interruption
        self._goes_on = goes_on

    def once(self) -> Status:
        """One look, after some listening."""
        until_s = time.monotonic() + ONCE_S
        while time.monotonic() < until_s and not self._is_over():
            self._listener.listen(min(until_s, time.monotonic() + REFRESH_S))
        return self._status()

    def follow(self, show: Callable[[Status], None]) -> bool:
        """Show the run until its verdict, or until that is not wanted any more.

        Returns:
            False where the run has ended without a verdict.
        """
        while True:
            self._listener.listen(time.monotonic() + REFRESH_S)
            status = self._status()
            if not self._goes_on(status):
                self._listener.listen(time.monotonic() + LAST_WORDS_S)
                show(self._status())
                return self._is_over()
            show(status)
            if self._is_over():
                return True

    def _is_over(self) -> bool:
        return self._interruption.requested or self._listener.standing.verdict is not None

    def _status(self) -> Status:
        return self._listener.standing.status(time.monotonic())


def follow_live(follower: Follower, console: Console) -> bool:
    """Follow on a terminal; see :meth:`Follower.follow`."""
    with Live(console=console, auto_refresh=False) as live:
        return follower.follow(
            lambda status: live.update(shown(status, console.width, console.height), refresh=True)
        )
