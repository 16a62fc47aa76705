"""What ``--goals`` chooses: how robots come to know what the others will do, and what they make of it."""

from typing import NamedTuple

import numpy as np

from agent.estimate import DEFAULT_GOALS, ESTIMATORS, GoalsName
from agent.estimate.goals import ConstantAcceleration, GoalEstimator, Unestimated
from agent.remember.memory import Memory
from agent.solve import Deadline
from agent.solve.arrival import EarlyPlanner
from agent.solve.orca import OrcaPlanner
from agent.solve.planning import JointPlan, Planner
from agent.solve.prediction import IndependentPredictor, Predictor
from agent.solve.problem import JointSolver
from agent.solve.vehicle import Array, rollout
from protocol.scene import Scene


class Method(NamedTuple):
    """Who does the verbs of algorithm 1, and by when."""

    estimator: GoalEstimator
    predictor: Predictor | IndependentPredictor
    planner: Planner | JointPlan | OrcaPlanner
    deadline: Deadline
    """Asked by all of them before they go on improving."""


def method_of(name: GoalsName, scene: Scene, robot: str, solver: JointSolver, deadline: Deadline) -> Method:
    """The method of a name for one robot: the publication's with one of its estimators, or a baseline.

    The solver of its trajectory problems is to ask the same deadline.

    Raises:
        ValueError: the estimator needs something that the scene does not hold.
        ModuleNotFoundError: ORCA's library is not installed.
    """
    plans = EarlyPlanner if name == DEFAULT_GOALS else Planner
    planner = plans(scene, robot, solver, deadline)
    if name in ESTIMATORS:
        estimator, predictor = ESTIMATORS[name](scene), Predictor(scene, solver, deadline)
        joint_or_own = JointPlan(robot, planner) if estimator.goals_are_shared else planner
        return Method(estimator, predictor, joint_or_own, deadline)

    def coasting(memory: Memory, other: str) -> Array:
        no_input = np.zeros((scene.horizons.prediction_steps, 2))
        return rollout(memory.state(other), no_input, scene.step_s)[:, :2]

    accelerates = name == "constant-acceleration-alone"
    independent = IndependentPredictor(robot, ConstantAcceleration(scene).path if accelerates else coasting)
    baseline = OrcaPlanner(scene, robot, planner) if name == "orca" else planner
    return Method(Unestimated(), independent, baseline, deadline)
