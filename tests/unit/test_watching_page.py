"""The page on watching says what is there: metrics, states and paths."""

import re
from pathlib import Path
from typing import get_args

import pytest
from prometheus_client.core import Metric

from agent.process.health import RobotHealth
from chassis.healthy import LIVE, METRICS, READY
from fleet.status.standing import RobotState
from protocol.messages import Mind, Observation, State, Timings, TrueRobot, Truth
from protocol.scene import Goal
from world.health import WorldHealth

PAGE = (Path(__file__).parents[2] / "docs" / "watching.md").read_text(encoding="utf-8")
STATE = State(x_m=0.0, y_m=0.0, heading_rad=0.0, speed_mps=0.0)


def table(before: str) -> list[list[str]]:
    """The cells of the first table after these words, without its head."""
    rows = re.search(r"(?:^\|.*\n)+", PAGE[PAGE.index(before) :], re.MULTILINE)
    assert rows
    return [[cell.strip() for cell in row.split("|")[1:-1]] for row in rows[0].splitlines()[2:]]


def robot_metrics() -> list[Metric]:
    """Of a robot to which everything has happened that has a metric."""
    health = RobotHealth("1", Goal(x_m=0.0, y_m=0.0, heading_rad=0.0))
    health.observed(Observation(epoch=1, step=0, time_s=0.0, robots={"1": STATE}))
    mind = Mind.model_construct(
        step=0,
        decision=0,
        arrived=False,
        estimates={"1": STATE},
        solver_failures=0,
        cut_short_at=None,
        timings_ms=Timings(decide=1.0),
    )
    health.decided(mind)
    health.decided(mind)
    return list(health.collect())


def world_metrics() -> list[Metric]:
    """Of a world to which everything has happened that has a metric."""
    health = WorldHealth(("1",))
    true = TrueRobot.model_construct(arrived_s=None, deadline_misses=0, clipped_commands=0)
    refused = {"1": {"answers a step again": 1}}
    truth = Truth.model_construct(
        step=0, time_s=0.0, robots={"1": true}, minimum_distance_m=1.0, collisions=(), refused=refused
    )
    health.stepped(truth, 0)
    return list(health.collect())


@pytest.mark.parametrize(
    ("prefix", "metrics"), [("unspoken_agent_", robot_metrics()), ("unspoken_world_", world_metrics())]
)
def test_the_tables_have_every_metric_with_its_kind_and_labels(prefix: str, metrics: list[Metric]) -> None:
    told = {
        f"{prefix}{name.strip('`')}": (kind, set(re.findall(r"`(\w+)`", labels)))
        for name, kind, labels, _ in table(f"begin with `{prefix}`")
    }
    there = {
        metric.name + ("_total" if metric.type == "counter" else ""): (
            metric.type,
            {label for sample in metric.samples for label in sample.labels} - {"le"},
        )
        for metric in metrics
    }
    assert told == there
    assert len(there) == len(metrics)
    assert all(metric.documentation.endswith(".") for metric in metrics)


def test_the_page_has_every_state_of_a_robot_and_every_path() -> None:
    assert [row[0].strip("`") for row in table("| state |")] == list(get_args(RobotState))
    assert [row[0].strip("`") for row in table("| path |")] == [LIVE, READY, METRICS]
