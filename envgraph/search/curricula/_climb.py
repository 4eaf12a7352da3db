"""The search: many families to begin with, few of which are improved by random moves."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import field
from math import inf, sqrt
from typing import Final

import numpy as np
from numpy.random import Generator, SeedSequence, default_rng
from numpy.typing import NDArray

from envgraph.code import dataclass
from envgraph.env import TooManyStates
from envgraph.env.compiled import NotCompiled
from envgraph.errors import InvalidArgument
from envgraph.search._diversity import Bounded
from envgraph.search._families import DIGITS, FamilyMeasure
from envgraph.search._family_measures import LEAST
from envgraph.search.curricula._episodes import Episode
from envgraph.search.curricula._levels import Level, Levels
from envgraph.search.curricula._moves import Family, Moves
from envgraph.search.curricula._objectives import Judged, value_of
from envgraph.search.curricula._starts import Begin, Easing, Starts

Scores = NDArray[np.float64]

LEVEL: Final = 50_000
"""Steps of learners that take as long as to make a table of a small model; no judgement of a family counts as fewer."""
SCREENED: Final = 0.12
"""Share of the effort for families to begin with."""
GLANCE, LOOK, POOL, JUDGE = 6, 12, 120, 520
"""Seeds that a family is judged by: at first, when many are compared, as a candidate for the best, and as the best."""
FEWEST, MOST = 48, 240
"""Seeds on which a family and what comes of it are compared."""
MOVES: Final = 80
"""Moves that are tried on the same seeds."""
BLOCK: Final = 16
"""Seeds after which a race between two families may be over."""
_SAME: Final = 1e-9
"""Diversities closer than this are the same."""
BIRTHS: Final = 1_000
"""Families that are drawn until one is a family at all."""


@dataclass(frozen=True, slots=True)
class CurriculumSettings:
    """How a family is searched for.

    Attributes:
        population: members of a family, the target included; at least 2.
        effort: how long: steps that learners make, where a table that is made counts as 50,000, and so does what an
            objective that needs fewer makes of some seeds.
        lanes: families that are improved side by side, until the better half of them goes on.
        enough: the search ends at this value; None: at the most that the objective can be.
        demanded: the least diversity of a family; infinity: the largest there is; or None.
        crossover, exchange: shares of these moves, see `Moves`.
        begin: where the members of the first families come from, see `Starts`.
    """

    population: int
    effort: int
    lanes: int = 4
    enough: float | None = None
    demanded: float | None = None
    crossover: float = 0.0
    exchange: float = 0.0
    begin: Begin = "easing"

    def __post_init__(self) -> None:
        if self.population < 2 or self.effort < 1 or self.lanes < 1:
            raise InvalidArgument("a search needs two members, a lane, and some effort")


@dataclass(slots=True, eq=False)
class _Lane:
    """A family that is improved.

    Attributes:
        current: the family that moves are tried on.
        best: the best one so far.
        before: what the best one is worth by the measures that count before the objective.
        value: of the best one, estimated on seeds of its own; minus infinity before it is known.
        rng: draws moves.
    """

    current: Family
    best: Family
    rng: Generator
    before: tuple[float, ...] = ()
    value: float = -inf


@dataclass(frozen=True, slots=True)
class CurriculumProgress:
    """Where a search stands.

    Attributes:
        family: the best one; while families to begin with are drawn, the last one.
        value: of it; minus infinity before it is known.
        spent: share of the effort.
        tried: families that were judged.
    """

    family: Family
    value: float
    spent: float
    tried: int


@dataclass(slots=True)
class CurriculumSearch:
    """Searches for a family of which an objective is as large as can be.

    Screening: families are drawn by `Starts` and judged on few seeds; half of them are eased as one of the best quarter
    so far was. The best quarter is compared on more seeds, the best third of these on twice as many, and so on, until
    as many are left as there are lanes. Climbing: in each lane moves are tried in epochs. In an epoch family and child
    meet the same seeds, which no epoch before had. A child is dropped as soon as it is clearly worse (a race), and
    takes the place of the family if it is not worse at the end. Families are compared on seeds of their own.

    Measures that count before the objective are asked first: a family that is worse in them is not judged, and one that
    is better in them takes the place of another one whatever the objective says.

    The result depends on the arguments alone: effort is counted, not timed.

    Args:
        levels: of the members.
        objective: what is to be large.
        settings: how long, and how many.
        seed: the one source of randomness.
        report: called now and then with where the search stands.
        measures: of families, that count before the objective, the one that counts most first.
    """

    levels: Levels
    objective: Judged
    settings: CurriculumSettings
    seed: int
    report: Callable[[CurriculumProgress], None] = lambda progress: None
    measures: Sequence[FamilyMeasure] = ()
    tried: int = field(default=0, init=False)
    _steps: int = field(default=0, init=False)
    _seeds: int = field(default=0, init=False)
    _demanded: float | None = field(init=False)
    _moves: Moves = field(init=False)

    def __post_init__(self) -> None:
        most = self.levels.problem.maximum(self.settings.population)
        if self.settings.demanded == inf == most:
            raise InvalidArgument("nobody knows how diverse a family can be at most: demand a number")
        demanded = self.settings.demanded
        self._demanded = None if demanded is None else min(demanded, most) - _SAME
        self._moves = Moves(
            self.levels, self._demanded, crossover=self.settings.crossover, exchange=self.settings.exchange
        )

    def run(self) -> CurriculumProgress:
        """The best family that was found.

        Raises:
            InvalidArgument: none was found that is as diverse as demanded, or has different members.
        """
        lanes = [
            _Lane(
                family,
                family,
                default_rng(SeedSequence(self.seed, spawn_key=(1, place))),
                self._before(family),
            )
            for place, family in enumerate(self._screened())
        ]
        rounds = len(lanes).bit_length()
        start = self._spent()
        for number in range(rounds):
            # Each round has twice the effort of the one before it, and half as many lanes.
            until = start + (1.0 - start) * (2 ** (number + 1) - 1) / (2**rounds - 1)
            share = (until - self._spent()) / len(lanes)
            for lane in lanes:
                self._climb(lane, self._spent() + share)
            lanes.sort(key=lambda lane: (lane.before, lane.value), reverse=True)
            lanes = lanes[: max(1, len(lanes) // 2)]
            if self._is_enough(lanes[0]):
                break
        if lanes[0].value == -inf:  # the effort was over before
            lanes[0].value = value_of(self._judged(lanes[0].best, JUDGE))
        return self._progress(lanes[0])

    @property
    def _enough(self) -> float:
        return self.objective.most if self.settings.enough is None else self.settings.enough

    def _is_enough(self, lane: _Lane) -> bool:
        """Whether nothing better is wanted, or possible in what counts before the objective."""
        most = (one.maximum(len(lane.best)) if isinstance(one, Bounded) else inf for one in self.measures)
        known = zip(lane.before, most, strict=True)
        return lane.value >= self._enough and all(value >= bound - _SAME for value, bound in known)

    def _before(self, family: Sequence[Level]) -> tuple[float, ...]:
        """What a family is worth by the measures that count before the objective."""
        return tuple(round(one.score(family), DIGITS) for one in self.measures)

    def _spent(self) -> float:
        """Share of the effort."""
        return (self._steps + LEVEL * self.levels.made) / self.settings.effort

    def _progress(self, lane: _Lane) -> CurriculumProgress:
        return CurriculumProgress(lane.best, lane.value, min(1.0, self._spent()), self.tried)

    # --- families to begin with

    def _screened(self) -> list[Family]:
        """As many families as there are lanes, the best first."""
        settings, rng = self.settings, default_rng(SeedSequence(self.seed, spawn_key=(0,)))
        starts = Starts(self.levels, self._moves, settings.population, self._demanded, rng, settings.begin)
        pool: list[tuple[tuple[tuple[float, ...], float], Family, Easing | Episode]] = []
        births = 0
        while (self._spent() < SCREENED and births < BIRTHS + settings.effort // LEVEL) or not pool:
            births += 1
            if not pool and births > BIRTHS:
                raise InvalidArgument(self._nothing())
            best = sorted(pool, key=_rank, reverse=True)[: len(pool) // 4]
            learnt = bool(best) and rng.random() < 0.5
            easing = best[int(rng.integers(len(best)))][2] if learnt else starts.easing(rng)
            family = starts.draw(easing, rng)
            if family is None:
                self._steps += LEVEL // 2
                continue
            before, most = self._before(family), max((one[0][0] for one in pool), default=())
            value = value_of(self._judged(family, GLANCE)) if before >= most else -inf
            self._steps += LEVEL if value == -inf else 0
            pool.append(((before, value), family, easing))
            self.report(CurriculumProgress(family, -inf, min(1.0, self._spent()), self.tried))
        pool.sort(key=_rank, reverse=True)
        pool, seeds = pool[: max(settings.lanes, len(pool) // 4)], LOOK
        while len(pool) > settings.lanes:
            pool = [
                ((before, value_of(self._judged(family, seeds))), family, easing)
                for (before, _), family, easing in pool
            ]
            pool.sort(key=_rank, reverse=True)
            pool, seeds = pool[: max(settings.lanes, len(pool) // 3)], 2 * seeds
        return [family for _, family, _ in pool]

    def _nothing(self) -> str:
        reasons = self.levels.rejected.most_common(1)
        why = f": {reasons[0][0]}, {reasons[0][1]} times" if reasons else ""
        demanded = self._demanded
        wanted = "" if demanded is None else f" with a diversity of {demanded:.3f}"
        return f"no family{wanted} that leads to the target was found in {BIRTHS} attempts{why}"

    # --- improving them

    def _climb(self, lane: _Lane, until: float) -> None:
        while self._spent() < until and not self._is_enough(lane):
            self._epoch(lane, until)
            self.report(self._progress(lane))

    def _epoch(self, lane: _Lane, until: float) -> None:
        """Judge the family of a lane on new seeds, see whether it is the best so far, and try moves on it."""
        lacking = 1.0 - min(1.0, max(0.0, lane.value))
        seeds = self._fresh(MOST if lacking * MOST <= 8 else max(FEWEST, int(8 / lacking)))
        scores = self._scores(lane.current, seeds)
        error = _per_seed(scores).std() / sqrt(len(seeds))
        if lane.current is not lane.best or lane.value == -inf:
            before = self._before(lane.current)
            if before > lane.before:
                lane.best, lane.before, lane.value = lane.current, before, -inf
            if value_of(scores) >= lane.value - 0.5 * error:
                self._consider(lane)
            elif value_of(scores) < lane.value - 2 * error:
                lane.current = lane.best
                scores = self._scores(lane.current, seeds)
        now = self._before(lane.current)
        for _ in range(MOVES):
            if self._spent() >= until:
                return
            child = self._moves.draw(lane.current, lane.rng)
            before = () if child is None else self._before(child)
            if child is None or before < now:
                self._steps += LEVEL // 2
                continue
            found = self._scores(child, seeds) if before > now else self._race(child, seeds, scores)
            if found is not None:
                lane.current, scores, now = child, found, before

    def _consider(self, lane: _Lane) -> None:
        """Take the family of a lane as its best one if it is, on seeds of its own."""
        scores = self._judged(lane.current, POOL)
        if value_of(scores) > lane.value - 0.02:
            more = self._judged(lane.current, JUDGE - POOL)
            value = value_of(np.concatenate([scores, more], axis=1))
            if value > lane.value:
                lane.best, lane.value = lane.current, value

    def _race(self, family: Family, seeds: range, other: Scores) -> Scores | None:
        """The scores of a family, or None if it is worse than one with other scores on the same seeds."""
        found: list[Scores] = []
        behind = squares = 0.0
        self.tried += 1
        for first in range(0, len(seeds), BLOCK):
            block = seeds[first : first + BLOCK]
            scores = self._scores(family, block)
            found.append(scores)
            difference = _per_seed(scores) - _per_seed(other[:, first : first + len(block)])
            behind += float(difference.sum())
            squares += float(difference @ difference)
            if behind < -sqrt(squares) - 0.6:
                return None
        scores = np.concatenate(found, axis=1)
        return scores if value_of(scores) >= value_of(other) else None

    # --- judging

    def _judged(self, family: Sequence[Level], seeds: int) -> Scores:
        """The scores of a family on new seeds."""
        self.tried += 1
        return self._scores(family, self._fresh(seeds))

    def _scores(self, family: Sequence[Level], seeds: range) -> Scores:
        self._steps += max(LEVEL, self.objective.effort * len(family) * len(seeds))
        try:
            return self.objective.scores(family, seeds)
        except (TooManyStates, NotCompiled) as error:  # of another member than the target
            known = error.message if isinstance(error, TooManyStates) else f"{error} is not compiled"
            self.levels.rejected[known] += 1
            return np.full((1, len(seeds)), LEAST)

    def _fresh(self, count: int) -> range:
        """Seeds that nothing has seen; one is enough where nothing is drawn."""
        first = self._seeds
        self._seeds += count if self.objective.drawn else 1
        return range(first, self._seeds)


def _rank(
    one: tuple[tuple[tuple[float, ...], float], Family, Easing | Episode],
) -> tuple[tuple[float, ...], float]:
    return one[0]


def _per_seed(scores: Scores) -> NDArray[np.float64]:
    """One number for each seed."""
    mean: NDArray[np.float64] = scores.mean(axis=0)
    return mean
