"""Scenario 8a beside the publication's own data: the first second of its run, and its goal estimates.

The trace: the first second of the publication's run with exchanged goals, driven again in closed loop.

The optimum at the start is a roundabout whose two directions cost the same. The publication's turns clockwise
and a solver may turn the other way, so positions are compared as they are and after mirroring x. The largest
distance is 3.5 mm; after the wrong choice it is 26 cm, and robots that drove straight at the published speeds
would be 13 cm away.

The estimates: the publication's goal estimates at 1.6 s beside those computed here from its own positions.

The figure shows positions of rows 0 to 15, while its estimates belong to the window of rows 1 to 16. Headings
and speeds are those of eq. 8 between positions; those of row 15, and row 16 as a whole, are extrapolated.
Mean distances to the published estimates, with this project's weights (the publication states none):

| window | inverse optimal control | constant acceleration |
| --- | --- | --- |
| rows 0 to 15 | 0.94 m (largest 1.99 m) | 9.43 m |
| rows 1 to 16 | 0.75 m (largest 1.87 m) | 9.61 m |
"""

import math
from collections.abc import Callable, Mapping
from functools import partial

import numpy as np
import pytest
from agent_helpers import EPOCH, SOLVERS, STEP_S, cold, published, remembered, scene_of

from agent.drive.commands import within_reach
from agent.estimate.goals import ConstantAcceleration, Exchanged, GoalEstimator
from agent.estimate.inverse_optimal_control import InverseOptimalControl
from agent.remember.memory import Memory
from agent.solve.problem import joint_problem
from agent.solve.starts import WarmStarts
from protocol.messages import Command, Observation
from protocol.scenario import Scenario, load_scenario
from protocol.vehicle import STANDSTILL, Input
from scenarios import find
from world.world import World

STEPS = 10
WITHIN_M = 0.05
Answers = Callable[[Mapping[str, Observation]], dict[str, Command]]


@pytest.fixture(scope="module")
def scenario() -> Scenario:
    return load_scenario(find("8a"))


def positions(world: World) -> np.ndarray:
    return np.array([(robot.state.x_m, robot.state.y_m) for robot in world.truth().robots.values()])


def driven(scenario: Scenario, answers: Answers) -> np.ndarray:
    """True positions (STEPS + 1, 8, 2) of a run in which the robots answer like this."""
    world = World(scenario, seed=0, epoch=EPOCH)
    rows = [positions(world)]
    for _ in range(STEPS):
        world.advance(answers(world.observations()))
        rows.append(positions(world))
    for robot in world.truth().robots.values():
        assert robot.deadline_misses == robot.clipped_commands == 0
    return np.array(rows)


def worst_deviation_m(scenario: Scenario, rows: np.ndarray) -> float:
    """Largest distance to the published positions of the robots with the same, or the mirrored, starts."""
    trace = np.array([rows[: STEPS + 1] for rows in published()["exchanged_trace"]]).swapaxes(0, 1)
    deviations = []
    for turned in (rows, rows * [-1.0, 1.0]):
        counterpart = [
            int(np.argmin(np.linalg.norm(turned[0] - start, axis=1))) for start in published()["starts"]
        ]
        assert sorted(counterpart) == list(range(len(scenario.robots)))
        deviations.append(np.linalg.norm(turned[:, counterpart] - trace, axis=2).max())
    return float(min(deviations))


def test_the_scenario_is_the_published_one(scenario):
    data = published()
    assert [[robot.start.x_m, robot.start.y_m] for robot in scenario.robots] == data["starts"]
    assert [[robot.goal.x_m, robot.goal.y_m] for robot in scenario.robots] == data["goals"]


