"""ROS 2 messages made and read by an independent library, and a bridge's file for the tests."""

import math

import numpy as np
from rosbags.typesys import Stores, get_typestore

from world.ros2.odometry import Ros2Bridge

STORE = get_typestore(Stores.ROS2_HUMBLE)
ODOMETRY, TWIST = "nav_msgs/msg/Odometry", "geometry_msgs/msg/Twist"


def geometry(name, *fields):
    return STORE.types[f"geometry_msgs/msg/{name}"](*fields)


def odometry_bytes(
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
    pose_covariance=(0.0,) * 36,
    twist_covariance=(0.0,) * 36,
    little_endian=True,
):
    """A message as a driver would send it; what is given beside the first five overrides them."""
    stamp = STORE.types["builtin_interfaces/msg/Time"](*divmod(stamp_ns, 1_000_000_000))
    turned = orientation or (0.0, 0.0, math.sin(heading_rad / 2), math.cos(heading_rad / 2))
    pose = geometry("Pose", geometry("Point", x_m, y_m, z_m), geometry("Quaternion", *turned))
    velocities = (linear or (speed_mps, 0.0, 0.0), angular or (0.0, 0.0, turn_rate_radps))
    twist = geometry("Twist", *(geometry("Vector3", *each) for each in velocities))
    message = STORE.types[ODOMETRY](
        STORE.types["std_msgs/msg/Header"](stamp, frame_id),
        child_frame_id,
        geometry("PoseWithCovariance", pose, np.array(pose_covariance)),
        geometry("TwistWithCovariance", twist, np.array(twist_covariance)),
    )
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
