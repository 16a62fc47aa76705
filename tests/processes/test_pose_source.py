"""A source of poses made by docs/poses.md, of `protocol` alone, and a real agent that does not notice."""

import math
from queue import SimpleQueue
from threading import Event

import pytest
import zenoh
from process_helpers import PATIENCE_S

from protocol.codec import decode, encode
from protocol.keys import Keys
from protocol.messages import Accuracy, Command, Observation, PublicScene, State
from protocol.policy import access_control, rights_of
from protocol.scene import Horizons, PublicRobot, Scene
from protocol.session import world_session

KEYS = Keys("hall")
SCENE = Scene(
    horizons=Horizons(prediction_steps=12, estimation_steps=3),
    robots={"me": PublicRobot(), "other": PublicRobot()},
)
GOAL = (1.0, 0.0, 0.0)


class Source:
    """Says where `me` is, and moves it as it commands; `other` goes by, far away."""

    def __init__(self, endpoint, users, epoch):
        self.epoch = epoch
        self.state = [0.0, 0.0, 0.0, 0.0]
        self.present = Event()
        self.commands = SimpleQueue()
        policy = access_control(rights_of(KEYS, ("me", "other")), "usernames")
        self._session = zenoh.open(world_session(endpoint, policy, users).to_zenoh())
        self._pose = self._session.declare_publisher(
            KEYS.pose("me"), congestion_control=zenoh.CongestionControl.DROP
        )
        self._declared = (
            self._session.declare_queryable(KEYS.scene_for("me"), self._tell_scene),
            self._session.declare_subscriber(
                KEYS.command("me"),
                lambda sample: self.commands.put(decode(Command, sample.payload.to_bytes())),
            ),
            self._session.liveliness().declare_subscriber(
                KEYS.alive("me"), lambda _: self.present.set(), history=True
            ),
        )

    def _tell_scene(self, query):
        with query:
            query.reply(KEYS.scene_for("me"), encode(PublicScene(epoch=self.epoch, scene=SCENE)))

    def says(self, step, *, without=(), epoch=None, **more):
        """Put the observation of a step."""
        robots = {
            "me": State.of(*self.state),
            "other": State.of(-5.0, 4.0 - 0.05 * step, -math.pi / 2, 0.5),
        }
        observation = Observation(
            epoch=self.epoch if epoch is None else epoch,
            step=step,
            time_s=SCENE.time_s(step),
            robots={robot: state for robot, state in robots.items() if robot not in without},
            **more,
        )
        self._pose.put(encode(observation))

    def hears(self, step):
        """The command that answers this step; nothing else may have come before."""
        command = self.commands.get(timeout=PATIENCE_S)
        assert (command.robot, command.epoch, command.step) == ("me", self.epoch, step)
        return command

    def drive(self, turn_rate, acceleration):
        x_m, y_m, heading, speed = self.state
        self.state = [
            x_m + SCENE.step_s * speed * math.cos(heading),
            y_m + SCENE.step_s * speed * math.sin(heading),
            heading + SCENE.step_s * turn_rate,
            speed + SCENE.step_s * acceleration,
        ]

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self._session.close()


@pytest.fixture
def users(tmp_path):
    """The world's file of passwords, beside one with that of the robot."""
    for name, text in {"me": "secret", "users": "me:secret\nother:another\n"}.items():
        (tmp_path / name).touch(mode=0o600)
        (tmp_path / name).write_text(text)
    return tmp_path / "users"


@pytest.mark.slow
def test_a_source_of_protocol_alone_drives_a_robot_to_its_goal_and_may_be_replaced(process, endpoint, users):
    login = ("--password-file", users.with_name("me"))
    goal = {"UNSPOKEN_GOAL": ",".join(map(str, GOAL))}
    agent = process(
        "agent", "agent", "--robot", "me", "--connect", endpoint, "--run", "hall", *login, env=goal
    )
    with Source(endpoint, users, epoch=11) as source:
        assert source.present.wait(PATIENCE_S)
        step = 1  # there is no step 0: nobody has made sure that all robots stand
        while math.dist(source.state, (*GOAL, 0.0)) > SCENE.arrival_tolerance:
            source.says(step)
            source.drive(*source.hears(step).input)
            step += 1
            assert step < 100
        # A step without the robot itself is answered by saying that there is no answer.
        source.says(step, without=("me",))
        assert source.hears(step).withheld
        # Steps may be left out; what is not newer is not answered, nor is what is of another epoch.
        step += 5
        source.says(step)
        assert not source.hears(step).withheld
        source.says(step)
        source.says(step - 1)
        source.says(step + 1, epoch=12)
        source.says(step + 2, age_steps=3, accuracy=Accuracy(position_m=0.01))
        assert not source.hears(step + 2).withheld
        assert source.commands.empty()
        assert agent.told.count("joined") == 1
    with Source(endpoint, users, epoch=12) as source:
        assert source.present.wait(PATIENCE_S)
        source.says(7)
        assert not source.hears(7).withheld
        agent.tells("epoch=12")
        assert agent.told.count("joined") == 2
        assert agent.running
    assert agent.complained == ""
