"""The distribution for a robot's own computer, installed as docs/containers.md says."""

import json
import os
import subprocess
import venv
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[3]
pytestmark = [pytest.mark.slow]


def run(*command: object) -> str:
    env = {name: value for name, value in os.environ.items() if name != "PYTHONPATH"}
    done = subprocess.run(list(map(str, command)), cwd=ROOT, env=env, capture_output=True, text=True)
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout


def test_a_device_gets_agent_and_protocol_and_nothing_of_the_bench(tmp_path):
    venv.create(tmp_path, with_pip=True)
    python = tmp_path / "bin" / "python"
    before = {each["name"] for each in json.loads(run(python, "-m", "pip", "list", "--format", "json"))}
    run(python, "-m", "pip", "install", "--quiet", "--constraint", "constraints.txt", "./deploy/agent")
    installed = {each["name"] for each in json.loads(run(python, "-m", "pip", "list", "--format", "json"))}
    assert "unspoken-agent" in installed - before
    assert not {"matplotlib", "dask", "distributed", "casadi", "scipy", "psutil", "mcap"} & installed
    find = "import importlib.util as u, sys; print(*(name for name in sys.argv[1:] if u.find_spec(name)))"
    found = run(python, "-P", "-c", find, "agent", "protocol", "world", "fleet", "scenarios")
    assert found.split() == ["agent", "protocol"]
    assert "--robot" in run(tmp_path / "bin" / "unspoken", "agent", "--help")
    run(python, "-P", "-c", "import agent.process.robot, agent.process.health, chassis.watching")
