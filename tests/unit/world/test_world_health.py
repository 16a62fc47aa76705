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


def test_a_run_is_told_by_its_steps_answers_and_misses():
    stage = Stage(2)
    stage.bus.silent.add("2")
    stage.bus.at_step[3] = lambda: stage.bus.answer("1", 2)
    stage.drive()
    told, steps = values(stage.health), stage.world.step
    expected = {
        "step": steps,
        "step_seconds_count": steps,
        "answer_lag_seconds_count{1}": steps,
        "answer_lag_seconds_count{2}": 0,
        "missed_commands_total{1}": 0,
        "missed_commands_total{2}": steps,
        "refused_messages_total{1,answers another step}": 1,
        "robot_present{1}": 1,
        "robot_arrived{1}": 1,
        "robot_arrived{2}": 0,
    }
    assert {name: told[f"unspoken_world_{name}"] for name in expected} == expected
    assert told["unspoken_world_minimum_distance_meters"] > 0.0
    assert stage.health.why_not_live() is None


def test_how_long_steps_and_answers_took_is_measured_on_the_clock_of_the_process():
    now_s = [100.0]
    health = WorldHealth(("1",), now_s=lambda: now_s[0])
    truth = Stage(1).world.truth()
    health.stepped(truth, 0)
    for passed_s in (0.03, 0.05):  # only the first answer counts
        now_s[0] += passed_s
        health.answered({"1"})
    now_s[0] += 0.02
    health.stepped(truth, 2)
    told = values(health)
    assert told["unspoken_world_answer_lag_seconds_sum{1}"] == pytest.approx(0.03)
    assert told["unspoken_world_step_seconds_sum"] == pytest.approx(0.1)
    assert told["unspoken_world_overruns_total"] == 2.0
