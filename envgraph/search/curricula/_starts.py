"""Families to begin with: the target, and what becomes of it as it is eased step by step.

Nobody says what makes an environment easy: regions of the model and rules are drawn, and the objective tells which of
the families that come of it are good.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable, Sequence
from typing import Literal

import numpy as np
from numpy.random import Generator

from envgraph.code import dataclass
from envgraph.errors import InvalidArgument
from envgraph.pattern import Constant, Modification, Retype, Rule, Set
from envgraph.rewrite import Row
from envgraph.search._store import Trace
from envgraph.search.curricula._episodes import Episode, optimal_episodes
from envgraph.search.curricula._levels import Levels
from envgraph.search.curricula._moves import Family, Moves

Begin = Literal["easing", "episode"]
"""Where the members of families come from: the target is eased by mutations, or an optimal episode goes on from it."""


@dataclass(frozen=True, slots=True)
class Easing:
    """How a target was eased.

    Attributes:
        near: the effect that rules have on the objects of an optimal episode; None: they stay as they are.
        far: the same for all other objects.
    """

    near: str | None
    far: str | None


@dataclass(frozen=True, slots=True)
class _Application:
    """A rule at a match in the target.

    Attributes:
        objects: those of the match.
    """

    rule: str
    row: Row
    objects: tuple[int, ...]


class Starts:
    """Draws families that lead to a target.

    "easing": the objects of the target are near, if an optimal episode or a shortest plan touches them, or far. For
    either kind an effect is drawn: all the mutation rules with this effect, such as retyping to one class, are applied
    to them one after the other. The states on the way from the target to the end are the candidates, those that are
    met first the hardest. The order is random, or leads toward or away from some object.

    "episode": the candidates are the states of an optimal episode, those near its end the easiest (reverse curriculum
    generation, Florensa et al. 2017, with known episodes). Chosen are states that lie about equally far apart.

    Args:
        levels: of the members.
        moves: says what a family may be.
        size: members of a family, the target included.
        demanded: the least diversity of a family, or None.
        rng: draws the optimal episodes.
        begin: where members come from.

    Raises:
        InvalidArgument: members come from an optimal episode, and none is known.
    """

    def __init__(
        self,
        levels: Levels,
        moves: Moves,
        size: int,
        demanded: float | None,
        rng: Generator,
        begin: Begin = "easing",
    ) -> None:
        self._levels, self._moves, self._size, self._demanded = levels, moves, size, demanded
        levels.go_to(levels.target.version)
        self._applications = self._by_effect()
        self._links = _links(levels)
        self._from_episodes = begin == "episode"
        self._episodes = optimal_episodes(levels, rng, states=self._from_episodes)
        if self._from_episodes and not any(one.states for one in self._episodes):
            raise InvalidArgument(
                "no optimal episode of the target is known that ends in success",
                'see whether `envgraph check` finds a `shortest_plan` within the limit; `begin = "easing"` needs none',
            )
        levels.go_to(levels.target.version)

    def easing(self, rng: Generator) -> Easing | Episode:
        """Any of them, each as likely; or any of the optimal episodes."""
        if self._from_episodes:
            return self._episodes[int(rng.integers(len(self._episodes)))]
        effects = [None, *self._applications]
        near, far = (effects[int(rng.integers(len(effects)))] for _ in range(2))
        return Easing(near, far)

    def draw(self, easing: Easing | Episode, rng: Generator) -> Family | None:
        """A family from the most eased member to the target, or None if what was drawn gives none."""
        levels = self._levels
        if isinstance(easing, Episode):
            parts: Iterable[Trace] = easing.states
        else:
            parts = [((one.rule, one.row),) for one in self._drawn(easing, rng)]
        levels.go_to(levels.target.version)
        steps: list[tuple[Trace, float | None]] = []
        trace: Trace = ()
        for part in parts:
            if levels.replayed(part):
                trace += part
                measures = levels.measured() if self._demanded is not None else None
                if measures is not None or self._demanded is None:
                    steps.append((trace, None if measures is None else levels.value(measures)))
        chosen = self._chosen(steps, rng)
        return None if chosen is None else self._family(chosen)

    def _family(self, traces: Sequence[Trace]) -> Family | None:
        """The members that come of the target by traces, each of which continues the one before it."""
        levels, found, done = self._levels, [self._levels.target], 0
        levels.go_to(levels.target.version)
        for trace in traces:
            levels.replayed(trace[done:])
            level = levels.here(trace)
            if level is None:
                return None
            found.append(level)
            done = len(trace)
        return tuple(reversed(found)) if self._moves.allowed(found) else None

    def _chosen(self, steps: Sequence[tuple[Trace, float | None]], rng: Generator) -> list[Trace] | None:
        """Which states on the way are members: any, or those that together are the most diverse."""
        wanted = self._size - 1
        if len(steps) < wanted:
            return None
        order: list[int] = rng.permutation(len(steps)).tolist()
        if self._demanded is None:
            places = order[:wanted]
            if self._from_episodes:  # one from each of as many parts of the way
                places = ((np.arange(wanted) + rng.random(wanted)) * len(steps) / wanted).astype(int).tolist()
        else:
            places = self._diverse([value for _, value in steps if value is not None], order)
        return [steps[place][0] for place in sorted(places)]

    def _diverse(self, values: Sequence[float], order: Sequence[int]) -> list[int]:
        """Places of values that with the target's are as diverse as can be: each time the one that adds the most."""
        measure, found = self._levels.problem.diversity, [self._levels.value(self._levels.target.measures)]
        places: list[int] = []
        for _ in range(self._size - 1):
            free = (place for place in order if place not in places)
            best = max(free, key=lambda place: round(measure.score([*found, values[place]]), 12))
            places.append(best)
            found.append(values[best])
        return places

    # --- what is applied, and in which order

    def _by_effect(self) -> dict[str, list[_Application]]:
        """The applications of mutation rules in the present model, by their effect."""
        engine, found = self._levels.engine, dict[str, list[_Application]]()
        members = (member for name in self._levels.problem.mutations for member in engine.catalog.group(name))
        for name in dict.fromkeys(members):
            if name in engine.units:
                continue
            rows = [match.row for match in engine.matches(name, applicable=True)]
            for row in rows:
                objects = tuple(value for value in row if type(value) is int and engine.model.alive(value))
                found.setdefault(_effect(engine.definition(name)), []).append(
                    _Application(name, row, objects)
                )
        return found

    def _drawn(self, easing: Easing, rng: Generator) -> list[_Application]:
        """What is applied, in its order: rules by blocks or mixed, and in each block by distance from an object."""
        touched = self._episodes[int(rng.integers(len(self._episodes)))].touched
        near = dict.fromkeys(touched)
        objects = list(self._links)
        among = touched if touched and rng.random() < 0.7 else objects
        anchor = among[-1] if rng.random() < 0.5 else among[int(rng.integers(len(among)))]
        distance = _distances(self._links, anchor)
        farthest = max(distance.values(), default=0) + 1
        toward, noise = (1 if rng.random() < 0.7 else -1), (0.2, 1.0, 1e9)[int(rng.integers(3))]
        share = 1.0 if rng.random() < 0.85 else rng.random()
        ranks: dict[str, float] = {}
        blocks = rng.random() < 0.5
        keyed: list[tuple[float, float, int, _Application]] = []
        for effect, inside in ((easing.near, True), (easing.far, False)):
            for one in self._applications[effect] if effect is not None else ():
                if any(each in near for each in one.objects) == inside and rng.random() < (
                    1.0 if inside else share
                ):
                    rank = ranks.setdefault(one.rule, rng.random()) if blocks else 0.0
                    steps = min((distance.get(each, farthest) for each in one.objects), default=farthest)
                    key = -toward * steps / farthest + noise * rng.random()
                    keyed.append((rank, key, len(keyed), one))
        return [one for *_, one in sorted(keyed, key=lambda entry: entry[:3])]


