"""What a report says in words: what was run, what to know first, and how to read the figures."""

from collections import Counter

from fleet.report import published
from fleet.report.charts import collision_distance_m
from fleet.report.material import Material
from fleet.report.measures import all_arrived
from fleet.report.statistics import CONFIDENCE, RESAMPLES, SEED


def facts(material: Material) -> list[tuple[str, str]]:
    """What was run, where, when and by what."""
    evaluation, machine = material.evaluation, material.evaluation.machine
    robots = [len(scenario.robots) for scenario in evaluation.scenarios.values()]
    least, most = min(robots), max(robots)
    begun = evaluation.begun
    commit = "" if machine.commit is None else f", commit {machine.commit}"
    seeds = "0" if evaluation.seeds == 1 else f"0 to {evaluation.seeds - 1}"
    return [
        ("Suite", f"{evaluation.suite}, scenarios: {len(robots)}"),
        ("Robots", f"{least}" if least == most else f"{least} to {most}"),
        ("Methods", ", ".join(evaluation.goals)),
        ("Solver", evaluation.solver),
        ("Noise", ", ".join(evaluation.noise)),
        ("Seeds", f"{seeds}, where anything is random"),
        ("Runs", f"{len(material.rows)} of {len(material.runs)}"),
        ("Begun", "not noted" if begun is None else f"{begun:%Y-%m-%d %H:%M %z}".strip()),
        ("Version", f"unspoken {machine.version}{commit}"),
        ("Machine", f"{machine.cpu}, {machine.cores} cores"),
        ("System", f"{machine.system}, Python {machine.python}"),
    ]


def remarks(material: Material) -> list[str]:
    """What a reader must know before any figure."""
    told = []
    missing = len(material.runs) - len(material.rows)
    if missing:
        counts = Counter(key.method for key in material.runs)
        counts.subtract(Counter(row.method for row in material.rows))
        told.append(
            f"Unfinished: {missing} of {len(material.runs)} runs are missing ({_counted(counts)}). The same "
            "`unspoken evaluate` command with the same --out makes them."
        )
    unfinished = Counter(row.method for row in material.rows if not all_arrived(row))
    if unfinished:
        told.append(
            f"Not all robots arrived in {unfinished.total()} of {len(material.rows)} runs "
            f"({_counted(unfinished)}). Durations and distances driven are those of the others."
        )
    if (material.evaluation.machine.commit or "").endswith("+"):
        told.append("The sources had been changed since the commit that is named here.")
    return told


def notes(material: Material) -> list[str]:
    """How the figures are to be read."""
    told = [
        "A scenario counts as one value: with several seeds, the mean over its runs, or the smallest of its "
        "smallest distances. Medians and boxes are over these values.",
        "Durations and distances driven are known only of runs in which all robots arrived; “unfinished as "
        "longest” is the median if each scenario with a run that did not arrive, or failed, had taken longer "
        "than all others.",
        f"Intervals: {CONFIDENCE:.0%} percentile bootstrap over scenarios, {RESAMPLES} resamples, seed "
        f"{SEED}; in comparisons both methods are resampled together. They tell how much the choice of "
        "scenarios matters, and nothing else.",
        "A fallback is a trajectory problem without solution; the robot then drives by its failure rule.",
        "CPU times are those of the thread that decides; runs may have been made side by side. The first "
        "decisions of a run are the slowest, so in a short run they are the 99th percentile.",
        "Boxes show the quartiles; whiskers reach to the last value within 1.5 times their distance.",
        f"Published figures are those of {published.SOURCE}, on forty scenarios and a computer of their own: "
        "trends can be compared, single values cannot.",
    ]
    if collision_distance_m(material.evaluation.scenarios.values()) is None:
        told.append(
            "Bodies differ in size, so no line shows at which distance of centres two robots collide."
        )
    durations_of_8a = [
        f"{row.method} {row.duration_s:.1f} s (published: {known_s:.1f} s)"
        for row in material.rows
        if (row.scenario, row.noise) == ("8a", "none")
        and row.duration_s is not None
        and (known_s := published.duration_of_8a_s(row.method)) is not None
    ]
    if durations_of_8a:
        told.append(f"Scenario 8a, which is the publication's own: {', '.join(durations_of_8a)}.")
    return told


def _counted(methods: Counter[str]) -> str:
    return ", ".join(f"{method}: {count}" for method, count in methods.items() if count)
