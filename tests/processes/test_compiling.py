"""Compiling in processes of their own, where no other test has compiled: once, enough, and interruptible."""

import errno
import fcntl
import json
import os
import re
import shutil
import signal
import subprocess
import sys
from pathlib import Path
from typing import get_args

import psutil
import pytest
from process_helpers import PATIENCE_S, endless, until

from agent.estimate import GoalsName
from agent.solve.compiled import FOLDER

ROBOT = ("agent", "--robot", 1, "--goal", "0.5,0,0")
COUNT = """
def compiled_so_far():
    from agent.solve.compiled import _kernels
    return sum(sum(each.stats.cache_misses.values()) for each in _kernels)
"""
COMPANY = (
    COUNT
    + """
import math, time
from agent.process.options import DecisionOptions
from agent.solve.compiled import _kernels, forbid_compiling
from agent.process.warm import warm_up
from protocol.messages import Observation, State
from protocol.scene import Goal, PublicRobot, Scene

ROBOTS = [str(i) for i in range(1, 13)]
TURNS = [math.tau * i / 12 for i in range(12)]
GOALS = {r: Goal(x_m=-5 * math.cos(t), y_m=-5 * math.sin(t), heading_rad=0.0) for r, t in zip(ROBOTS, TURNS)}

def drive(goals):
    scene = Scene(robots=dict.fromkeys(ROBOTS, PublicRobot()), goals=GOALS)
    agent = DecisionOptions(goals=goals).agent("1", GOALS["1"], scene, time.perf_counter)
    for step in range(36):
        count = 1 + step % 12 if step < 24 else 36 - step  # they come one by one, vanish at once, then leave
        states = {
            r: State.of((5 - 0.05 * step) * math.cos(t), (5 - 0.05 * step) * math.sin(t), t + math.pi, 0.5)
            for r, t in list(zip(ROBOTS, TURNS))[:count]
        }
        if step >= 30:  # near its goal
            states["1"] = State.of(-4.0, 0.0, math.pi, 0.5)
        seen = Observation(epoch=0, step=step, time_s=0.1 * step, robots=states)
        agent.decide(seen)
"""
)


def answer_of(program, *arguments, **environment):
    """What a Python program prints, as JSON, in a process of its own, where no other test has compiled."""
    said = subprocess.run(
        [sys.executable, "-c", program, *map(str, arguments)],
        env={**os.environ, **environment},
        capture_output=True,
        text=True,
    )
    assert said.returncode == 0, said.stderr
    return json.loads(said.stdout)


@pytest.mark.parametrize(
    "goals",
    [
        goals if goals == "ioc" else pytest.param(goals, marks=pytest.mark.slow)
        for goals in get_args(GoalsName)
    ],
)
def test_after_the_warm_up_robots_come_and_go_and_nothing_is_compiled(goals):
    """A call that no compiled form fits would raise: compiling is forbidden."""
    run = f"""
warm_up({goals!r}, "realtime")
forbid_compiling()
forms = [each.signatures for each in _kernels]
drive({goals!r})
print("[%d, %d]" % (compiled_so_far(), forms == [each.signatures for each in _kernels]))
"""
    assert answer_of(COMPANY + run) == [0, True]


def test_one_warm_up_compiles_for_every_choice_and_needs_neither_the_reference_solver_nor_the_bench():
    """What ``main`` uses for all; the reference solver shares the starts and estimators."""
    run = """
import json, sys
from typing import get_args
import agent.__main__
from agent.solve.compiled import _kernels
from agent.estimate import GoalsName
from agent.process.warm import warm_up

def used():
    return {f"{each.__module__}.{each.__name__}{form}" for each in _kernels for form in each.signatures}

warm_up("ioc", "realtime")
loaded = sorted({"casadi", "matplotlib", "mcap", "world", "fleet", "scenarios"} & set(sys.modules))
most = used()
for goals in get_args(GoalsName):
    for solver in ("realtime", "reference"):
        warm_up(goals, solver)
print(json.dumps([loaded, sorted(used() - most)]))
"""
    assert answer_of(run) == [[], []]