def _effect(rule: object) -> str:
    """What a rule does, if that is to retype or to set to a constant; else its name: no other does the same."""
    assert isinstance(rule, Rule), "units have no matches"
    if isinstance(rule.right, Modification) and not rule.blocks and rule.right.actions:
        parts = []
        for action in rule.right.actions:
            match action:
                case Retype(type=cls):
                    parts.append(f"retype {cls}")
                case Set(feature=feature, operator="=", value=Constant(value=value)):
                    parts.append(f"{feature} = {value!r}")
                case _:
                    return rule.qualified_name
        return ", ".join(sorted(parts))
    return rule.qualified_name


def _links(levels: Levels) -> dict[int, list[int]]:
    """Of each object those that it is linked with, containers and what they contain aside."""
    model, found = levels.engine.model, dict[int, list[int]]()
    for cls in model.metamodel.class_list:
        if not cls.abstract:
            found |= {node: [] for node in model.exact_extent(cls.name)}
    references = model.metamodel.references
    contained = {(one.target, one.opposite) for one in references if one.containment}
    for reference in references:
        if not reference.containment and (reference.owner, reference.name) not in contained:
            for source in found:
                for target in model.store.forward[reference.index][source]:
                    found[source].append(target)
                    found[target].append(source)
    return found


def _distances(links: dict[int, list[int]], start: int) -> dict[int, int]:
    """Steps from an object to those that can be reached, by breadth-first search."""
    found, waiting = {start: 0}, deque([start])
    while waiting:
        node = waiting.popleft()
        for other in links[node]:
            if other not in found:
                found[other] = found[node] + 1
                waiting.append(other)
    return found
