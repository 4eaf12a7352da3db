"""Programs to be divided into classes, of the sizes of the Transformation Tool Contest 2016; and an annealer by hand.

The contest's inputs are of no licence that would let them be kept here. `problem` draws programs of the same numbers of
methods, attributes and dependencies, in groups: most dependencies stay in their group.
"""

from __future__ import annotations

from collections import defaultdict
from math import exp
from random import Random
from typing import NamedTuple

from envgraph.graph import Model


class Size(NamedTuple):
    """How many there are of each, and the CRA index that the authors of the case published with their inputs.

    Counted in the inputs of the contest; the indices are those of MOMoT in the README of
    https://github.com/martin-fleck/cra-ttc2016 (A to C with their later solutions).
    """

    methods: int
    attributes: int
    data: int
    functional: int
    published: float


SIZES = {
    "A": Size(4, 5, 7, 6, 3.0),
    "B": Size(8, 10, 15, 14, 3.083),
    "C": Size(15, 20, 50, 48, -3.79),
    "D": Size(40, 40, 147, 148, -23.6338),
    "E": Size(80, 80, 298, 297, -69.6555),
}


class Program(NamedTuple):
    """Features by number, the methods first; what each method depends on."""

    methods: int
    attributes: int
    data: frozenset[tuple[int, int]]
    functional: frozenset[tuple[int, int]]


