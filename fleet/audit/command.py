"""``unspoken audit`` and ``unspoken replay``: a recorded run repeated, and what came of it shown."""

from bdb import BdbQuit
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from importlib.metadata import version
from pathlib import Path
from typing import Annotated

import typer
from rich import box
from rich.console import Console
from rich.progress import Progress, SpinnerColumn, TextColumn, TimeElapsedColumn
from rich.table import Column, Table

from agent.agent import Agent
from agent.process.warm import warm_up
from chassis.refusal import ExitStatus, Refusal
from fleet.audit.recorded import Difference, RecordedRun, open_run
from fleet.audit.replay import Audit, Report, RobotReplay, Tally, Turn, Watch, first_ones
from fleet.interruption import Interruption, announced, compile_solver
from fleet.record.experiment import VIRTUAL, RunFacts
from fleet.record.report import TO_STDOUT, JsonOption, write_report
from protocol.messages import Observation

STEPS_HEADER = "  step   time s  turn rate rad/s  acceleration m/s²  as recorded  decided in ms"

RunArgument = Annotated[
    Path,
    typer.Argument(
        metavar="RUN", help="The output directory of unspoken run or simulate, or the run.mcap in it."
    ),
]


def audit(run: RunArgument, json: JsonOption = None) -> None:
    """Verify from a recording that each robot decided on its own observations and the scene alone.

    The world is replayed with the recorded commands and must reproduce every observation; each robot is
    replayed with its own recorded observations and must reproduce every decision, bit for bit. This takes as
    long as the original decisions did; Ctrl-C ends it. docs/auditing.md explains what this shows and what it
    cannot.

    Exit status: 0 everything follows; 1 something does not, or interrupted; 2 invalid usage, or not a
    recording; 3 the run cannot be replayed on this machine, or the report cannot be written.
    """
    console = Console(stderr=json == TO_STDOUT, highlight=False)
    with Interruption() as interruption:
        audited = Audit(open_run(run))
        if json not in (None, TO_STDOUT):  # told now and not after minutes
            write_report(audited.report().to_json(), json, ExitStatus.WRONG_USAGE)
        with _repeating(interruption) as watch:
            try:
                compile_solver(interruption)
                audited.go(watch)
            except KeyboardInterrupt:
                pass  # the report says so
        report = audited.report()
        console.print(robot_table(report))
        console.print(conclusion(report), markup=False, soft_wrap=True)
        if json is not None:
            write_report(report.to_json(), json)
    if report.result != "follows":
        raise typer.Exit(ExitStatus.UNMET)


def replay(
    run: RunArgument,
    robot: Annotated[str, typer.Option(help="The robot's id.")],
    steps: Annotated[bool, typer.Option("--steps", help="Print one line per decision.")] = False,
    debug_at: Annotated[
        int | None,
        typer.Option(min=0, metavar="STEP", help="Enter Python's debugger just before this step's decision."),
    ] = None,
) -> None:
    """Replay the decisions of one robot of a recorded run, and compare them with the recorded ones.

    Ctrl-C ends it.

    Exit status: 0 all are identical, bit for bit; 1 they are not, or interrupted; 2 invalid usage, no such
    robot or step, or not a recording; 3 the run cannot be replayed on this machine.
    """
    with Interruption() as interruption:
        recorded = open_run(run)
        repeated = _robot_replay(recorded, run, robot, debug_at)
        differences = recorded.scene_differences()
        done = 0
        if not differences:  # else nothing can be repeated
            try:
                with _repeating(interruption, shown=not steps and debug_at is None) as watch:
                    compile_solver(interruption)
                    warm_up(recorded.facts.goals, recorded.facts.solver)
                    if steps:
                        typer.echo(STEPS_HEADER)
                    for done, turn in enumerate(repeated.turns(_debugger(debug_at)), 1):
                        differences += turn.differences
                        if steps:
                            typer.echo(step_line(turn, recorded.scenario.step_s))
                        watch(robot, done, len(repeated.minds))
            except (KeyboardInterrupt, BdbQuit):
                typer.echo(f"Interrupted: {done} of {len(repeated.minds)} decisions have been repeated.")
                raise typer.Exit(ExitStatus.UNMET) from None
            differences += repeated.surplus
    if differences:
        typer.echo(first_of(first_ones(differences), recorded.facts, version("unspoken")))
        raise typer.Exit(ExitStatus.UNMET)
    typer.echo(f"All {done} decisions of robot {robot} follow, bit for bit, from what it was given.")


def _robot_replay(recorded: RecordedRun, path: Path, robot: str, debug_at: int | None) -> RobotReplay:
    if robot not in recorded.robots:
        raise Refusal(f"{path}: this run has no robot {robot!r}; its robots are {', '.join(recorded.robots)}")
    repeated = RobotReplay(recorded, robot)
    decided = sorted({mind.step for mind in repeated.minds})
    if debug_at is not None and debug_at not in decided:
        there_are = (
            f"it made them from step {decided[0]} to {decided[-1]}" if decided else "it made none at all"
        )
        raise Refusal(f"robot {robot} made no decision at step {debug_at} of this run; {there_are}")
    return repeated


