"""Everything is compiled before a robot starts, once on a machine, and nothing afterwards."""

import ast
import errno
import fcntl
import json
import os
import re
import shutil
import subprocess
import sys
import time
from pathlib import Path
from typing import get_args

import pytest

from agent.estimate import GoalsName
from agent.process.warm import compile_in_background, warm_up
from agent.solve import compiled
from agent.solve.compiled import (
    FOLDER,
    chosen_folder,
    forbid_compiling,
    is_complete,
    is_writable,
    kernel,
    places,
    sources,
)
from chassis.refusal import Refusal

PATIENCE_S = 120.0
"""How long a test waits for what should come; only reached when it fails."""

COUNT = """
def compiled_so_far():
    from agent.solve.compiled import _kernels
    return sum(sum(each.stats.cache_misses.values()) for each in _kernels)
"""
COMPANY = (
    COUNT
    + """
import math, time
from agent.agent import Agent
from agent.solve.compiled import _kernels, forbid_compiling
from agent.process.warm import warm_up
from protocol.messages import Observation, State
from protocol.scene import Goal, PublicRobot, Scene

ROBOTS = [str(i) for i in range(1, 13)]
TURNS = [math.tau * i / 12 for i in range(12)]
GOALS = {r: Goal(x_m=-5 * math.cos(t), y_m=-5 * math.sin(t), heading_rad=0.0) for r, t in zip(ROBOTS, TURNS)}

def drive(goals):
    scene = Scene(robots=dict.fromkeys(ROBOTS, PublicRobot()), goals=GOALS)
    agent = Agent.of("1", GOALS["1"], scene, goals=goals, solver="realtime", clock=time.perf_counter)
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


TAKE_LONG = ("exchanged", "constant-acceleration", "joint-fit", "kalman-filter")
"""They solve the joint problem of twelve robots, or use what the others use too."""


@pytest.mark.parametrize(
    "goals",
    [
        pytest.param(goals, marks=pytest.mark.slow) if goals in TAKE_LONG else goals
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


def test_one_warm_up_compiles_for_every_choice():
    """What ``main`` uses for all; the reference solver shares the starts and estimators."""
    run = """
from typing import get_args
from agent.solve.compiled import _kernels
from agent.estimate import GoalsName
from agent.process.warm import warm_up
import json

def used():
    return {f"{each.__module__}.{each.__name__}{form}" for each in _kernels for form in each.signatures}

warm_up("ioc", "realtime")
most = used()
for goals in get_args(GoalsName):
    for solver in ("realtime", "reference"):
        warm_up(goals, solver)
print(json.dumps(sorted(used() - most)))
"""
    assert answer_of(run) == []


def test_where_compiling_is_forbidden_a_call_with_other_types_raises(monkeypatch):
    monkeypatch.setattr(compiled, "_kernels", [])

    @kernel
    def doubled(values):
        return 2.0 * values

    @kernel
    def never_called(values):
        return values

    assert doubled(1.5) == 3.0
    forbid_compiling()
    assert doubled(2.5) == 5.0
    with pytest.raises(TypeError, match="No matching definition"):
        doubled("text")


def test_a_robot_with_the_real_time_solver_loads_neither_the_reference_solver_nor_the_bench():
    run = """
import json, sys
import agent.__main__
from agent.process.warm import warm_up
warm_up("ioc", "realtime")
print(json.dumps(sorted({"casadi", "matplotlib", "mcap", "world", "fleet", "scenarios"} & set(sys.modules))))
"""
    assert answer_of(run) == []


def constants_in_kernels():
    """Names that kernels use and the modules that they are imported from."""
    for path in sources():
        tree = ast.parse(path.read_text(encoding="utf-8"))
        origin = {
            alias.asname or alias.name: node.module
            for node in tree.body
            if isinstance(node, ast.ImportFrom)
            for alias in node.names
        }
        for function in tree.body:
            if isinstance(function, ast.FunctionDef) and "kernel" in map(
                ast.unparse, function.decorator_list
            ):
                for each in (leaf for line in function.body for leaf in ast.walk(line)):
                    if isinstance(each, ast.Name) and each.id in origin:
                        yield each.id, origin[each.id]


def test_compiled_code_is_made_of_nothing_but_the_sources_that_name_its_folder():
    """Otherwise an old form would be loaded after a change."""
    used = set(constants_in_kernels())
    assert ("FIRST_FREE_STAGE", "agent.solve.problem") in used
    package = Path(compiled.__file__).parent
    watched = {".".join(("agent", *path.relative_to(package).with_suffix("").parts)) for path in sources()}
    assert {module for _, module in used} <= watched


def test_a_complete_folder_is_preferred_then_one_that_can_be_written(tmp_path):
    (tmp_path / "file").touch()
    closed, first, second = tmp_path / "file" / "cache", tmp_path / "first", tmp_path / "second"
    assert chosen_folder([closed, first, second], "k") == first / "k"
    (second / "k").mkdir(parents=True)
    (second / "k" / "complete").touch()
    assert chosen_folder([closed, first, second], "k") == second / "k"
    assert chosen_folder([closed], "k") == closed / "k"


def test_a_folder_can_be_written_if_it_could_be_made(tmp_path):
    (tmp_path / "file").touch()
    assert is_writable(tmp_path / "a" / "b")
    assert not is_writable(tmp_path / "file" / "b")
    assert not is_writable(tmp_path / "file")


def test_kernels_are_kept_beside_the_package_or_with_the_user_unless_the_user_says_where(
    monkeypatch, tmp_path
):
    monkeypatch.delenv("NUMBA_CACHE_DIR", raising=False)
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    assert places() == [Path(compiled.__file__).parent / "__pycache__", tmp_path / "unspoken"]
    monkeypatch.delenv("XDG_CACHE_HOME")
    monkeypatch.setenv("HOME", "/home/somebody")
    assert places()[1] == Path("/home/somebody/.cache/unspoken")
    monkeypatch.setenv("NUMBA_CACHE_DIR", "mine")
    assert places() == [Path.cwd() / "mine"]


def test_without_a_place_to_write_the_message_says_what_was_found_and_what_to_do(tmp_path):
    (tmp_path / "file").touch()
    refused = subprocess.run(
        [sys.executable, "-m", "agent.process.warm"],
        env={**os.environ, "NUMBA_CACHE_DIR": str(tmp_path / "file" / "cache")},
        capture_output=True,
        text=True,
    )
    assert (refused.returncode, refused.stdout) == (1, "")
    assert f"{tmp_path}/file/cache cannot be written; set NUMBA_CACHE_DIR to" in refused.stderr
    assert len(refused.stderr.splitlines()) == 1


def test_whoever_waits_is_told_why_compiling_failed(tmp_path, monkeypatch):
    (tmp_path / "file").touch()
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path / "file" / "cache"))
    monkeypatch.setattr(compiled, "FOLDER", tmp_path)
    with pytest.raises(Refusal, match=r"file/cache cannot be written; set NUMBA_CACHE_DIR"):
        compile_in_background(unwanted=lambda: False)


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


class Children:
    """Notes the processes that are started."""

    def __init__(self, monkeypatch):
        self.started = []
        original = subprocess.Popen

        def popen(*arguments, **options):
            self.started.append(original(*arguments, **options))
            return self.started[-1]

        monkeypatch.setattr(subprocess, "Popen", popen)


def test_where_all_is_compiled_no_process_is_started(monkeypatch):
    assert is_complete()
    children = Children(monkeypatch)
    assert compile_in_background(unwanted=lambda: True)
    assert children.started == []


def test_compiling_that_is_no_longer_wanted_is_ended(tmp_path, monkeypatch):
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path))
    monkeypatch.setattr(compiled, "FOLDER", tmp_path / "nothing")
    children = Children(monkeypatch)
    assert not compile_in_background(unwanted=lambda: any(tmp_path.glob("kernels-*/lock")))
    [child] = children.started
    assert child.returncode is not None
    assert not any(tmp_path.glob("kernels-*/complete"))


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
            give_up_s = time.monotonic() + PATIENCE_S
            while not all(map(waits_for_a_lock, both)):
                assert time.monotonic() < give_up_s
                time.sleep(0.01)
            fcntl.flock(lock, fcntl.LOCK_UN)
            assert [process.wait(PATIENCE_S) for process in both] == [0, 0]
        finally:
            for process in both:
                process.kill()
    assert (tmp_path / "compilers").read_text() == "x"
    assert (folder / "complete").exists()


@pytest.mark.slow
def test_two_warm_ups_from_nothing_at_the_same_time_leave_all_kernels_on_disk(tmp_path):
    environment = {**os.environ, "NUMBA_CACHE_DIR": str(tmp_path)}
    both = [subprocess.Popen([sys.executable, "-m", "agent.process.warm"], env=environment) for _ in range(2)]
    try:
        assert [process.wait(280.0) for process in both] == [0, 0]
    finally:
        for process in both:
            process.kill()
    run = (
        COUNT + "from agent.process.warm import warm_up; warm_up('ioc', 'realtime'); print(compiled_so_far())"
    )
    assert answer_of(run, NUMBA_CACHE_DIR=str(tmp_path)) == 0


def test_the_warm_up_says_how_long_it_took():
    begin_s = time.perf_counter()
    assert 0.0 < warm_up("ioc", "realtime") <= time.perf_counter() - begin_s
