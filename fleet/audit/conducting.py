"""Conducts an audit and a replay for a person: shows how it is getting on and what came of it."""

import time
from bdb import BdbQuit
from collections.abc import Callable, Sequence
from importlib.metadata import version
from pathlib import Path

from rich.console import Console
from rich.progress import Progress, SpinnerColumn, TextColumn, TimeElapsedColumn

from agent.agent import Agent
from agent.process.warm import warm_up
from chassis import refusal
from fleet.audit.audit import Audit, first_ones
from fleet.audit.difference import Difference
from fleet.audit.recorded import RecordedRun, open_run
from fleet.audit.robot_replay import RobotReplay
from fleet.audit.showing import STEPS_HEADER, conclusion, first_of, robot_table, step_line
from fleet.interruption import Interruption
from fleet.record.recording import RecordingError
from fleet.record.report_file import TO_STDOUT, write_report
from fleet.run.processes import ProcessFailedError
from fleet.run.progress import announced, compile_solver
from protocol.messages import Observation
from world.process import ExitStatus


class UnknownError(Exception):
    """The run has no such robot or decision; the text says which there are."""


def conduct_audit(path: Path, json: Path | None) -> ExitStatus:
    """Audit a run and print what came of it.

    Args:
        path: of the recording or its directory.
        json: where the report goes as JSON; ``-`` is the standard output, and all else then goes to the
            standard error.
    """
    errors = Console(stderr=True, highlight=False)
    console = errors if json == TO_STDOUT else Console(highlight=False)

    def audit(interruption: Interruption) -> ExitStatus:
        audit = Audit(open_run(path))
        if json not in (None, TO_STDOUT):  # a mistake in the path is told now, not after minutes
            write_report(audit.report().to_json(), json, refusal.ExitStatus.WRONG_USAGE)
        with _Watching(interruption, errors) as watching:
            try:
                compile_solver(interruption)
                audit.go(watching.watch)
            except KeyboardInterrupt:
                pass  # the report says so
        report = audit.report()
        console.print(robot_table(report))
        _say(console, conclusion(report))
        if json is not None:
            write_report(report.to_json(), json)
        return ExitStatus.ARRIVED if report.result == "follows" else ExitStatus.ENDED_OTHERWISE

    return _conducted(audit, errors)


def conduct_replay(path: Path, robot: str, *, steps: bool, debug_at: int | None) -> ExitStatus:
    """Repeat one robot's decisions and print what came of it.

    Args:
        path: of the recording or its directory.
        robot: its id.
        steps: whether each decision is shown.
        debug_at: the step whose decision is entered with Python's debugger; None for none.
    """
    console, errors = Console(highlight=False), Console(stderr=True, highlight=False)

    def replay(interruption: Interruption) -> ExitStatus:
        run = open_run(path)
        if robot not in run.robots:
            raise UnknownError(
                f"{path}: this run has no robot {robot!r}; its robots are {', '.join(run.robots)}"
            )
        scene_difference = run.scene_difference()
        if scene_difference is not None:  # then nothing can be repeated
            return _told(console, run, [scene_difference])
        replay = RobotReplay(run, robot, time.perf_counter)
        _check_decision(replay, debug_at)
        differences: list[Difference] = []
        done = 0
        try:
            with _Watching(interruption, errors, shown=not steps and debug_at is None) as watching:
                compile_solver(interruption)
                warm_up(run.facts.goals, run.facts.solver)
                if steps:
                    _say(console, STEPS_HEADER)
                for turn in replay.turns(_debugger(debug_at)):
                    done += 1
                    differences += turn.differences
                    if steps:
                        _say(console, step_line(turn, run.scenario.step_s))
                    watching.watch(robot, done, len(replay.minds))
        except (KeyboardInterrupt, BdbQuit):
            _say(console, f"Interrupted: {done} of {len(replay.minds)} decisions have been repeated.")
            return ExitStatus.ENDED_OTHERWISE
        differences += replay.surplus
        if not differences:
            _say(
                console, f"All {done} decisions of robot {robot} follow, bit for bit, from what it was given."
            )
            return ExitStatus.ARRIVED
        return _told(console, run, differences)

    return _conducted(replay, errors)


def _check_decision(replay: RobotReplay, step: int | None) -> None:
    decided = sorted({mind.step for mind in replay.minds})
    if step is None or step in decided:
        return
    there_are = f"it made them from step {decided[0]} to {decided[-1]}" if decided else "it made none at all"
    raise UnknownError(f"robot {replay.robot} made no decision at step {step} of this run; {there_are}")


def _debugger(step: int | None) -> Callable[[Agent, Observation], None]:
    """Stops before the decision of this step."""

    def before(agent: Agent, observation: Observation) -> None:
        if observation.step == step:
            breakpoint()  # `agent` decides on `observation` as soon as this function is left

    return before


def _told(console: Console, run: RecordedRun, differences: Sequence[Difference]) -> ExitStatus:
    _say(console, first_of(first_ones(differences), run.facts, version("unspoken")))
    return ExitStatus.ENDED_OTHERWISE


class _Watching(Progress):
    """The line that shows how repeating gets on, and the place where it can be interrupted."""

    def __init__(self, interruption: Interruption, errors: Console, *, shown: bool = True) -> None:
        columns = SpinnerColumn(), TextColumn("{task.description}"), TimeElapsedColumn()
        super().__init__(*columns, console=errors, transient=True, disable=not shown)
        self._interruption = interruption
        self._line = self.add_task(announced("reading the recording"), total=None)

    def watch(self, robot: str, done: int, total: int) -> None:
        """Some decisions of a robot have been repeated."""
        if self._interruption.requested:
            raise KeyboardInterrupt
        self.update(self._line, description=f"robot {robot}: {done} of {total} decisions")


def _conducted(work: Callable[[Interruption], ExitStatus], errors: Console) -> ExitStatus:
    """Do the work with signals taken over, and tell what prevented it."""
    with Interruption() as interruption:
        try:
            return work(interruption)
        except (RecordingError, UnknownError) as error:
            _say(errors, f"unspoken: {error}")
            return ExitStatus.WRONG_USAGE
        except (ProcessFailedError, ModuleNotFoundError) as error:
            _say(errors, f"unspoken: this run cannot be repeated here: {error}")
            return ExitStatus.FAILED


def _say(console: Console, text: str) -> None:
    """Long lines hold paths and values, which are not to be broken."""
    console.print(text, markup=False, soft_wrap=True)
