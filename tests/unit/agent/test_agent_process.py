"""The shell of a robot on real sessions inside the test's own process, about an agent that can be slow."""

import threading
from contextlib import contextmanager
from queue import SimpleQueue

import zenoh
from agent_helpers import EPOCH, mind_of, scene_of, seen
from structlog.testing import capture_logs

from agent.agent import Decision
from agent.process.health import RobotHealth
from agent.process.inbox import Inbox
from agent.process.options import RobotOptions
from agent.process.robot import RobotProcess
from protocol.codec import decode, encode
from protocol.keys import Keys
from protocol.messages import Command, Mind, Observation, PublicScene
from protocol.scene import Goal
from protocol.session import world_session

PATIENCE_S = 60.0
KEYS = Keys("run")


class Slow:
    """Stands for the agent: given the world, the next pose comes in during its first two decisions."""

    def __init__(self):
        self.world = None
        self.answered, self.withdrawn = [], []

    def decide(self, observation):
        step = observation.step
        if self.world and len(self.answered) < 2:
            self.world.show(step + 1)
            self.world.wait_until_stored(step + 1)
        self.answered.append(step)
        command = Command(epoch=EPOCH, robot="a", step=step, turn_rate_radps=0.0, acceleration_mps2=0.0)
        return Decision(command, mind_of(step))

    def withdraw(self):
        self.withdrawn.append(self.answered[-1])


class World:
    """Answers for the scene, shows poses, and keeps what the robot says in its order."""

    def __init__(self, session, monkeypatch):
        stored = self._stored = SimpleQueue()
        self.present, self.said = threading.Event(), SimpleQueue()

        class Watched(Inbox):
            def store(self, payload):
                super().store(payload)
                stored.put(decode(Observation, payload).step)

        def answer(query):
            with query:
                query.reply(KEYS.scene_for("a"), encode(PublicScene(epoch=EPOCH, scene=scene_of("a"))))

        def keep(sample):
            kind = {"mind": Mind, "command": Command}.get(KEYS.kind_of(str(sample.key_expr)))
            if kind is not None:
                self.said.put((kind, decode(kind, sample.payload.to_bytes()).step))

        monkeypatch.setattr("agent.process.robot.Inbox", Watched)
        self._poses = session.declare_publisher(KEYS.pose("a"))
        self._declared = (
            session.declare_queryable(KEYS.scene_for("a"), answer),
            session.declare_subscriber(KEYS.everything, keep),  # one for all, which keeps their order
            session.liveliness().declare_subscriber(KEYS.alive("a"), lambda _: self.present.set()),
        )

    def show(self, step, epoch=EPOCH):
        """Publish a pose."""
        pose = seen(step, {"a": (0.0, 0.0, 0.0, 0.0)})
        self._poses.put(encode(pose.model_copy(update={"epoch": epoch})))

    def wait_until_stored(self, step):
        """Until this pose lies in the robot's inbox."""
        while self._stored.get(timeout=PATIENCE_S) != step:
            pass


@contextmanager
def driving(endpoint, monkeypatch, make_agent):
    """A world, and robot a in it on a thread of its own."""
    monkeypatch.setattr("agent.process.robot.compile_in_background", lambda **_: False)
    goal = Goal(x_m=4.0, y_m=0.0, heading_rad=0.0)
    options = RobotOptions(robot="a", goal=goal, connect=endpoint, run=KEYS.run)
    with zenoh.open(world_session(endpoint).to_zenoh()) as session:
        world = World(session, monkeypatch)
        robot = RobotProcess(options, None, make_agent, RobotHealth("a", goal))
        runs = threading.Thread(target=robot.run)
        runs.start()
        assert world.present.wait(PATIENCE_S)
        yield world
        robot.stop()
        runs.join()


def test_a_decision_that_a_newer_pose_has_overtaken_is_thought_but_not_commanded(endpoint, monkeypatch):
    slow = Slow()
    with capture_logs() as log, driving(endpoint, monkeypatch, lambda *_: slow) as world:
        slow.world = world
        world.show(0)
        said = [world.said.get(timeout=PATIENCE_S) for _ in range(4)]
    assert said == [(Mind, 0), (Mind, 1), (Mind, 2), (Command, 2)]
    assert (slow.answered, slow.withdrawn) == ([0, 1, 2], [0, 1])
    assert [entry["so_far"] for entry in log if entry["event"] == "decided too late"] == [1]
    assert (log[-1]["event"], log[-1]["late_decisions"]) == ("stopped", 2)


def test_a_pose_of_another_epoch_does_not_make_a_robot_forget(endpoint, monkeypatch):
    made, said = [], []
    with driving(endpoint, monkeypatch, lambda *_: made.append(Slow()) or made[-1]) as world:
        for step, epoch in ((0, EPOCH), (1, EPOCH + 1), (2, EPOCH)):
            world.show(step, epoch)
            world.wait_until_stored(step)
            if epoch == EPOCH:
                said += [world.said.get(timeout=PATIENCE_S) for _ in range(2)]
    assert said == [(Mind, 0), (Command, 0), (Mind, 2), (Command, 2)]
    assert [agent.answered for agent in made] == [[0, 2]]
