"""A run is one process for the world and one for each robot."""

import signal

from process_helpers import endless, environment


def test_there_is_one_process_for_the_world_and_one_for_each_robot(tmp_path, bench):
    run = bench("out", "run", endless(tmp_path / "endless.yaml", 3))
    run.reach(1)
    children = run.children()
    assert sorted(line[-2:] for line in children.values()) == [["-m", "agent"]] * 3 + [["-m", "world"]]
    run.signal(signal.SIGINT)
    assert run.end() == 1
    run.leaves_nothing(children)


def test_no_command_line_tells_a_goal_and_no_process_knows_that_of_another(tmp_path, bench):
    run = bench("out", "run", endless(tmp_path / "endless.yaml", 2))
    run.reach(0)
    assert not any("900" in part for line in run.children().values() for part in line)
    given = {robot: environment(run.pid("agent", robot)) for robot in ("1", "2")}
    assert {robot: env["UNSPOKEN_GOAL"] for robot, env in given.items()} == {
        "1": "900.0,0.0,0.0",
        "2": "900.0,2.0,0.0",
    }
    needed = {"ROBOT", "GOAL", "CONNECT", "RUN", "PASSWORD_FILE", "PARENT"}
    choices = {"GOALS", "SOLVER", "ITERATIONS", "BUDGET_MS"}
    for robot, env in given.items():
        names = {name.removeprefix("UNSPOKEN_") for name in env if name.startswith("UNSPOKEN_")}
        assert needed <= names <= needed | choices, robot
    assert "UNSPOKEN_GOAL" not in environment(run.pid("world"))