def _debugger(step: int | None) -> Callable[[Agent, Observation], None]:
    """Stops before the decision of this step."""

    def before(agent: Agent, observation: Observation) -> None:
        if observation.step == step:
            breakpoint()  # `agent` decides on `observation` as soon as this function is left

    return before


@contextmanager
def _repeating(interruption: Interruption, *, shown: bool = True) -> Iterator[Watch]:
    """What is yielded shows how repeating gets on, and is the place where it can be interrupted.

    Raises:
        Refusal: the recording is sound, but cannot be repeated on this machine.
    """
    columns = SpinnerColumn(), TextColumn("{task.description}"), TimeElapsedColumn()
    errors = Console(stderr=True, highlight=False)
    with Progress(*columns, console=errors, transient=True, disable=not shown) as progress:
        line = progress.add_task(announced("reading the recording"), total=None)

        def watch(robot: str, done: int, total: int) -> None:
            if interruption.requested:
                raise KeyboardInterrupt
            progress.update(line, description=f"robot {robot}: {done} of {total} decisions")

        try:
            yield watch
        except ModuleNotFoundError as error:
            raise Refusal(f"this run cannot be repeated here: {error}", ExitStatus.FAILED) from None


def robot_table(report: Report) -> Table:
    """One row a robot; fits into 80 columns."""
    table = Table(Column("Robot", overflow="fold"), box=box.SIMPLE_HEAD)
    headers = "Observations", "From the\nworld's sensors", "Decisions", "Minds\nidentical"
    for header in (*headers, "Commands\nidentical"):
        table.add_column(header, justify="right")
    for robot in report.robots:
        table.add_row(
            robot.id,
            str(robot.observations.recorded),
            _how_many(robot.observations),
            str(robot.minds.recorded),
            _how_many(robot.minds),
            _how_many(robot.commands),
        )
    return table


def _how_many(tally: Tally) -> str:
    if tally.identical == tally.recorded:
        return "yes"
    return f"[red]no, {tally.identical} of {tally.recorded}[/]"


def conclusion(report: Report) -> str:
    """What the audit shows, in a few sentences of plain text."""
    facts = report.facts
    if report.result == "interrupted":
        return "Interrupted: what is shown above has been repeated, the rest has not."
    if report.result == "differs":
        return first_of(report.differences, facts, report.repeated_with)
    decisions = sum(robot.minds.recorded for robot in report.robots)
    sentences = [
        f"Everything follows, bit for bit: all {decisions} decisions from each robot's own observations and "
        "the scene alone, and all observations from what the robots drove.",
        "The scene holds all goals, as it should in a run with exchanged goals."
        if report.goals_told
        else "The scene holds no goals.",
    ]
    if facts.clock != VIRTUAL:  # otherwise there was no bus
        sentences.append(
            "The router delivered nothing else: the policy was in force."
            if facts.policy
            else "No policy was in force: what else may have reached the robots is not shown."
        )
    if report.verdict is None:
        sentences.append(
            f"The recording ends without a verdict: what came after step {report.last_step} is not shown."
        )
    return " ".join(sentences)


def first_of(differences: Sequence[Difference], facts: RunFacts, repeated_with: str) -> str:
    """The first of some differences, how many more there are, and what may be the reason.

    The run with these facts was repeated with that version of the software.
    """
    first, *others = differences
    text = f"Something does not follow. {first}"
    if others:
        whose = "the world" if others[0].robot is None else f"robot {others[0].robot}"
        text += f". After it others differ too, such as {others[0].part}s of {whose}"
    if facts.version != repeated_with:
        text += (
            f". The run was recorded with version {facts.version} of the software and repeated with "
            f"{repeated_with}, which may decide otherwise: repeat it with the version that recorded it"
        )
    return f"{text}."


def step_line(turn: Turn, step_s: float) -> str:
    """One decision under ``STEPS_HEADER``, where a step takes ``step_s``."""
    step = turn.recorded.step
    when = f"{step:6d} {step * step_s:8.2f}"
    if turn.repeated is None:
        return f"{when}  {turn.differences[0].repeated}"
    command, mind = turn.repeated.command, turn.repeated.mind
    unlike = " and ".join(difference.part for difference in turn.differences)
    remarks = ["late: withdrawn"] if turn.command is None else []
    remarks += [f"not solved: {', '.join(mind.failed)}"] if mind.failed else []
    return (
        f"{when}  {command.turn_rate_radps:+15.6f}  {command.acceleration_mps2:+17.6f}  "
        f"{f'no: {unlike}' if unlike else 'yes':>11}  {mind.timings_ms.decide:13.1f}  {'; '.join(remarks)}"
    ).rstrip()
