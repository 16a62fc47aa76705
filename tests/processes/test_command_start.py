"""What the command ``unspoken`` imports before it knows what is wanted: little, so it answers at once."""

import json
import subprocess
import sys

import pytest

LIBRARIES = {"casadi", "dask", "distributed", "matplotlib", "numba", "numpy", "scipy", "zenoh"}
BENCH = {"fleet", "scenarios", "world"}
RUN = """
import json, sys
from {package}.entry import main
try:
    main()
finally:
    print("\\n" + json.dumps(sorted(sys.modules)))
"""


def imported(package, *words):
    command = [sys.executable, "-c", RUN.format(package=package), *words]
    said = subprocess.run(command, capture_output=True, text=True, check=True)
    return set(json.loads(said.stdout.splitlines()[-1]))


@pytest.mark.parametrize("package", ["agent", "fleet"])
@pytest.mark.parametrize("word", ["--help", "--version"])
def test_help_and_version_import_no_library_of_a_command(package, word):
    assert imported(package, word) & LIBRARIES == set()


def test_help_of_a_command_imports_no_other_command():
    modules = imported("fleet", "scenarios", "--help")
    assert "fleet.scenarios.command" in modules
    assert {"fleet.evaluate.command", "fleet.bench.command", "agent.__main__"} & modules == set()


def test_a_device_needs_neither_the_world_nor_the_bench():
    assert imported("agent", "agent", "--help") & BENCH == set()
