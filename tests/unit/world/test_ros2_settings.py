"""Files of a bridge: what they mean, and one clear error for everything that can be wrong in them."""

import pytest
import yaml
from ros2_helpers import bridge_file

from chassis.files import read_as
from chassis.refusal import Refusal
from world.ros2.odometry import Ros2Bridge


@pytest.fixture
def load(tmp_path):
    def load_text(content):
        path = tmp_path / "bridge.yaml"
        path.write_text(content if isinstance(content, str) else yaml.safe_dump(content, sort_keys=False))
        return read_as(path, Ros2Bridge, "file of a bridge")

    return load_text


def test_a_file_with_nothing_but_robots_has_the_defaults_of_a_scenario(load):
    found = load(bridge_file(2))
    assert (found.step_s, found.connect, found.stale_s) == (0.1, "tcp/127.0.0.1:7447", 0.3)
    assert [robot.id for robot in found.robots] == ["1", "2"]
    assert found.robots[1].odometry == "/robot_2/odom"


@pytest.mark.parametrize(
    ("robot", "field", "words"),
    [
        ({"odometry": "odom"}, "odometry", "the full name of a ROS topic is expected"),
        ({"odometry": "/a//odom"}, "odometry", "'/a//odom' found"),
        ({"command": "/robot/cmd_vel\n"}, "command", "the full name of a ROS topic"),
        ({"goal": {"x_m": 1.0, "y_m": 0.0}}, "goal", "there is no such field"),
    ],
)
def test_mistakes_of_a_robot_are_told_with_their_place(load, robot, field, words):
    with pytest.raises(Refusal, match=rf"bridge\.yaml:\d+: robots\[0\]\.{field}: .*{words}"):
        load(bridge_file(1, robot=robot))


def test_two_robots_cannot_have_one_id_or_one_topic(load):
    content = bridge_file(3)
    content["robots"][2]["id"] = 1
    with pytest.raises(Refusal, match=r"robots\[2\]\.id: the id '1' is used twice"):
        load(content)
    content = bridge_file(3)
    content["robots"][2]["odometry"] = "/robot_1/odom"
    with pytest.raises(Refusal, match=r"robots\[2\]\.odometry: the topic /robot_1/odom is that of robot"):
        load(content)
    content = bridge_file(1)
    content["robots"][0]["command"] = "/robot_1/odom"
    with pytest.raises(Refusal, match=r"robots\[0\]\.command: .* \(odometry\)"):
        load(content)
