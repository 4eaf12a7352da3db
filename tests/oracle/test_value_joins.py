"""Patterns that compare computed values, after random edits and rollbacks: all matchers agree, and orders stay."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from unittest.mock import patch

from hypothesis import given, settings, strategies as st

from envgraph.graph import Model
from envgraph.match import FREE, CompiledMatcher, ViewMatcher
from envgraph.match.generate import _translation
from envgraph.metamodel import Attribute, Class, EnumType, Metamodel, Reference, Scalar, Value
from envgraph.pattern import (
    Binary,
    Check,
    Constant,
    Constraint,
    Expression,
    FunctionCall,
    Library,
    Pattern,
)
from tests.oracle.naive._naive import NaiveMatcher
from tests.oracle.worlds import Dice, edit
from tests.profile import examples
from tests.unit.match.writing import check, equal, find, fold, is_a, neg, op, path, pattern, v, value

COLOUR = EnumType("Colour", ("red", "green"))
WORLD = Metamodel(
    "world",
    (
        Class(
            "P",
            features=(
                Attribute("i", Scalar.INT),
                Attribute("f", Scalar.FLOAT),
                Attribute("s", Scalar.STRING),
                Attribute("b", Scalar.BOOL),
                Attribute("c", COLOUR),
                Attribute("many", Scalar.INT, 0, None),
                Reference("up", "P", 0, 1),
                Reference("next", "P", 0, None),
            ),
        ),
        Class("Q", supertypes=("P",)),
    ),
    (COLOUR,),
)
NUMBERS: dict[str, tuple[Value, ...]] = {
    "i": (0, 1, 2, 3, 5, 2**62, -(2**63)),
    "f": (0.0, -0.0, 0.5, 1.0, 2.0, 4.611686018427388e18),
}


def side(dice: Dice, name: str) -> Expression:
    """An expression over one variable that is a number; it may fail, and leave 64 bits."""
    own: Expression = v(name)
    match dice.number(0, 9):
        case 0 | 1 | 2:
            return own
        case 3:
            return Binary(dice.one(["/", "%"]), Constant(dice.one([2, 7.0])), own)
        case 4:
            return Binary("*", own, own)
        case 5:
            return FunctionCall("abs", (own,))
        case _:
            return Binary(dice.one("+-*/"), own, Constant(dice.one([1, 2, 0.5])))


def related(dice: Dice, near: str, far: str) -> Iterator[Constraint]:
    """One or two comparisons of values of two objects, and what they read."""
    if dice.chance(15):  # strings, truth values and enum values
        feature = dice.one(["s", "c", "b"])
        yield path(f"P.{feature}", near, f"{near}0")
        yield path(f"P.{feature}", far, f"{far}0")
        whole = FunctionCall("toString", (v(f"{far}0"),))
        yield Check(Binary(dice.one(["==", "<", ">="]), FunctionCall("toString", (v(f"{near}0"),)), whole))
        return
    names = {}
    for each in (near, far):
        names[each] = f"{each}1"
        if dice.chance(20):
            yield path("P.up", each, f"{each}2")
            yield path(f"P.{dice.one('if')}", f"{each}2", f"{each}1")
        elif dice.chance(20):
            yield path("P.next", each, f"{each}2")
            yield path(f"P.{dice.one('if')}", f"{each}2", f"{each}1")
        else:
            yield path(f"P.{dice.one(['i', 'i', 'f', 'many'])}", each, f"{each}1")
    if dice.chance(20):
        yield equal("w", value(Binary("+", FunctionCall("toFloat", (v(names[near]),)), Constant(1))))
        yield equal("w", value(Binary("*", v(names[far]), Constant(2.0))))
        return
    if dice.chance(15):
        yield path("P.up", near, "g")
        yield path("P.up", far, "g")
    for _ in range(dice.number(1, 2)):
        operator = dice.one(["==", "==", "<", "<=", ">", ">="])
        left, right = side(dice, names[near]), side(dice, names[far])
        yield Check(Binary(operator, *((left, right) if dice.chance(50) else (right, left))))
    if dice.chance(20):
        yield Check(Binary(dice.one(["<", "!="]), v(names[far]), Constant(2)))


def patterns(dice: Dice) -> list[Pattern]:
    """A comparison of two objects; and patterns that ask for one, none, a number or a sum of such objects."""
    typed = dice.one(["P", "Q"])
    pair = pattern(f"pair(a : P, b : {typed})", list(related(dice, "a", "b")))
    return [
        pair,
        pattern("none(a : P)", [neg(find("pair", "a", "_"))]),
        pattern("nobody(b : P)", [neg(find("pair", "_", "b"))]),
        pattern("number(a : P, n : int)", [equal("n", fold("count", find("pair", "a", "_")))]),
        pattern("some(a : P)", [find("pair", "a", "b"), path("P.next", "b", "c"), find("pair", "c", "_")]),
        pattern(
            "itself(a : P, b : P)",  # a number of itself is compared for each pair
            [
                path("P.i", "a", "n"),
                is_a("P", "b"),
                path("P.i", "b", "m"),
                check("m", "<", "n"),
                equal("n", fold("count", path("P.many", "b", "n"))),
            ],
        ),
        pattern("bucket(k : int, a : P)", [path("P.i", "a", "x"), equal("k", value(op("x", "/", 2)))]),
        pattern(
            "buckets(k : int, n : int)",
            [find("bucket", "k", "_"), equal("n", fold("count", find("bucket", "k", "_")))],
        ),
    ]


def library_of(dice: Dice) -> Library:
    """The patterns, in a library."""
    library = Library(WORLD)
    library.add(*patterns(dice))
    return library


def random_objects_with_values(dice: Dice) -> Model:
    """Some objects with values, more than questions that are answered without an index."""
    model = Model(WORLD)
    for _ in range(dice.number(3, 12)):
        node = model.graph.new(dice.one(["P", "P", "Q"]))
        change(dice, model, node)
    for _ in range(8):
        edit(dice, model)
    return model


def change(dice: Dice, model: Model, node: int) -> None:
    """Other numbers of an object."""
    for name, values in NUMBERS.items():
        if dice.chance(70):
            model.graph.set_value(node, model.metamodel.feature("P", name), dice.one([*values, None]))  # type: ignore[arg-type]


def edit_or_roll_back(dice: Dice, model: Model) -> None:
    """Random changes, sometimes rolled back."""
    savepoint = model.graph.history.savepoint() if dice.chance(30) else None
    for _ in range(dice.number(1, 3)):
        nodes = list(model.graph.extent("P"))
        if nodes and dice.chance(60):
            change(dice, model, dice.one(nodes))
        else:
            edit(dice, model)
    if savepoint is not None:
        (model.graph.history.rollback if dice.chance(60) else model.graph.history.release)(savepoint)


@contextmanager
def without_indexes() -> Iterator[None]:
    """Functions that are generated in the block compare row by row."""
    with patch.object(_translation, "value_join", lambda *_: None):
        yield


def ask_all(dice: Dice, model: Model, library: Library) -> None:
    """Hold the matchers against each other between changes."""
    naive, compiled, plain = (kind(model, library) for kind in (NaiveMatcher, CompiledMatcher, CompiledMatcher))
    names = {each.qualified_name: len(each.parameters) for each in library.patterns}
    for _ in range(5):
        for name, width in names.items():
            free = (FREE,) * width
            rows = compiled.rows(name, free)
            assert sorted(rows) == sorted(naive.rows(name, free)), name
            with without_indexes():
                assert rows == plain.rows(name, free), f"{name}: another order"
            assert compiled.count(name, free) == len(rows)
            for row in rows[:4]:
                given = tuple(each if dice.chance(50) else FREE for each in row)
                with without_indexes():
                    expected = plain.rows(name, given)
                assert compiled.rows(name, given) == expected
                assert compiled.first(name, given) == expected[0]
                assert compiled.count(name, given) == len(expected)
                assert compiled.exists(name, given)
        edit_or_roll_back(dice, model)


@settings(max_examples=examples(30))
@given(st.integers(0, 2**48))
def test_matchers_agree_on_comparisons_of_computed_values(seed: int) -> None:
    dice = Dice(seed)
    ask_all(dice, random_objects_with_values(dice), library_of(dice))


@settings(max_examples=examples(30))
@given(st.integers(0, 2**48))
def test_views_agree_on_comparisons_of_computed_values(seed: int) -> None:
    dice = Dice(seed)
    model, library = random_objects_with_values(dice), library_of(dice)
    naive, views = NaiveMatcher(model, library), ViewMatcher(model, library)
    names = {each.qualified_name: len(each.parameters) for each in library.patterns}
    views.watch(*names)
    for _ in range(6):
        for name, width in names.items():
            assert sorted(views.rows(name, (FREE,) * width)) == sorted(naive.rows(name, (FREE,) * width)), name
        views.check_integrity()
        before = {name: list(views.rows(name, (FREE,) * width)) for name, width in names.items()}
        savepoint = model.graph.history.savepoint()
        edit_or_roll_back(dice, model)
        views.rows("pair", (FREE, FREE))
        model.graph.history.rollback(savepoint)
        assert before == {name: list(views.rows(name, (FREE,) * width)) for name, width in names.items()}
        edit_or_roll_back(dice, model)
