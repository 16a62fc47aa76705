"""The simulated world as a pure core: commands in, observations out."""

from collections.abc import Mapping

from protocol.messages import Command, Observation, Refusal, Refusals, State, TrueRobot, Truth
from protocol.scenario import Scenario
from world.judge import refusal_at
from world.referee import Referee
from world.sensing import Sensors, View
from world.vehicle import Vehicle, VehicleState


class World:
    """All robots of a scenario, their sensors and the referee, one step after the other.

    Nothing here reads a clock, starts a thread, or does input or output: the same scenario, seed, epoch and
    commands give the same observations and truths bit for bit.

    Args:
        scenario: what is simulated.
        seed: of all random numbers (sensor noise and dropouts); not negative.
        epoch: identifies this world in all its messages.
    """

    def __init__(self, scenario: Scenario, *, seed: int, epoch: int) -> None:
        self._epoch = epoch
        self._scenario = scenario
        self._step = 0
        self._robots = {robot.id: robot for robot in scenario.robots}
        self._vehicles = {
            robot.id: Vehicle(robot.limits, scenario.step_s, VehicleState(*robot.start_state()))
            for robot in scenario.robots
        }
        self._sensors = {
            robot.id: Sensors(robot.id, scenario.sensing_of(robot), seed=seed, index=index)
            for index, robot in enumerate(scenario.robots)
        }
        self._referee = Referee(scenario)
        self._observe()

    @property
    def step(self) -> int:
        """The present step."""
        return self._step

    @property
    def robots(self) -> tuple[str, ...]:
        """Ids of all robots, in the order of the scenario."""
        return tuple(self._vehicles)

    @property
    def present(self) -> tuple[str, ...]:
        """Ids of the robots that are in the scene at the present step."""
        time_s = self._scenario.time_s(self._step)
        return tuple(name for name, robot in self._robots.items() if robot.is_present(time_s))

    @property
    def over(self) -> bool:
        """Whether the run has ended."""
        return self._referee.verdict is not None

    def observations(self) -> dict[str, Observation]:
        """What each robot in the scene sees at the present step; drawn once, however often it is read."""
        return self._observations

    def refusal(self, robot: str, command: Command) -> Refusal | None:
        """Why a command that came from this robot does not answer the present step, None if it does."""
        return refusal_at(self._step, self._epoch, robot, command)

    def advance(self, commands: Mapping[str, Command]) -> dict[str, Observation]:
        """Drive all robots to the next step.

        A robot without a command, or with one that is withheld or that `refusal` objects to, has missed its
        deadline, which is counted; :class:`world.vehicle.Vehicle` says what it drives then. Robots that have
        arrived go on obeying; those that are not in the scene stand still.

        Args:
            commands: the commands of the present step by the robot that gave them.

        Returns:
            The observations of the new step.

        Raises:
            RuntimeError: the run has ended.
        """
        if self.over:
            raise RuntimeError(f"the run has ended at step {self._step}; it cannot be advanced")
        present = self.present
        for robot, vehicle in self._vehicles.items():
            if robot not in present:
                vehicle.stand()
                continue
            command = commands.get(robot)
            missed = command is None or command.withheld or self.refusal(robot, command) is not None
            vehicle.obey(None if missed else command)
        self._step += 1
        self._observe()
        return self._observations

    def interrupt(self) -> None:
        """End a run that goes on; its verdict is "interrupted"."""
        self._referee.interrupt()

    def truth(self, refused: Refusals | None = None) -> Truth:
        """The true states at the present step and the referee's counts; with the verdict once it is over.

        Args:
            refused: commands that were not taken so far.
        """
        referee, present = self._referee, self.present
        return Truth(
            epoch=self._epoch,
            step=self._step,
            time_s=self._scenario.time_s(self._step),
            robots={
                robot: TrueRobot(
                    state=State.of(*vehicle.state),
                    turn_rate_radps=vehicle.applied.turn_rate_radps,
                    acceleration_mps2=vehicle.applied.acceleration_mps2,
                    arrived_s=referee.arrived_s[robot],
                    driven_m=referee.distances.driven_m[robot],
                    deadline_misses=vehicle.deadline_misses,
                    clipped_commands=vehicle.clipped_commands,
                )
                for robot, vehicle in self._vehicles.items()
                if robot in present
            },
            minimum_distance_m=referee.distances.minimum_distance_m,
            collisions=referee.distances.collisions,
            verdict=referee.verdict,
            refused=refused or {},
        )

    def _observe(self) -> None:
        states = {robot: vehicle.state for robot, vehicle in self._vehicles.items()}
        present = self.present
        self._referee.watch(self._step, {robot: states[robot] for robot in present})
        views = {robot: sensors.see(states, present) for robot, sensors in self._sensors.items()}
        self._observations = {robot: self._observation(views[robot], robot) for robot in present}

    def _observation(self, view: View, robot: str) -> Observation:
        return Observation(
            epoch=self._epoch,
            step=self._step,
            time_s=self._scenario.time_s(self._step),
            robots=view.robots,
            age_steps=view.age_steps,
            accuracy=self._sensors[robot].accuracy,
        )
