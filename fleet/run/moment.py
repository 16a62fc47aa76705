"""One step of a run in virtual time, and the robots that take part in it."""

from collections.abc import Mapping
from typing import NamedTuple

from agent.agent import Agent, Decision
from agent.solve.deadline import Clock, Deadline
from fleet.run.experiment import RunFacts
from protocol.messages import Command, Observation, Truth
from protocol.scenario import ScenarioRobot
from protocol.scene import Scene

EPOCH = 0
"""Of the first world; what it says depends on nothing but the run."""


class Moment(NamedTuple):
    """One step: how things stand, what each robot is shown of them, and what comes of it."""

    truth: Truth
    observations: Mapping[str, Observation]
    """As the world gives them; faults may let something else reach a robot."""
    decisions: Mapping[str, Decision]
    """Of the robots that made one; in the last moment nobody does."""
    commands: Mapping[str, tuple[Command, ...]]
    """What reached the world from each robot, taken or not; with faults, this may not be what was decided."""


def agent_of(
    robot: ScenarioRobot,
    scene: Scene,
    facts: RunFacts,
    clock: Clock,
    deadline: Deadline,
) -> Agent:
    """A robot of a run, which has not seen anything yet.

    Raises:
        ValueError: its estimator needs something that the scene does not hold.
        ModuleNotFoundError: the library of a baseline is not installed here.
    """
    return Agent.of(
        robot.id,
        robot.goal_pose(),
        scene,
        goals=facts.goals,
        solver=facts.solver,
        clock=clock,
        iterations=facts.iterations,
        deadline=deadline,
    )
