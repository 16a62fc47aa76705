"""Real robots in place of simulated ones: poses from ROS 2 odometry, commands to ROS 2 as twists.

`OdometryWorld` is the pure core; `live` and `__main__` wrap it in two Zenoh sessions, one for the
agents and one for the side of ROS.
"""
