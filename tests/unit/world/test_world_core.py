import random

import pytest
from hypothesis import given
from hypothesis import strategies as st
from world_helpers import EPOCH, SPRINT_STEPS, at, command, lanes, sprint

from protocol.codec import encode
from protocol.scenario import Sensing
from protocol.vehicle import STANDSTILL, Input, Limits, braking_input
from world.vehicle import ROUNDING, drive
from world.world import World

BRAKING_MPS2 = -3.0
"""Of a robot at speed that no jerk limit holds back."""
NOISY = Sensing(range_m=6.0, position_noise_m=0.05, heading_noise_rad=0.05, speed_noise_mps=0.1, dropout=0.2)


def driven_by_chance(scenario, *, seed, steps=40):
    """The bytes of every truth and observation of a run under random commands, some of them missing."""
    world = World(scenario, seed=seed, epoch=EPOCH)
    chance = random.Random(1)
    truths, observations = [], []
    for step in range(steps):
        commands = {
            robot: command(robot, step, chance.uniform(-3, 3), chance.uniform(-2, 2))
            for robot in world.robots
            if chance.random() < 0.9
        }
        truths.append(encode(world.truth()))
        observations.append([encode(seen) for seen in world.observations().values()])
        world.advance(commands)
    return truths, observations


def test_the_same_scenario_seed_and_commands_give_the_same_run_bit_for_bit():
    scenario = lanes(4, length_m=9.0, sensing=NOISY)
    assert driven_by_chance(scenario, seed=3) == driven_by_chance(scenario, seed=3)


def test_the_seed_changes_what_is_seen_and_nothing_that_is_true():
    scenario = lanes(4, length_m=9.0, sensing=NOISY)
    truths, observations = driven_by_chance(scenario, seed=3)
    other_truths, other_observations = driven_by_chance(scenario, seed=4)
    assert truths == other_truths
    assert observations != other_observations


def test_reading_observations_twice_does_not_draw_noise_twice():
    scenario = lanes(2, length_m=9.0, sensing=NOISY)
    once, often = (World(scenario, seed=0, epoch=EPOCH) for _ in range(2))
    for _ in range(5):
        for _ in range(3):
            assert often.observations() == once.observations()
        assert once.advance({}) == often.advance({}) == often.observations()


def test_observers_have_their_own_noise_and_their_own_sensing():
    scenario = lanes(3, length_m=9.0, sensing=Sensing(position_noise_m=0.1))
    third = scenario.robots[2].model_copy(update={"sensing": Sensing(range_m=1.0)})
    world = World(scenario.model_copy(update={"robots": [*scenario.robots[:2], third]}), seed=0, epoch=EPOCH)
    seen = world.observations()
    assert seen["1"].robots["1"] != seen["2"].robots["1"]
    assert seen["1"].robots.keys() == {"1", "2", "3"}
    assert seen["3"].robots == {"3": world.truth().robots["3"].state}


def test_a_sprint_arrives_when_and_where_the_sums_say():
    world = World(lanes(2), seed=0, epoch=EPOCH)
    while not world.over:
        assert world.truth().verdict is None
        world.advance({robot: command(robot, world.step, sprint(world.step)) for robot in world.robots})
    truth = world.truth()
    assert truth.verdict == "arrived"
    assert truth.step == world.step == SPRINT_STEPS
    assert truth.time_s == pytest.approx(2.0)
    for robot in truth.robots.values():
        assert robot.state.x_m == pytest.approx(1.0)
        assert robot.state.speed_mps == pytest.approx(0.0, abs=1e-12)
        assert robot.driven_m == pytest.approx(1.0)
        assert robot.arrived_s == pytest.approx(2.0)
        assert (robot.deadline_misses, robot.clipped_commands) == (0, 0)
    assert truth.minimum_distance_m == pytest.approx(2.0)
    with pytest.raises(RuntimeError, match="ended at step 20"):
        world.advance({})


def test_robots_start_standing_where_the_scenario_says_and_see_it_at_step_0():
    world = World(lanes(2), seed=0, epoch=EPOCH)
    observation = world.observations()["2"]
    assert (observation.epoch, observation.step, observation.time_s) == (EPOCH, 0, 0.0)
    assert observation.robots["2"].as_tuple() == (0.0, 2.0, 0.0, 0.0)
    assert observation.robots == {robot: true.state for robot, true in world.truth().robots.items()}


def moving_world():
    """Two robots at 1 m/s in x, after ten steps; their last commands say to go on at 0.5 m/s²."""
    world = World(lanes(2, length_m=9.0), seed=0, epoch=EPOCH)
    for step in range(10):
        world.advance({robot: command(robot, step, 1.0, then=(0.1, 0.5)) for robot in world.robots})
    return world


def applied(world, robot):
    """(ω, a) that led to the present step."""
    true = world.truth().robots[robot]
    return (true.turn_rate_radps, true.acceleration_mps2)


INVALID = {
    "missing": None,
    "of another epoch": command("2", 10, 1.0, epoch=EPOCH + 1, then=(0.2, 2.0)),
    "of the step before": command("2", 9, 1.0, then=(0.2, 2.0)),
    "of the step after": command("2", 11, 1.0, then=(0.2, 2.0)),
    "of another robot": command("1", 10, 1.0, then=(0.2, 2.0)),
}


