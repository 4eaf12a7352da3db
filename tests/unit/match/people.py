"""A small world for tests of single constructs: people and teams."""

from __future__ import annotations

from envgraph.graph import Model
from envgraph.match import FREE
from envgraph.metamodel import Attribute, Class, EnumType, Metamodel, Reference, Scalar
from envgraph.pattern import Library, ObjectType, Pattern
from tests.unit.match.kinds import Kind

MOOD = EnumType("Mood", ("calm", "cross"))

METAMODEL = Metamodel(
    "people",
    (
        Class(
            "Person",
            features=(
                Attribute("age", Scalar.INT),
                Attribute("pay", Scalar.FLOAT),
                Attribute("mood", MOOD),
                Reference("knows", "Person", 0, None),
                Reference("boss", "Person", 0, 1, opposite="staff"),
                Reference("staff", "Person", 0, None, opposite="boss"),
            ),
        ),
        Class("Chief", supertypes=("Person",)),
        Class(
            "Team",
            features=(
                Reference("members", "Person", 0, None, containment=True),
                Reference("lead", "Person", 0, 1),
            ),
        ),
        Class("Ghost"),
    ),
    (MOOD,),
)


class World:
    """A model whose objects are known by name, and a matcher over some patterns.

    Ada (a Chief) is the boss of Bob and Cyd, Bob is the boss of Dan. Ada knows Bob, Bob knows Cyd, Cyd knows Ada,
    Dan knows himself.
    """

    def __init__(self, kind: Kind, *patterns: Pattern) -> None:
        self.model = model = Model(METAMODEL)
        self.library = Library(METAMODEL)
        self.library.add(*patterns)
        self.matcher = kind(model, self.library)
        ada = model.create("Chief", object_name="ada", age=50, pay=9.5, mood="cross")
        bob = model.create("Person", object_name="bob", age=30, pay=4.0, boss=ada, knows=[])
        cyd = model.create("Person", object_name="cyd", age=30, pay=5.0, boss=ada, knows=[ada])
        dan = model.create("Person", object_name="dan", age=20, pay=4.0, boss=bob)
        ada.knows.append(bob)
        bob.knows.append(cyd)
        dan.knows.append(dan)
        model.create("Team", object_name="red", members=[ada, bob], lead=ada)
        model.create("Team", object_name="blue", members=[cyd])

    def id(self, name: str) -> int:
        """The object with a name."""
        return self.model[name].id

    def rows(self, pattern: str, *arguments: object) -> set[tuple[object, ...]]:
        """Matches with names for objects; arguments likewise, `...` for a free one, none at all for all free."""
        types = self.library.parameter_types(pattern)
        given = arguments or (...,) * len(types)
        found = self.matcher.rows(pattern, self.arguments(pattern, *given))
        assert len(set(found)) == len(found)
        return {
            tuple(
                self.model.graph.object_name(v) if isinstance(t, ObjectType) else v  # type: ignore[arg-type]
                for v, t in zip(row, types, strict=True)
            )
            for row in found
        }

    def arguments(self, pattern: str, *given: object) -> tuple[object, ...]:
        """Arguments for a matcher."""
        types = self.library.parameter_types(pattern)
        return tuple(
            FREE if value is ... else self.id(str(value)) if isinstance(type_, ObjectType) else value
            for value, type_ in zip(given, types, strict=True)
        )
