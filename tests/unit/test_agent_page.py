"""What the page on the agent says of its options, its file and its check is what there is."""

import re
from pathlib import Path

import pytest
import typer
import yaml
from markdown_it import MarkdownIt

from agent.__main__ import main
from agent.process.options import FileOptions, options_in
from chassis.refusal import app_of

DOCS = Path(__file__).parents[2] / "docs"
PAGE = (DOCS / "agent.md").read_text(encoding="utf-8")
COMMAND = typer.main.get_command(app_of(main))
OPTIONS = {parameter.opts[0]: parameter for parameter in COMMAND.params if parameter.name != "help"}
NONE = {"–", "none", "required"}


def rows() -> list[list[str]]:
    """The cells of the table of options, row by row."""
    table = re.search(r"^\| option .*\n(?:\|.*\n)+", PAGE, re.MULTILINE)
    assert table
    return [[cell.strip() for cell in row.split("|")[1:-1]] for row in table[0].splitlines()[2:]]


def code(cell: str) -> str | None:
    """What stands in a cell as code; None where there is nothing to say."""
    return None if cell in NONE else re.fullmatch("`([^`]+)`", cell)[1]  # type: ignore[index]


def test_the_table_says_of_every_option_what_is_so() -> None:
    assert sorted(code(row[0]) or "" for row in rows()) == sorted(OPTIONS)
    for name, environment, in_file, default, _ in rows():
        parameter = OPTIONS[code(name) or ""]
        assert code(environment) == parameter.envvar
        assert code(in_file) == (parameter.name if parameter.name in FileOptions.model_fields else None)
        assert (default == "required") == parameter.required
        if parameter.name not in ("check", "json"):
            assert code(default) == (None if parameter.default is None else str(parameter.default))


@pytest.mark.parametrize("page", ["agent.md", "deploy.md"])
def test_the_example_of_a_file_can_be_used(page: str, tmp_path: Path) -> None:
    tokens = MarkdownIt().parse((DOCS / page).read_text(encoding="utf-8"))
    [example] = [token.content for token in tokens if token.type == "fence" and token.info == "yaml"]
    path = tmp_path / "agent.yaml"
    path.write_text(example, encoding="utf-8")
    path.chmod(0o600)
    assert options_in(path).keys() == yaml.safe_load(example).keys()