def test_a_robot_without_a_place_for_its_solver_says_what_was_found_and_what_to_do(process, tmp_path):
    (tmp_path / "file").touch()
    place = tmp_path / "file" / "cache"
    robot = process("one", *ROBOT, env={"NUMBA_CACHE_DIR": place})
    assert robot.end() == 3
    assert f"robot 1: the solver is not compiled yet, and {place} cannot be written" in robot.complained
    assert "set NUMBA_CACHE_DIR to a folder that can be" in robot.complained
    assert len(robot.complained.splitlines()) == 1


def test_a_complete_folder_is_used_even_where_nothing_can_be_written(tmp_path):
    """The locators of numba itself want to write first."""
    shutil.copytree(FOLDER, tmp_path / FOLDER.name)
    run = (
        COUNT
        + f"""
import builtins, os, tempfile
def refuse(*_args, **_kwargs):
    raise OSError({errno.EROFS}, "Read-only file system")
tempfile.TemporaryFile = os.makedirs = os.mkdir = refuse
from agent.process.warm import FOLDER, warm_up
warm_up("ioc", "realtime")
import json
print(json.dumps([str(FOLDER.parent), compiled_so_far()]))
"""
    )
    assert answer_of(run, NUMBA_CACHE_DIR=str(tmp_path)) == [str(tmp_path), 0]


def waits_for_a_lock(process):
    return re.search(rf"-> FLOCK .* {process.pid} ", Path("/proc/locks").read_text()) is not None


def test_of_several_processes_that_want_it_one_compiles(tmp_path):
    """Both find nothing and reach the lock, which is held until both wait for it."""
    run = f"""
import agent.process.warm
def compile(*_):
    open({str(tmp_path / "compilers")!r}, "a").write("x")
    return 1.0
agent.process.warm.warm_up = compile
agent.process.warm.main()
"""
    environment = {**os.environ, "NUMBA_CACHE_DIR": str(tmp_path)}
    folder = tmp_path / FOLDER.name
    folder.mkdir()

    with (folder / "lock").open("w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        both = [subprocess.Popen([sys.executable, "-c", run], env=environment) for _ in range(2)]
        try:
            until(lambda: all(map(waits_for_a_lock, both)), "both wait for the lock")
            fcntl.flock(lock, fcntl.LOCK_UN)
            assert [process.wait(PATIENCE_S) for process in both] == [0, 0]
        finally:
            for process in both:
                process.kill()
    assert (tmp_path / "compilers").read_text() == "x"
    assert (folder / "complete").exists()


def interrupted_while_it_compiles(process, cache, number):
    """Send a signal to what has just begun to compile; its children."""
    until(lambda: any(cache.glob("kernels-*/lock")), "compiling")
    children = process.children()
    assert [line[-1] for line in children.values()] == ["agent.process.warm"]
    process.signal(number)
    return children


@pytest.mark.parametrize(("command", "number"), [("run", signal.SIGINT), ("simulate", signal.SIGTERM)])
def test_a_run_that_is_interrupted_while_it_compiles_ends_at_once_and_in_order(
    bench, tmp_path, command, number
):
    run = bench("out", command, endless(tmp_path / "endless.yaml", 2), env={"NUMBA_CACHE_DIR": tmp_path})
    children = interrupted_while_it_compiles(run, tmp_path, number)
    assert run.end() == 1
    assert "compiling the solver (once on this machine" in run.told
    assert run.complained == ""
    run.leaves_nothing(children)
    assert run.summary["verdict"] == "interrupted"
    assert not any(tmp_path.glob("kernels-*/complete"))


def test_a_robot_that_waits_for_its_solver_can_be_ended(process, tmp_path):
    robot = process("one", *ROBOT, env={"NUMBA_CACHE_DIR": tmp_path})
    children = interrupted_while_it_compiles(robot, tmp_path, signal.SIGTERM)
    assert robot.end() == 0
    assert robot.complained == ""
    assert not any(map(psutil.pid_exists, children))
