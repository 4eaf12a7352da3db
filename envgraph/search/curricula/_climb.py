"""Search for a curriculum: try reverse curricula, screen random families, and improve the best of them by moves."""

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
from envgraph.errors import TOLERANCE, InvalidArgument
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
"""Scores by the measures with precedence, the value of the objective, the family, and its origin."""


@dataclass(frozen=True, slots=True)
class ClimbCosts:
    """How the effort of a search is divided; `python -m benchmarks teaching` measures the success of its results."""

    level: int = (
        50_000  # training steps that take as long as a small table; each judgement counts at least as many
    )
    screened: float = 0.12  # share of the effort for screening
    moves: int = 80  # that are tried on the same seeds
    block: int = 16  # seeds after which a family is compared again and may be dropped
    births: int = 1_000  # attempts to sample a first valid family
    enough_good: int = 4  # good families per lane, judged on the first seeds, after which screening ends
    fewer_steps: float = (
        0.64  # share of the steps with which a family is searched if a reverse curriculum is good
    )
    improving: float = 0.4  # share of the effort for this, and at most as much for the reverse curriculum
    enough: float = 0.99  # value of a learning objective at which the search ends, by default
    new_learners: int = 500  # trained on the final family, on seeds that the search has not used


CLIMB: Final = ClimbCosts()
GLANCE, LOOK, POOL, JUDGE = 6, 12, 120, 520
"""Numbers of seeds to judge a family: when sampled, when compared, as a candidate for the best, and as the best."""
FEWEST, MOST = 48, 240
"""Least and largest number of seeds on which a family is compared with its children."""


@dataclass(slots=True, eq=False)
class _Lane:
    """A family that the search improves independently of the families in other lanes.

    Attributes:
        current: the family to which moves are applied.
        best: the best family of the lane so far.
        origin: the source of the members of the lane's first family.
        before: scores of `best` by the measures that take precedence over the objective.
        value: value of `best`, estimated on separate seeds; minus infinity until it is estimated.
        rng: random generator of the moves.
    """

    current: Family
    best: Family
    origin: Origin
    rng: Generator
    before: tuple[float, ...] = ()
    value: float = -inf


@dataclass(frozen=True, slots=True)
class CurriculumProgress:
    """The progress of a curriculum search, and its result when it is finished.

    Attributes:
        family: the best family so far; during screening the last sampled family.
        value: value of the family; minus infinity until it is known. In the result of a learning objective: the share
            of 500 new learners that solve the target.
        spent: share of the effort that is spent, from 0 to 1.
        tried: number of families that were judged.
        origin: the source of the family's members; None before the end.
        learnt: only in the result of a learning objective. "steps" and "fewest" are the largest and the smallest number
            of training steps in total. "alone" is the success of 500 learners trained on the target alone with "steps".
            "unsearched" is the success of the reverse curriculum with the same steps, if the search improved on it.
    """

    family: Family
    value: float
    spent: float
    tried: int
    origin: Origin | None = None
    learnt: Mapping[str, float] = field(default_factory=dict)


