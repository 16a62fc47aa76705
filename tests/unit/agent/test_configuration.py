"""A robot's options: on the command line, in the environment and in a file, and which goes before which."""

from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from typer.testing import CliRunner

import agent.__main__
from agent.cli import app
from agent.process.options import RobotOptions, options_in, parse_goal
from chassis.refusal import Refusal, app_of
from protocol.scene import Goal

NUMBERS = st.floats(-1e6, 1e6)


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
    """Runs the command line with ``--check``, and gives the options that it would check."""
    found = []
    monkeypatch.setattr(
        agent.__main__, "check_device", lambda options, config, as_json_text: found.append(options) or True
    )

    def run(*arguments, env=None):
        result = CliRunner().invoke(app, ["agent", "--check", *map(str, arguments)], env=env)
        return result, found[-1] if found else None

    return run


@settings(max_examples=30)
@given(
    goal=st.builds(Goal, x_m=NUMBERS, y_m=NUMBERS, heading_rad=NUMBERS),
    robot=st.from_regex(r"\A[A-Za-z0-9][A-Za-z0-9_-]{0,31}\Z"),
    budget_ms=st.none() | st.floats(0.0, 1e9),
    reserve=st.booleans(),
    keys=st.none() | st.just(Path("/a/b")),
)
def test_the_environment_of_a_process_says_exactly_its_options(goal, robot, budget_ms, reserve, keys):
    found: list[RobotOptions] = []

    def note(options: RobotOptions) -> None:
        found.append(options)

    told = {"run": "hall", "goals": "ioc", "iterations": 3, "watch_port": 9100, "robots": 4}
    drawn = {"goal": goal, "robot": robot, "budget_ms": budget_ms, "reserve": reserve, "keys": keys}
    options = RobotOptions(**told, **drawn)
    command = app_of(agent.__main__.with_options(environment=True)(note))
    environment = {f"UNSPOKEN_{name.upper()}": value for name, value in options.as_environment().items()}
    assert CliRunner().invoke(command, [], env=environment).exit_code == 0
    assert found == [options]


def test_the_command_line_goes_before_the_environment_and_that_before_the_file(file, checked):
    path = file("robot: 1\ngoal: {x_m: 1, y_m: 0, heading_rad: 0}\nrun: of-the-file\niterations: 7\n")
    env = {"UNSPOKEN_CONFIG": str(path), "UNSPOKEN_RUN": "of-the-environment", "UNSPOKEN_ROBOT": "2"}
    _, options = checked("--robot", 5, env=env)
    assert (options.robot, options.run, options.iterations) == ("5", "of-the-environment", 7)
    assert options.connect == RobotOptions.model_fields["connect"].default


@pytest.mark.parametrize(
    ("variable", "value", "words"),
    [
        ("ROBOT", "a/b", ("--robot", "'a/b' found")),
        ("ROBOT", "", ("--robot",)),
        ("GOAL", "1,2", ("--goal", "'1,2' found, x,y,heading is expected")),
        ("GOAL", "1,2,nan", ("--goal", "x,y,heading is expected")),
        ("GOALS", "guess", ("--goals", "guess", "constant-acceleration")),
        ("ITERATIONS", "0", ("--iterations", "greater than or equal to 1")),
        ("BUDGET_MS", "nan", ("--budget-ms", "greater than or equal to 0")),
        ("BUDGET_MS", "inf", ("--budget-ms", "finite number")),
        ("CONNECT", 5000 * "x", ("--connect", "at most 4096 characters")),
        ("WATCH_PORT", "65536", ("--watch-port", "65535")),
    ],
    ids=lambda each: each[:9] if isinstance(each, str) else "",
)
def test_an_option_from_the_environment_is_checked(variable, value, words):
    right = {"UNSPOKEN_ROBOT": "1", "UNSPOKEN_GOAL": "1,2,3"}
    result = CliRunner().invoke(app, ["agent"], env={**right, f"UNSPOKEN_{variable}": value})
    assert (result.exit_code, result.stdout) == (2, "")
    for word in words:
        assert word in result.stderr


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("robot: 1\nrobto: 2\n", ":2: robto: there is no such field; did you mean 'robot'?"),
        ("goal: 4,0,0\n", ":1: goal: a map with x_m, y_m, heading_rad is expected, found '4,0,0'"),
        ("run: 1.5\n", ":1: run: input should be a valid string, found 1.5; put it in quotes"),
        ("robots: 1000\n", ":1: robots: input should be less than or equal to 128, found 1000"),
        ("", ": the file is empty; a file of a robot's options needs a map with robot, goal"),
        (None, ": the file cannot be read: No such file or directory"),
    ],
)
def test_a_mistake_in_the_file_is_named_with_its_place(text, words, file, checked, tmp_path):
    path = tmp_path / "none.yaml" if text is None else file(text)
    result, options = checked("--config", path)
    assert (result.exit_code, options) == (2, None)
    assert result.stderr.startswith(f"{path}{words}")


def test_a_goal_is_not_for_everybody_to_read(file):
    goal = "goal: {x_m: 4, y_m: 0, heading_rad: 0}\n"
    with pytest.raises(Refusal, match=r"everybody .* can read the robot's goal \(mode 0644\).*chmod o= "):
        options_in(file(goal, 0o644))
    assert options_in(file(goal, 0o640)) == {"goal": parse_goal("4,0,0")}
    assert options_in(file("robot: 1\n", 0o644)) == {"robot": "1"}
