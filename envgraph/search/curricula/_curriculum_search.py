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
from envgraph.search.curricula._curriculum_settings import CurriculumSettings
from envgraph.search.curricula._family_moves import Family, FamilyMoves
from envgraph.search.curricula._first_families import FamilyOrigin, FirstFamilySampler
from envgraph.search.curricula._model_levels import LevelFactory, ModelLevel
from envgraph.search.curricula._objectives import CurriculumObjective, LearningObjective, value_of_scores
from envgraph.search.curricula._reverse_curricula import (
    FAMILY_SIZES,
    GOOD_SUCCESS_RATE,
    TrainedFamily,
    reverse_curriculum,
)
from envgraph.search.problem._candidate_pool import SCORE_DECIMALS, FamilyMeasure
from envgraph.search.problem._family_measures import LOWEST_SCORE
from envgraph.search.problem._statistics import BoundedMeasure

Scores = NDArray[np.float64]
ScreenedFamily = tuple[tuple[tuple[float, ...], float], Family, FamilyOrigin]
"""Scores by the measures with precedence, the value of the objective, the family, and its origin."""


@dataclass(frozen=True, slots=True)
class ClimbCosts:
    """The shares of effort in a search; `python -m benchmarks teaching` measures the success of its results."""

    level: int = 50_000  # training steps that take as long as a small table; each judgement counts at least as many
    screened: float = 0.12  # share of the effort for screening
    moves: int = 80  # that are tried on the same seeds
    block: int = 16  # seeds after which a family is compared again and may be dropped
    births: int = 1_000  # attempts to sample a first valid family
    enough_good: int = 4  # good families per lane, judged on the first seeds, after which screening ends
    fewer_steps: float = 0.64  # share of the steps with which a family is searched if a reverse curriculum is good
    improving: float = 0.4  # share of the effort for this, and at most as much for the reverse curriculum
    enough: float = 0.99  # value of a learning objective at which the search ends, by default
    new_learners: int = 500  # trained on the final family, on seeds that the search has not used


CLIMB: Final = ClimbCosts()
SAMPLE_SEEDS, SCREENING_SEEDS, CANDIDATE_SEEDS, BEST_SEEDS = 6, 12, 120, 520
"""Numbers of seeds to judge a family: when sampled, when compared, as a candidate for the best, and as the best."""
FEWEST_EPOCH_SEEDS, MOST_EPOCH_SEEDS = 48, 240
"""Least and largest number of seeds on which a family is compared with its children."""


@dataclass(slots=True, eq=False)
class _SearchLane:
    """A family that the search improves independently of the families in other lanes.

    Attributes:
        current_family: the family to which moves are applied.
        best_family: the best family of the lane so far.
        origin: the source of the members of the lane's first family.
        preceding_scores: scores of `best_family` by the measures that take precedence over the objective.
        best_value: value of `best_family`, estimated on separate seeds; minus infinity until it is estimated.
        rng: random generator of the moves.
    """

    current_family: Family
    best_family: Family
    origin: FamilyOrigin
    rng: Generator
    preceding_scores: tuple[float, ...] = ()
    best_value: float = -inf


@dataclass(frozen=True, slots=True)
class CurriculumProgress:
    """The progress of a curriculum search, and its result when it is finished.

    Attributes:
        family: the best family so far; during screening the last sampled family.
        value: value of the family; minus infinity until it is known. In the result of a learning objective: the share
            of 500 new learners that solve the target.
        effort_share: share of the effort that is spent, from 0 to 1.
        families_judged: number of families that were judged.
        origin: the source of the family's members; None before the end.
        learning_results: only in the result of a learning objective. "steps" and "fewest" are the largest and the
            smallest number of training steps in total. "alone" is the success of 500 learners trained on the target
            alone with "steps". "unsearched" is the success of the reverse curriculum with the same steps, if the search
            improved on it.
    """

    family: Family
    value: float
    effort_share: float
    families_judged: int
    origin: FamilyOrigin | None = None
    learning_results: Mapping[str, float] = field(default_factory=dict)


