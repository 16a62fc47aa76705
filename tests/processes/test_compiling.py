"""On a machine where nothing is compiled yet: what is said, and how it can be stopped."""

import json
import signal

import pytest
from process_helpers import is_alive, lanes, until, write_scenario

COMPILING = "kernels-*/lock"
"""Made when compiling begins."""


@pytest.fixture
def cache(tmp_path):
    """A place for compiled kernels, with none in it."""
    folder = tmp_path / "cache"
    folder.mkdir()
    return folder


@pytest.mark.parametrize("command", ["run", "simulate"])
@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_a_run_that_is_interrupted_while_it_compiles_ends_at_once_and_in_order(
    bench, tmp_path, cache, command, number
):
    scenario = write_scenario(tmp_path / "lanes.yaml", lanes(2, 0.5))
    run = bench("out", command, scenario, env={"NUMBA_CACHE_DIR": cache})
    until(lambda: any(cache.glob(COMPILING)), "compiling")
    children = run.children()
    assert [line[-1] for line in children.values()] == ["agent.process.warm"]
    run.signal(number)
    assert run.end() == 1
    assert "compiling the solver (once on this machine" in run.told
    assert run.complained == ""
    run.leaves_nothing(children)
    assert json.loads((run.out / "summary.json").read_text())["verdict"] == "interrupted"
    assert not any(cache.glob("kernels-*/complete"))


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_a_robot_that_waits_for_its_solver_can_be_ended(process, cache, number):
    robot = process("one", "agent", "--robot", 1, "--goal", "0.5,0,0", env={"NUMBA_CACHE_DIR": cache})
    until(lambda: any(cache.glob(COMPILING)), "compiling")
    children = robot.children()
    robot.signal(number)
    assert robot.end() == 0
    assert robot.complained == ""
    assert not any(map(is_alive, children))


def test_a_robot_without_a_place_for_its_solver_says_what_to_do(process, tmp_path):
    (tmp_path / "file").touch()
    place = tmp_path / "file" / "cache"
    robot = process("one", "agent", "--robot", 1, "--goal", "0.5,0,0", env={"NUMBA_CACHE_DIR": place})
    assert robot.end() == 3
    assert f"robot 1: the solver is not compiled yet, and {place} cannot be written" in robot.complained
    assert "set NUMBA_CACHE_DIR to a folder that can be" in robot.complained
    assert len(robot.complained.splitlines()) == 1
