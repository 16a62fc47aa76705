"""Where every robot wants to go, inferred from what was seen: one module an estimator."""

from collections.abc import Callable
from typing import Literal

from agent.estimation.constant_acceleration import ConstantAcceleration
from agent.estimation.exchanged import Exchanged
from agent.estimation.interface import GoalEstimator
from agent.estimation.inverse_optimal_control import InverseOptimalControl
from protocol.scene import Scene

GoalsName = Literal["exchanged", "ioc", "constant-acceleration"]

ESTIMATORS: dict[GoalsName, Callable[[Scene], GoalEstimator]] = {
    "exchanged": Exchanged,
    "ioc": InverseOptimalControl,
    "constant-acceleration": ConstantAcceleration,
}
"""By the name that ``--goals`` takes."""
