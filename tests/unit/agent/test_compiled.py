"""Kernels: where they are kept, when they count as complete, and the same bits wherever their arrays lie."""

import ast
import random
import subprocess
import time
from pathlib import Path

import numpy as np
import pytest
from agent_helpers import cold
from realtime_helpers import random_crossing

import agent
from agent.process.warm import compile_in_background
from agent.solve import Deadline, compiled, joint_solver
from agent.solve.compiled import (
    chosen_folder,
    forbid_compiling,
    is_complete,
    is_writable,
    kernel,
    places,
    sources,
)

PACKAGE = Path(agent.__file__).parent
TRIES = 500
LARGEST = 2000
"""Of the arrays in between: they share the heap with those of the kernels."""


def test_a_solution_does_not_depend_on_where_the_arrays_lie():
    """As it does where sums may be reordered: vector units are used or not by how far apart arrays are."""
    chance = random.Random(5)
    solver = joint_solver("realtime", 2, Deadline(time.perf_counter, None))
    problem = random_crossing(3, 1)
    first = solver.solve(problem, cold(problem))
    start = first.start()
    others, found = [], set()
    for _ in range(TRIES):
        others += [np.empty(chance.randrange(1, LARGEST)) for _ in range(chance.randrange(6))]
        chance.shuffle(others)
        del others[60:]
        found.add(solver.solve(problem, start).inputs.tobytes())
    assert len(found) == 1


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
    watched = {".".join(("agent", *path.relative_to(PACKAGE).with_suffix("").parts)) for path in sources()}
    assert {module for _, module in used} <= watched


def test_a_complete_folder_is_preferred_then_one_that_can_be_written(tmp_path):
    (tmp_path / "file").touch()
    closed, first, second = tmp_path / "file" / "cache", tmp_path / "first", tmp_path / "second"
    assert chosen_folder([closed, first, second], "k") == first / "k"
    (second / "k").mkdir(parents=True)
    (second / "k" / "complete").touch()
    assert chosen_folder([closed, first, second], "k") == second / "k"
    assert chosen_folder([closed], "k") == closed / "k"
    assert is_writable(second / "not" / "there" / "yet")
    assert not is_writable(closed)


def test_kernels_are_kept_beside_the_package_or_with_the_user_unless_the_user_says_where(
    monkeypatch, tmp_path
):
    monkeypatch.delenv("NUMBA_CACHE_DIR", raising=False)
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    assert places() == [PACKAGE / "__pycache__", tmp_path / "unspoken"]
    monkeypatch.delenv("XDG_CACHE_HOME")
    monkeypatch.setenv("HOME", "/home/somebody")
    assert places()[1] == Path("/home/somebody/.cache/unspoken")
    monkeypatch.setenv("NUMBA_CACHE_DIR", "mine")
    assert places() == [Path.cwd() / "mine"]


def test_where_all_is_compiled_no_process_is_started(monkeypatch):
    assert is_complete()
    monkeypatch.setattr(subprocess, "Popen", None)
    assert compile_in_background(unwanted=lambda: True)
