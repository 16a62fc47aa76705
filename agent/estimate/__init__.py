"""Where every robot wants to go, inferred from what was seen: one module an estimator."""

from collections.abc import Callable
from typing import Literal

from agent.estimate.bilevel import Bilevel
from agent.estimate.goals import ConstantAcceleration, Exchanged, GoalEstimator
from agent.estimate.inverse_optimal_control import InverseOptimalControl
from agent.estimate.joint_fit import JointFit
from agent.estimate.kalman_filter import KalmanFilter
from protocol.scene import Scene

GoalsName = Literal[
    "exchanged",
    "ioc",
    "joint-fit",
    "kalman-filter",
    "bilevel",
    "constant-acceleration",
    "constant-acceleration-alone",
    "constant-velocity",
    "orca",
]
"""What ``--goals`` takes: the name of an estimator, or of a baseline that asks for no goals."""

DEFAULT_GOALS: GoalsName = "joint-fit"
"""The one that loses least against exchanged goals (``docs/estimation.md``)."""

ESTIMATORS: dict[GoalsName, Callable[[Scene], GoalEstimator]] = {
    "exchanged": Exchanged,
    "ioc": InverseOptimalControl,
    "joint-fit": JointFit,
    "kalman-filter": KalmanFilter,
    "bilevel": Bilevel,
    "constant-acceleration": ConstantAcceleration,
}
"""By name. ``agent.methods`` has the baselines."""
