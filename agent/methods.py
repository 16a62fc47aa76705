"""What ``--goals`` chooses: how robots come to know what the others will do, and what they make of it."""

from typing import NamedTuple

from agent.deadline import Deadline
from agent.estimation import ESTIMATORS, GoalsName
from agent.estimation.constant_acceleration import ConstantAcceleration
from agent.estimation.interface import GoalEstimator
from agent.estimation.unestimated import Unestimated
from agent.independent import ConstantVelocity, IndependentPredictor
from agent.orca import OrcaPlanner
from agent.planning import Planner
from agent.prediction import Predictor
from agent.solver.problem import JointSolver
from protocol.scene import Scene


class Method(NamedTuple):
    """Who does the verbs of algorithm 1."""

    estimator: GoalEstimator
    predictor: Predictor | IndependentPredictor
    planner: Planner | OrcaPlanner


def method_of(name: GoalsName, scene: Scene, robot: str, solver: JointSolver, deadline: Deadline) -> Method:
    """The method of a name for one robot: the publication's with one of its estimators, or a baseline.

    Raises:
        ValueError: the estimator needs something that the scene does not hold.
        ModuleNotFoundError: ORCA's library is not installed.
    """
    planner = Planner(scene, robot, solver, deadline)
    if name in ESTIMATORS:
        return Method(ESTIMATORS[name](scene), Predictor(scene, solver, deadline), planner)
    if name == "constant-acceleration-alone":
        accelerating = IndependentPredictor(robot, ConstantAcceleration(scene).path)
        return Method(Unestimated(), accelerating, planner)
    coasting = IndependentPredictor(robot, ConstantVelocity(scene).path)
    if name == "constant-velocity":
        return Method(Unestimated(), coasting, planner)
    return Method(Unestimated(), coasting, OrcaPlanner(scene, robot, planner))
