"""What the terminal says at the end of a run."""

import io
from typing import Any

import pytest
from rich.console import Console

from fleet.record.summary import Summary, Tally
from fleet.record.verdict import degradation_lines, robot_table, verdict_line
from fleet.run.experiment import RunFacts


@pytest.fixture
def make_summary(facts: RunFacts, make_truth: Any) -> Any:
    def make(robots: dict[str, float | None], step: int, verdict: str | None, **truth: Any) -> Summary:
        tally = Tally()
        states = {name: {"arrived_s": arrived_s} for name, arrived_s in robots.items()}
        tally.add(make_truth(step, states, verdict=verdict, **truth))
        return tally.summary(facts)

    return make


def eight(missing: tuple[str, ...] = ()) -> dict[str, float | None]:
    return {name: None if name in missing else 12.2 for name in "12345678"}


PAIR, TWO_PAIRS = (("1", "2"),), (("1", "2"), ("3", "4"))


@pytest.mark.parametrize(
    ("run", "line"),
    [
        (
            (eight(), 122, "arrived", 1.27, ()),
            "All 8 robots arrived after 12.2 s without collision; smallest distance 1.27 m.",
        ),
        (
            (eight(), 122, "arrived", 0.9, PAIR),
            "All 8 robots arrived after 12.2 s, but 1 pair of robots collided; smallest distance 0.90 m.",
        ),
        (
            ({"1": 5.0, "2": 5.4}, 54, "arrived", 1.4, ()),
            "Both robots arrived after 5.4 s without collision; smallest distance 1.40 m.",
        ),
        (({"1": 5.0}, 50, "arrived", None, ()), "The robot arrived after 5.0 s."),
        (({"1": None}, 50, "timeout", None, ()), "Out of time after 5.0 s: robot 1 had not arrived."),
        (
            (eight(("2", "5")), 143, "deadlock", 1.3, ()),
            "Deadlock after 14.3 s: robots 2 and 5 never arrived; smallest distance 1.30 m.",
        ),
        (
            (eight(("2", "5", "7")), 143, "deadlock", 0.8, TWO_PAIRS),
            "Deadlock after 14.3 s: robots 2, 5 and 7 never arrived; smallest distance 0.80 m. "
            "2 pairs of robots collided.",
        ),
        (
            (eight(tuple("1234567")), 30, None, 1.3, ()),
            "Interrupted after 3.0 s: 7 of 8 robots had not arrived; smallest distance 1.30 m.",
        ),
        (
            (eight(), 122, "collision", 0.5, PAIR),
            "Collision of 1 pair of robots; after 12.2 s all 8 robots had arrived; smallest distance 0.50 m.",
        ),
    ],
)
def test_the_verdict_is_a_plain_sentence(make_summary: Any, run: tuple[Any, ...], line: str) -> None:
    robots, step, verdict, distance_m, collisions = run
    summary = make_summary(robots, step, verdict, minimum_distance_m=distance_m, collisions=collisions)
    assert verdict_line(summary, step_s=0.1) == line


def test_a_run_without_a_step_has_a_verdict_too(facts: RunFacts) -> None:
    assert verdict_line(Tally().summary(facts), 0.1) == "Interrupted before the first step."
    assert verdict_line(Tally().summary(facts, "failed"), 0.1) == "Failed before the first step."


def printed(summary: Summary, clipped: dict[str, int]) -> list[str]:
    console = Console(file=io.StringIO(), width=80)
    console.print(robot_table(summary, clipped))
    text: str = console.file.getvalue()  # type: ignore[attr-defined]
    return text.splitlines()


def test_the_table_has_a_row_for_every_robot_and_their_sum(
    facts: RunFacts, make_truth: Any, make_mind: Any
) -> None:
    tally = Tally()
    tally.add(
        make_truth(
            30,
            {
                "1": {"arrived_s": 2.9, "driven_m": 8.126, "deadline_misses": 7},
                "2": {"driven_m": 5.0, "clipped_commands": 11},
            },
        )
    )
    tally.add(make_mind("2", 30, solver_failures=4))
    rows = [line.split() for line in printed(tally.summary(facts), tally.clipped_commands)]
    assert ["1", "2.9", "8.13", "0", "7", "0"] in rows
    assert ["2", "–", "5.00", "4", "0", "11"] in rows
    assert ["all", "–", "13.13", "4", "7", "11"] in rows


def test_the_table_of_many_robots_with_long_names_fits_into_80_columns(make_summary: Any) -> None:
    names = [f"a-robot-with-a-long-name-no-{i:04}" for i in range(16)]
    lines = printed(make_summary(dict.fromkeys(names, 12.2), 122, "arrived"), dict.fromkeys(names, 0))
    assert max(map(len, lines)) <= 80
    first_column = "".join(line[:26].strip() for line in lines)
    assert all(name in first_column for name in names), "folded, but not shortened"


def test_degradations_are_told_robot_by_robot(make_summary: Any) -> None:
    summary: Summary = make_summary({"1": 5.0, "2": 5.0}, 50, "arrived")
    assert degradation_lines(summary) == []
    degraded = {"1": {"extrapolation": 1.3, "controlled stop": 2.0}, "2": {"gate": 0.1}}
    assert degradation_lines(summary.model_copy(update={"degraded": degraded})) == [
        "Robot 1 was degraded: extrapolation 1.3 s, controlled stop 2 s.",
        "Robot 2 was degraded: gate 0.1 s.",
    ]