@pytest.mark.parametrize("solver", ["realtime", pytest.param("reference", marks=pytest.mark.slow)])
def test_the_joint_problem_drives_all_robots_along_the_published_trace(scenario, solver):
    """That of eq. 7, which leaves all sides open; the sides agreed on here lead to another optimum."""
    scene = scenario.scene(with_goals=True)
    memory, robots = Memory(scene.horizons.estimation_steps + 2, scene.step_s), list(scene.robots)
    estimator, starts, last = Exchanged(scene), WarmStarts(), dict.fromkeys(scene.robots, STANDSTILL)

    def answers(observations: Mapping[str, Observation]) -> dict[str, Command]:
        seen = observations["1"]
        memory.remember(seen.step, {robot: state.as_tuple() for robot, state in seen.robots.items()})
        problem = joint_problem(scene, memory.present(), estimator.estimate(memory), {}, last)
        start = starts.start(problem, robots, otherwise=partial(cold, problem))
        solution = SOLVERS[solver].solve(problem, start)
        assert solution.solved
        starts.keep(robots, solution)
        for row, (robot, known) in enumerate(scene.robots.items()):
            speed = float(memory.state(robot)[3])
            last[robot] = within_reach(
                solution.inputs[row, 0], known.limits, last[robot], speed, scene.step_s
            )
        return {robot: command(robot, seen.step, control) for robot, control in last.items()}

    assert worst_deviation_m(scenario, driven(scenario, answers)) < WITHIN_M


def command(robot: str, step: int, control: Input) -> Command:
    return Command(
        epoch=EPOCH,
        robot=robot,
        step=step,
        turn_rate_radps=control.turn_rate_radps,
        acceleration_mps2=control.acceleration_mps2,
    )


ROBOTS = [str(number) for number in range(1, 9)]


def states_of(positions: np.ndarray, goal: np.ndarray) -> np.ndarray:
    """States of eq. 8 that pass through these positions (n, 2); standing at first, facing the goal."""
    ways = np.diff(positions, axis=0)
    directions = np.arctan2(ways[:, 1], ways[:, 0])
    directions[0] = math.atan2(*(goal - positions[0])[::-1])
    moving = np.column_stack([np.unwrap(directions), np.hypot(*ways.T) / STEP_S])
    return np.column_stack([positions, np.concatenate([moving, [2 * moving[-1] - moving[-2]]])])


def one_row_on(states: np.ndarray) -> np.ndarray:
    """The same with one more row, the last inputs continued."""
    x, y, heading, speed = states[-1]
    turned, faster = 2 * states[-1, 2:] - states[-2, 2:]
    moved = (x + STEP_S * speed * math.cos(heading), y + STEP_S * speed * math.sin(heading), turned, faster)
    return np.concatenate([states, [moved]])


@pytest.fixture(scope="module")
def tracks() -> dict[str, np.ndarray]:
    data = published()
    traces, goals = np.array(data["ioc_trace_until_1_6_s"]), np.array(data["goals"])
    return {name: states_of(*each) for name, *each in zip(ROBOTS, traces, goals, strict=True)}


def distances(estimator: type[GoalEstimator], tracks: dict[str, np.ndarray]) -> np.ndarray:
    """From each published estimate to the one computed here, in m."""
    estimates = estimator(scene_of(ROBOTS)).estimate(remembered(tracks))
    found = np.array([estimates[robot][:2] for robot in ROBOTS])
    return np.linalg.norm(found - published()["ioc_goal_estimates_at_1_6_s"], axis=1)


def test_estimates_lie_near_the_published_ones_and_nearest_from_their_own_window(tracks):
    """And ten times nearer than those of constant acceleration."""
    from_rows = distances(InverseOptimalControl, tracks)
    on = {robot: one_row_on(track) for robot, track in tracks.items()}
    found, simple = (distances(each, on) for each in (InverseOptimalControl, ConstantAcceleration))
    assert from_rows.mean() < 1.0
    assert found.mean() < min(0.8, 0.9 * from_rows.mean(), simple.mean() / 10)
    assert found.max() < 2.0
    assert (found < simple / 4).all()


def test_goal_headings_stay_near_the_present_ones(tracks):
    """No robot is taken to be spinning towards a goal many turns away; 0.07 rad is the most measured."""
    estimates = InverseOptimalControl(scene_of(ROBOTS)).estimate(remembered(tracks))
    turns = [estimates[robot][2] - track[-1, 2] for robot, track in tracks.items()]
    np.testing.assert_allclose(turns, 0.0, atol=0.2)
