"""What comes before a run, and the line that shows how it, or a number of them, is getting on."""

from rich.console import Console
from rich.progress import (
    BarColumn,
    MofNCompleteColumn,
    Progress,
    SpinnerColumn,
    TaskID,
    TextColumn,
    TimeElapsedColumn,
    TimeRemainingColumn,
)

from agent.process.warm import compile_in_background
from agent.solve.compiled import is_complete
from fleet.interruption import Interruption
from protocol.messages import Message, Truth

SPEED_S = 600.0
"""The time left is judged by what was done in so many seconds: runs differ much."""


def progress_of_many(console: Console) -> Progress:
    """A bar with the time left; its tasks have a field ``failed``, a text."""
    return Progress(
        TextColumn("{task.description}"),
        BarColumn(),
        MofNCompleteColumn(),
        TextColumn("{task.fields[failed]}"),
        TimeElapsedColumn(),
        TextColumn("left"),
        TimeRemainingColumn(),
        console=console,
        speed_estimate_period=SPEED_S,
    )


class RunProgress(Progress):
    """Shows step, simulated time, arrivals and the smallest distance so far while entered.

    Args:
        console: where to show it; nothing but the last line is shown where that is no terminal.
        begin: what to show before the first step.
    """

    def __init__(self, console: Console, begin: str) -> None:
        super().__init__(
            SpinnerColumn(), TextColumn("{task.description}"), TimeElapsedColumn(), console=console
        )
        self._line: TaskID = self.add_task(begin, total=None)

    def show(self, message: Message) -> None:
        """Take in a truth; other messages change nothing."""
        if isinstance(message, Truth):
            self.update(self._line, description=_line(message))


def _line(truth: Truth) -> str:
    arrived = sum(robot.arrived_s is not None for robot in truth.robots.values())
    closest = "" if truth.minimum_distance_m is None else f" · closest {truth.minimum_distance_m:.2f} m"
    hit = f" · [red]{len(truth.collisions)} collided[/]" if truth.collisions else ""
    return f"step {truth.step} · {truth.time_s:.1f} s · {arrived}/{len(truth.robots)} arrived{closest}{hit}"


def compile_solver(interruption: Interruption) -> None:
    """Wait until the solver is compiled, which takes no time where it has been.

    Raises:
        Refusal: it cannot be compiled or kept.
        KeyboardInterrupt: an interruption came before.
    """
    if not compile_in_background(unwanted=lambda: interruption.requested):
        raise KeyboardInterrupt


def announced(begin: str) -> str:
    """What a run does first, with the wait for the solver if there is one."""
    if is_complete():
        return begin
    return f"compiling the solver (once on this machine, about a minute), then {begin}"
