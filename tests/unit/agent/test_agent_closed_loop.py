"""Agents driving in the simulated world, core against core, in virtual time."""

import pytest
from agent_helpers import EPOCH

from agent.estimate import GoalsName
from agent.process.options import DecisionOptions
from agent.solve import SolverName
from protocol.messages import Mind, Truth
from protocol.scenario import Scenario, Sensing, load_scenario
from scenarios import find
from world.world import World

COLLISION_M = 0.99
CROSSING = load_scenario(find("2-crossing"))


def run(
    scenario: Scenario, goals: GoalsName, *, steps: int, seed: int = 0, solver: SolverName = "realtime"
) -> tuple[Truth, list[Mind]]:
    """The world after so many steps, or at its verdict, and what everybody thought on the way."""
    scene = scenario.scene(with_goals=goals == "exchanged")
    world = World(scenario, seed=seed, epoch=EPOCH)
    options = DecisionOptions(goals=goals, solver=solver)
    agents = {
        robot.id: options.agent(robot.id, robot.goal_pose(), scene, lambda: 0.0) for robot in scenario.robots
    }
    minds = []
    while not world.over and world.step < steps:
        commands = {}
        for robot, observation in world.observations().items():
            decision = agents[robot].decide(observation)
            assert decision is not None
            commands[robot] = decision.command
            minds.append(decision.mind)
        world.advance(commands)
    return world.truth(), minds


@pytest.mark.parametrize(
    ("goals", "solver"),
    [
        ("exchanged", "realtime"),
        ("ioc", "realtime"),
        ("constant-acceleration", "realtime"),
        pytest.param("exchanged", "reference", marks=pytest.mark.slow),
        pytest.param("ioc", "reference", marks=pytest.mark.slow),
        pytest.param("constant-acceleration", "reference", marks=pytest.mark.slow),
    ],
)
def test_two_robots_cross_and_park_without_one_command_beyond_the_limits(goals, solver):
    truth, minds = run(CROSSING, goals, steps=150, solver=solver)
    assert truth.verdict == "arrived"
    assert truth.minimum_distance_m > COLLISION_M
    assert not any(mind.failed for mind in minds)
    for robot in truth.robots.values():
        assert robot.clipped_commands == robot.deadline_misses == 0
        # The shortest way is 8 m.
        assert 7.8 < robot.driven_m < 10.0


def test_noise_and_dropouts_are_lived_with_and_the_same_run_twice_is_the_same_bit_for_bit():
    """Far enough for both estimators, with noise that makes recovered inputs jump about."""
    noisy = Sensing(
        range_m=5.0, position_noise_m=0.02, heading_noise_rad=0.02, speed_noise_mps=0.1, dropout=0.2
    )
    scenario = CROSSING.model_copy(update={"sensing": noisy})
    once, again = (run(scenario, "ioc", steps=18, seed=3) for _ in range(2))
    assert once == again
    truth, minds = once
    assert [mind.failed for mind in minds] == [()] * 36
    assert {len(mind.prediction) for mind in minds} == {1, 2}, "out of range at first"
    assert all(robot.driven_m > 1.0 for robot in truth.robots.values())
