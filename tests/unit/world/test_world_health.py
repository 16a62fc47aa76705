"""What a world's process tells of itself, from a run with everything around it scripted."""

import pytest
from world_stage import Stage

from world.health import WorldHealth


def values(health):
    return {
        sample.name + (f"{{{','.join(sample.labels.values())}}}" if sample.labels else ""): sample.value
        for metric in health.collect()
        for sample in metric.samples
    }


def test_a_world_is_ready_with_all_its_robots():
    health = WorldHealth(("1", "2"))
    health.beat()
    health.wants("it waits for 2")
    assert health.why_not_ready() == "it waits for 2"
    assert values(health)["unspoken_world_ready"] == 0.0
    health.works("drives 2 robots")
    assert values(health)["unspoken_world_ready"] == 1.0


def test_a_run_is_told_by_its_steps_answers_and_misses():
    stage = Stage(2)
    stage.bus.silent.add("2")
    stage.bus.at_step[3] = lambda: stage.bus.answer("1", 2)
    stage.drive()
    told = values(stage.health)
    steps = stage.world.step
    assert told["unspoken_world_step"] == steps
    assert told["unspoken_world_step_seconds_count"] == steps
    assert told["unspoken_world_answer_lag_seconds_count{1}"] == steps
    assert told["unspoken_world_answer_lag_seconds_count{2}"] == 0.0
    assert told["unspoken_world_missed_commands_total{2}"] == steps
    assert told["unspoken_world_missed_commands_total{1}"] == 0.0
    assert told["unspoken_world_refused_messages_total{1,answers another step}"] == 1.0
    assert told["unspoken_world_robot_present{1}"] == 1.0
    assert told["unspoken_world_robot_arrived{1}"] == 1.0
    assert told["unspoken_world_robot_arrived{2}"] == 0.0
    assert told["unspoken_world_minimum_distance_meters"] > 0.0
    assert stage.health.why_not_live() is None


def test_how_long_steps_and_answers_took_is_measured_on_the_clock_of_the_process():
    now_s = [100.0]
    health = WorldHealth(("1",), now_s=lambda: now_s[0])
    truth = Stage(1).world.truth()
    health.stepped(truth, 0)
    now_s[0] += 0.03
    health.answered({"1"})
    now_s[0] += 0.05
    health.answered({"1"})
    now_s[0] += 0.02
    health.stepped(truth, 2)
    told = values(health)
    assert told["unspoken_world_answer_lag_seconds_sum{1}"] == pytest.approx(0.03)
    assert told["unspoken_world_answer_lag_seconds_count{1}"] == 1.0
    assert told["unspoken_world_step_seconds_sum"] == pytest.approx(0.1)
    assert told["unspoken_world_overruns_total"] == 2.0
