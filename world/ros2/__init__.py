"""Real robots in place of simulated ones: poses from ROS 2 odometry, commands to ROS 2 as twists."""
