"""No goals at all: for methods that predict motions without asking where they lead."""

from agent.memory import Memory
from agent.vehicle import Array


class Unestimated:
    """Estimates nothing."""

    goals_are_shared = False

    def estimate(self, memory: Memory) -> dict[str, Array]:
        """See :class:`agent.estimation.interface.GoalEstimator`."""
        return {}