@pytest.mark.parametrize("answer", INVALID.values(), ids=INVALID.keys())
def test_a_robot_without_a_valid_command_drives_what_its_last_one_said_for_then_and_next_brakes(answer):
    world = moving_world()
    answers = {"2": answer} if answer else {}
    world.advance({"1": command("1", 10, 1.0, then=(0.1, 0.5))} | answers)
    assert applied(world, "1") == (0.0, 1.0)
    assert applied(world, "2") == (0.1, 0.5)
    world.advance({})
    assert applied(world, "1") == (0.1, 0.5)
    assert applied(world, "2") == (0.0, BRAKING_MPS2)
    robots = world.truth().robots
    assert {name: robot.deadline_misses for name, robot in robots.items()} == {"1": 1, "2": 2}
    assert {name: robot.clipped_commands for name, robot in robots.items()} == {"1": 0, "2": 0}


PAIRS = st.tuples(st.floats(-2.0, 2.0), st.floats(-4.0, 4.0))
ANSWERS = st.none() | st.tuples(st.integers(-1, 1), PAIRS, st.none() | PAIRS)


@given(st.lists(ANSWERS, max_size=25))
def test_every_step_is_driven_by_its_command_or_the_plan_of_the_one_before_or_braking(answers):
    """Judged by a record of all that was accepted, in which the rule is looked up step by step.

    Args:
        answers: for each step nothing, or by how many steps the answer is wrong, its input and its `then`.
    """
    limits, step_s = Limits(), 0.1
    world = World(lanes(1, length_m=900.0, limits=limits, area={"x_max_m": 1e3}), seed=0, epoch=EPOCH)
    state, before, inputs, thens, clipped = at(0.0, 0.0), STANDSTILL, {}, {}, 0
    for step, answer in enumerate(answers):
        told = {}
        if answer is not None:
            wrong_by, (turn_rate, acceleration), then = answer
            told = {"1": command("1", max(step + wrong_by, 0), acceleration, turn_rate, then=then)}
            if told["1"].step == step:
                inputs[step], thens[step] = (turn_rate, acceleration), then
        braking = braking_input(limits, before, state.speed_mps, step_s)
        wanted = inputs.get(step) or thens.get(step - 1) or braking
        state, before, _ = drive(limits, state, before, Input(*wanted), step_s)
        clipped += step in inputs and max(abs(w - b) for w, b in zip(wanted, before, strict=True)) > ROUNDING
        world.advance(told)
        assert applied(world, "1") == before
    robot = world.truth().robots["1"]
    assert robot.deadline_misses == len(answers) - len(inputs)
    assert robot.clipped_commands == clipped


def test_a_refusal_says_what_is_wrong_with_a_command():
    world = moving_world()
    assert world.refusal("2", command("2", 10)) is None
    assert "epoch" in (world.refusal("2", INVALID["of another epoch"]) or "")
    assert "step" in (world.refusal("2", INVALID["of the step before"]) or "")
    assert "another robot" in (world.refusal("2", INVALID["of another robot"]) or "")


@pytest.mark.parametrize("acceleration", [1.0, -1.0])
def test_a_silent_robot_comes_to_a_standstill_within_its_limits(acceleration):
    limits = Limits()
    scenario = lanes(1, length_m=9.0, limits=limits)
    world = World(scenario, seed=0, epoch=EPOCH)
    for step in range(10):
        world.advance({"1": command("1", step, acceleration, 0.2)})
    before = world.truth().robots["1"]
    top_mps = abs(before.state.speed_mps)
    for _ in range(25):
        world.advance({})
        now = world.truth().robots["1"]
        jump = abs(now.acceleration_mps2 - before.acceleration_mps2)
        assert jump <= limits.jerk_mps3 * scenario.step_s + 1e-9
        turn_jump = abs(now.turn_rate_radps - before.turn_rate_radps)
        assert turn_jump <= limits.turn_acceleration_radps2 * scenario.step_s + 1e-9
        before = now
    assert top_mps > 0.5
    assert abs(before.state.speed_mps) < 1e-6
    assert before.turn_rate_radps == 0.0
    assert before.deadline_misses == 25


def test_commands_beyond_the_limits_are_clipped_and_counted_for_their_robot_only():
    world = World(lanes(2, length_m=9.0, limits=Limits()), seed=0, epoch=EPOCH)
    for step in range(3):
        world.advance({"1": command("1", step, 0.5), "2": command("2", step, 100.0)})
    robots = world.truth().robots
    assert (robots["1"].clipped_commands, robots["2"].clipped_commands) == (0, 3)
    assert robots["2"].acceleration_mps2 == pytest.approx(2.1)


def test_a_robot_that_has_arrived_still_obeys():
    world = World(lanes(2), seed=0, epoch=EPOCH)
    while world.truth().robots["1"].arrived_s is None:
        world.advance({"1": command("1", world.step, sprint(world.step)), "2": command("2", world.step)})
    for _ in range(10):
        world.advance({"1": command("1", world.step, 1.0), "2": command("2", world.step)})
    first = world.truth().robots["1"]
    assert first.state.x_m > 1.3
    assert first.arrived_s == pytest.approx(2.0)


def test_commands_of_robots_outside_the_scenario_change_nothing():
    world, other = moving_world(), moving_world()
    valid = {robot: command(robot, 10, 0.3) for robot in world.robots}
    world.advance(valid)
    other.advance(valid | {"9": command("9", 10)})
    assert world.truth() == other.truth()
