"""Files of a bridge: one clear error for everything that can be wrong in them."""

import pytest
import yaml
from ros2_helpers import bridge_file

from chassis.files import read_as
from chassis.refusal import Refusal
from world.ros2.odometry import Ros2Bridge


@pytest.mark.parametrize(
    ("index", "field", "value", "words"),
    [
        (0, "odometry", "/a//odom", "'/a//odom' found, the full name of a ROS topic is"),
        (0, "command", "/robot/cmd_vel\n", ".* the full name of a ROS topic is"),
        (0, "goal", {"x_m": 1.0, "y_m": 0.0}, "there is no such field"),
        (2, "id", 1, "the id '1' is used twice"),
        (2, "odometry", "/robot_1/odom", "the topic /robot_1/odom is that of robot"),
        (0, "command", "/robot_1/odom", r".* \(odometry\)"),
    ],
)
def test_mistakes_of_a_robot_are_told_with_their_place(tmp_path, index, field, value, words):
    content = bridge_file(3)
    content["robots"][index][field] = value
    path = tmp_path / "bridge.yaml"
    path.write_text(yaml.safe_dump(content, sort_keys=False))
    with pytest.raises(Refusal, match=rf"bridge\.yaml:\d+: robots\[{index}\]\.{field}: {words}"):
        read_as(path, Ros2Bridge, "file of a bridge")
