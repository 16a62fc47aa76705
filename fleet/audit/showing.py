"""An audit and a replay on the terminal."""

from rich import box
from rich.table import Table

from fleet.audit.audit import Report
from fleet.audit.difference import Difference
from fleet.audit.robot_replay import Turn
from fleet.audit.world_replay import Tally
from fleet.run.experiment import VIRTUAL, RunFacts

STEPS_HEADER = "  step   time s  turn rate rad/s  acceleration m/s²  as recorded  decided in ms"


def robot_table(report: Report) -> Table:
    """One row a robot; fits into 80 columns."""
    table = Table(box=box.SIMPLE_HEAD)
    table.add_column("Robot", overflow="fold")
    for header in (
        "Observations",
        "From the\nworld's sensors",
        "Decisions",
        "Minds\nidentical",
        "Commands\nidentical",
    ):
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
    if report.result == "interrupted":
        return "Interrupted: what is shown above has been repeated, the rest has not."
    if report.result == "differs":
        return first_of(report.differences, report.facts, report.repeated_with)
    goals = (
        "The scene holds all goals, as it should in a run with exchanged goals."
        if report.goals_told
        else "The scene holds no goals."
    )
    decisions = sum(robot.minds.recorded for robot in report.robots)
    text = (
        f"Everything follows, bit for bit: all {decisions} decisions from each robot's own observations and "
        f"the scene alone, and all observations from what the robots drove. {goals}{_policy(report.facts)}"
    )
    if report.verdict is None:
        text += (
            f" The recording ends without a verdict: what came after step {report.last_step} is not shown."
        )
    return text


def first_of(differences: tuple[Difference, ...], facts: RunFacts, repeated_with: str) -> str:
    """The first difference, how many more there are, and what may be the reason.

    Args:
        differences: at least one.
        facts: of the recording.
        repeated_with: the version of the software that repeated it.
    """
    first, *others = differences
    text = f"Something does not follow. {first}"
    if others:
        text += f". After it others differ too, such as {others[0].part}s of {_whose(others[0])}"
    if facts.version != repeated_with:
        text += (
            f". The run was recorded with version {facts.version} of the software and repeated with "
            f"{repeated_with}, which may decide otherwise: repeat it with the version that recorded it"
        )
    return f"{text}."


def _policy(facts: RunFacts) -> str:
    if facts.clock == VIRTUAL:
        return ""  # there was no bus
    if facts.policy:
        return " The router delivered nothing else: the policy was in force."
    return " No policy was in force: what else may have reached the robots is not shown."


def _whose(difference: Difference) -> str:
    return "the world" if difference.robot is None else f"robot {difference.robot}"


def step_line(turn: Turn, step_s: float) -> str:
    """One decision under ``STEPS_HEADER``.

    Args:
        turn: the decision.
        step_s: Δt in s.
    """
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