def problem(size: Size, seed: int = 1) -> Program:
    """A random program of a size, in groups of about eight features."""
    rng = Random(seed)
    count = size.methods + size.attributes
    group = [rng.randrange(max(2, count // 8)) for _ in range(count)]

    def links(wanted: int, targets: range) -> frozenset[tuple[int, int]]:
        found = dict[tuple[int, int], None]()
        while len(found) < wanted:
            method, other = rng.randrange(size.methods), rng.choice(targets)
            if method != other and (group[method] == group[other] or rng.random() < 0.25 / max(group)):
                found[method, other] = None
        return frozenset(found)

    return Program(
        size.methods,
        size.attributes,
        links(size.data, range(size.methods, count)),
        links(size.functional, range(size.methods)),
    )


def fill(model: Model, program: Program) -> None:
    """Put a program into an empty model of the bundled domain."""
    root = model.create("ClassModel", name="program")
    kinds = ["Method"] * program.methods + ["Attribute"] * program.attributes
    features = [model.create(kind, name=f"f{number}") for number, kind in enumerate(kinds)]
    for feature in features:
        root.features.append(feature)
    for method, attribute in sorted(program.data):
        features[method].dataDependency.append(features[attribute])
    for caller, callee in sorted(program.functional):
        features[caller].functionalDependency.append(features[callee])


class ByHand:
    """The same annealing in plain Python: the moves of `rules/assignment`, by their weights, and an index that follows.

    For each class the weighted dependencies of its methods are kept, inside of it and in all. A move takes the terms of
    the dependencies that it touches out, and puts them in again: those of the feature, and those on the other
    features of both classes, whose weight changes. Undoing is the move back.
    """

    def __init__(self, program: Program, seed: int) -> None:
        self.rng = Random(seed)
        self.methods = program.methods
        count = program.methods + program.attributes
        self.uses: list[list[int]] = [[] for _ in range(count)]
        self.users: list[list[int]] = [[] for _ in range(count)]
        for method, other in sorted(program.data | program.functional):
            self.uses[method].append(other)
            self.users[other].append(method)
        self.ties = [
            pair
            for method, others in enumerate(self.uses)
            for other in others
            for pair in ((method, other), (other, method))
        ]
        self.of = [-1] * count
        self.members: dict[int, set[int]] = {}
        self.sizes: dict[int, list[int]] = {}
        self.next = 0
        self.inside: defaultdict[int, float] = defaultdict(float)
        self.total: defaultdict[int, float] = defaultdict(float)
        self.index = 0.0
        for feature in range(count):  # the two rules that begin, by their weights
            classes = list(self.members)
            new = not classes or self.rng.random() < 2 / 3
            self.put(feature, self.fresh() if new else self.rng.choice(classes))
        self.index = self.computed()

    def fresh(self) -> int:
        self.next += 1
        self.members[self.next], self.sizes[self.next] = set(), [0, 0]
        return self.next

    def put(self, feature: int, cls: int) -> None:
        self.of[feature] = cls
        self.members[cls].add(feature)
        self.sizes[cls][feature >= self.methods] += 1

    def weight(self, feature: int) -> float:
        """What a dependency on a feature counts."""
        methods, attributes = self.sizes[self.of[feature]]
        if feature >= self.methods:
            return 1.0 / attributes
        return 1.0 / (methods - 1) if methods > 1 else 0.0

    def computed(self) -> float:
        """The index, and what is kept for it, anew."""
        self.inside.clear()
        self.total.clear()
        for method in range(self.methods):
            own = self.of[method]
            for other in self.uses[method]:
                weight = self.weight(other)
                self.total[own] += weight
                if self.of[other] == own:
                    self.inside[own] += weight
        return sum(map(self.ratio, self.members))

    def ratio(self, cls: int) -> float:
        methods = self.sizes[cls][0]
        return (2 * self.inside[cls] - self.total[cls]) / methods if methods else 0.0

    def move(self, feature: int, to: int) -> None:
        """Move a feature, and let the index follow."""
        of, users, members, before = self.of, self.users, self.members, self.of[feature]
        kind = feature >= self.methods
        alike = [one for cls in (before, to) for one in members[cls] if (one >= self.methods) == kind]
        if to != before and feature not in alike:
            alike.append(feature)
        touched = {before, to}
        touched.update(of[user] for one in alike for user in users[one])
        self.index -= sum(map(self.ratio, touched))
        self.change(alike, feature, -1.0)
        members[before].discard(feature)
        self.sizes[before][kind] -= 1
        self.put(feature, to)
        self.change(alike, feature, 1.0)
        self.index += sum(map(self.ratio, touched))
        if not members[before]:
            del members[before], self.sizes[before]
            self.inside.pop(before, None)
            self.total.pop(before, None)

    def change(self, alike: list[int], feature: int, sign: float) -> None:
        """Add or take out the terms of dependencies on some features, and of one feature."""
        of, inside, total = self.of, self.inside, self.total
        for one in alike:
            cls, weight = of[one], sign * self.weight(one)
            for user in self.users[one]:
                if user != feature:
                    total[of[user]] += weight
                    if of[user] == cls:
                        inside[cls] += weight
        own = of[feature]
        for one in self.uses[feature]:
            weight = sign * self.weight(one)
            total[own] += weight
            if of[one] == own:
                inside[own] += weight

    def drawn(self) -> tuple[list[int], int, int]:
        """A move that can be made: the features, from which class, to which; as if it were drawn among all matches."""
        rng, members = self.rng, self.members
        while True:
            drawn = rng.random() * 11
            if drawn < 6:
                feature, other = rng.choice(self.ties)
                source, to = self.of[feature], self.of[other]
                if source != to and len(members[source]) > 1:
                    return [feature], source, to
            elif drawn < 10:
                feature = rng.randrange(len(self.of))
                source = self.of[feature]
                if len(members[source]) > 1:
                    return [feature], source, self.fresh()
            elif len(members) > 1:
                to, source = rng.sample(list(members), 2)
                return list(members[source]), source, to

    def step(self, temperature: float) -> bool:
        """Try a move; whether it was kept."""
        members, before = self.members, self.index
        moved, source, to = self.drawn()
        for feature in moved:
            self.move(feature, to)
        worse = before - self.index
        if worse <= 0 or self.rng.random() < exp(-worse / temperature):
            return True
        if source not in members:
            members[source], self.sizes[source] = set(), [0, 0]
        for feature in moved:
            self.move(feature, source)
        self.index = before
        return False