@dataclass(slots=True)
class CurriculumSearch:
    """A search for a family that maximises an objective.

    For a learning objective, `reverse_curriculum` is tried first. If it is good and the file fixes the steps, it is the
    result. If it is good and the steps are free, the search looks for a family that is good with fewer steps. If it is
    not good, the search looks for a better family. The result replaces the reverse curriculum only if new seeds confirm
    it.

    Screening: families are sampled by `FirstFamilySampler` and judged on few seeds. Half of them reuse an origin of the
    best quarter so far. The best quarter is judged on more seeds, the best third of these on twice as many, and so on,
    until one family per lane is left.

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
        on_progress: callback that is called regularly with the progress.
        preceding_measures: family measures that take precedence over the objective, in order of precedence.
    """

    levels: LevelFactory
    objective: CurriculumObjective
    settings: CurriculumSettings
    seed: int
    on_progress: Callable[[CurriculumProgress], None] = lambda progress: None
    preceding_measures: Sequence[FamilyMeasure] = ()
    families_judged: int = field(default=0, init=False)
    _steps_spent: int = field(default=0, init=False)
    _next_seed: int = field(default=0, init=False)
    _least_diversity: float | None = field(init=False)
    _moves: FamilyMoves = field(init=False)
    _size: int = field(init=False)
    _rng: Generator = field(init=False)

    def __post_init__(self) -> None:
        self._size = self.settings.population or 6
        self._rng = default_rng(SeedSequence(self.seed, spawn_key=(0,)))
        most = self.levels.problem.largest_diversity(self._size)
        if self.settings.least_diversity == inf == most:
            raise InvalidArgument(
                "`least_diversity` is infinity, but the largest possible diversity is unknown: give a number"
            )
        demanded = self.settings.least_diversity
        self._least_diversity = None if demanded is None else min(demanded, most) - TOLERANCE
        self._moves = FamilyMoves(self.levels, self._least_diversity)

    def run(self) -> CurriculumProgress:
        """Run the search, and return the result.

        Raises:
            InvalidArgument: no family with the demanded diversity and distinct members was found.
        """
        starts = FirstFamilySampler(self.levels, self._moves, self._least_diversity, self._rng, self.settings.begin)
        reverse = self._best_reverse_curriculum(starts)
        if reverse is None:
            return self._result(self._search_family(starts, [], 1.0))
        self._size, self.objective = len(reverse.family), reverse.objective
        good, until = reverse.success >= GOOD_SUCCESS_RATE, 1.0
        if good and not reverse.objective.is_steps_free:
            return self._result(reverse)
        if good:
            until = min(1.0, self._effort_share() + CLIMB.improving)
            self.objective = reverse.objective.with_steps(max(1, int(CLIMB.fewer_steps * reverse.objective.steps[0])))
        else:  # its success is overestimated: it was selected as the best of many on few seeds
            share = self._success_rate(reverse.family, reverse.objective, CLIMB.new_learners)
            reverse = replace(reverse, success=share)
        found = self._search_family(starts, [*starts.reverse_curricula(self._size)], until)
        if isinstance(found, TrainedFamily) and found.success >= (
            GOOD_SUCCESS_RATE if good else reverse.success + TOLERANCE
        ):
            return self._result(found, self._success_rate(reverse.family, found.objective, CLIMB.new_learners))
        return self._result(reverse)

    def _best_reverse_curriculum(self, starts: FirstFamilySampler) -> TrainedFamily | None:
        """Return the best reverse curriculum, whose members are states of an optimal episode of the target.

        None if no optimal episode has as many states as a family has members, or if the objective is not the learning
        objective alone, without a demanded diversity.
        """
        if (
            not isinstance(self.objective, LearningObjective)
            or self.preceding_measures
            or self._least_diversity is not None
        ):
            return None
        sizes = FAMILY_SIZES if self.settings.population is None else (self.settings.population,)
        is_over = lambda: self._effort_share() > CLIMB.improving  # noqa: E731
        return reverse_curriculum(starts, self.objective, sizes, self._success_rate, is_over)

    def _search_family(
        self,
        starts: FirstFamilySampler,
        first_families: Sequence[tuple[FamilyOrigin, Family]],
        last_effort_share: float,
    ) -> TrainedFamily | _SearchLane:
        """Return the best family found, among `first_families` and others, until the share `last_effort_share` of the
        effort is spent.

        With a learning objective the result is the family with the success of new learners, otherwise its lane.
        """
        start = self._effort_share()
        until, lanes = start + CLIMB.screened * (last_effort_share - start), list[_SearchLane]()
        for place, (_, family, origin) in enumerate(self._screen_families(starts, first_families, until)):
            rng = default_rng(SeedSequence(self.seed, spawn_key=(1, place)))
            lanes.append(_SearchLane(family, family, origin, rng, self._preceding_scores(family)))
        rounds = len(lanes).bit_length()
        start = self._effort_share()
        for number in range(rounds):
            # Each round has half as many lanes as the previous round, and twice its effort.
            end = start + (last_effort_share - start) * (2 ** (number + 1) - 1) / (2**rounds - 1)
            share = (end - self._effort_share()) / len(lanes)
            for lane in lanes:
                self._improve_lane(lane, self._effort_share() + share)
            lanes.sort(key=lambda lane: (lane.preceding_scores, lane.best_value), reverse=True)
            lanes = lanes[: max(1, len(lanes) // 2)]
            if self._is_enough(lanes[0]):
                break
        best = lanes[0]
        if isinstance(self.objective, LearningObjective):
            share = self._success_rate(best.best_family, self.objective, CLIMB.new_learners)
            return TrainedFamily(best.best_family, self.objective, share, best.origin)
        if best.best_value == -inf:  # the effort was spent before the family was judged
            best.best_value = value_of_scores(self._scores_on_new_seeds(best.best_family, BEST_SEEDS))
        return best

    def _result(self, found: TrainedFamily | _SearchLane, unsearched: float | None = None) -> CurriculumProgress:
        spent = min(1.0, self._effort_share())
        if isinstance(found, _SearchLane):
            return CurriculumProgress(found.best_family, found.best_value, spent, self.families_judged, found.origin)
        totals = [steps * len(found.family) for steps in found.objective.steps]
        alone = self._success_rate((self.levels.target,), found.objective.with_steps(max(totals)), CLIMB.new_learners)
        learnt = {"fewest": min(totals), "steps": max(totals), "alone": alone}
        if unsearched is not None:
            learnt["unsearched"] = unsearched
        return CurriculumProgress(found.family, found.success, spent, self.families_judged, found.origin, learnt)

    def _success_rate(self, family: Family, objective: LearningObjective, number_of_seeds: int) -> float:
        """Train `number_of_seeds` new learners; return the share that solves the target, 0 if a member has too many
        states.
        """
        self._steps_spent += max(CLIMB.level, objective.effort * len(family) * number_of_seeds)
        self.families_judged += 1
        try:
            return objective.success_rate(family, self._take_seeds(number_of_seeds))
        except (TooManyStates, NotCompiled):
            return 0.0

    @property
    def _sufficient_value(self) -> float:
        most = CLIMB.enough if isinstance(self.objective, LearningObjective) else self.objective.most
        return most if self.settings.enough is None else self.settings.enough

    def _is_enough(self, lane: _SearchLane) -> bool:
        """Return True if the lane's best family reached the wanted value and the maxima of all preceding measures."""
        most = (
            one.maximum(len(lane.best_family)) if isinstance(one, BoundedMeasure) else inf
            for one in self.preceding_measures
        )
        known = zip(lane.preceding_scores, most, strict=True)
        return lane.best_value >= self._sufficient_value and all(value >= bound - TOLERANCE for value, bound in known)

    def _preceding_scores(self, family: Sequence[ModelLevel]) -> tuple[float, ...]:
        """Return the scores of a family by the measures that take precedence over the objective, rounded."""
        return tuple(round(one.score(family), SCORE_DECIMALS) for one in self.preceding_measures)

    def _effort_share(self) -> float:
        """Return the share of the effort that is spent, from 0; it may exceed 1."""
        return (self._steps_spent + CLIMB.level * self.levels.tables_made) / self.settings.effort

    # --- screening

    def _screen_families(
        self,
        starts: FirstFamilySampler,
        first_families: Sequence[tuple[FamilyOrigin, Family]],
        last_effort_share: float,
    ) -> list[ScreenedFamily]:
        """Screen the families `first_families` and sampled ones, and return the best family for each lane, the best
        first.

        Sampling ends when the share `last_effort_share` of the effort is spent, or enough families are good.
        """
        settings, rng, pool = self.settings, self._rng, list[ScreenedFamily]()
        births = good = 0
        most_births = CLIMB.births + settings.effort // CLIMB.level
        while (
            births < len(first_families)
            or not pool
            or (self._effort_share() < last_effort_share and births < most_births)
        ):
            if good == CLIMB.enough_good * settings.lanes:
                break
            births += 1
            if not pool and births > CLIMB.births:
                raise InvalidArgument(self._nothing_found_message())
            best = sorted(pool, key=_screening_key, reverse=True)[: len(pool) // 4]
            learnt = bool(best) and rng.random() < 0.5
            origin = best[int(rng.integers(len(best)))][2] if learnt else starts.sample_origin(rng)
            family = starts.sample_family(origin, self._size, rng) if births > len(first_families) else None
            if births <= len(first_families):
                origin, family = first_families[births - 1]
            if family is None:
                self._steps_spent += CLIMB.level // 2
                continue
            before, most = self._preceding_scores(family), max((one[0][0] for one in pool), default=())
            value = value_of_scores(self._scores_on_new_seeds(family, SAMPLE_SEEDS)) if before >= most else -inf
            self._steps_spent += CLIMB.level if value == -inf else 0
            pool.append(((before, value), family, origin))
            good += value >= self._sufficient_value
            self.on_progress(CurriculumProgress(family, -inf, min(1.0, self._effort_share()), self.families_judged))
        pool.sort(key=_screening_key, reverse=True)
        pool, seeds = pool[: max(settings.lanes, len(pool) // 4)], SCREENING_SEEDS
        while len(pool) > settings.lanes:
            pool = [
                ((before, value_of_scores(self._scores_on_new_seeds(family, seeds))), family, origin)
                for (before, _), family, origin in pool
            ]
            pool.sort(key=_screening_key, reverse=True)
            pool, seeds = pool[: max(settings.lanes, len(pool) // 3)], 2 * seeds
        return pool

    def _nothing_found_message(self) -> str:
        reasons = self.levels.rejection_counts.most_common(1)
        why = f": {reasons[0][0]}, {reasons[0][1]} times" if reasons else ""
        demanded = self._least_diversity
        wanted = "" if demanded is None else f" with a diversity of {demanded:.3f}"
        return f"no valid family{wanted} was found in {CLIMB.births} attempts{why}"

    # --- climbing

    def _improve_lane(self, lane: _SearchLane, last_effort_share: float) -> None:
        while self._effort_share() < last_effort_share and not self._is_enough(lane):
            self._run_epoch(lane, last_effort_share)
            self.on_progress(
                CurriculumProgress(
                    lane.best_family, lane.best_value, min(1.0, self._effort_share()), self.families_judged
                )
            )

    def _run_epoch(self, lane: _SearchLane, last_effort_share: float) -> None:
        """Judge the lane's current family on new seeds, and try moves on it. A child that is not worse replaces it.

        The best family of the lane is updated first. If the current family is clearly worse, the best one replaces it.
        """
        lacking = 1.0 - min(1.0, max(0.0, lane.best_value))
        seeds = self._take_seeds(
            MOST_EPOCH_SEEDS if lacking * MOST_EPOCH_SEEDS <= 8 else max(FEWEST_EPOCH_SEEDS, int(8 / lacking))
        )
        scores = self._scores_on_seeds(lane.current_family, seeds)
        error = _mean_per_seed(scores).std() / sqrt(len(seeds))
        if lane.current_family is not lane.best_family or lane.best_value == -inf:
            before = self._preceding_scores(lane.current_family)
            if before > lane.preceding_scores:
                lane.best_family, lane.preceding_scores, lane.best_value = lane.current_family, before, -inf
            if value_of_scores(scores) >= lane.best_value - 0.5 * error:
                self._update_best(lane)
            elif value_of_scores(scores) < lane.best_value - 2 * error:
                lane.current_family = lane.best_family
                scores = self._scores_on_seeds(lane.current_family, seeds)
        now = self._preceding_scores(lane.current_family)
        for _ in range(CLIMB.moves):
            if self._effort_share() >= last_effort_share:
                return
            child = self._moves.sample_move(lane.current_family, lane.rng)
            before = () if child is None else self._preceding_scores(child)
            if child is None or before < now:
                self._steps_spent += CLIMB.level // 2
                continue
            found = (
                self._scores_on_seeds(child, seeds) if before > now else self._scores_unless_worse(child, seeds, scores)
            )
            if found is not None:
                lane.current_family, scores, now = child, found, before

    def _update_best(self, lane: _SearchLane) -> None:
        """Judge the lane's current family on new seeds, and make it the lane's best family if its value is larger."""
        scores = self._scores_on_new_seeds(lane.current_family, CANDIDATE_SEEDS)
        if value_of_scores(scores) > lane.best_value - 0.02:
            more = self._scores_on_new_seeds(lane.current_family, BEST_SEEDS - CANDIDATE_SEEDS)
            value = value_of_scores(np.concatenate([scores, more], axis=1))
            if value > lane.best_value:
                lane.best_family, lane.best_value = lane.current_family, value

    def _scores_unless_worse(self, family: Family, seeds: range, other_scores: Scores) -> Scores | None:
        """Return the scores of a family on `seeds`; None if they are worse than `other_scores`, those of another
        family.
        """
        found: list[Scores] = []
        behind = squares = 0.0
        self.families_judged += 1
        for first in range(0, len(seeds), CLIMB.block):
            block = seeds[first : first + CLIMB.block]
            scores = self._scores_on_seeds(family, block)
            found.append(scores)
            difference = _mean_per_seed(scores) - _mean_per_seed(other_scores[:, first : first + len(block)])
            behind += float(difference.sum())
            squares += float(difference @ difference)
            if behind < -sqrt(squares) - 0.6:
                return None
        scores = np.concatenate(found, axis=1)
        return scores if value_of_scores(scores) >= value_of_scores(other_scores) else None

    # --- judging

    def _scores_on_new_seeds(self, family: Sequence[ModelLevel], number_of_seeds: int) -> Scores:
        """Return the scores of a family on `number_of_seeds` new seeds, and count the family as tried."""
        self.families_judged += 1
        return self._scores_on_seeds(family, self._take_seeds(number_of_seeds))

    def _scores_on_seeds(self, family: Sequence[ModelLevel], seeds: range) -> Scores:
        self._steps_spent += max(CLIMB.level, self.objective.effort * len(family) * len(seeds))
        try:
            return self.objective.scores(family, seeds)
        except (TooManyStates, NotCompiled) as error:  # a member other than the target failed
            known = error.message if isinstance(error, TooManyStates) else f"a member cannot be compiled: {error}"
            self.levels.rejection_counts[known] += 1
            return np.full((1, len(seeds)), LOWEST_SCORE)

    def _take_seeds(self, count: int) -> range:
        """Return a range of `count` new seeds, or of a single new seed if the objective is deterministic."""
        first = self._next_seed
        self._next_seed += count if self.objective.drawn else 1
        return range(first, self._next_seed)


def _screening_key(one: ScreenedFamily) -> tuple[tuple[float, ...], float]:
    return one[0]


def _mean_per_seed(scores: Scores) -> NDArray[np.float64]:
    """Return the mean of the scores over the criteria, for each seed."""
    mean: NDArray[np.float64] = scores.mean(axis=0)
    return mean
