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


def test_help_tells_what_it_does_and_how_it_ends() -> None:
    told = bridge("--help")
    assert told.exit_code == 0
    assert "Exit status: 0 stopped" in told.stdout
    listed = set(re.findall(r"--([a-z-]+) ", told.stdout)) - {"help"}
    assert listed == {"listen", "users", "keys", "insecure", "run", "start-timeout", "watch-port"}
    for option in listed:
        assert f"UNSPOKEN_{option.upper().replace('-', '_')}" in told.stdout


def test_the_file_of_the_docs_is_valid_and_shows_every_default() -> None:
    path = ROOT / "docs" / "bridge.yaml"
    shown = read_as(path, Ros2Bridge, "file of a bridge")
    rules = Ros2Bridge.model_validate(bridge_file(1)).model_dump(exclude={"robots"})
    assert shown.model_dump(exclude={"robots"}) == rules
    written = yaml.safe_load(path.read_text())
    assert set(written) == set(Ros2Bridge.model_fields)


@pytest.mark.parametrize(
    ("content", "words"),
    [
        (None, "cannot be read"),
        ("robots: []", "at least 1 item"),
        (
            "robots:\n  - {id: 1, odometry: odom, command: /cmd_vel}",
            "bridge.yaml:2: robots[0].odometry: 'odom'",
        ),
    ],
)
def test_a_wrong_file_is_one_clear_message(tmp_path: Path, content: str | None, words: str) -> None:
    path = tmp_path / "bridge.yaml"
    if content is not None:
        path.write_text(content)
    refused = bridge(path)
    assert refused.exit_code == 2
    assert words in refused.stderr
    assert len(refused.stderr.splitlines()) == 1


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("--listen", "tcp/0.0.0.0:7448"), "can be reached from other machines"),
        (("--listen", "tls/world.local:7448"), "--keys"),
        (("--users", "nowhere"), "nowhere"),
        (("--run", "a/b"), "--run"),
        (("--start-timeout", "nan"), "--start-timeout"),
    ],
)
def test_what_a_world_refuses_is_refused_here_too(
    tmp_path: Path, arguments: tuple[str, str], words: str
) -> None:
    path = tmp_path / "bridge.yaml"
    path.write_text(yaml.safe_dump(bridge_file(2)))
    refused = bridge(path, *arguments)
    assert refused.exit_code == 2
    assert words in refused.stderr
    assert "Traceback" not in refused.output