@dataclass(slots=True)
class CurriculumSearch:
    """A search for a family that maximises an objective.

    For a learning objective, `reverse_curriculum` is tried first. If it is good and the file fixes the steps, it is the
    result. If it is good and the steps are free, the search looks for a family that is good with fewer steps. If it is
    not good, the search looks for a better family. The result replaces the reverse curriculum only if new seeds confirm
    it.

    Screening: families are sampled by `Starts` and judged on few seeds. Half of them reuse an origin of the best
    quarter so far. The best quarter is judged on more seeds, the best third of these on twice as many, and so on, until
    one family per lane is left.

    Climbing: each lane tries moves in epochs. In an epoch the family and its children are judged on the same new seeds.
    A child is dropped as soon as it is clearly worse. It replaces the family if it is not worse after all seeds. The
    best family of a lane is updated on separate seeds.

    Measures with precedence over the objective are computed first. A family that is worse by them is not judged. A
    family that is better by them replaces another family whatever the objective says.

    The result depends on the arguments alone, because effort is counted in steps and not in time.

    Args:
        levels: makes the members of families.
        objective: the objective to maximise.
        settings: effort and sizes.
        seed: the only source of randomness.
        report: callback that is called regularly with the progress.
        measures: family measures that take precedence over the objective, in order of precedence.
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
            raise InvalidArgument(
                "`demanded` is infinity, but the largest possible diversity is unknown: give a number"
            )
        demanded = self.settings.demanded
        self._demanded = None if demanded is None else min(demanded, most) - TOLERANCE
        self._moves = Moves(self.levels, self._demanded)

    def run(self) -> CurriculumProgress:
        """Run the search, and return the result.

        Raises:
            InvalidArgument: no family with the demanded diversity and distinct members was found.
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
            until = min(1.0, self._spent() + CLIMB.improving)
            self.objective = plain.objective.at(max(1, int(CLIMB.fewer_steps * plain.objective.steps[0])))
        else:  # its success is overestimated: it was selected as the best of many on few seeds
            share = self._success(plain.family, plain.objective, CLIMB.new_learners)
            plain = replace(plain, success=share)
        found = self._searched(starts, [*starts.reversed_episodes(self._size)], until)
        if isinstance(found, TrainedFamily) and found.success >= (
            GOOD if good else plain.success + TOLERANCE
        ):
            return self._ended(found, self._success(plain.family, found.objective, CLIMB.new_learners))
        return self._ended(plain)

    def _reverse_curriculum(self, starts: Starts) -> TrainedFamily | None:
        """Return the best reverse curriculum; None if it does not apply or no episode has enough states.

        It applies if the objective is a learning objective, without further measures and without a demanded diversity.
        """
        if not isinstance(self.objective, Learning) or self.measures or self._demanded is not None:
            return None
        sizes = SIZES if self.settings.population is None else (self.settings.population,)
        is_over = lambda: self._spent() > CLIMB.improving  # noqa: E731
        return reverse_curriculum(starts, self.objective, sizes, self._success, is_over)

    def _searched(
        self, starts: Starts, first: Sequence[tuple[Origin, Family]], until: float
    ) -> TrainedFamily | _Lane:
        """Return the best family found, among `first` and others, until the share `until` of the effort is spent.

        With a learning objective the result is the family with the success of new learners, otherwise its lane.
        """
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
                self._screened(starts, first, start + CLIMB.screened * (until - start))
            )
        ]
        rounds = len(lanes).bit_length()
        start = self._spent()
        for number in range(rounds):
            # Each round has half as many lanes as the previous round, and twice its effort.
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
            share = self._success(best.best, self.objective, CLIMB.new_learners)
            return TrainedFamily(best.best, self.objective, share, best.origin)
        if best.value == -inf:  # the effort was spent before the family was judged
            best.value = value_of(self._judged(best.best, JUDGE))
        return best

    def _ended(self, found: TrainedFamily | _Lane, unsearched: float | None = None) -> CurriculumProgress:
        spent = min(1.0, self._spent())
        if isinstance(found, _Lane):
            return CurriculumProgress(found.best, found.value, spent, self.tried, found.origin)
        totals = [steps * len(found.family) for steps in found.objective.steps]
        alone = self._success((self.levels.target,), found.objective.at(max(totals)), CLIMB.new_learners)
        learnt = {"fewest": min(totals), "steps": max(totals), "alone": alone}
        if unsearched is not None:
            learnt["unsearched"] = unsearched
        return CurriculumProgress(found.family, found.success, spent, self.tried, found.origin, learnt)

    def _success(self, family: Family, objective: Learning, seeds: int) -> float:
        """Train `seeds` new learners; return the share that solves the target, 0 if a member has too many states."""
        self._steps += max(CLIMB.level, objective.effort * len(family) * seeds)
        self.tried += 1
        try:
            return objective.success(family, self._fresh(seeds))
        except (TooManyStates, NotCompiled):
            return 0.0

    @property
    def _enough(self) -> float:
        most = CLIMB.enough if isinstance(self.objective, Learning) else self.objective.most
        return most if self.settings.enough is None else self.settings.enough

    def _is_enough(self, lane: _Lane) -> bool:
        """Return True if the lane's best family reached the wanted value and the maxima of all preceding measures."""
        most = (one.maximum(len(lane.best)) if isinstance(one, Bounded) else inf for one in self.measures)
        known = zip(lane.before, most, strict=True)
        return lane.value >= self._enough and all(value >= bound - TOLERANCE for value, bound in known)

    def _before(self, family: Sequence[Level]) -> tuple[float, ...]:
        """Return the scores of a family by the measures that take precedence over the objective, rounded."""
        return tuple(round(one.score(family), DIGITS) for one in self.measures)

    def _spent(self) -> float:
        """Return the share of the effort that is spent, from 0; it may exceed 1."""
        return (self._steps + CLIMB.level * self.levels.made) / self.settings.effort

    # --- screening

    def _screened(
        self, starts: Starts, first: Sequence[tuple[Origin, Family]], until: float
    ) -> list[Screened]:
        """Screen the families `first` and sampled ones, and return the best family for each lane, the best first.

        Sampling ends when the share `until` of the effort is spent, or enough families are good.
        """
        settings, rng, pool = self.settings, self._rng, list[Screened]()
        births = good = 0
        most_births = CLIMB.births + settings.effort // CLIMB.level
        while births < len(first) or not pool or (self._spent() < until and births < most_births):
            if good == CLIMB.enough_good * settings.lanes:
                break
            births += 1
            if not pool and births > CLIMB.births:
                raise InvalidArgument(self._nothing())
            best = sorted(pool, key=_rank, reverse=True)[: len(pool) // 4]
            learnt = bool(best) and rng.random() < 0.5
            origin = best[int(rng.integers(len(best)))][2] if learnt else starts.origin(rng)
            family = starts.draw(origin, self._size, rng) if births > len(first) else None
            if births <= len(first):
                origin, family = first[births - 1]
            if family is None:
                self._steps += CLIMB.level // 2
                continue
            before, most = self._before(family), max((one[0][0] for one in pool), default=())
            value = value_of(self._judged(family, GLANCE)) if before >= most else -inf
            self._steps += CLIMB.level if value == -inf else 0
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
        return f"no valid family{wanted} was found in {CLIMB.births} attempts{why}"

    # --- climbing

    def _climb(self, lane: _Lane, until: float) -> None:
        while self._spent() < until and not self._is_enough(lane):
            self._epoch(lane, until)
            self.report(CurriculumProgress(lane.best, lane.value, min(1.0, self._spent()), self.tried))

    def _epoch(self, lane: _Lane, until: float) -> None:
        """Judge the lane's current family on new seeds, and try moves on it. A child that is not worse replaces it.

        The best family of the lane is updated first. If the current family is clearly worse, the best one replaces it.
        """
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
        for _ in range(CLIMB.moves):
            if self._spent() >= until:
                return
            child = self._moves.draw(lane.current, lane.rng)
            before = () if child is None else self._before(child)
            if child is None or before < now:
                self._steps += CLIMB.level // 2
                continue
            found = self._scores(child, seeds) if before > now else self._race(child, seeds, scores)
            if found is not None:
                lane.current, scores, now = child, found, before

    def _consider(self, lane: _Lane) -> None:
        """Judge the lane's current family on new seeds, and make it the lane's best family if its value is larger."""
        scores = self._judged(lane.current, POOL)
        if value_of(scores) > lane.value - 0.02:
            more = self._judged(lane.current, JUDGE - POOL)
            value = value_of(np.concatenate([scores, more], axis=1))
            if value > lane.value:
                lane.best, lane.value = lane.current, value

    def _race(self, family: Family, seeds: range, other: Scores) -> Scores | None:
        """Return the scores of a family on `seeds`; None if they are worse than `other`, those of another family."""
        found: list[Scores] = []
        behind = squares = 0.0
        self.tried += 1
        for first in range(0, len(seeds), CLIMB.block):
            block = seeds[first : first + CLIMB.block]
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
        """Return the scores of a family on `seeds` new seeds, and count the family as tried."""
        self.tried += 1
        return self._scores(family, self._fresh(seeds))

    def _scores(self, family: Sequence[Level], seeds: range) -> Scores:
        self._steps += max(CLIMB.level, self.objective.effort * len(family) * len(seeds))
        try:
            return self.objective.scores(family, seeds)
        except (TooManyStates, NotCompiled) as error:  # a member other than the target failed
            known = (
                error.message
                if isinstance(error, TooManyStates)
                else f"a member cannot be compiled: it has {error}"
            )
            self.levels.rejected[known] += 1
            return np.full((1, len(seeds)), LEAST)

    def _fresh(self, count: int) -> range:
        """Return a range of `count` new seeds, or of a single new seed if the objective is deterministic."""
        first = self._seeds
        self._seeds += count if self.objective.drawn else 1
        return range(first, self._seeds)


def _rank(one: Screened) -> tuple[tuple[float, ...], float]:
    return one[0]


def _per_seed(scores: Scores) -> NDArray[np.float64]:
    """Return the mean of the scores over the criteria, for each seed."""
    mean: NDArray[np.float64] = scores.mean(axis=0)
    return mean
