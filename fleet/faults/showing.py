"""The trials on the terminal: a row a case, and every failure with the command that repeats it."""

from collections.abc import Sequence
from statistics import median

from rich.table import Table

from fleet.faults.trial import Outcome
from fleet.record.tables import new_table, number


def case_table(outcomes: Sequence[Outcome]) -> Table:
    """One line a case: in how many trials everything held, how they ended, and how often monitors braked."""
    table = new_table(
        "Trials of faults",
        "Case",
        "Trials",
        "Hold",
        "All\narrived",
        "With a\ncollision",
        "Inter-\nventions",
        "Median\nin s",
        names=1,
    )
    for case in [*dict.fromkeys(each.case for each in outcomes), "all"]:
        several = [each for each in outcomes if case in (each.case, "all")]
        table.add_row(
            case,
            str(len(several)),
            str(sum(not each.violations for each in several)),
            str(sum(each.verdict == "arrived" for each in several)),
            str(sum(each.collisions > 0 for each in several)),
            str(sum(each.interventions for each in several)),
            number(median(each.time_s for each in several)),
        )
    return table


def failure_lines(outcomes: Sequence[Outcome], command: str) -> list[str]:
    """What did not hold, each with how to repeat it.

    Args:
        outcomes: of all trials.
        command: that made them, without what chooses one of them.
    """
    return [
        f"{each.case}, {each.robots} robots, seed {each.seed}: {'; '.join(each.violations)}\n"
        f"  {command} --only {each.case} --robots {each.robots} --first-seed {each.seed} --seeds 1"
        for each in outcomes
        if each.violations
    ]
