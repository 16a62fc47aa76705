"""What a check finds, for people and as JSON."""

import json
from collections.abc import Iterable
from typing import Literal, NamedTuple

State = Literal["ok", "warning", "failed"]


class Finding(NamedTuple):
    """One item of the check."""

    item: str
    state: State
    found: str
    remedy: str = ""
    """What to do about it; empty where ``found`` tells that, too, or nothing is to be done."""

    def line(self) -> str:
        """As one line for people."""
        remedy = f"; {self.remedy}" if self.remedy else ""
        return f"{self.state:8} {self.item:14} {self.found}{remedy}"


def is_ready(findings: Iterable[Finding]) -> bool:
    """Whether nothing has failed."""
    return all(finding.state != "failed" for finding in findings)


def told_as_json(findings: Iterable[Finding]) -> str:
    """All of them, for programs."""
    told = list(findings)
    return json.dumps(
        {"ready": is_ready(told), "items": [each._asdict() for each in told]}, ensure_ascii=False, indent=2
    )
