"""The tutorial works as it is written: its files are saved, its commands given one after the other."""

import os
import re
import subprocess
import sys
from pathlib import Path

import pytest
from markdown_it import MarkdownIt

ROOT = Path(__file__).parents[2]
COMMANDS = Path(sys.executable).parent


@pytest.mark.slow
def test_every_command_of_the_tutorial_does_what_it_should(tmp_path):
    said = ""
    blocks = [
        block for block in MarkdownIt().parse((ROOT / "docs" / "tutorial.md").read_text()) if block.content
    ]
    for before, block in zip(["", *(one.content for one in blocks)], blocks, strict=False):
        if block.type == "fence" and block.info == "yaml":
            (name,) = re.findall(r"Save this as `(\S+\.yaml)`", before)
            (tmp_path / name).write_text(block.content)
        elif block.type == "fence" and "PATH" not in block.content:
            for line in block.content.splitlines():
                done = subprocess.run(
                    line.split(),
                    cwd=tmp_path,
                    env={**os.environ, "PATH": f"{COMMANDS}:{os.environ['PATH']}"},
                    capture_output=True,
                    text=True,
                )
                assert done.returncode == 0, (line, done.stdout, done.stderr)
                said += done.stdout
    for written in ("mine/summary.json", "mine/paths.png", "mine-compared/report.html"):
        assert (tmp_path / "runs" / written).stat().st_size > 0
    assert "Everything follows" in said
