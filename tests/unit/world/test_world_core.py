import random

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from world_helpers import EPOCH, SPRINT_STEPS, at, command, lanes, sprint

from protocol.codec import encode
from protocol.scenario import Sensing
from protocol.vehicle import STANDSTILL, Input, Limits, braking_input
from world.vehicle import ROUNDING, drive
from world.world import World

NOISY = Sensing(range_m=6.0, position_noise_m=0.05, heading_noise_rad=0.05, speed_noise_mps=0.1, dropout=0.2)


def driven_by_chance(scenario, *, seed, steps=20, reads=1):
    """The bytes of every truth and observation of a run under random commands, some of them missing."""
    world = World(scenario, seed=seed, epoch=EPOCH)
    chance = random.Random(1)
    truths, observations = [], []
    for step in range(steps):
        commands = {
            robot: command(robot, step, chance.uniform(-3, 3), chance.uniform(-2, 2))
            for robot in (*world.robots, "9")
            if chance.random() < 0.9
        }
        truths.append(encode(world.truth()))
        for _ in range(reads):
            seen = [encode(seen) for seen in world.observations().values()]
        observations.append(seen)
        world.advance(commands)
    return truths, observations


def test_scenario_seed_and_commands_give_a_run_bit_for_bit_and_the_seed_changes_only_what_is_seen():
    scenario = lanes(4, length_m=9.0, sensing=NOISY)
    truths, observations = driven_by_chance(scenario, seed=3)
    assert (truths, observations) == driven_by_chance(scenario, seed=3, reads=2)
    other_truths, other_observations = driven_by_chance(scenario, seed=4)
    assert truths == other_truths
    assert observations != other_observations


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


PAIRS = st.tuples(st.floats(-2.0, 2.0), st.floats(-4.0, 4.0))
WRONG = ({"step": 1}, {"step": -1}, {"epoch": 1}, {"robot": "2"}, {"withheld": True}, {})
ANSWERS = st.none() | st.tuples(st.sampled_from(WRONG), PAIRS)


@settings(max_examples=50)
@given(st.lists(ANSWERS, max_size=25))
def test_every_step_is_driven_by_its_command_or_braking(answers):
    """Judged by a record of all that was accepted, in which the rule is looked up step by step.

    Args:
        answers: for each step nothing, or what is wrong with the answer, and its input.
    """
    limits, step_s = Limits(), 0.1
    world = World(lanes(1, length_m=900.0, limits=limits, area={"x_max_m": 1e3}), seed=0, epoch=EPOCH)
    state, before, inputs, clipped = at(0.0, 0.0), STANDSTILL, {}, 0
    for step, answer in enumerate(answers):
        told = {}
        if answer is not None:
            wrong, (turn_rate, acceleration) = answer
            right = command("1", step, acceleration, turn_rate)
            told = {
                "1": right.model_copy(update={name: _changed(right, name, by) for name, by in wrong.items()})
            }
            assert (world.refusal("1", told["1"]) is None) == (wrong in ({}, {"withheld": True}))
            if not wrong:
                inputs[step] = (turn_rate, acceleration)
        braking = braking_input(limits, before, state.speed_mps, step_s)
        wanted = inputs.get(step) or braking
        state, before, _ = drive(limits, state, before, Input(*wanted), step_s)
        clipped += step in inputs and max(abs(w - b) for w, b in zip(wanted, before, strict=True)) > ROUNDING
        world.advance(told)
        true = world.truth().robots["1"]
        assert (true.turn_rate_radps, true.acceleration_mps2) == before
    robot = world.truth().robots["1"]
    assert robot.deadline_misses == len(answers) - len(inputs)
    assert robot.clipped_commands == clipped


def _changed(right, name, by):
    return getattr(right, name) + by if name in ("step", "epoch") else by
