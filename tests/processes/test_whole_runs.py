"""Whole runs of the published scenario and others, in as many processes as robots and in virtual time."""

import os
import subprocess
import sys
from contextlib import contextmanager

import pytest
from process_helpers import repeatable


@contextmanager
def busy_machine():
    """Other processes want each core several times over."""
    burning = [sys.executable, "-c", "while True: pass"]
    burners = [subprocess.Popen(burning) for _ in range(2 * (os.cpu_count() or 1))]
    try:
        yield
    finally:
        for burner in burners:
            burner.kill()
            burner.wait()


@pytest.mark.slow
@pytest.mark.timeout(1500)
def test_eight_robots_cross_in_nine_processes_as_in_virtual_time_although_the_machine_is_busy(bench):
    run = bench("out", "run", "8a", "--goals", "ioc")
    run.reach(1)
    children = run.children()
    assert sorted(line[-1] for line in children.values()) == ["agent"] * 8 + ["world"]
    with busy_machine():
        run.reach(20)
    assert run.end(1400.0) == 0, run.complained
    run.leaves_nothing(children)
    assert (run.summary["verdict"], run.summary["collisions"]) == ("arrived", 0)
    assert all(robot["arrived_s"] is not None for robot in run.summary["robots"])
    assert "All 8 robots arrived" in run.told
    virtual = bench("virtual", "simulate", "8a", "--goals", "ioc")
    assert virtual.end(1400.0) == 0, virtual.complained
    assert repeatable(run.out) == repeatable(virtual.out)
