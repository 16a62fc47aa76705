"""The page of a report: everything in one file, without scripts and without the network."""

from base64 import b64encode
from collections.abc import Sequence
from importlib.resources import files
from typing import NamedTuple

from jinja2 import Environment, StrictUndefined

from fleet.report.tables import Table


class Picture(NamedTuple):
    """A picture of the page, which is a file of its own too."""

    file: str
    """Its name."""
    png: bytes
    alternative: str
    """What it shows, in words."""

    @property
    def source(self) -> str:
        """The picture as an address that holds it."""
        return f"data:image/png;base64,{b64encode(self.png).decode()}"


class Level(NamedTuple):
    """All methods at one level of noise."""

    title: str
    pictures: Sequence[Picture]
    tables: Sequence[Table]
    details: Sequence[Table]
    """Long ones, shown on demand."""


class WorstRun(NamedTuple):
    """One of the worst runs."""

    title: str
    why: str
    picture: Picture | None
    remarks: Sequence[str]
    command: str
    """What repeats it."""


class Page(NamedTuple):
    """What a report says."""

    title: str
    facts: Sequence[tuple[str, str]]
    remarks: Sequence[str]
    """What a reader must know first."""
    overview: Sequence[Table]
    levels: Sequence[Level]
    worst: Sequence[WorstRun]
    notes: Sequence[str]

    @property
    def pictures(self) -> list[Picture]:
        """All of the page."""
        charts = [picture for level in self.levels for picture in level.pictures]
        return charts + [run.picture for run in self.worst if run.picture is not None]

    def html(self) -> str:
        """The page."""
        environment = Environment(
            autoescape=True, undefined=StrictUndefined, trim_blocks=True, lstrip_blocks=True
        )
        return environment.from_string(_text("page.html")).render(page=self, style=_text("page.css"))


def _text(name: str) -> str:
    return files("fleet.report").joinpath(name).read_text(encoding="utf-8")
