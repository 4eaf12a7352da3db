"""First families of a search: the target, and states made from it by easing or taken from an optimal episode.

No rule defines what makes an environment easy. Regions of the model and rules are sampled, and the objective decides
which of the resulting families are good.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import accumulate

import numpy as np
from numpy.random import Generator
from numpy.typing import NDArray

from envgraph.code import dataclass
from envgraph.errors import InvalidArgument
from envgraph.pattern import Constant, Modification, RetypeAction, Rule, SetAction
from envgraph.rewrite import Row
from envgraph.search._run_store import Trace
from envgraph.search.curricula._curriculum_settings import BeginKind
from envgraph.search.curricula._family_moves import Family, FamilyMoves
from envgraph.search.curricula._model_levels import LevelFactory, ModelLevel
from envgraph.search.curricula._optimal_episodes import OptimalEpisode, optimal_episodes
from envgraph.search.problem._individual_measures import link_distances

_TracedState = tuple[Trace, float]
"""The trace from the target to a state, and the value of the state for the diversity; 0 if none is demanded."""


@dataclass(frozen=True, slots=True)
class Easing:
    """The way in which mutations ease a target.

    Attributes:
        near_effect: effect of the rules applied to objects that an optimal episode touches; None: these objects do
            not change.
        far_effect: effect of the rules applied to all other objects; None: these objects do not change.
    """

    near_effect: str | None
    far_effect: str | None


@dataclass(frozen=True, slots=True)
class FamilyOrigin:
    """The source of the members of a family.

    Attributes:
        episode: the optimal episode whose states are used. None: the target itself is used.
        easing: the way in which mutations ease these states, or the target. None: they are not eased.
    """

    episode: OptimalEpisode | None
    easing: Easing | None

    def __str__(self) -> str:
        if self.episode is None:
            return "the target, eased by mutations"
        return "states of an optimal episode" + (", eased by mutations" if self.easing else "")


@dataclass(frozen=True, slots=True)
class _TargetApplication:
    """A rule and a match of it in the target.

    Attributes:
        objects: ids of the matched objects.
    """

    rule: str
    row: Row
    objects: tuple[int, ...]


class FirstFamilySampler:
    """A sampler of first families that lead to a target.

    With "easing", the objects that an optimal episode or a shortest plan touches are near, all others are far. For near
    and far objects an effect is sampled, such as retyping to one class. All mutations with this effect are applied to
    the objects one after the other. The states from the target to the end are candidates, and earlier states are
    harder. The order is random, or leads toward or away from an object.

    With "episode", the candidates are the states of an optimal episode, and states near its end are easier (reverse
    curriculum generation, Florensa et al. 2017, with known episodes). The members are about equally spaced states.

    With "auto", families of both kinds are sampled, and also families of states of an optimal episode that are eased.

    If a state of an optimal episode violates a constraint, such as "the truck is on the start tile", the constraint
    is dropped for all members but the target; see `LevelFactory.drop_violated_constraints`.

    Args:
        levels: makes the members.
        moves: checks if members form a family.
        demanded: the least diversity of a family, or None.
        rng: samples the optimal episodes.
        begin: the source of the members: "easing", "episode" or "auto".

    Raises:
        InvalidArgument: `begin` is "episode", and no optimal episode is known.
    """

    def __init__(
        self,
        levels: LevelFactory,
        moves: FamilyMoves,
        demanded: float | None,
        rng: Generator,
        begin: BeginKind = "easing",
    ) -> None:
        self._levels, self._moves, self._least_diversity, self._begin = levels, moves, demanded, begin
        levels.check_out(levels.target.version)
        self._applications = self._applications_by_effect()
        self._links = _linked_objects(levels)
        self._optimal_episodes = optimal_episodes(levels, rng, needs_states=begin != "easing")
        known = (
            {} if begin == "easing" else {one.state_traces: one for one in self._optimal_episodes if one.state_traces}
        )
        self._episodes = list(known.values())
        self._levels_by_trace: dict[Trace, ModelLevel | None] = {}
        if begin == "episode" and not self._episodes:
            raise InvalidArgument(
                "no optimal episode of the target was found in which the agent succeeds",
                'check with `envgraph check` that the target has a `shortest_plan`, or write `begin = "easing"`',
            )
        for episode in self._episodes:
            levels.check_out(levels.target.version)
            for part in episode.state_traces:
                levels.try_apply_all(part)
                levels.drop_violated_constraints()
        levels.check_out(levels.target.version)

    def sample_origin(self, rng: Generator) -> FamilyOrigin:
        """Sample an origin that `begin` allows. With "auto" and known episodes the three kinds are equally probable."""
        episode = easing = None
        if self._episodes and (self._begin == "episode" or rng.random() < 2 / 3):
            episode = self._episodes[int(rng.integers(len(self._episodes)))]
        if episode is None or (self._begin == "auto" and rng.random() < 1 / 2):
            effects = [None, *self._applications]
            easing = Easing(*(effects[int(rng.integers(len(effects)))] for _ in range(2)))
        return FamilyOrigin(episode, easing)

    def reverse_curricula(self, size: int) -> Iterator[tuple[FamilyOrigin, Family]]:
        """Yield equally spaced states and the target as a family, for each optimal episode with enough valid states."""
        for episode in self._episodes:
            ways = list(accumulate(episode.state_traces))
            places = _evenly_spaced_places(len(ways), size - 1, np.full(size - 1, 0.5))
            family = self._family_of_traces([ways[place] for place in places]) if len(ways) >= size - 1 else None
            if family is not None:
                yield FamilyOrigin(episode, None), family

    def sample_family(self, origin: FamilyOrigin, size: int, rng: Generator) -> Family | None:
        """Sample a family of `size` members from an origin, the easiest first; None if the states form no family."""
        easing, wanted = origin.easing, size - 1
        parts: list[Trace] = []
        if easing is not None:
            parts = [((one.rule, one.row),) for one in self._sample_easing(easing, rng)]
        if origin.episode is not None and easing is not None:
            ways = list(accumulate(origin.episode.state_traces))
            if len(ways) < wanted:
                return None
            starts = [ways[place] for place in _evenly_spaced_places(len(ways), wanted, rng.random(wanted))]
            chosen = self._choose_one_of_each([self._states_after(start, parts) for start in starts], rng)
        else:
            states = parts if origin.episode is None else origin.episode.state_traces
            chosen = self._choose_states(self._states_after((), states)[1:], wanted, origin, rng)
        return None if chosen is None else self._family_of_traces(chosen)

    def _states_after(self, start: Trace, further_parts: Sequence[Trace]) -> list[_TracedState]:
        """Return the states reached from the target by the trace `start` and then by each part.

        Each state is the trace from the target, with its value for the diversity. If no diversity is demanded, this is
        0, and states may be invalid. Otherwise invalid states are left out. Parts that fail are skipped.
        """
        levels = self._levels
        levels.check_out(levels.target.version)
        levels.try_apply_all(start)
        steps: list[_TracedState] = []
        for part in ((), *further_parts):
            if levels.try_apply_all(part):
                start += part
                measures = levels.measure_or_count() if self._least_diversity is not None else None
                if measures is not None or self._least_diversity is None:
                    steps.append((start, 0.0 if measures is None else levels.diversity_value(measures)))
        return steps

    def _family_of_traces(self, traces: Sequence[Trace]) -> Family | None:
        """Return the levels of these traces and the target, the easiest first; None if they do not form a family."""
        levels, found = self._levels, [self._levels.target]
        for trace in traces:
            if trace not in self._levels_by_trace:
                levels.check_out(levels.target.version)
                self._levels_by_trace[trace] = levels.commit_if_member(trace) if levels.try_apply_all(trace) else None
            level = self._levels_by_trace[trace]
            if level is None:
                return None
            found.append(level)
        return tuple(reversed(found)) if self._moves.is_allowed(found) else None

    def _choose_states(
        self, states: Sequence[_TracedState], wanted: int, origin: FamilyOrigin, rng: Generator
    ) -> list[Trace] | None:
        """Return the traces of `wanted` states in their order; None if there are fewer states.

        The states maximise the diversity if one is demanded. Else states of an episode are about equally spaced, and
        others are random.
        """
        if len(states) < wanted:
            self._levels.rejection_counts[f"fewer than {wanted} states for members were reached from the target"] += 1
            return None
        order: list[int] = rng.permutation(len(states)).tolist()
        places, values = order[:wanted], [self._levels.diversity_value(self._levels.target.measures)]
        if self._least_diversity is not None:
            places = []
            for _ in range(wanted):
                places.append(self._add_most_diverse(states, [one for one in order if one not in places], values))
        elif origin.episode is not None:
            places = _evenly_spaced_places(len(states), wanted, rng.random(wanted))
        return [states[place][0] for place in sorted(places)]

    def _choose_one_of_each(
        self, state_sequences: Sequence[Sequence[_TracedState]], rng: Generator
    ) -> list[Trace] | None:
        """Return the trace of a random state of each sequence, or of the most diverse one if a diversity is demanded.

        Return None if a sequence is empty.
        """
        if not all(state_sequences):
            return None
        values, found = [self._levels.diversity_value(self._levels.target.measures)], dict[int, Trace]()
        for way in rng.permutation(len(state_sequences)).tolist():
            order: list[int] = rng.permutation(len(state_sequences[way])).tolist()
            place = (
                order[0]
                if self._least_diversity is None
                else self._add_most_diverse(state_sequences[way], order, values)
            )
            found[way] = state_sequences[way][place][0]
        return [found[way] for way in sorted(found)]

    def _add_most_diverse(self, states: Sequence[_TracedState], places: Sequence[int], values: list[float]) -> int:
        """Return the one of `places` whose value makes `values` the most diverse, and append this value to `values`."""
        score = self._levels.problem.diversity.score
        best = max(places, key=lambda place: round(score([*values, states[place][1]]), 12))
        values.append(states[best][1])
        return best

    # --- which rules are applied, and in which order

    def _applications_by_effect(self) -> dict[str, list[_TargetApplication]]:
        """Return all matches of mutation rules (not units) in the current model, grouped by the effect of the rule."""
        engine, found = self._levels.engine, dict[str, list[_TargetApplication]]()
        members = (member for name in self._levels.problem.mutations for member in engine.catalog.group(name))
        for name in dict.fromkeys(members):
            if name in engine.units:
                continue
            rows = [match.row for match in engine.matches(name, applicable=True)]
            for row in rows:
                objects = tuple(value for value in row if type(value) is int and engine.model.graph.alive(value))
                found.setdefault(_rule_effect(engine.definition(name)), []).append(
                    _TargetApplication(name, row, objects)
                )
        return found

    def _sample_easing(self, easing: Easing, rng: Generator) -> list[_TargetApplication]:
        """Sample the rule applications of an easing, in order. Some of those on far objects may be left out.

        The rules are sorted by blocks or mixed. Within a block they are sorted by distance from a sampled object, with
        noise.
        """
        touched = self._optimal_episodes[int(rng.integers(len(self._optimal_episodes)))].touched_objects
        near = dict.fromkeys(touched)
        objects = list(self._links)
        among = touched if touched and rng.random() < 0.7 else objects
        anchor = among[-1] if rng.random() < 0.5 else among[int(rng.integers(len(among)))]
        distance = link_distances(self._links, anchor)
        farthest = max(distance.values(), default=0) + 1
        toward, noise = (1 if rng.random() < 0.7 else -1), (0.2, 1.0, 1e9)[int(rng.integers(3))]
        share = 1.0 if rng.random() < 0.85 else rng.random()
        ranks: dict[str, float] = {}
        blocks = rng.random() < 0.5
        keyed: list[tuple[float, float, int, _TargetApplication]] = []
        for effect, inside in ((easing.near_effect, True), (easing.far_effect, False)):
            for one in self._applications[effect] if effect is not None else ():
                if any(each in near for each in one.objects) == inside and rng.random() < (1.0 if inside else share):
                    rank = ranks.setdefault(one.rule, rng.random()) if blocks else 0.0
                    steps = min((distance.get(each, farthest) for each in one.objects), default=farthest)
                    key = -toward * steps / farthest + noise * rng.random()
                    keyed.append((rank, key, len(keyed), one))
        return [one for *_, one in sorted(keyed, key=lambda entry: entry[:3])]


def _evenly_spaced_places(count: int, wanted: int, positions: NDArray[np.float64]) -> list[int]:
    """Return a place in each of `wanted` equal parts of `count` places. `positions` is the position in a part, 0 to
    1.
    """
    places: list[int] = ((np.arange(wanted) + positions) * count / max(1, wanted)).astype(int).tolist()
    return places


def _rule_effect(rule: object) -> str:
    """Return what a rule does, such as "retype Wall", if it only retypes or sets constants; else the rule's name."""
    assert isinstance(rule, Rule), "units have no matches"
    if isinstance(rule.right, Modification) and not rule.blocks and rule.right.actions:
        parts = []
        for action in rule.right.actions:
            match action:
                case RetypeAction(type=cls):
                    parts.append(f"retype {cls}")
                case SetAction(feature=feature, operator="=", value=Constant(value=value)):
                    parts.append(f"{feature} = {value!r}")
                case _:
                    return rule.qualified_name
        return ", ".join(sorted(parts))
    return rule.qualified_name


def _linked_objects(levels: LevelFactory) -> dict[int, list[int]]:
    """Return the ids of the linked objects for each object, in both directions. Containment references are ignored."""
    model, found = levels.engine.model, dict[int, list[int]]()
    for cls in model.metamodel.class_list:
        if not cls.abstract:
            found |= {node: [] for node in model.graph.exact_extent(cls.name)}
    for reference in model.metamodel.references:
        if model.metamodel.containment_link(reference, 0, 1) is None:
            for source in found:
                for target in model.graph.store.forward[reference.index][source]:
                    found[source].append(target)
                    found[target].append(source)
    return found
