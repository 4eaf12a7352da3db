"""Strategies that follow a single model: simulated annealing and hill climbing.

With several goals each run minimises another scalarisation. The first runs minimise one goal each. Later runs minimise
the largest weighted distance from the best values found so far, with random weights (Tchebycheff), so that every part
of the front can be reached. All non-dominated states on the way are archived.
"""

from __future__ import annotations

from collections.abc import Callable
from math import inf

from envgraph.code import dataclass
from envgraph.errors import InvalidArgument
from envgraph.lang import ComponentOptions, key
from envgraph.search.evolution._survivor_selection import acceptance_probability
from envgraph.search.optimising._goals import ConstrainedCosts
from envgraph.search.optimising._search_walk import Walk

_INITIAL_TEMPERATURE, _FINAL_TEMPERATURE = 0.3, 0.01
"""Initial and final temperature, in units of the mean cost increase: the best of several on the contest's inputs."""

EnergyFunction = Callable[[ConstrainedCosts], float]


@dataclass(frozen=True, slots=True)
class Annealing:
    """Simulated annealing: random moves; a worse state is accepted with a probability that falls over time.

    The temperature is chosen automatically. It falls exponentially from 0.3 to 0.01 of the mean of all cost increases
    so far. It is lowest when the moves or the time run out, whichever is first. A move that reduces the violation is
    always accepted, a move that increases it never.

    Attributes:
        runs: number of runs from the initial model, which share moves and time equally. None: one run for one goal, ten
            runs per goal for several goals.
    """

    runs: int | None = key(None, ComponentOptions.integer, low=1, most="width")

    def __post_init__(self) -> None:
        if self.runs is not None and self.runs < 1:
            raise InvalidArgument(f"`runs` is {self.runs}, but must be at least 1")

    def search(self, walk: Walk) -> None:
        """Search by annealing until the walk is over."""
        goals = len(walk.current_costs.costs)
        runs = self.runs or (1 if goals == 1 else 10 * goals)
        for run in range(runs):
            if walk.over():
                return
            walk.check_out(walk.initial_state)
            self._anneal(walk, (walk.most_moves * (run + 1)) // runs, (run + 1) / runs, _energy_function(walk, run))

    @staticmethod
    def _anneal(walk: Walk, last_move: int, last_time_share: float, energy: EnergyFunction) -> None:
        """Anneal until `last_move` moves are tried in total, or the share `last_time_share` of the time limit has
        passed.
        """
        begin, began, here = walk.moves_tried, walk.time_share, energy(walk.current_costs)
        increases, total = 0, 0.0

        def elapsed_share() -> float:
            moves = (walk.moves_tried - begin) / (last_move - begin) if begin < last_move else 1.0
            return max(
                moves,
                (walk.time_share - began) / (last_time_share - began) if began < last_time_share else 1.0,
            )

        while elapsed_share() < 1 and not walk.over():
            standing = walk.attempt()
            if standing is None:
                continue
            there = energy(standing)
            accepted = standing.violation < walk.current_costs.violation
            if standing.violation == walk.current_costs.violation:
                increase = there - here if there != here else 0.0  # both may be infinite
                accepted = increase <= 0
                if 0 < increase < inf:
                    increases, total = increases + 1, total + increase
                    temperature = temperature_at(total / increases, min(elapsed_share(), 1.0))
                    accepted = walk.rng.random() < acceptance_probability(increase, temperature)
            if accepted:
                walk.keep()
                here = there
            else:
                walk.undo()


def temperature_at(mean_increase: float, time_share: float) -> float:
    """Return the temperature at a time from 0 to 1, given the mean cost increase of worsening moves.

    >>> [round(temperature_at(2.0, time_share), 3) for time_share in (0.0, 0.5, 1.0)]
    [0.6, 0.11, 0.02]
    """
    found: float = mean_increase * _INITIAL_TEMPERATURE * (_FINAL_TEMPERATURE / _INITIAL_TEMPERATURE) ** time_share
    return found


@dataclass(frozen=True, slots=True)
class HillClimb:
    """Hill climbing: random moves; a worse state is never accepted. It restarts if there was no improvement for long.

    Attributes:
        patience: number of moves without improvement after which it restarts from the initial model.
    """

    patience: int = key(1000, ComponentOptions.integer, low=1, most="steps")

    def __post_init__(self) -> None:
        if self.patience < 1:
            raise InvalidArgument(f"`patience` is {self.patience}, but must be at least 1")

    def search(self, walk: Walk) -> None:
        """Search by hill climbing with restarts until the walk is over."""
        run = 0
        while not walk.over():
            walk.check_out(walk.initial_state)
            energy, idle = _energy_function(walk, run), 0
            run += 1
            here = energy(walk.current_costs)
            while idle < self.patience and not walk.over():
                idle += 1
                standing = walk.attempt()
                if standing is None:
                    continue
                before, after = (walk.current_costs.violation, here), (standing.violation, energy(standing))
                if after > before:
                    walk.undo()
                    continue
                walk.keep()
                here = after[1]
                if after < before:
                    idle = 0


def _energy_function(walk: Walk, run: int) -> EnergyFunction:
    """Return the function that the run with this number minimises: the cost, or a scalarisation of several costs."""
    goals = len(walk.current_costs.costs)
    if goals == 1:
        return lambda standing: standing.costs[0]
    if run < goals:
        # The other costs break ties, so that the result of the run is on the front.
        return lambda standing: standing.costs[run] + 1e-6 * sum(standing.costs)
    low, high = walk.archive.cost_bounds()
    weights: list[float] = walk.rng.dirichlet([1.0] * goals).tolist()
    scaled = [
        (weight / (b - a), a) if a < b < inf else (weight, 0.0) for weight, a, b in zip(weights, low, high, strict=True)
    ]

    def energy(standing: ConstrainedCosts) -> float:
        costs = zip(scaled, standing.costs, strict=True)
        parts: list[float] = [weight * (cost - best) for (weight, best), cost in costs]
        return max(parts) + 1e-3 * sum(parts)

    return energy
