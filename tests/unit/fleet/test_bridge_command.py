"""``unspoken bridge ros2`` as far as its command line goes; tests/processes has bridges that drive."""

import re
from pathlib import Path

import pytest
import yaml
from click.testing import Result
from ros2_helpers import bridge_file
from typer.testing import CliRunner

from chassis.files import read_as
from fleet.cli import app
from world.ros2.odometry import Ros2Bridge

ROOT = Path(__file__).parents[3]


def bridge(*arguments: object) -> Result:
    return CliRunner().invoke(app, ["bridge", "ros2", *map(str, arguments)], env={"COLUMNS": "200"})


def test_help_tells_its_options_each_with_its_environment_variable() -> None:
    told = bridge("--help")
    listed = set(re.findall(r"--([a-z-]+) ", told.stdout)) - {"help"}
    assert listed == {"listen", "users", "keys", "insecure", "run", "start-timeout", "watch-port"}
    for option in listed:
        assert f"UNSPOKEN_{option.upper().replace('-', '_')}" in told.stdout


def test_the_file_of_the_docs_is_valid_and_shows_every_default() -> None:
    path = ROOT / "docs" / "bridge.yaml"
    shown = read_as(path, Ros2Bridge, "file of a bridge")
    rules = Ros2Bridge.model_validate(bridge_file(1)).model_dump(exclude={"robots"})
    assert shown.model_dump(exclude={"robots"}) == rules
    assert set(yaml.safe_load(path.read_text())) == set(Ros2Bridge.model_fields)


RIGHT = yaml.safe_dump(bridge_file(2))
WRONG = "robots:\n  - {id: 1, odometry: odom, command: /cmd_vel}"


@pytest.mark.parametrize(
    ("content", "arguments", "words"),
    [
        (None, (), "cannot be read"),
        ("robots: []", (), "at least 1 item"),
        (WRONG, (), "bridge.yaml:2: robots[0].odometry: 'odom'"),
        (RIGHT, ("--listen", "tcp/0.0.0.0:7448"), "can be reached from other machines"),
        (RIGHT, ("--listen", "tls/world.local:7448"), "--keys"),
        (RIGHT, ("--users", "nowhere"), "nowhere"),
        (RIGHT, ("--run", "a/b"), "--run"),
        (RIGHT, ("--start-timeout", "nan"), "--start-timeout"),
    ],
)
def test_a_wrong_file_and_what_a_world_refuses_are_refused(
    tmp_path: Path, content: str | None, arguments: tuple[str, ...], words: str
) -> None:
    path = tmp_path / "bridge.yaml"
    if content is not None:
        path.write_text(content)
    refused = bridge(path, *arguments)
    assert refused.exit_code == 2
    assert words in refused.stderr
    assert "Traceback" not in refused.output
