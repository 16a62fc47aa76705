"""An optimiser that looks for the lowest value in the unit cube, over and over from other places."""

from collections.abc import Callable, Sequence

import cma
import numpy as np
from numpy.typing import NDArray

from fleet.hunt.attempt import Points

SPREAD = 0.2
"""First standard deviation of each coordinate around the start, which reaches most of the cube."""
GENERATIONS = 30
"""Of one start at most; many starts find more of different kinds than a long one."""


class Search:
    """Asks for the values of points, generation by generation, and goes where they are low.

    Each start draws its first generation anywhere in the cube, and goes on from the best of it by CMA-ES
    (Hansen 2016, "The CMA Evolution Strategy: A Tutorial") with a diagonal covariance matrix: a start has
    some hundred values, which are too few to learn all correlations of dozens of coordinates. It ends when a
    value is low enough, or no lower ones come; the next one begins elsewhere.

    Args:
        size: number of coordinates.
        random: draws everything; the same draws and values give the same points.
        enough: a value below this ends a start.

    Attributes:
        start: the number of the present start, from 0.
    """

    def __init__(self, size: int, random: np.random.Generator, enough: float) -> None:
        self._size, self._random, self._enough = size, random, enough
        self.start = 0
        self._strategy: cma.CMAEvolutionStrategy | None = None

    @property
    def generation_size(self) -> int:
        """Points of a generation: CMA-ES's usual number."""
        return 4 + int(3.0 * np.log(self._size))

    def ask(self) -> Points:
        """The points of the next generation."""
        if self._strategy is None:
            drawn: Points = self._random.random((self.generation_size, self._size)).tolist()
            return drawn
        return [np.clip(point, 0.0, 1.0).tolist() for point in self._strategy.ask()]

    def tell(self, points: Points, values: Sequence[float]) -> None:
        """Take in the values of the points that were asked for; infinity for those that have none."""
        finite = [value for value in values if np.isfinite(value)]
        if not finite or min(finite) < self._enough:
            self._begin_anew()
            return
        if self._strategy is None:
            self._strategy = self._from(points[int(np.argmin(values))])
            return
        # CMA-ES goes by the order of values alone.
        self._strategy.tell(points, [min(value, max(finite) + 1.0) for value in values])
        if self._strategy.stop() or self._strategy.countiter >= GENERATIONS:
            self._begin_anew()

    def run(self, budget: int, values_of: Callable[[Points], Sequence[float]]) -> None:
        """Ask and tell until the budget is spent.

        Args:
            budget: number of points whose values may be asked for.
            values_of: gives the values of points.
        """
        while budget > 0:
            points = self.ask()
            values = values_of(points[:budget])
            budget -= len(values)
            if len(values) == len(points):
                self.tell(points, values)

    def _begin_anew(self) -> None:
        self._strategy = None
        self.start += 1

    def _from(self, point: Sequence[float]) -> cma.CMAEvolutionStrategy:
        def normal(*shape: int) -> NDArray[np.float64]:
            return self._random.standard_normal(shape)

        options = {
            "bounds": [0.0, 1.0],
            "popsize": self.generation_size,
            "CMA_diagonal": True,
            "randn": normal,
            "seed": np.nan,  # nothing but `randn` draws
            "verbose": -9,
        }
        return cma.CMAEvolutionStrategy(list(point), SPREAD, options)
