"""What the command ``unspoken`` imports before it knows what is wanted: little, so it answers at once."""

import json
import subprocess
import sys

import pytest

LIBRARIES = {"casadi", "dask", "distributed", "matplotlib", "numba", "numpy", "scipy", "zenoh"}
BENCH = {"fleet", "scenarios", "world"}
OTHER_COMMANDS = {"fleet.evaluate.command", "fleet.bench.command", "agent.__main__"}
RUN = """
import json, sys
from {entry} import main
try:
    main()
finally:
    print("\\n" + json.dumps(sorted(sys.modules)))
"""


@pytest.mark.parametrize(
    ("entry", "words", "unwanted"),
    [
        ("agent", ["--version"], LIBRARIES),
        ("fleet.entry", ["--help"], LIBRARIES),
        ("fleet.entry", ["scenarios", "--help"], OTHER_COMMANDS),
        ("agent", ["agent", "--help"], BENCH),
    ],
)
def test_help_and_version_import_nothing_that_they_do_not_need(entry, words, unwanted):
    command = [sys.executable, "-c", RUN.format(entry=entry), *words]
    said = subprocess.run(command, capture_output=True, text=True, check=True)
    assert words != ["--version"] or said.stdout.splitlines()[0].endswith("protocol 1")
    modules = set(json.loads(said.stdout.splitlines()[-1]))
    assert entry in modules
    assert unwanted & modules == set()
