"""``unspoken run`` and ``unspoken simulate``: one run, shown while it goes on, kept, and how it ended."""

import re
from collections.abc import Callable, Iterator
from contextlib import closing
from datetime import datetime
from functools import partial
from pathlib import Path
from typing import Annotated

import typer
from rich.console import Console
from rich.progress import Progress, SpinnerColumn, TextColumn, TimeElapsedColumn

from agent.process.options import DecisionOptions
from chassis.options import with_options
from chassis.refusal import ExitStatus, Refusal
from fleet.inject.scenario import warnings_of
from fleet.interruption import Interruption, announced
from fleet.record.experiment import VIRTUAL, Experiment, prepare
from fleet.record.output import Output
from fleet.record.recording import BusMessage, StreamItem
from fleet.record.summary import remarks, robot_table, verdict_line
from fleet.run import virtual
from fleet.run.launch import run_processes
from fleet.run.processes import Restart
from protocol.messages import Truth
from world.clock import ClockKind

Stream = Callable[[Path, Interruption], Iterator[StreamItem]]
"""Makes a run's messages, given the directory for logs and the wish to end."""

ScenarioArgument = Annotated[
    str, typer.Argument(metavar="SCENARIO", help="A scenario file, or the name of a bundled one such as 8a.")
]
SeedOption = Annotated[
    int, typer.Option(min=0, metavar="N", help="Seed of sensor noise, dropouts and random faults.")
]
FAULTS_HELP = "File of faults to inject in addition to those of the scenario."
FaultsOption = Annotated[Path | None, typer.Option(help=FAULTS_HELP, metavar="FILE", dir_okay=False)]
OutOption = Annotated[
    Path | None,
    typer.Option(
        help="Output directory, new or empty.",
        metavar="DIR",
        show_default="runs/<scenario>-<goals>-<time>",
        file_okay=False,
    ),
]


@with_options(budget_ms={"show_default": "half of Δt with --clock realtime, otherwise none"})
def run(
    scenario: ScenarioArgument,
    decisions: DecisionOptions,
    clock: Annotated[
        ClockKind,
        typer.Option(help="Wait for every robot at every step, or publish a step every Δt."),
    ] = ClockKind.LOCKSTEP,
    seed: SeedOption = 0,
    faults: FaultsOption = None,
    policy: Annotated[
        bool,
        typer.Option(
            "--policy/--no-policy",
            help="Limit each process to what it is granted to read and send, or let every process do "
            "everything.",
        ),
    ] = True,
    restart: Annotated[
        Restart, typer.Option(help="Whether to restart a process that fails before the run is over.")
    ] = Restart.NEVER,
    out: OutOption = None,
) -> None:
    """Run a scenario in real processes: a world, and one process per robot.

    Exit status: 0 all robots arrived without collision, 1 the run ended otherwise, 2 invalid usage or
    scenario, 3 a process failed.
    """
    experiment = prepare(scenario, decisions, clock=clock.value, seed=seed, policy=policy, faults=faults)
    begin = f"starting the world and {_robots(experiment)}"
    conduct(experiment, out, partial(run_processes, experiment, restart=restart), begin)


@with_options(without=["budget_ms"])
def simulate(
    scenario: ScenarioArgument,
    decisions: DecisionOptions,
    clock: Annotated[
        ClockKind,
        typer.Option(
            help="Accepted as for run; in virtual time no command is late, so both give the same run."
        ),
    ] = ClockKind.LOCKSTEP,
    seed: SeedOption = 0,
    faults: FaultsOption = None,
    out: OutOption = None,
) -> None:
    """Run a scenario in virtual time: the same world and robots in a single process.

    Exit status: 0 all robots arrived without collision, 1 the run ended otherwise, 2 invalid usage or
    scenario.
    """
    experiment = prepare(scenario, decisions, clock=VIRTUAL, seed=seed, faults=faults)
    begin = f"preparing {_robots(experiment)}"
    conduct(experiment, out, lambda _, interruption: virtual.simulate(experiment, interruption), begin)


def _robots(experiment: Experiment) -> str:
    count = len(experiment.scenario.robots)
    return "1 robot" if count == 1 else f"{count} robots"


def conduct(experiment: Experiment, out: Path | None, stream: Stream, begin: str) -> None:
    """Run an experiment to its end, leave its output in a directory and print the verdict.

    Args:
        experiment: what to run.
        out: for the output, new or empty; None for one named after the experiment and the time.
        stream: what runs it.
        begin: what to show until the first step.

    Raises:
        typer.Exit: not all robots arrived without collision.
        Refusal: the output cannot be written, or a process failed; what there is has been kept and shown.
    """
    facts = experiment.facts
    failure: Refusal | None = None
    name = re.sub(r"[^\w.-]", "-", facts.scenario)  # it may hold anything, a slash too
    directory = out or Path("runs") / f"{name}-{facts.goals}-{datetime.now():%Y%m%d-%H%M%S}"
    console = Console(highlight=False)
    columns = SpinnerColumn(), TextColumn("{task.description}"), TimeElapsedColumn()
    with Interruption() as interruption:
        output = Output(directory, experiment)
        for warning in warnings_of(experiment.scenario):
            typer.echo(f"Warning: {warning}.", err=True)
        try:
            with output, Progress(*columns, console=console) as progress:
                line = progress.add_task(announced(begin), total=None)

                def show(truth: Truth) -> None:
                    progress.update(line, description=_progress(truth))

                _follow(stream(output.logs, interruption), output, show, interruption)
        except KeyboardInterrupt:
            pass  # the verdict says so
        except Refusal as refusal:
            failure = refusal
        try:
            summary = output.finish(without_verdict="interrupted" if failure is None else "failed")
        except Refusal as refusal:
            sentences = map(str, filter(None, (failure, refusal)))
            raise Refusal("\n".join(sentences), ExitStatus.FAILED) from None
        if summary.robots:
            console.print(robot_table(summary, output.tally.clipped_commands))
        console.print(verdict_line(summary, experiment.scenario.step_s))
        written = ", ".join(sorted(path.name for path in output.directory.iterdir()))
        for remark in (*remarks(summary), f"Recorded in {output.directory}: {written}"):
            console.print(remark, markup=False, soft_wrap=True)
        if failure is not None:
            raise failure
    if summary.verdict != "arrived":
        raise typer.Exit(ExitStatus.UNMET)


def _follow(
    messages: Iterator[StreamItem],
    output: Output,
    show: Callable[[Truth], None],
    interruption: Interruption,
) -> None:
    """Take every message, until the user insists on the end."""
    with closing(messages):  # type: ignore[type-var]  # generators, whose closing ends the processes
        for item in messages:
            output.take(item)
            if isinstance(item, BusMessage) and isinstance(item.message, Truth):
                show(item.message)
            if interruption.insisted:
                return


def _progress(truth: Truth) -> str:
    arrived = sum(robot.arrived_s is not None for robot in truth.robots.values())
    closest = "" if truth.minimum_distance_m is None else f" · closest {truth.minimum_distance_m:.2f} m"
    hit = f" · [red]{len(truth.collisions)} collided[/]" if truth.collisions else ""
    return f"step {truth.step} · {truth.time_s:.1f} s · {arrived}/{len(truth.robots)} arrived{closest}{hit}"
