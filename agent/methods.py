"""What ``--goals`` chooses: how robots come to know what the others will do, and what they make of it."""

from typing import NamedTuple

from agent.estimate import ESTIMATORS, GoalsName
from agent.estimate.constant_acceleration import ConstantAcceleration
from agent.estimate.exchanged import Unestimated
from agent.estimate.interface import GoalEstimator
from agent.solve.deadline import Deadline
from agent.solve.independent import ConstantVelocity, IndependentPredictor
from agent.solve.orca import OrcaPlanner
from agent.solve.planning import Planner
from agent.solve.prediction import Predictor
from agent.solve.problem import JointSolver
from protocol.scene import Scene


class Method(NamedTuple):
    """Who does the verbs of algorithm 1, and by when."""

    estimator: GoalEstimator
    predictor: Predictor | IndependentPredictor
    planner: Planner | OrcaPlanner
    deadline: Deadline
    """Asked by all of them before they go on improving."""


def method_of(name: GoalsName, scene: Scene, robot: str, solver: JointSolver, deadline: Deadline) -> Method:
    """The method of a name for one robot: the publication's with one of its estimators, or a baseline.

    Args:
        name: of the method.
        scene: what everybody may know.
        robot: who decides.
        solver: of its trajectory problems, which asks the same deadline.
        deadline: of its decisions.

    Raises:
        ValueError: the estimator needs something that the scene does not hold.
        ModuleNotFoundError: ORCA's library is not installed.
    """
    planner = Planner(scene, robot, solver, deadline)
    if name in ESTIMATORS:
        return Method(ESTIMATORS[name](scene), Predictor(scene, solver, deadline), planner, deadline)
    if name == "constant-acceleration-alone":
        accelerating = IndependentPredictor(robot, ConstantAcceleration(scene).path)
        return Method(Unestimated(), accelerating, planner, deadline)
    coasting = IndependentPredictor(robot, ConstantVelocity(scene).path)
    if name == "constant-velocity":
        return Method(Unestimated(), coasting, planner, deadline)
    return Method(Unestimated(), coasting, OrcaPlanner(scene, robot, planner), deadline)
