"""Views that join by the values of attributes: what agrees is looked up, in large models."""

from __future__ import annotations

import pytest

from envgraph.graph import Model
from envgraph.lang import from_text
from envgraph.match import FREE, ViewMatcher
from envgraph.metamodel import Attribute, Class, Metamodel, Reference, Scalar
from envgraph.pattern import Library, Pattern
from tests.oracle.naive._naive import NaiveMatcher

TOWN = Metamodel(
    "town",
    (
        Class(
            "Person",
            features=(
                Attribute("name", Scalar.STRING),
                Attribute("age", Scalar.INT),
                Reference("boss", "Person", 0, 1),
                Reference("flat", "Flat", 0, 1),
            ),
        ),
        Class("Flat", features=(Attribute("number", Scalar.INT),)),
    ),
)
NAME, AGE, NUMBER = TOWN.attributes
BOSS, FLAT = TOWN.references
PATTERNS = {
    "same": "pattern same(a : Person, b : Person) { Person.name(a, n); Person.name(b, n); a != b; }",
    "unique": "pattern unique(a : Person) { Person.name(a, n); 1 == count Person.name(_, n); }",
    "alone": """
        pattern other(a : Person, n : string) { Person(a); Person.name(b, n); a != b; }
        pattern alone(a : Person) { Person.name(a, n); neg find other(a, n); }
    """,
    "peer": "pattern peer(a : Person, b : Person) { Person.boss(a, b); Person.age(a, x); Person.age(b, x); }",
    "across": "pattern across(a : Person, f : Flat) { Person.age(a, n); Flat.number(f, n); }",
    "home": "pattern home(a : Person) { Person.age(a, n); Person.flat.number(a, n); }",
    "grown": "pattern grown(a : Person, b : Person) { Person.age(a, x); Person.age(b, y); check(x > y + 100); }",
}
BY_VALUE = {"same", "unique", "across"}
"""Those of which something would be looked for among all objects otherwise."""


def town(size: int) -> Model:
    """People with names, ages, bosses and flats of their own."""
    model = Model(TOWN)
    for number in range(size):
        model.create("Flat", number=number)
    flats = model.nodes("Flat")
    people = [model.create("Person", name=f"p{number}", age=number, flat=flats[-number]) for number in range(size)]
    for number in range(1, size):
        people[number].boss = people[number // 10]
    return model


def queries(name: str) -> Library:
    """One of the patterns, with what it calls."""
    found = Library(TOWN)
    found.add(*(each for each in from_text(PATTERNS[name], "query") if isinstance(each, Pattern)))
    return found


def value_views(views: ViewMatcher) -> list[str]:
    """Attributes whose values are a view."""
    assert views.watched_views.network is not None
    return [name.removesuffix("/values") for name in views.watched_views.network.operators if name.endswith("/values")]


@pytest.mark.parametrize("name", [name for name in PATTERNS if name != "grown"])
@pytest.mark.parametrize("size", [12, 150])
def test_matches_follow_changes_of_values(name: str, size: int) -> None:
    model, library = town(size), queries(name)
    views, naive = ViewMatcher(model, library), NaiveMatcher(model, library)
    views.watch(name)
    assert bool(value_views(views)) == (size > 100 and name in BY_VALUE)
    free = (FREE,) * len(library.parameter_types(name))
    people = list(model.graph.extent("Person"))
    savepoint = model.graph.history.savepoint()
    before = list(views.rows(name, free))
    changes = (
        lambda: model.graph.set_value(people[3], NAME, "p4"),
        lambda: model.graph.set_value(people[3], AGE, 4),
        lambda: model.graph.set_value(people[5], NAME, None),
        lambda: model.graph.set_value(people[5], AGE, None),
        lambda: model.graph.retype(people[6], "Flat", lossy=True),
        lambda: model.graph.set_value(people[3], NAME, "p3"),
        lambda: model.graph.delete(people[4], "spo"),
    )
    for number, change in enumerate(changes):
        change()
        if size < 100 or number in (1, 6):  # the naive matcher takes its time
            assert sorted(views.rows(name, free)) == naive.rows(name, free), number  # type: ignore[type-var]
    views.check_integrity()
    model.graph.history.rollback(savepoint)
    assert list(views.rows(name, free)) == before


def test_value_changes_visit_only_objects_with_that_value() -> None:
    model, library = town(400), queries("same")
    views = ViewMatcher(model, library)
    views.watch("same")
    assert value_views(views) == ["Person.name"]
    plan = str(views.explain("same", ()))
    assert "for     Person(" not in plan
    assert "(rows 1" in plan


def test_value_statistics_ignore_objects_of_other_classes() -> None:
    model = Model(TOWN)
    for _ in range(600):
        model.create("Flat")
    for number in range(150):
        model.create("Person", name=f"p{number}")
    views = ViewMatcher(model, queries("same"))
    views.watch("same")
    assert value_views(views) == ["Person.name"]


@pytest.mark.parametrize("name", ["peer", "home", "grown"])
def test_values_that_are_never_looked_up_have_no_view(name: str) -> None:
    views = ViewMatcher(town(150), queries(name))
    views.watch(name)
    assert value_views(views) == []


def test_unselective_values_have_no_view() -> None:
    model = town(150)
    for number, person in enumerate(model.graph.extent("Person")):
        model.graph.set_value(person, NAME, f"p{number % 3}")
    views = ViewMatcher(model, queries("same"))
    views.watch("same")
    assert value_views(views) == []
