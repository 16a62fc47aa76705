"""Scenes, memories, problems and a second, slow way of driving that the tests of the agent share."""

import json
import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from agent.agent import Agent
from agent.estimate import GoalsName
from agent.methods import method_of
from agent.process.options import RobotOptions
from agent.remember.memory import Memory
from agent.solve import ITERATIONS, Clock, Deadline, joint_solver
from agent.solve.problem import JointProblem, JointSolver, Solution, Start, braking_inputs, within_limits
from agent.solve.starts import cold_start
from agent.solve.vehicle import Array
from protocol.messages import Accuracy, Mind, Observation, State, Timings
from protocol.scene import Area, Goal, PublicRobot, Scene
from protocol.vehicle import Limits

STEP_S = 0.1
EPOCH = 7
SAFETY_M = 1.39
WEIGHTS = (1.0, 1.0, 0.03, 0.6)
LOOSE = Limits(
    speed_mps=1000.0,
    acceleration_mps2=1000.0,
    turn_rate_radps=1000.0,
    jerk_mps3=1000.0,
    turn_acceleration_radps2=1000.0,
)
"""Limits that nothing in the tests comes near."""
NEVER = Deadline(lambda: 0.0, None)
SOLVERS: dict[str, JointSolver] = {
    "realtime": joint_solver("realtime", ITERATIONS, NEVER),
    "reference": joint_solver("reference", ITERATIONS, NEVER),
}
"""One of each for all tests: they may keep nothing that changes a result, and one test shows that."""


def free(wanted: Array) -> None:
    """A reserve that allows everything."""


class Watched:
    """Solves as a real solver does, or fails on demand; keeps what it was asked and what it answered."""

    def __init__(self, name: str = "realtime") -> None:
        self._solver = SOLVERS[name]
        self.asked: list[tuple[JointProblem, Start]] = []
        self.answered: list[Solution] = []
        self.phases: list[str] = []
        """One entry for all starts of a problem."""
        self.fails: set[str] = set()

    def solve(self, problem: JointProblem, start: Start) -> Solution:
        phase = "plan" if len(problem.obstacles) else "predict"
        if self.phases[-1:] != [phase]:
            self.phases.append(phase)
        solution = self._solver.solve(problem, start)
        self.asked.append((problem, start))
        self.answered.append(replace(solution, solved=solution.solved and phase not in self.fails))
        return self.answered[-1]


def agent_of(
    goal: Goal,
    scene: Scene,
    *,
    goals: GoalsName = "constant-acceleration",
    solver: JointSolver | str = "realtime",
    clock: Clock = lambda: 0.0,
) -> Agent:
    """Robot a."""
    solver = SOLVERS[solver] if isinstance(solver, str) else solver
    return Agent("a", goal, scene, method_of(goals, scene, "a", solver, NEVER), clock)


def published() -> dict[str, Any]:
    """Scenario 8a as the publication's plot data show it; see fleet/report/publication.md."""
    path = Path(__file__).parents[3] / "fleet" / "report" / "publication.json"
    content: dict[str, Any] = json.loads(path.read_text(encoding="utf-8"))["scenario_8a"]
    return content


def euler(state: Sequence[float], inputs: Iterable[Sequence[float]], step_s: float = STEP_S) -> Array:
    """Eq. 8 written as a loop over plain numbers, shape (K + 1, 4)."""
    x, y, heading, speed = state
    states = [(x, y, heading, speed)]
    for turn_rate, acceleration in inputs:
        x, y = x + step_s * speed * math.cos(heading), y + step_s * speed * math.sin(heading)
        heading, speed = heading + step_s * turn_rate, speed + step_s * acceleration
        states.append((x, y, heading, speed))
    return np.array(states)


def enlarged(scale: float, limits: Limits | None = None) -> Limits:
    """Of a vehicle so many times as large that does the same in the same time."""
    limits, names = limits or Limits(), ("speed_mps", "acceleration_mps2", "jerk_mps3")
    return limits.model_copy(update={name: scale * getattr(limits, name) for name in names})


def square(half_m: float) -> Area:
    return Area(x_min_m=-half_m, x_max_m=half_m, y_min_m=-half_m, y_max_m=half_m)


def scene_of(robots: Iterable[str], *, limits: Limits | None = None, **rules: Any) -> Scene:
    robot = PublicRobot(limits=limits or Limits())
    return Scene(robots=dict.fromkeys(robots, robot), **rules)


