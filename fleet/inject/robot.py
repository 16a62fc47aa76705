"""``python -m fleet.inject.robot``: one robot's process, as ``python -m agent``, with faults of its mind.

It is told of the faults by ``UNSPOKEN_FAULTS`` and of the run's seed by ``UNSPOKEN_SEED``.
"""

import time
from collections.abc import Callable, Sequence
from typing import Any

from agent.agent import Agent, Decision
from agent.methods import method_of
from agent.process.options import RobotOptions
from agent.process.robot import Decides, run_robot
from agent.solve import joint_solver
from agent.solve.deadline import Deadline
from agent.solve.problem import JointSolver
from chassis.options import with_options
from chassis.refusal import run
from fleet.inject.robot_mind import RobotMind
from fleet.inject.schedule import Scheduled
from fleet.inject.told import faults_told
from protocol.faults import ClockStep, Fault
from protocol.messages import Observation
from protocol.scene import Scene


def make_faulty(options: RobotOptions, scene: Scene) -> Decides:
    """A mind with the faults of the run.

    Raises:
        ValueError: the estimator needs something that the scene does not hold.
    """

    def make(scene: Scene, deadline: Deadline, through: Callable[[JointSolver], JointSolver]) -> Agent:
        solver = through(joint_solver(options.solver, options.iterations, deadline))
        method = method_of(options.goals, scene, options.robot, solver, deadline)
        return Agent(options.robot, options.goal, scene, method, time.perf_counter)

    faults = faults_told(scene)
    mind = RobotMind(make, options.robot, scene, faults, clock=time.perf_counter, budget_s=options.budget_s)
    return ClockStepped(mind, options.robot, faults)


class ClockStepped:
    """A mind in a process whose wall clock jumps.

    Args:
        mind: that decides.
        robot: its id.
        faults: of the run; those of clocks count.
    """

    def __init__(self, mind: Decides, robot: str, faults: Sequence[Scheduled[Fault]]) -> None:
        self._mind = mind
        self._steps: list[Scheduled[Any]] = [
            each for each in faults if isinstance(each.fault, ClockStep) and each.befalls(robot)
        ]

    def decide(self, observation: Observation) -> Decision | None:
        """See :meth:`agent.agent.Agent.decide`."""
        if self._steps:
            step_clock(sum(each.fault.offset_s for each in self._steps if each.is_on(observation.step)))
        return self._mind.decide(observation)

    def withdraw(self) -> None:
        """See :meth:`agent.agent.Agent.withdraw`."""
        self._mind.withdraw()


_time, _time_ns = time.time, time.time_ns


def step_clock(offset_s: float) -> None:
    """From now on the wall clock of this process, as Python tells it, is ahead by so much."""
    offset_ns = round(offset_s * 1e9)
    time.time = lambda: _time() + offset_s
    time.time_ns = lambda: _time_ns() + offset_ns


@with_options(environment=True)
def main(options: RobotOptions) -> None:
    """Be one robot with a mind that has the faults of the run."""
    run_robot(options, make_faulty)


if __name__ == "__main__":
    run(main)
