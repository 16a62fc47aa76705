"""A robot in virtual time with all that lies between it and the world, as its faults let it be."""

import logging
from collections.abc import Callable, Sequence

import structlog

from agent.agent import Agent, Decision
from agent.methods import method_of
from agent.process.inbox import Inbox
from agent.solve import joint_solver
from agent.solve.deadline import Clock, Deadline
from agent.solve.problem import JointSolver
from fleet.inject.link import Link
from fleet.inject.robot_mind import RobotMind, mind_faults
from fleet.inject.schedule import Scheduled
from fleet.run.experiment import RunFacts
from fleet.run.moment import agent_of
from protocol.codec import encode
from protocol.faults import Fault
from protocol.messages import Observation
from protocol.scenario import ScenarioRobot
from protocol.scene import Scene

SILENT = structlog.wrap_logger(None, wrapper_class=structlog.make_filtering_bound_logger(logging.CRITICAL))
"""In virtual time, what is refused is counted, or shows in what does not happen; there is no log of it."""


class VirtualRobot:
    """What a robot's process is on the bus, in one epoch of the world.

    Args:
        link: between the world and the robot.
        epoch: of the world.
        make_mind: called at each start of the robot.
    """

    def __init__(self, link: Link, epoch: int, make_mind: Callable[[], Agent | RobotMind]) -> None:
        self._link = link
        self._epoch = epoch
        self._make_mind = make_mind
        self.start()

    def start(self) -> None:
        """Begin with nothing in memory."""
        self._inbox = Inbox(SILENT)
        self._mind = self._make_mind()

    def due(self, step: int) -> tuple[bytes, ...]:
        """What was said earlier and reaches the world at the beginning of a step."""
        return self._link.due(step)

    def shown(self, observation: Observation, *, runs: bool) -> tuple[Decision | None, tuple[bytes, ...]]:
        """What the robot makes of a step.

        Args:
            observation: as the world gives it.
            runs: whether there is anybody to take it.

        Returns:
            Its decision, and what of it reaches the world; None and nothing where it made none.
        """
        delivery = self._link.observed(observation)
        decision = self._decided(delivery.payloads) if runs else None
        return decision, () if decision is None else self._link.commanded(encode(decision.command))

    def _decided(self, payloads: Sequence[bytes]) -> Decision | None:
        for payload in payloads:
            self._inbox.store(payload)
        if not self._inbox.has_news():
            return None
        newest = self._inbox.next()
        if not isinstance(newest, Observation) or newest.epoch != self._epoch:
            return None  # a process asks the world for its epoch, and stays in the one that it has joined
        return self._mind.decide(newest)


def virtual_robot(
    robot: ScenarioRobot,
    scene: Scene,
    facts: RunFacts,
    faults: Sequence[Scheduled[Fault]],
    clock: Clock,
    epoch: int,
) -> VirtualRobot:
    """A robot of a run with the faults that befall it.

    Raises:
        ValueError: its estimator needs something that the scene does not hold.
    """

    def make(scene: Scene, deadline: Deadline, through: Callable[[JointSolver], JointSolver]) -> Agent:
        solver = through(joint_solver(facts.solver, facts.iterations, deadline))
        method = method_of(facts.goals, scene, robot.id, solver, deadline)
        return Agent(robot.id, robot.goal_pose(), scene, method, clock)

    def make_mind() -> Agent | RobotMind:
        if not mind_faults(faults, robot.id):
            return agent_of(robot, scene, facts, clock, Deadline(clock, facts.budget_s))
        return RobotMind(make, robot.id, scene, faults, clock=clock, budget_s=facts.budget_s)

    return VirtualRobot(Link(faults, robot.id, scene), epoch, make_mind)
