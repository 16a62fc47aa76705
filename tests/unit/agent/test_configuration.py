"""The file of a robot's options: what it may hold, what is refused, and what goes before it."""

from pathlib import Path

import pytest
import typer
from typer.testing import CliRunner

import agent.__main__
from agent.check.findings import Device
from agent.cli import app
from agent.process.options import Configuration, options_in
from chassis.refusal import Refusal
from protocol.scene import Goal

WHOLE = """
robot: 3
goal: {x_m: 4, y_m: -4.5, heading_rad: -0.785}
connect: tls/world.local:7447
keys: keys/robot-3
run: hall
goals: ioc
solver: reference
iterations: 3
budget_ms: 50
robots: 4
"""
OPTIONS = {
    parameter.name
    for parameter in typer.main.get_command(app).commands["agent"].params  # type: ignore[attr-defined]
}


@pytest.fixture
def file(tmp_path):
    def write(text, mode=0o600):
        path = tmp_path / "agent.yaml"
        path.write_text(text, encoding="utf-8")
        path.chmod(mode)
        return path

    return write


@pytest.fixture
def checked(monkeypatch):
    """Runs the command line with ``--check``, and gives what it would check."""
    devices = []
    monkeypatch.setattr(
        agent.__main__, "check_device", lambda device, as_json: devices.append(device) or True
    )

    def run(*arguments, env=None):
        told = CliRunner().invoke(app, ["agent", "--check", *map(str, arguments)], env=env)
        return told, devices[-1] if devices else None

    return run


def test_every_option_that_says_how_a_robot_is_may_stand_in_the_file():
    assert set(Configuration.model_fields) == OPTIONS - {"config", "check", "json", "help"}


def test_all_of_them_are_taken(file, checked, tmp_path):
    told, device = checked("--config", path := file(WHOLE))
    assert told.exit_code == 0, told.output
    assert device == Device(
        robot="3",
        goal=Goal(x_m=4.0, y_m=-4.5, heading_rad=-0.785),
        connect="tls/world.local:7447",
        password_file=None,
        keys=tmp_path / "keys" / "robot-3",
        run="hall",
        goals="ioc",
        solver="reference",
        iterations=3,
        budget_s=0.05,
        robots=4,
        config=path,
    )


def test_the_command_line_goes_before_the_environment_and_that_before_the_file(file, checked):
    path = file("robot: 1\ngoal: {x_m: 1, y_m: 0, heading_rad: 0}\nrun: of-the-file\niterations: 7\n")
    env = {"UNSPOKEN_CONFIG": str(path), "UNSPOKEN_RUN": "of-the-environment", "UNSPOKEN_ROBOT": "2"}
    _, device = checked("--robot", 5, env=env)
    assert (device.robot, device.run, device.iterations) == ("5", "of-the-environment", 7)
    assert device.connect == "tcp/127.0.0.1:7447", "the default"


def test_what_nobody_says_is_still_asked_for(file, checked):
    told, device = checked("--config", file("run: hall\n"))
    assert (told.exit_code, device) == (2, None)
    assert "--robot" in told.output


MISTAKES = [
    ("robot: 1\nrobto: 2\n", "agent.yaml:2: robto: there is no such field; did you mean 'robot'?"),
    ("iterations: many\n", "agent.yaml:1: iterations: input should be a valid integer, found 'many'"),
    ("iterations: 0\n", "agent.yaml:1: iterations: input should be greater than or equal to 1, found 0"),
    ("budget_ms: .nan\n", "agent.yaml:1: budget_ms: input should be a finite number, found .nan"),
    ("goal: 4,0,0\n", "agent.yaml:1: goal: a map with x_m, y_m, heading_rad is expected, found '4,0,0'"),
    ("goal: {x_m: 4, y_m: 0}\n", "agent.yaml:1: goal.heading_rad: this field is missing"),
    ("solver: quick\n", "agent.yaml:1: solver: input should be 'realtime' or 'reference', found 'quick'"),
    ("run: a/b\n", "agent.yaml:1: run: string should match pattern "),
    ("robots: 1000\n", "agent.yaml:1: robots: input should be less than or equal to 128, found 1000"),
    ("run: a\nrun: b\n", "agent.yaml:2: 'run' is given twice, first in line 1: keep one of the two"),
    ("- robot: 1\n", "agent.yaml:1: a map with robot, goal, connect"),
    ("", "agent.yaml: the file is empty; a file of a robot's options needs a map with robot, goal"),
]


@pytest.mark.parametrize(("text", "told"), MISTAKES, ids=[text.strip() or "nothing" for text, _ in MISTAKES])
def test_a_mistake_is_told_with_its_place(file, text, told):
    path = file(text)
    with pytest.raises(Refusal) as refused:
        options_in(path)
    assert str(refused.value).startswith(f"{path.parent}/{told}")


def test_on_the_command_line_a_mistake_is_told_in_plain_lines(file, checked):
    told, device = checked("--config", file("gaol: 1\nrun: 1.5\n"))
    assert (told.exit_code, device) == (2, None)
    first, second = told.stderr.splitlines()
    assert ":1: gaol: there is no such field; did you mean 'goal'?" in first
    assert ":2: run: input should be a valid string, found 1.5; put it in quotes" in second


def test_a_file_that_is_not_there_is_a_clear_error(checked):
    told, _ = checked("--config", "/nowhere/agent.yaml")
    assert told.exit_code == 2
    assert told.stderr == "/nowhere/agent.yaml: the file cannot be read: No such file or directory\n"


def test_a_goal_is_not_for_everybody_to_read(file):
    goal = "goal: {x_m: 4, y_m: 0, heading_rad: 0}\n"
    with pytest.raises(Refusal, match=r"everybody .* can read the robot's goal \(mode 0644\).*chmod o= "):
        options_in(file(goal, 0o644))
    assert options_in(file(goal, 0o640)) == {"goal": "4.0,0.0,0.0"}
    assert options_in(file("robot: 1\n", 0o644)) == {"robot": "1"}


def test_files_are_looked_for_beside_the_file(file, monkeypatch):
    path = file("password_file: secret\nkeys: /etc/unspoken/keys\n")
    monkeypatch.chdir(path.parent)
    assert options_in(Path("agent.yaml")) == {
        "password_file": str(path.parent / "secret"),
        "keys": "/etc/unspoken/keys",
    }


def test_json_is_for_the_check_only():
    told = CliRunner().invoke(app, ["agent", "--robot", "1", "--goal", "1,0,0", "--json"])
    assert told.exit_code == 2
    assert "--check" in told.output
