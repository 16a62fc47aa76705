"""What a device is told, before anything of it is tried."""

from dataclasses import dataclass
from pathlib import Path

from agent.estimation import GoalsName
from agent.process import RobotOptions
from agent.solver import SolverName
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