def remembered(tracks: Mapping[str, Array], *, estimation_steps: int = 15) -> Memory:
    """A memory that saw these states (n, 4), all ending now; a shorter track begins later."""
    memory = Memory(estimation_steps + 2, STEP_S)
    longest = max(len(track) for track in tracks.values())
    for step in range(longest):
        first = {robot: longest - len(track) for robot, track in tracks.items()}
        memory.remember(
            step,
            {robot: track[step - first[robot]] for robot, track in tracks.items() if step >= first[robot]},
        )
    return memory


def problem_of(
    states: Sequence[Sequence[float]] | Array,
    goals: Sequence[Sequence[float]] | Array,
    *,
    previous: Sequence[Sequence[float]] | None = None,
    obstacles: Array | None = None,
    limits: Limits | None = None,
    area_m: float = 10.0,
    weights: Sequence[float] = WEIGHTS,
    steps: int = 30,
) -> JointProblem:
    """A joint problem with the publication's numbers unless said otherwise."""
    count = len(states)
    moving = np.zeros((0, steps + 1, 2)) if obstacles is None else obstacles
    return JointProblem(
        states=np.array(states, dtype=float),
        previous_inputs=np.zeros((count, 2)) if previous is None else np.array(previous, dtype=float),
        first_inputs=np.tile([[-np.inf], [np.inf]], (count, 1, 2)),
        goals=np.array(goals, dtype=float),
        limits=(limits or Limits(),) * count,
        obstacles=moving,
        safety_distances=np.full((count, count + len(moving)), SAFETY_M),
        sides=np.zeros((count, count + len(moving))),
        area=np.array([[-area_m, -area_m], [area_m, area_m]]),
        weights=np.tile(weights, (steps + 1, 1)),
        steps=steps,
        step_s=STEP_S,
    )


def assert_inputs_within_limits(problem: JointProblem, inputs: Array, rounding: float = 1e-9) -> None:
    """From previous inputs outside the limits, the first change starts at the limit."""
    assert inputs.shape == (len(problem.states), problem.steps, 2)
    bounds = np.array([(each.turn_rate_radps, each.acceleration_mps2) for each in problem.limits])[:, None]
    rates = np.array([(each.turn_acceleration_radps2, each.jerk_mps3) for each in problem.limits])[:, None]
    held = problem.previous_inputs[:, None].clip(-bounds, bounds)
    changes = np.diff(np.concatenate([held, inputs], axis=1), axis=1)
    assert (np.abs(inputs) <= bounds + rounding).all()
    assert (np.abs(changes) <= STEP_S * rates + rounding).all()


def cold(problem: JointProblem, turn_radps: float = 0.2) -> Start:
    """Everybody brakes and turns, so that symmetric crossings begin as a roundabout; no forces are known."""
    inputs = braking_inputs(problem)
    inputs[:, :, 0] = turn_radps
    return cold_start(problem, within_limits(problem, inputs))


def seen(
    step: int, states: Mapping[str, Sequence[float]], *, accuracy: Accuracy | None = None, age_steps: int = 0
) -> Observation:
    """What a robot observes when these robots are in these states."""
    return Observation(
        epoch=EPOCH,
        step=step,
        time_s=step * STEP_S,
        age_steps=age_steps,
        accuracy=accuracy or Accuracy(),
        robots={
            robot: State(x_m=float(x), y_m=float(y), heading_rad=float(heading), speed_mps=float(speed))
            for robot, (x, y, heading, speed) in states.items()
        },
    )


def mind_of(step: int, **told: Any) -> Mind:
    """What robot a may have thought at a step."""
    nothing = {"arrived": False, "estimates": {}, "prediction": {}, "plan": (), "failed": ()}
    counts = {"decision": step, "solver_failures": 0, "cut_short_at": None, "timings_ms": Timings()}
    return Mind(epoch=EPOCH, robot="a", step=step, **{**nothing, **counts, **told})


def device(connect: str = "tcp/127.0.0.1:7447", **changes: Any) -> RobotOptions:
    """Options of a device to check: that of robot 1 unless said otherwise."""
    goal = Goal(x_m=4.0, y_m=0.0, heading_rad=0.0)
    return RobotOptions(**{"robot": "1", "goal": goal, "goals": "ioc", **changes}, connect=connect)
