"""The search: try the reverse curriculum, draw many other families, and improve the best of these by moves."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import field, replace
from math import inf, sqrt
from typing import Final

import numpy as np
from numpy.random import Generator, SeedSequence, default_rng
from numpy.typing import NDArray

from envgraph.code import dataclass
from envgraph.env import TooManyStates
from envgraph.env.compiled import NotCompiled
from envgraph.errors import InvalidArgument
from envgraph.search.curricula._levels import Level, Levels
from envgraph.search.curricula._moves import Family, Moves
from envgraph.search.curricula._objectives import Judged, Learning, value_of
from envgraph.search.curricula._reverse import GOOD, SIZES, TrainedFamily, reverse_curriculum
from envgraph.search.curricula._settings import CurriculumSettings
from envgraph.search.curricula._starts import Origin, Starts
from envgraph.search.problem._diversity import Bounded
from envgraph.search.problem._family_measures import LEAST
from envgraph.search.problem._pool import DIGITS, FamilyMeasure

Scores = NDArray[np.float64]
Screened = tuple[tuple[tuple[float, ...], float], Family, Origin]
"""Values by the measures that count before the objective, the value by the objective, the family, its origin."""

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
ENOUGH_GOOD: Final = 4
"""Good families for each lane, judged on the first seeds, after which no more families are drawn."""
FEWER_STEPS: Final = 0.64
"""If a reverse curriculum is good, a family is searched for that is good with this share of its steps."""
IMPROVING: Final = 0.4
"""Share of the effort for this search; the reverse curriculum takes at most the same share."""
ENOUGH: Final = 0.99
"""The search for a family that teaches ends at this value by default."""
NEW_LEARNERS: Final = 500
"""Learners that are trained on the final family, on seeds that the search has not used."""


@dataclass(slots=True, eq=False)
class _Lane:
    """A family that is improved.

    Attributes:
        current: the family that moves are tried on.
        best: the best one so far.
        origin: what the members of the lane's first family were made from.
        before: what the best one is worth by the measures that count before the objective.
        value: of the best one, estimated on seeds of its own; minus infinity before it is known.
        rng: draws moves.
    """

    current: Family
    best: Family
    origin: Origin
    rng: Generator
    before: tuple[float, ...] = ()
    value: float = -inf


@dataclass(frozen=True, slots=True)
class CurriculumProgress:
    """Where a search stands.

    Attributes:
        family: the best one; while families to begin with are drawn, the last one.
        value: of the family; minus infinity before it is known. At the end, if learners judge: the share of 500 new
            learners that solve the target.
        spent: share of the effort.
        tried: families that were judged.
        origin: what the members are made from; None before the end.
        learnt: at the end, if learners judge: the most "steps" in all, and the "fewest"; "alone", the success of 500
            learners with the most steps on the target alone; and if the search improved on the reverse curriculum,
            "unsearched", the success of the reverse curriculum with the steps of the family.
    """

    family: Family
    value: float
    spent: float
    tried: int
    origin: Origin | None = None
    learnt: Mapping[str, float] = field(default_factory=dict)


@dataclass(slots=True)
class CurriculumSearch:
    """Searches for a family of which an objective is as large as can be.

    If learners judge, `reverse_curriculum` is tried first. If it is good and the file names steps, it is the result.
    If it is good and the steps are free, the search looks for a family that is good with fewer steps; if it is not
    good, for a better family. The found family replaces the reverse curriculum only if new seeds confirm it.

    Screening: families are drawn by `Starts` and judged on few seeds; half of them have the origin of one of the best
    quarter so far. The best quarter is compared on more seeds, the best third of these on twice as many, and so on,
    until as many are left as there are lanes. Climbing: in each lane moves are tried in epochs. In an epoch family and
    child meet the same new seeds. A child is dropped as soon as it is clearly worse (a race), and
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
    _size: int = field(init=False)
    _rng: Generator = field(init=False)

    def __post_init__(self) -> None:
        self._size = self.settings.population or 6
        self._rng = default_rng(SeedSequence(self.seed, spawn_key=(0,)))
        most = self.levels.problem.maximum(self._size)
        if self.settings.demanded == inf == most:
            raise InvalidArgument("nobody knows how diverse a family can be at most: demand a number")
        demanded = self.settings.demanded
        self._demanded = None if demanded is None else min(demanded, most) - _SAME
        self._moves = Moves(self.levels, self._demanded)

    def run(self) -> CurriculumProgress:
        """The best family that was found.

        Raises:
            InvalidArgument: none was found that is as diverse as demanded, or has different members.
        """
        starts = Starts(self.levels, self._moves, self._demanded, self._rng, self.settings.begin)
        plain = self._reverse_curriculum(starts)
        if plain is None:
            return self._ended(self._searched(starts, [], 1.0))
        self._size, self.objective = len(plain.family), plain.objective
        good, until = plain.success >= GOOD, 1.0
        if good and not plain.objective.free:
            return self._ended(plain)
        if good:
            until = min(1.0, self._spent() + IMPROVING)
            self.objective = plain.objective.at(max(1, int(FEWER_STEPS * plain.objective.steps[0])))
        else:  # it was the best of many on few seeds
            share = self._success(plain.family, plain.objective, NEW_LEARNERS)
            plain = replace(plain, success=share)
        found = self._searched(starts, [*starts.reversed_episodes(self._size)], until)
        if isinstance(found, TrainedFamily) and found.success >= (GOOD if good else plain.success + _SAME):
            return self._ended(found, self._success(plain.family, found.objective, NEW_LEARNERS))
        return self._ended(plain)

    def _reverse_curriculum(self, starts: Starts) -> TrainedFamily | None:
        """Return the best reverse curriculum; None if not only learners judge, or no episode has enough states."""
        if not isinstance(self.objective, Learning) or self.measures or self._demanded is not None:
            return None
        sizes = SIZES if self.settings.population is None else (self.settings.population,)
        is_over = lambda: self._spent() > IMPROVING  # noqa: E731
        return reverse_curriculum(starts, self.objective, sizes, self._success, is_over)

    def _searched(
        self, starts: Starts, first: Sequence[tuple[Origin, Family]], until: float
    ) -> TrainedFamily | _Lane:
        """Return the best family that is found until the share `until` of the effort is spent."""
        start = self._spent()
        lanes = [
            _Lane(
                family,
                family,
                origin,
                default_rng(SeedSequence(self.seed, spawn_key=(1, place))),
                self._before(family),
            )
            for place, (_, family, origin) in enumerate(
                self._screened(starts, first, start + SCREENED * (until - start))
            )
        ]
        rounds = len(lanes).bit_length()
        start = self._spent()
        for number in range(rounds):
            # Each round has twice the effort of the one before it, and half as many lanes.
            end = start + (until - start) * (2 ** (number + 1) - 1) / (2**rounds - 1)
            share = (end - self._spent()) / len(lanes)
            for lane in lanes:
                self._climb(lane, self._spent() + share)
            lanes.sort(key=lambda lane: (lane.before, lane.value), reverse=True)
            lanes = lanes[: max(1, len(lanes) // 2)]
            if self._is_enough(lanes[0]):
                break
        best = lanes[0]
        if isinstance(self.objective, Learning):
            share = self._success(best.best, self.objective, NEW_LEARNERS)
            return TrainedFamily(best.best, self.objective, share, best.origin)
        if best.value == -inf:  # the effort was over before
            best.value = value_of(self._judged(best.best, JUDGE))
        return best

    def _ended(self, found: TrainedFamily | _Lane, unsearched: float | None = None) -> CurriculumProgress:
        spent = min(1.0, self._spent())
        if isinstance(found, _Lane):
            return CurriculumProgress(found.best, found.value, spent, self.tried, found.origin)
        totals = [steps * len(found.family) for steps in found.objective.steps]
        alone = self._success((self.levels.target,), found.objective.at(max(totals)), NEW_LEARNERS)
        learnt = {"fewest": min(totals), "steps": max(totals), "alone": alone}
        if unsearched is not None:
            learnt["unsearched"] = unsearched
        return CurriculumProgress(found.family, found.success, spent, self.tried, found.origin, learnt)

    def _success(self, family: Family, objective: Learning, seeds: int) -> float:
        """Train so many new learners; return the share that solves the target, 0 if a member has too many states."""
        self._steps += max(LEVEL, objective.effort * len(family) * seeds)
        self.tried += 1
        try:
            return objective.success(family, self._fresh(seeds))
        except (TooManyStates, NotCompiled):
            return 0.0

    @property
    def _enough(self) -> float:
        most = ENOUGH if isinstance(self.objective, Learning) else self.objective.most
        return most if self.settings.enough is None else self.settings.enough

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

    # --- families to begin with

    def _screened(
        self, starts: Starts, first: Sequence[tuple[Origin, Family]], until: float
    ) -> list[Screened]:
        """Return a family for each lane, the best first, of the families `first` and of drawn ones."""
        settings, rng, pool = self.settings, self._rng, list[Screened]()
        births = good = 0
        most_births = BIRTHS + settings.effort // LEVEL
        while births < len(first) or not pool or (self._spent() < until and births < most_births):
            if good == ENOUGH_GOOD * settings.lanes:
                break
            births += 1
            if not pool and births > BIRTHS:
                raise InvalidArgument(self._nothing())
            best = sorted(pool, key=_rank, reverse=True)[: len(pool) // 4]
            learnt = bool(best) and rng.random() < 0.5
            origin = best[int(rng.integers(len(best)))][2] if learnt else starts.origin(rng)
            family = starts.draw(origin, self._size, rng) if births > len(first) else None
            if births <= len(first):
                origin, family = first[births - 1]
            if family is None:
                self._steps += LEVEL // 2
                continue
            before, most = self._before(family), max((one[0][0] for one in pool), default=())
            value = value_of(self._judged(family, GLANCE)) if before >= most else -inf
            self._steps += LEVEL if value == -inf else 0
            pool.append(((before, value), family, origin))
            good += value >= self._enough
            self.report(CurriculumProgress(family, -inf, min(1.0, self._spent()), self.tried))
        pool.sort(key=_rank, reverse=True)
        pool, seeds = pool[: max(settings.lanes, len(pool) // 4)], LOOK
        while len(pool) > settings.lanes:
            pool = [
                ((before, value_of(self._judged(family, seeds))), family, origin)
                for (before, _), family, origin in pool
            ]
            pool.sort(key=_rank, reverse=True)
            pool, seeds = pool[: max(settings.lanes, len(pool) // 3)], 2 * seeds
        return pool

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
            self.report(CurriculumProgress(lane.best, lane.value, min(1.0, self._spent()), self.tried))

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


def _rank(one: Screened) -> tuple[tuple[float, ...], float]:
    return one[0]


def _per_seed(scores: Scores) -> NDArray[np.float64]:
    """One number for each seed."""
    mean: NDArray[np.float64] = scores.mean(axis=0)
    return mean
