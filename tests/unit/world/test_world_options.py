"""Wrong usage of the world's command line, refused before anything is opened."""

import pytest
from typer.testing import CliRunner

from chassis.refusal import app_of
from world.__main__ import main


@pytest.mark.parametrize(
    ("arguments", "told"),
    [
        ([], "--scenario"),
        (["--scenario", "8a", "--run", "a/b"], "'a/b' found, 1 to 32 letters, digits"),
        (["--scenario", "8a", "--clock", "sundial"], "'sundial'"),
        (["--scenario", "8a", "--seed", "-1"], "--seed"),
        (["--scenario", "8a", "--start-timeout", "nan"], "--start-timeout"),
        (["--scenario", "8a", "--answer-timeout", "86401"], "--answer-timeout"),
        (["--scenario", "8z"], "8z: there is no such file"),
    ],
)
def test_wrong_usage_is_told_with_status_2(arguments, told):
    env = {"COLUMNS": "400", "NO_COLOR": "1", "TERM": "dumb"}
    result = CliRunner().invoke(app_of(main), arguments, env=env)
    assert result.exit_code == 2
    assert told in result.stderr
    assert result.stdout == ""
