"""Wrong usage of the world's command line, refused before anything is opened."""

import pytest
import typer
from typer.testing import CliRunner

from chassis.refusal import Command
from world.__main__ import main

app = typer.Typer()
app.command(cls=Command)(main)


def invoke(*arguments):
    result = CliRunner().invoke(app, arguments, env={"COLUMNS": "400", "NO_COLOR": "1", "TERM": "dumb"})
    assert not isinstance(result.exception, Exception), result.exception
    return result


@pytest.mark.parametrize(
    ("arguments", "told"),
    [
        ([], "--scenario"),
        (["--scenario", "8a", "--run", "a/b"], "'a/b' is no name of a run"),
        (["--scenario", "8a", "--clock", "sundial"], "'sundial'"),
        (["--scenario", "8a", "--seed", "-1"], "--seed"),
        (["--scenario", "8a", "--start-timeout", "nan"], "nan found, 0 to 86400 seconds are expected"),
        (["--scenario", "8a", "--answer-timeout", "inf"], "inf found, 0 to 86400 seconds are expected"),
        (["--scenario", "8a", "--answer-timeout", "-1"], "-1.0 found"),
        (["--scenario", "8a", "--colour", "red"], "--colour"),
        (["--scenario", "8z"], "8z: there is no such file"),
    ],
)
def test_wrong_usage_is_told_with_status_2(arguments, told):
    result = invoke(*arguments)
    assert result.exit_code == 2
    assert told in result.stderr
    assert result.stdout == ""


def test_a_wrong_scenario_file_is_told_with_its_name_and_status_2(tmp_path):
    path = tmp_path / "crossing.yaml"
    path.write_text("name: crossing\nrobots: []\n")
    result = invoke("--scenario", str(path))
    assert result.exit_code == 2
    assert "crossing.yaml:2" in result.stderr
