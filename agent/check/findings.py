"""What a check finds, for people and as JSON."""

import json
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Literal, NamedTuple

from agent.estimate import GoalsName
from agent.process.robot import RobotOptions
from agent.solve import SolverName
from protocol.identity import Identity
from protocol.scene import Goal


@dataclass(frozen=True)
class Device:
    """The options of ``unspoken agent``, valid each by itself."""

    robot: str
    goal: Goal
    connect: str
    password_file: Path | None
    keys: Path | None
    run: str
    goals: GoalsName
    solver: SolverName
    iterations: int
    budget_s: float | None
    robots: int
    """How many to reckon with where no world tells."""
    config: Path | None

    def options(self, identity: Identity, goal: Goal | None = None) -> RobotOptions:
        """What its robot's process would be told.

        Args:
            identity: that proves who it is.
            goal: None for its own.
        """
        return RobotOptions(
            self.robot,
            goal or self.goal,
            self.connect,
            identity,
            self.run,
            self.goals,
            self.solver,
            self.iterations,
            self.budget_s,
        )


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
