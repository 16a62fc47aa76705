"""The shell of a robot on real sessions inside the test's own process, about an agent that can be slow."""

import threading
from queue import SimpleQueue

import zenoh
from agent_helpers import EPOCH, scene_of, seen
from structlog.testing import capture_logs

from agent.agent import Decision
from agent.process.health import RobotHealth
from agent.process.inbox import Inbox
from agent.process.options import RobotOptions
from agent.process.robot import RobotProcess
from protocol.codec import decode, encode
from protocol.keys import Keys
from protocol.messages import Command, Mind, Observation, PublicScene, Timings
from protocol.scene import Goal
from protocol.session import world_session

PATIENCE_S = 60.0
KEYS = Keys("run")


class Slow:
    """Stands for the agent: where it is given the world, the next pose comes in during its first decision."""

    def __init__(self, world=None):
        self._world = world
        self.answered, self.withdrawn = [], []

    def decide(self, observation):
        step = observation.step
        if self._world and not self.answered:
            self._world.show(step + 1)
            self._world.wait_until_stored(step + 1)
        self.answered.append(step)
        return Decision(
            Command(epoch=EPOCH, robot="a", step=step, turn_rate_radps=0.0, acceleration_mps2=0.0),
            Mind(
                epoch=EPOCH,
                robot="a",
                step=step,
                decision=step,
                arrived=False,
                estimates={},
                prediction={},
                plan=(),
                failed=(),
                solver_failures=0,
                cut_short_at=None,
                timings_ms=Timings(),
            ),
        )

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


def robot_of(endpoint, make_agent):
    goal = Goal(x_m=4.0, y_m=0.0, heading_rad=0.0)
    options = RobotOptions(robot="a", goal=goal, connect=endpoint, run=KEYS.run)
    return RobotProcess(options, None, make_agent, RobotHealth("a", goal))


def test_a_decision_that_a_newer_pose_has_overtaken_is_thought_but_not_commanded(endpoint, monkeypatch):
    with zenoh.open(world_session(endpoint).to_zenoh()) as session, capture_logs() as log:
        world = World(session, monkeypatch)
        slow = Slow(world)
        monkeypatch.setattr("agent.process.robot.compile_in_background", lambda **_: False)
        robot = robot_of(endpoint, lambda *_: slow)
        runs = threading.Thread(target=robot.run)
        runs.start()
        assert world.present.wait(PATIENCE_S)
        world.show(0)
        said = [world.said.get(timeout=PATIENCE_S) for _ in range(3)]
        robot.stop()
        runs.join()
    assert said == [(Mind, 0), (Mind, 1), (Command, 1)]
    assert (slow.answered, slow.withdrawn) == ([0, 1], [0])
    told = [(entry["event"], entry.get("late_decisions")) for entry in log]
    assert ("decided too late", None) in told
    assert told[-1] == ("stopped", 1)


def test_a_pose_of_another_epoch_does_not_make_a_robot_forget(endpoint, monkeypatch):
    with zenoh.open(world_session(endpoint).to_zenoh()) as session:
        world, made = World(session, monkeypatch), []
        monkeypatch.setattr("agent.process.robot.compile_in_background", lambda **_: False)
        robot = robot_of(endpoint, lambda *_: made.append(Slow()) or made[-1])
        runs = threading.Thread(target=robot.run)
        runs.start()
        assert world.present.wait(PATIENCE_S)
        said = []
        for step, epoch in ((0, EPOCH), (1, EPOCH + 1), (2, EPOCH)):
            world.show(step, epoch)
            world.wait_until_stored(step)
            if epoch == EPOCH:
                said += [world.said.get(timeout=PATIENCE_S) for _ in range(2)]
        robot.stop()
        runs.join()
    assert said == [(Mind, 0), (Command, 0), (Mind, 2), (Command, 2)]
    assert [agent.answered for agent in made] == [[0, 2]]
