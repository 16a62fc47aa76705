"""``python hanging.py agent|world``: such a process, as started by its own module, that hangs at step 3.

Its loop is then stuck in the middle of a step, while all its other threads go on.
"""

import sys
import threading
from typing import Any

import chassis.health
import world.__main__
from agent.agent import Decision
from agent.process.options import RobotOptions
from agent.process.robot import Decides, make_agent, run_robot
from chassis.options import with_options
from chassis.refusal import run
from protocol.messages import Observation
from protocol.scene import Scene
from world.world import World

STEP = 3


class Hanging:
    def __init__(self, mind: Decides) -> None:
        self._mind = mind

    def decide(self, observation: Observation) -> Decision | None:
        if observation.step >= STEP:
            threading.Event().wait()
        return self._mind.decide(observation)

    def withdraw(self) -> None:
        self._mind.withdraw()


def hanging_agent(options: RobotOptions, scene: Scene) -> Decides:
    return Hanging(make_agent(options, scene))


class HangingWorld(World):
    def advance(self, commands: Any) -> Any:
        if self.step >= STEP:
            threading.Event().wait()
        return super().advance(commands)


@with_options(environment=True)
def robot(options: RobotOptions) -> None:
    run_robot(options, hanging_agent)


if __name__ == "__main__":
    what = sys.argv.pop(1)
    chassis.health.LONGEST_SILENCE_S = 1.0  # so that the test need not wait for ten
    if what == "world":
        world.__main__.World = HangingWorld  # type: ignore[misc]
    run(robot if what == "agent" else world.__main__.main)
