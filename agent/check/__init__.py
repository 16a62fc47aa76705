"""The check of a device, ``--check``: whether it is ready to be a robot."""

from collections.abc import Sequence
from textwrap import fill
from typing import Literal, NamedTuple


class Finding(NamedTuple):
    """One item of the check."""

    item: str
    state: Literal["ok", "warning", "failed"]
    found: str
    remedy: str = ""
    """What to do about it; empty where ``found`` says that, too, or nothing is to be done."""

    def line(self, width: int | None = None) -> str:
        """As one line for people; on a terminal of some width, as several that begin under one another."""
        head, remedy = f"{self.state:8} {self.item:14} ", f"; {self.remedy}" if self.remedy else ""
        text = f"{head}{self.found}{remedy}"
        if width is None:
            return text
        indent = len(head) * " "
        return fill(text, width, subsequent_indent=indent, break_long_words=False, break_on_hyphens=False)


def is_ready(findings: Sequence[Finding]) -> bool:
    """Whether nothing has failed."""
    return all(finding.state != "failed" for finding in findings)


def verdict(findings: Sequence[Finding]) -> str:
    """The last line for people."""
    failed, warned = (sum(each.state == state for each in findings) for state in ("failed", "warning"))
    warnings = f", {warned} warning{'' if warned == 1 else 's'}" if warned else ""
    return f"not ready: {failed} failed{warnings}" if failed else f"ready{warnings}"
