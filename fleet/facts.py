"""What is known of a run before it starts."""

from agent.estimation import GoalsName
from agent.solver import ITERATIONS, SolverName
from protocol.keys import Name
from protocol.scene import Settings

SHARING: GoalsName = "exchanged"
"""The one choice of ``--goals`` for which the world tells the goals."""


VIRTUAL = "virtual"
"""The clock of ``simulate``, as its summary names it."""


class RunFacts(Settings):
    """Which experiment a run is; kept in its summary and in its recording."""

    scenario: str
    """The scenario's name."""
    goals: GoalsName
    """How the robots come to know goals: ``exchanged`` or the name of an estimator."""
    solver: SolverName
    iterations: int = ITERATIONS
    """Most of the real-time solver for one problem."""
    budget_ms: float | None = None
    """After which the real-time solver improves a decision no further; None for no limit."""
    clock: str
    seed: int
    run: Name
    """The run's name on the bus."""
    faults: int = 0
    """How many were to befall it."""
    policy: bool = False
    """Whether the world's router let every process do what it was granted and nothing else."""
    version: str
    """Of this software."""

    @property
    def goals_are_exchanged(self) -> bool:
        """Whether the scene holds the goals."""
        return self.goals == SHARING

    @property
    def budget_s(self) -> float | None:
        """The time that a decision may take, in s; None for no limit."""
        return None if self.budget_ms is None else self.budget_ms / 1000.0
