"""The wire: what robots, world and bench say to each other, and all that they have to read alike."""
