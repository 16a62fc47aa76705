"""``python -m fleet.inject.robot``: one robot's process, as ``python -m agent``, with the faults of its mind.

It is told of the faults by ``UNSPOKEN_FAULTS`` and of the run's seed by ``UNSPOKEN_SEED``.
"""

import time

from agent.agent import Decision
from agent.process.options import RobotOptions
from agent.process.robot import Decides, run_robot
from chassis.options import with_options
from chassis.refusal import run
from fleet.inject.fault import of_kind
from fleet.inject.mind import ClockStep, FaultyMind
from fleet.inject.scenario import faults_of_this_process
from protocol.messages import Observation
from protocol.scene import Scene

_time, _time_ns = time.time, time.time_ns


class MindOfProcess(FaultyMind):
    """Lives in a process of its own, whose wall clock may jump."""

    def decide(self, observation: Observation) -> Decision | None:
        """See :meth:`agent.agent.Agent.decide`."""
        if steps := of_kind(self._faults, ClockStep):
            step_clock(sum(each.fault.offset_s for each in steps if each.is_on(observation.step)))
        return super().decide(observation)


def step_clock(offset_s: float) -> None:
    """From now on the wall clock of this process, as Python tells it, is ahead by so much."""
    offset_ns = round(offset_s * 1e9)
    time.time = lambda: _time() + offset_s
    time.time_ns = lambda: _time_ns() + offset_ns


@with_options(environment=True)
def main(options: RobotOptions) -> None:
    """Be one robot with a mind that has the faults of the run."""

    def make_faulty(options: RobotOptions, scene: Scene) -> Decides:
        faults, clock = faults_of_this_process(scene), time.perf_counter
        return MindOfProcess(options.robot, options.goal, scene, faults, options, clock)

    run_robot(options, make_faulty)


if __name__ == "__main__":
    run(main)
