"""``unspoken agent --check``: whether this device is ready to be a robot, without disturbing a world."""
