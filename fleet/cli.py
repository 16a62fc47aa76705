"""The command line ``unspoken``."""

import re
from datetime import datetime
from functools import partial
from pathlib import Path
from typing import Annotated, Any

import typer

import agent.__main__
import world.__main__
import world.ros2.__main__
from agent.cli import VersionOption
from agent.estimate import DEFAULT_GOALS, GoalsName
from agent.solve import ITERATIONS, SolverName
from fleet.audit.command import audit, replay
from fleet.bench.command import bench
from fleet.evaluate.command import evaluate
from fleet.faults.command import faults
from fleet.keys.command import app as keys
from fleet.report.command import report
from fleet.run.compiling import announced
from fleet.run.conduct import Stream, conduct
from fleet.run.experiment import VIRTUAL, Experiment, prepare
from fleet.run.live import run_processes
from fleet.run.supervision import Restart
from fleet.run.virtual import simulate as simulate_messages
from fleet.scenarios.command import app as scenarios
from fleet.status.command import status
from protocol.scenario import ScenarioError
from world.process import ClockKind, ExitStatus

app = typer.Typer(
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
    help="Mobile robots that cross each other's way without communicating.",
)

bridge = typer.Typer(no_args_is_help=True, help="Real robots in place of simulated ones.")
bridge.command("ros2")(world.ros2.__main__.main)


@bridge.callback()
def _bridges() -> None:
    """With a single command in it, this keeps the command's name."""


ScenarioArgument = Annotated[
    str, typer.Argument(metavar="SCENARIO", help="A scenario file, or the name of a bundled one such as 8a.")
]
GoalsOption = Annotated[
    GoalsName,
    typer.Option(callback=agent.__main__.checked_goals, help=agent.__main__.GOALS_HELP),
]
SolverOption = Annotated[SolverName, typer.Option(help="What solves the trajectory problems.")]
IterationsOption = Annotated[int, typer.Option(min=1, help=agent.__main__.ITERATIONS_HELP)]
SeedOption = Annotated[int, typer.Option(min=0, help="Of sensor noise and dropouts.")]
FaultsOption = Annotated[
    Path | None,
    typer.Option(
        help="A file of faults that are to befall the run, besides those of the scenario.",
        metavar="FILE",
        dir_okay=False,
    ),
]
OutOption = Annotated[
    Path | None,
    typer.Option(
        help="Directory for the output, new or empty.",
        show_default="runs/<scenario>-<goals>-<time>",
        file_okay=False,
    ),
]


@app.command()
def run(
    scenario: ScenarioArgument,
    goals: GoalsOption = DEFAULT_GOALS,
    clock: Annotated[
        ClockKind,
        typer.Option(help="Wait for every robot at every step, or publish one step every Δt."),
    ] = ClockKind.LOCKSTEP,
    solver: SolverOption = "realtime",
    iterations: IterationsOption = ITERATIONS,
    budget_ms: Annotated[
        float | None,
        typer.Option(
            callback=agent.__main__.checked_budget,
            help=agent.__main__.BUDGET_HELP,
            show_default="half of Δt with --clock realtime, otherwise none",
        ),
    ] = None,
    seed: SeedOption = 0,
    faults: FaultsOption = None,
    policy: Annotated[
        bool,
        typer.Option(
            "--policy/--no-policy",
            help="Let every process read and say what it is granted and nothing else, or let all do all.",
        ),
    ] = True,
    restart: Annotated[
        Restart, typer.Option(help="Whether a process that fails before the run is over is started again.")
    ] = Restart.NEVER,
    out: OutOption = None,
) -> None:
    """Run a scenario in real processes: a world, and one process per robot.

    Exit status: 0 all robots arrived without collision, 1 the run ended otherwise, 2 wrong usage or
    scenario, 3 a process failed.
    """
    experiment = _prepared(
        scenario,
        goals=goals,
        solver=solver,
        clock=clock.value,
        seed=seed,
        iterations=iterations,
        budget_ms=budget_ms,
        policy=policy,
        faults=faults,
    )
    begin = f"starting the world and {_robots(experiment)}"
    _conduct(experiment, out, partial(run_processes, experiment, restart=restart), begin)


@app.command()
def simulate(
    scenario: ScenarioArgument,
    goals: GoalsOption = DEFAULT_GOALS,
    clock: Annotated[
        ClockKind,
        typer.Option(help="Taken as for run; in virtual time no command is late, so both drive the same."),
    ] = ClockKind.LOCKSTEP,
    solver: SolverOption = "realtime",
    iterations: IterationsOption = ITERATIONS,
    seed: SeedOption = 0,
    faults: FaultsOption = None,
    out: OutOption = None,
) -> None:
    """Run a scenario in virtual time: the same world and robots in this one process.

    Exit status: 0 all robots arrived without collision, 1 the run ended otherwise, 2 wrong usage or scenario.
    """
    experiment = _prepared(
        scenario,
        goals=goals,
        solver=solver,
        clock=VIRTUAL,
        seed=seed,
        iterations=iterations,
        faults=faults,
    )
    _conduct(
        experiment,
        out,
        lambda _logs, interruption: simulate_messages(experiment, interruption),
        f"preparing {_robots(experiment)}",
    )


app.command("world")(world.__main__.main)
app.command("agent")(agent.__main__.main)
app.command("status")(status)
app.add_typer(bridge, name="bridge")
app.command("bench")(bench)
app.add_typer(scenarios, name="scenarios")
app.add_typer(keys, name="keys")
app.command("evaluate")(evaluate)
app.command("report")(report)
app.command("faults")(faults)
app.command("audit")(audit)
app.command("replay")(replay)


@app.callback()
def _options(_version: VersionOption = False) -> None:
    """Options of the command itself."""


def _prepared(scenario: str, **choices: Any) -> Experiment:
    try:
        return prepare(scenario, **choices)
    except ScenarioError as error:
        typer.echo(str(error), err=True)
        raise typer.Exit(ExitStatus.WRONG_USAGE) from None


def _conduct(experiment: Experiment, out: Path | None, stream: Stream, begin: str) -> None:
    facts = experiment.facts
    name = re.sub(r"[^\w.-]", "-", facts.scenario)  # it may hold anything, a slash too
    directory = out or Path("runs") / f"{name}-{facts.goals}-{datetime.now():%Y%m%d-%H%M%S}"
    raise typer.Exit(conduct(experiment, directory, stream, announced(begin)))


def _robots(experiment: Experiment) -> str:
    count = len(experiment.scenario.robots)
    return "1 robot" if count == 1 else f"{count} robots"
