"""The world: one process that simulates the robots, plays their sensors and referees the run."""
