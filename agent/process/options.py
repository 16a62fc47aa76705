"""A robot's options: for the command line, the environment, the file, the check and the facts of a run."""

import stat
from pathlib import Path
from typing import Annotated, Any

import typer
from pydantic import Field

from agent.agent import Agent
from agent.estimate import DEFAULT_GOALS, GoalsName
from agent.methods import method_of
from agent.solve import ITERATIONS, Clock, Deadline, SolverName, joint_solver
from agent.solve.orca import is_available
from chassis.files import Record, read_as
from chassis.healthy import HELP as WATCH_PORT_HELP
from chassis.options import optional
from chassis.refusal import Refusal
from protocol.keys import Id, Name, checked_name
from protocol.scene import MAX_ROBOTS, Goal, Scene


def key_name(value: str) -> str:
    """A name that can stand in a key.

    Raises:
        typer.BadParameter: it cannot.
    """
    try:
        return checked_name(value)
    except ValueError as error:
        raise typer.BadParameter(str(error)) from None


def parse_goal(value: str | Goal) -> Goal:
    """A goal pose from ``x,y,heading`` in m, m and rad.

    Raises:
        typer.BadParameter: it is not three finite numbers of a plausible size.
    """
    if isinstance(value, Goal):  # from the file
        return value
    try:
        x_m, y_m, heading_rad = (float(part) for part in value.split(","))
        return Goal(x_m=x_m, y_m=y_m, heading_rad=heading_rad)
    except ValueError:
        raise typer.BadParameter(
            f"{value!r} found, x,y,heading is expected: three numbers in metres, metres and radians, "
            "such as 4,-4,-0.785"
        ) from None


def checked_goals(value: GoalsName) -> GoalsName:
    """A method that can be used here.

    Raises:
        typer.BadParameter: its library is not installed.
    """
    if value == "orca" and not is_available():
        raise typer.BadParameter(
            "orca needs the library pyrvo, which is not installed; in the clone, install it by "
            "pip install '.[orca]'"
        )
    return value


class DecisionOptions(Record):
    """How robots decide: what the robots of a run have in common."""

    goals: Annotated[GoalsName, typer.Option(metavar="NAME", callback=checked_goals)] = Field(
        DEFAULT_GOALS,
        description="How robots anticipate each other: exchanged (all goals are known); by an estimator: "
        "ioc, joint-fit, kalman-filter, bilevel or constant-acceleration; or by a baseline without goals: "
        "constant-acceleration-alone, constant-velocity or orca.",
    )
    solver: SolverName = Field("realtime", description="Solver for the trajectory problems.")
    iterations: Annotated[int, typer.Option(metavar="N")] = Field(
        ITERATIONS,
        ge=1,
        description="Maximum iterations of the real-time solver per problem and step.",
    )
    budget_ms: Annotated[
        float | None,
        typer.Option(
            metavar="MS",
            show_default="none, so that decisions do not depend on the clock",
        ),
    ] = Field(
        None,
        ge=0,
        description="Time in ms after which the real-time solver stops improving a decision.",
    )
    reserve: Annotated[bool, typer.Option("--reserve/--no-reserve")] = Field(
        True,
        description="Limit each robot to what leaves it and every other one able to brake clear of each "
        "other, or, for experiments, let it follow its plan.",
    )

    def decisions(self) -> dict[str, Any]:
        """These options alone, by name."""
        return self.model_dump(include=set(DecisionOptions.model_fields))

    @property
    def budget_s(self) -> float | None:
        """The time that a decision may take, in s; None for no limit."""
        return None if self.budget_ms is None else self.budget_ms / 1000.0

    def agent(
        self, robot: str, goal: Goal, scene: Scene, clock: Clock, deadline: Deadline | None = None
    ) -> Agent:
        """A robot that decides so; after the deadline, that of the budget unless told otherwise, no better.

        Raises:
            ValueError: the estimator needs something that the scene does not hold.
            ModuleNotFoundError: ORCA's library is not installed.
        """
        deadline = deadline or Deadline(clock, self.budget_s)
        solver = joint_solver(self.solver, self.iterations, deadline)
        method = method_of(self.goals, scene, robot, solver, deadline)
        return Agent(robot, goal, scene, method, clock, keeps_reserve=self.reserve)


class RobotOptions(DecisionOptions):
    """What a robot's process is told at its start."""

    robot: Annotated[Id, typer.Option(metavar="NAME", callback=key_name)] = Field(
        description="This robot's id in the scenario."
    )
    goal: Annotated[Goal, typer.Option(metavar="X,Y,HEADING", parser=parse_goal)] = Field(
        description="Its own goal pose in m, m and rad. Set it in the environment to hide it from process "
        "lists."
    )
    connect: Annotated[str, typer.Option(metavar="ENDPOINT")] = Field(
        "tcp/127.0.0.1:7447", min_length=1, max_length=4096, description="Zenoh endpoint of the world."
    )
    password_file: Annotated[
        Path | None, typer.Option(metavar="FILE", show_default="none, for a world that asks for none")
    ] = Field(None, strict=False, description="File with this robot's password, readable only by you.")
    keys: Annotated[Path | None, typer.Option(metavar="DIR", show_default="none")] = Field(
        None,
        strict=False,
        description="Folder with this robot's keys, created by 'unspoken keys'; for an endpoint tls/….",
    )
    run: Annotated[Name, typer.Option(metavar="NAME", callback=key_name)] = Field(
        "run", description="Name of the run, the first part of all its Zenoh keys."
    )
    watch_port: Annotated[int | None, typer.Option(metavar="PORT", show_default="none")] = Field(
        None, ge=0, le=65535, description=WATCH_PORT_HELP
    )
    robots: Annotated[int, typer.Option(metavar="N")] = Field(
        8,
        ge=1,
        le=MAX_ROBOTS,
        description="With --check: number of robots to assume if no world can be asked.",
    )

    def as_environment(self) -> dict[str, str]:
        """The options that are not as by default, by name, as the environment says them."""
        changed = self.model_dump(mode="json", exclude_defaults=True, exclude={"goal"})
        return {name: str(value) for name, value in changed.items()} | {
            "goal": f"{self.goal.x_m!r},{self.goal.y_m!r},{self.goal.heading_rad!r}"
        }


FileOptions = optional(RobotOptions)
"""What a file may hold: any of the options, under its name. ``docs/agent.md`` explains each."""


def options_in(path: Path) -> dict[str, Any]:
    """The options that a file sets, by name, as the command line takes them.

    Raises:
        Refusal: the file cannot be read or is not valid, with a line for each mistake; or it holds the
            robot's goal, and everybody can read it.
    """
    file = read_as(path, FileOptions, "file of a robot's options")
    options = {name: getattr(file, name) for name in file.model_fields_set}
    options = {name: value for name, value in options.items() if value is not None}
    mode = stat.S_IMODE(path.stat().st_mode)
    if "goal" in options and mode & stat.S_IROTH:
        raise Refusal(
            f"{path}: everybody on this device can read the robot's goal (mode {mode:04o}), which it tells "
            f"nobody; run: chmod o= {path}"
        )
    folder = path.absolute().parent
    return {name: folder / value if isinstance(value, Path) else value for name, value in options.items()}
