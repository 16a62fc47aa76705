"""The side of ROS without ROS: a Zenoh router, and robots that send odometry and obey twists.

Payloads are made and read by an independent library. Each robot has a frame, a clock and a byte order of its
own, as real ones have. Its base follows a twist as fast as its limits allow, and no faster.
"""

import cmath
import itertools
import math
import threading
import time
from dataclasses import dataclass, field
from typing import Self

import zenoh
from ros2_helpers import odometry_bytes, twist_of

from protocol.session import world_session

TICK_S = 0.02
"""Between two steps of the bases, and two odometry messages of each."""
ACCELERATION_MPS2 = 4.0
WATCHDOG_S = 0.5
"""A base that hears nothing for so long stands, as drivers do."""


@dataclass
class Base:
    """One robot; x, y and heading are in the common frame."""

    name: str
    x_m: float
    y_m: float
    heading_rad: float
    origin: tuple[float, float, float] = (0.0, 0.0, 0.0)
    clock_off_s: float = 0.0
    little_endian: bool = True
    speed_mps: float = 0.0
    turn_rate_radps: float = 0.0
    wanted: tuple[float, float] = (0.0, 0.0)
    told: list[tuple[float, float]] = field(default_factory=list)
    told_s: float = 0.0
    sends: bool = True

    def tell(self, payload: bytes) -> None:
        self.wanted = twist_of(payload)
        self.told.append(self.wanted)
        self.told_s = time.monotonic()

    def move(self, passed_s: float) -> None:
        heard = time.monotonic() - self.told_s < WATCHDOG_S
        wanted_mps, self.turn_rate_radps = self.wanted if heard else (0.0, 0.0)
        most_mps = ACCELERATION_MPS2 * passed_s
        self.speed_mps += min(max(wanted_mps - self.speed_mps, -most_mps), most_mps)
        self.x_m += passed_s * self.speed_mps * math.cos(self.heading_rad)
        self.y_m += passed_s * self.speed_mps * math.sin(self.heading_rad)
        self.heading_rad += passed_s * self.turn_rate_radps

    def odometry(self) -> bytes:
        off_x_m, off_y_m, turned_rad = self.origin
        local = complex(self.x_m - off_x_m, self.y_m - off_y_m) * cmath.rect(1.0, -turned_rad)
        return odometry_bytes(
            local.real,
            local.imag,
            self.heading_rad - turned_rad,
            self.speed_mps,
            self.turn_rate_radps,
            stamp_ns=round((time.monotonic() + self.clock_off_s) * 1e9),
            little_endian=self.little_endian,
        )


class RosSide:
    """The router with its robots, moving in real time from its start to its end.

    Attributes:
        minimum_distance_m: of any two centres so far.
    """

    def __init__(self, endpoint: str, bases: list[Base]) -> None:
        self.bases = {base.name: base for base in bases}
        self.minimum_distance_m = math.inf
        self._over = threading.Event()
        self._session = zenoh.open(world_session(endpoint).to_zenoh())
        self._odometry = {
            base.name: self._session.declare_publisher(f"robot_{base.name}/odom") for base in bases
        }
        self._twists = [
            self._session.declare_subscriber(
                f"robot_{base.name}/cmd_vel", lambda sample, base=base: base.tell(sample.payload.to_bytes())
            )
            for base in bases
        ]
        self._moving = threading.Thread(target=self._move)

    def put(self, name: str, payload: bytes) -> None:
        """Anything on a robot's odometry key."""
        self._odometry[name].put(payload)

    def _move(self) -> None:
        before_s = time.monotonic()
        while not self._over.wait(TICK_S):
            now_s = time.monotonic()
            passed_s, before_s = now_s - before_s, now_s
            for base in self.bases.values():
                base.move(passed_s)
                if base.sends:
                    self.put(base.name, base.odometry())
            for one, other in itertools.combinations(self.bases.values(), 2):
                distance_m = math.hypot(one.x_m - other.x_m, one.y_m - other.y_m)
                self.minimum_distance_m = min(self.minimum_distance_m, distance_m)

    def __enter__(self) -> Self:
        self._moving.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._over.set()
        self._moving.join()
        self._session.close()
