"""Runs over a scripted bus: robots answer at once, or something else happens whenever the world waits."""

import structlog
from world_helpers import EPOCH, command, lanes, sprint

from protocol.codec import encode
from world.bus import Inbox
from world.clock import LockStep, RealTime
from world.health import WorldHealth
from world.run import Run
from world.world import World


class ScriptedInbox(Inbox):
    """Whenever the world would wait, the next thing of the script happens; time passes only then."""

    def __init__(self, robots):
        super().__init__(robots)
        self.script = []
        self.now_s = 0.0

    def take(self, timeout_s):
        if timeout_s > 0.0 and not self._news and not self._interrupted:
            if self.script:
                self.script.pop(0)()
            else:
                self.now_s += timeout_s
        return super().take(0.0)


class ScriptedBus:
    """Records what is published; every robot but the silent ones answers with its sprint."""

    def __init__(self, inbox):
        self.inbox = inbox
        self.silent = set()
        self.observations = []
        self.truths = []
        self.at_step = {}

    def publish_observations(self, observations):
        self.observations.append(observations)
        for robot, seen in observations.items():
            if robot not in self.silent:
                self.answer(robot, seen.step)

    def publish_truth(self, truth):
        self.truths.append(truth)
        self.at_step.pop(truth.step, lambda: None)()

    def answer(self, robot, step, /, **changes):
        told = command(robot, step, sprint(step)).model_copy(update=changes)
        self.inbox.store_command(robot, encode(told))


class Stage:
    """A run of robots on lanes, unless another scenario is given, with everything around it scripted."""

    def __init__(self, count=2, *, real_time=False, scenario=None, **rules):
        self.world = World(scenario or lanes(count, **rules), seed=0, epoch=EPOCH)
        self.inbox = ScriptedInbox(self.world.robots)
        self.bus = ScriptedBus(self.inbox)
        clock = RealTime(0.1, self.now) if real_time else LockStep(60.0, self.now)
        self.health = WorldHealth(self.world.robots)
        self.run = Run(self.world, clock, self.inbox, self.bus, structlog.get_logger(), self.health)
        for robot in self.world.robots:
            self.inbox.store_presence(robot, present=True)
        self.run.wait_for_robots(0.0)

    def now(self):
        return self.inbox.now_s

    def drive(self):
        return self.run.drive()

    def misses(self):
        return {robot: true.deadline_misses for robot, true in self.bus.truths[-1].robots.items()}
