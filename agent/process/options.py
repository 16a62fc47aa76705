"""A robot's options in a file, for a device that starts by itself; the command line and environment win."""

import stat
from pathlib import Path
from typing import Annotated, Any

from pydantic import Field

from agent.estimate import GoalsName
from agent.solve import SolverName
from chassis.files import Record
from chassis.refusal import Refusal
from chassis.yaml_file import read_as
from protocol.keys import Id, Name
from protocol.scene import MAX_ROBOTS, Goal

Text = Annotated[str, Field(min_length=1, max_length=4096)]


class Configuration(Record):
    """What the file may hold: any of the options, under its name. ``docs/agent.md`` explains each."""

    robot: Id | None = None
    goal: Goal | None = None
    connect: Text | None = None
    password_file: Text | None = None
    """Like ``keys``: seen from the folder of the file."""
    keys: Text | None = None
    run: Name | None = None
    goals: GoalsName | None = None
    solver: SolverName | None = None
    iterations: Annotated[int, Field(ge=1)] | None = None
    budget_ms: Annotated[float, Field(ge=0)] | None = None
    watch_port: Annotated[int, Field(ge=0, le=65535)] | None = None
    robots: Annotated[int, Field(ge=1, le=MAX_ROBOTS)] | None = None


def options_in(path: Path) -> dict[str, Any]:
    """The options that a file sets, by name, as the command line takes them.

    Raises:
        Refusal: the file cannot be read or is not valid, with a line for each mistake; or it holds the
            robot's goal, and everybody can read it.
    """
    file = read_as(path, Configuration, "file of a robot's options")
    options = file.model_dump(exclude_none=True, exclude={"goal"})
    if file.goal is not None:
        _refuse_readers(path)
        options["goal"] = ",".join(map(repr, (file.goal.x_m, file.goal.y_m, file.goal.heading_rad)))
    folder = path.absolute().parent
    return options | {
        name: str(folder / options[name]) for name in ("password_file", "keys") if name in options
    }


def _refuse_readers(path: Path) -> None:
    mode = stat.S_IMODE(path.stat().st_mode)
    if mode & stat.S_IROTH:
        raise Refusal(
            f"{path}: everybody on this device can read the robot's goal (mode {mode:04o}), which it tells "
            f"nobody; run: chmod o= {path}"
        )
