"""Commands that the world has obeyed and the bench has not received yet."""

from protocol.messages import Command, Message, Truth


class Stragglers:
    """Tells from a run's messages whether commands of the last step are still on their way to the bench.

    A command goes to the world and to the bench at the same time, so the truth that the world makes of it can
    be faster than the command itself.
    """

    def __init__(self) -> None:
        self._answered: dict[str, tuple[int, int]] = {}
        self._truth: Truth | None = None
        self._due: dict[str, tuple[int, int]] = {}

    def add(self, message: Message) -> None:
        """Take a command or a truth; other messages tell nothing more."""
        if isinstance(message, Command):
            self._answered[message.robot] = (message.epoch, message.step)
        elif isinstance(message, Truth):
            before, self._truth = self._truth, message
            steps = obeyed(before, message) if before is not None else {}
            self._due = {robot: (message.epoch, step) for robot, step in steps.items()}

    def on_their_way(self) -> bool:
        """Whether a command that led to the newest truth has not been taken."""
        return any(self._answered.get(robot) != due for robot, due in self._due.items())


def obeyed(before: Truth, after: Truth) -> dict[str, int]:
    """By robot, the step whose command led from one truth to the next; without those who missed it."""
    # The verdict on an interrupted step, or the first truth of a world that was started again.
    if after.step == before.step or after.epoch != before.epoch:
        return {}
    return {
        robot: before.step
        for robot, true in after.robots.items()
        if robot in before.robots and true.deadline_misses == before.robots[robot].deadline_misses
    }
