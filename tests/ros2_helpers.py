"""ROS 2 messages made and read by an independent library, and a bridge's file for the tests."""

import math

import numpy as np
from rosbags.typesys import Stores, get_typestore

from world.ros2.settings import Ros2Bridge

STORE = get_typestore(Stores.ROS2_HUMBLE)
ODOMETRY, TWIST = "nav_msgs/msg/Odometry", "geometry_msgs/msg/Twist"


def _made(name, *fields):
    return STORE.types[name](*fields)


def odometry_message(
    x_m=0.0,
    y_m=0.0,
    heading_rad=0.0,
    speed_mps=0.0,
    turn_rate_radps=0.0,
    *,
    stamp_ns=0,
    frame_id="odom",
    child_frame_id="base_link",
    z_m=0.0,
    orientation=None,
    linear=None,
    angular=None,
    pose_covariance=None,
    twist_covariance=None,
):
    """A message as a driver would make it; what is given beside the first five overrides them."""
    turned = orientation or (0.0, 0.0, math.sin(heading_rad / 2), math.cos(heading_rad / 2))
    second, nanosecond = divmod(stamp_ns, 1_000_000_000)
    nothing = np.zeros(36)
    vector, twist = "geometry_msgs/msg/Vector3", "geometry_msgs/msg/Twist"
    pose = _made(
        "geometry_msgs/msg/Pose",
        _made("geometry_msgs/msg/Point", x_m, y_m, z_m),
        _made("geometry_msgs/msg/Quaternion", *turned),
    )
    velocity = _made(
        twist,
        _made(vector, *(linear or (speed_mps, 0.0, 0.0))),
        _made(vector, *(angular or (0.0, 0.0, turn_rate_radps))),
    )
    stamp = _made("builtin_interfaces/msg/Time", second, nanosecond)
    return _made(
        ODOMETRY,
        _made("std_msgs/msg/Header", stamp, frame_id),
        child_frame_id,
        _made(
            "geometry_msgs/msg/PoseWithCovariance",
            pose,
            nothing if pose_covariance is None else np.array(pose_covariance),
        ),
        _made(
            "geometry_msgs/msg/TwistWithCovariance",
            velocity,
            nothing if twist_covariance is None else np.array(twist_covariance),
        ),
    )


def odometry_bytes(*values, little_endian=True, **fields):
    message = odometry_message(*values, **fields)
    return bytes(STORE.serialize_cdr(message, ODOMETRY, little_endian=little_endian))


def twist_of(payload):
    """Speed and turn rate of a twist's bytes; all else has to be zero."""
    twist = STORE.deserialize_cdr(payload, TWIST)
    assert (twist.linear.y, twist.linear.z, twist.angular.x, twist.angular.y) == (0.0, 0.0, 0.0, 0.0)
    return twist.linear.x, twist.angular.z


def diagonal(**variances):
    """A 6×6 covariance, by the names x, y, z, roll, pitch, yaw."""
    order = ("x", "y", "z", "roll", "pitch", "yaw")
    return np.diag([variances.get(name, 0.0) for name in order]).ravel().tolist()


def bridge_file(count=2, *, robot=None, **rules):
    """The content of a file with robots 1, 2, …"""
    robots = [
        {"id": i, "odometry": f"/robot_{i}/odom", "command": f"/robot_{i}/cmd_vel", **(robot or {})}
        for i in range(1, count + 1)
    ]
    return {"robots": robots, **rules}


def settings(count=2, **rules):
    return Ros2Bridge.model_validate(bridge_file(count, **rules))
