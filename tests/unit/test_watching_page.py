"""The page on watching says what is there: metrics, states, paths and statuses."""

import re
from pathlib import Path
from typing import Any, get_args

import pytest
from markdown_it import MarkdownIt
from prometheus_client.core import Metric

from agent.process.health import RobotHealth
from chassis.healthy import LIVE, METRICS, READY
from fleet.status.standing import RobotState
from protocol.messages import Mind, Observation, State, Timings, TrueRobot, Truth
from protocol.scene import Goal
from world.health import WorldHealth

PAGE = Path(__file__).parents[2] / "docs" / "watching.md"
STATE = State(x_m=0.0, y_m=0.0, heading_rad=0.0, speed_mps=0.0)


def tables() -> dict[str, list[list[str]]]:
    """Rows of the page's tables, by the head of their first column; of several metrics tables, in order."""
    found: dict[str, list[list[str]]] = {}
    row: list[str] = []
    rows: list[list[str]] = []
    for token in MarkdownIt().enable("table").parse(PAGE.read_text(encoding="utf-8")):
        if token.type == "table_open":
            rows = []
        elif token.type == "tr_open":
            row = []
        elif token.type == "inline":
            row.append(token.content)
        elif token.type == "tr_close":
            rows.append(row)
            row = []
        elif token.type == "table_close":
            name = rows[0][0]
            found[name if name not in found else f"{name} again"] = rows[1:]
    return found


def robot_metrics() -> list[Metric]:
    """Of a robot that has lived through everything that is told."""
    health = RobotHealth("1", Goal(x_m=0.0, y_m=0.0, heading_rad=0.0))
    health.joined(2)
    health.observed(Observation(epoch=1, step=0, time_s=0.0, robots={"1": STATE}))
    told: dict[str, Any] = {
        "prediction": {},
        "plan": (),
        "failed": (),
        "solver_failures": 0,
        "cut_short_at": None,
        "timings_ms": Timings(decide=1.0),
    }
    for step in (0, 1):
        mind = Mind(
            epoch=1, robot="1", step=step, decision=step, arrived=False, estimates={"1": STATE}, **told
        )
        health.decided(mind)
    return list(health.collect())


def world_metrics() -> list[Metric]:
    """Of a world that has lived through everything that is told."""
    health = WorldHealth(("1",))
    true = TrueRobot(
        state=STATE,
        turn_rate_radps=0.0,
        acceleration_mps2=0.0,
        arrived_s=None,
        driven_m=0.0,
        deadline_misses=0,
        clipped_commands=0,
    )
    truth = Truth(
        epoch=1,
        step=0,
        time_s=0.0,
        robots={"1": true},
        minimum_distance_m=1.0,
        collisions=(),
        refused={"1": {"answers a step again": 1}},
        verdict=None,
    )
    health.stepped(truth, 0)
    return list(health.collect())


def as_rows(metrics: list[Metric], prefix: str) -> dict[str, tuple[str, set[str]]]:
    """By name: kind and labels."""
    found = {}
    for metric in metrics:
        name = metric.name.removeprefix(prefix) + ("_total" if metric.type == "counter" else "")
        labels = {label for sample in metric.samples for label in sample.labels} - {"le"}
        found[name] = (metric.type, labels)
    return found


@pytest.mark.parametrize(
    ("table", "prefix", "metrics"),
    [
        ("metric", "unspoken_agent_", robot_metrics),
        ("metric again", "unspoken_world_", world_metrics),
    ],
)
def test_the_tables_have_every_metric_with_its_kind_and_labels(table: str, prefix: str, metrics: Any) -> None:
    rows = {
        name.strip("`"): (kind, set(re.findall(r"`(\w+)`", labels)))
        for name, kind, labels, _ in tables()[table]
    }
    assert rows == as_rows(metrics(), prefix)
    assert prefix in PAGE.read_text(encoding="utf-8")


def test_every_metric_has_a_meaning_and_a_name_of_its_own() -> None:
    metrics = [*robot_metrics(), *world_metrics()]
    assert len({metric.name for metric in metrics}) == len(metrics)
    assert all(metric.documentation.endswith(".") for metric in metrics)


def test_the_page_has_every_state_of_a_robot_and_every_path() -> None:
    assert [row[0].strip("`") for row in tables()["state"]] == list(get_args(RobotState))
    assert [row[0].strip("`") for row in tables()["path"]] == [LIVE, READY, METRICS]
