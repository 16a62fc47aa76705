"""The world: one process that simulates the robots, plays their sensors and referees the run.

`World` is the pure core; `run`, `bus` and `__main__` wrap it in a Zenoh session.
"""
