"""An interrupted run ends in order, whenever it is interrupted, and leaves its output and nothing else."""

import os
import signal

from process_helpers import endless, recorded, until

from chassis.refusal import Refusal


def ends_as_interrupted(run, children):
    """Check what every interrupted run has in common."""
    assert run.end() == 1, run.complained
    assert run.complained == ""
    assert "Interrupted" in run.told
    run.leaves_nothing(children)
    assert run.summary["verdict"] == "interrupted"
    assert (run.out / "paths.png").exists()


def test_a_second_signal_ends_a_run_whose_world_no_longer_answers(tmp_path, bench):
    run = bench("out", "run", endless(tmp_path / "endless.yaml", 1))
    run.reach(1)
    children = run.children()
    os.kill(run.pid("world"), signal.SIGSTOP)
    run.signal(signal.SIGINT)
    run.signal(signal.SIGTERM)
    ends_as_interrupted(run, children)


def test_a_signal_while_processes_start_ends_them(tmp_path, bench):
    run = bench("out", "run", endless(tmp_path / "endless.yaml", 2))
    until((run.out / "logs" / "robot-2.log").exists, "the start of the last robot")
    children = run.children()
    run.signal(signal.SIGHUP)
    ends_as_interrupted(run, children)


def test_a_signal_ends_a_simulation(tmp_path, bench):
    simulation = bench("out", "simulate", endless(tmp_path / "endless.yaml", 2))

    def has_begun():
        try:
            return len(recorded(simulation.out)) > 1
        except Refusal:
            return False

    until(has_begun, "the first recorded step")
    simulation.signal(signal.SIGTERM)
    ends_as_interrupted(simulation, {})
    key, last = recorded(simulation.out)[-1]
    assert (key, last.verdict) == ("truth", "interrupted")
