"""Attributes with many values: what may be written, who hears of it, and what takes it back."""

from __future__ import annotations

import json
from collections.abc import Callable

import pytest

from envgraph.errors import EnvgraphError, InvalidArgument, RuleError, TypeMismatch
from envgraph.graph import (
    IsomorphismClasses,
    Model,
    ValueList,
    check_conformance,
    from_networkx,
    model_from_json,
    model_to_json,
    to_networkx,
)
from envgraph.metamodel import Attribute, Class, EnumType, Metamodel, Scalar
from tests.facts import Notified, ValueFact

GENRE = EnumType("Genre", ("novel", "poem"))
TAGS = Attribute("tags", Scalar.STRING, lower=0, upper=None)
MARKS = Attribute("marks", Scalar.FLOAT, lower=0, upper=None, unique=False)
GENRES = Attribute("genres", GENRE, lower=1, upper=2)
LIBRARY = Metamodel("library", [Class("Book", features=(TAGS, MARKS, GENRES)), Class("Shelf")], [GENRE])
tags, marks, genres = LIBRARY.attributes


@pytest.fixture
def model() -> Model:
    return Model(LIBRARY)


def test_multi_valued_attributes_are_live_lists(model: Model) -> None:
    book = model.create("Book", tags=["a", "b"], marks=(1, 1.0, 2.5), genres=["novel"])
    assert isinstance(book.tags, ValueList)
    assert (book.tags, book.marks, list(book.genres)) == (["a", "b"], [1.0, 1.0, 2.5], ["novel"])
    book.tags.append("c")
    book.tags.append("a")  # it is there
    book.tags.insert(0, "z")
    book.tags.remove("b")
    assert book.tags == ("z", "a", "c") and book.tags[-1] == "c" and book.tags[:2] == ["z", "a"]
    book.tags += ["d"]
    book.tags[0] = "y"
    del book.tags[1]
    book.tags.reverse()
    book.tags.reverse()
    assert repr(book.tags) == "['y', 'c', 'd']" and "d" in book.tags and len(book.tags) == 3
    book.tags.reverse()
    assert book.tags == ["d", "c", "y"]
    book.marks.append(1)
    assert book.marks == [1.0, 1.0, 2.5, 1.0]
    book.marks = []
    assert not book.marks and model.graph.value(book.id, marks) == () and model.graph.values(book.id, tags)
    model.check_integrity()


@pytest.mark.parametrize(
    ("change", "error", "message"),
    [
        (lambda book: setattr(book, "tags", "abc"), TypeMismatch, "takes several values: write a list"),
        (lambda book: setattr(book, "tags", 3), TypeMismatch, "takes several values: write a list"),
        (lambda book: setattr(book, "tags", ["a", 1]), TypeMismatch, "`Book.tags` takes string, not 1"),
        (lambda book: setattr(book, "tags", ["a", "a"]), InvalidArgument, "'a' is given twice"),
        (lambda book: book.marks.append(float("nan")), TypeMismatch, "takes float, not nan"),
        (lambda book: book.genres.append("poet"), TypeMismatch, "did you mean `poem`"),
        (lambda book: setattr(book, "marks", [2**70, None]), TypeMismatch, "takes float, not None"),
    ],
)
def test_refused_values_change_nothing(
    model: Model, change: Callable[..., object], error: type[EnvgraphError], message: str
) -> None:
    book = model.create("Book", tags=["x"])
    before = model_to_json(model)
    with pytest.raises(error, match=message):
        change(book)
    assert model_to_json(model) == before


def test_upper_bounds_are_enforced_and_lower_bounds_are_conformance(model: Model) -> None:
    book = model.create("Book")
    assert [str(one) for one in check_conformance(model)] == ["`Book#0` has no value of `genres`, which needs 1..2"]
    book.genres = ["poem", "novel"]
    assert not check_conformance(model)
    narrow = Metamodel("m", [Class("A", features=(Attribute("n", Scalar.INT, lower=0, upper=2),))])
    with pytest.raises(RuleError, match=r"would have 3 of at most 2 values of `n`") as caught:
        Model(narrow).create("A", n=[1, 2, 3])
    assert caught.value.reason == "full"


class _Ear:
    def __init__(self) -> None:
        self.heard: list[tuple[str, object]] = []

    def inserted(self, fact: object) -> None:
        self.heard += [("+", fact[2])] if isinstance(fact, ValueFact) else []

    def removing(self, fact: object) -> None:
        self.heard += [("-", fact[2])] if isinstance(fact, ValueFact) else []

    def restored(self) -> None:
        self.heard.append(("restored", None))


def test_listeners_are_notified_of_each_inserted_and_deleted_value(model: Model) -> None:
    book = model.create("Book", tags=["a", "b"], marks=[1.0])
    ear = _Ear()
    Notified(model, ear)
    book.tags = ["b", "c"]
    assert ear.heard == [("-", "a"), ("+", "c")]
    book.marks = [1.0, 1.0]  # no other value
    book.tags = ["c", "b"]
    assert len(ear.heard) == 2
    book.delete()
    assert ear.heard[2:] == [("-", "b"), ("-", "c"), ("-", 1.0)]


def test_rollback_and_versions_restore_order_and_duplicates(model: Model) -> None:
    book = model.create("Book", tags=["a", "b"], marks=[1.0, 2.0, 1.0])
    version = model.commit()
    before = model_to_json(model)
    savepoint = model.graph.history.savepoint()
    book.tags = ["b", "a", "c"]
    book.marks.remove(1.0)
    assert book.marks == [2.0, 1.0]
    model.check_integrity()
    model.graph.history.rollback(savepoint)
    assert model_to_json(model) == before
    model.check_integrity()
    book.tags.clear()
    model.graph.retype(book.id, "Shelf")
    model.check_integrity()
    model.checkout(version, discard=True)
    assert model_to_json(model) == before
    model.check_integrity()


def test_hashes_ignore_the_order_of_values_but_not_duplicates(model: Model) -> None:
    def hashes(**features: object) -> tuple[int, int, int]:
        one = Model(LIBRARY)
        one.create("Book", **features)
        return one.state_hash(), one.canonical_hash(), shapes.class_number(one.graph.store)

    shapes = IsomorphismClasses()
    assert hashes(tags=["a", "b"]) == hashes(tags=["b", "a"])
    assert hashes(marks=[1, 2, 2]) == hashes(marks=[2, 1, 2])
    different = [hashes(), hashes(tags=["a"]), hashes(marks=[1, 2]), hashes(marks=[1, 2, 2])]
    assert all(len(set(column)) == 4 for column in zip(*different, strict=True))


def test_json_and_networkx_keep_lists(model: Model) -> None:
    model.create("Book", tags=["b", "a"], marks=[1, float("inf"), 1], genres=["poem"])
    model.create("Book")
    text = json.dumps(model_to_json(model))
    assert '"tags": ["b", "a"], "marks": [1.0, "inf", 1.0], "genres": ["poem"]' in text
    for again in (model_from_json(text, LIBRARY), from_networkx(to_networkx(model), LIBRARY), model.copy()):
        assert model_to_json(again) == model_to_json(model)


@pytest.mark.parametrize(
    ("features", "message"),
    [
        ({"tags": ["a", 3]}, r"`objects\[0\].features.tags\[1\]`: `Book.tags` takes string, not 3"),
        ({"tags": ["a", "a"]}, r"`objects\[0\].features.tags`: .*'a' is given twice"),
        ({"genres": ["poem", "novel", "poem"]}, "given twice"),
        ({"marks": [None]}, r"marks\[0\]`: `Book.marks` takes float, not None"),
    ],
)
def test_json_errors_name_the_wrong_value(features: object, message: str) -> None:
    data = {"format": "envgraph-model-1", "objects": [{"id": 0, "class": "Book", "features": features}]}
    with pytest.raises(EnvgraphError, match=message):
        model_from_json(data, LIBRARY)


def test_edits_at_a_position_notify_one_value_and_journal_no_copy(model: Model) -> None:
    book = model.create("Book", tags=[f"t{n}" for n in range(100)], marks=[n % 3 for n in range(100)])
    ear = _Ear()
    Notified(model, ear)
    savepoint = model.graph.history.savepoint()
    book.tags.insert(0, "a")
    book.tags.append("z")
    del book.tags[50]
    book.tags[1] = "b"
    assert ear.heard == [("+", "a"), ("+", "z"), ("-", "t49"), ("-", "t0"), ("+", "b")]
    assert book.tags[:2] == ["a", "b"] and book.tags[-1] == "z" and len(book.tags) == 101
    assert all(len(str(part)) < 2000 for part in model.graph.store.journal[1::4] + model.graph.store.journal[2::4])
    model.check_integrity()
    ear.heard.clear()
    book.marks.insert(0, 2.0)  # which moves before the 0.0 among those that patterns see
    assert model.graph.store.distinct[marks.index][book.id] == (2.0, 0.0, 1.0) and not ear.heard
    del book.marks[0]
    assert model.graph.store.distinct[marks.index][book.id] == (0.0, 1.0, 2.0) and not ear.heard
    book.marks.pop()
    model.check_integrity()
    model.graph.history.rollback(savepoint)
    assert book.tags == [f"t{n}" for n in range(100)] and book.marks == [n % 3 for n in range(100)]
    model.check_integrity()


def test_versions_restore_edits_at_positions_exactly(model: Model) -> None:
    book = model.create("Book", tags=[f"t{n}" for n in range(40)])
    states = [(model.commit(), list(book.tags))]
    for number in range(120):  # long enough for segments that are reduced
        book.tags.insert(number % 7, f"u{number}")
        del book.tags[(5 * number) % len(book.tags)]
        version = model.commit()
        if number % 40 == 39:
            states.append((version, list(book.tags)))
    for version, expected in [*states, *states[::-1]]:
        model.checkout(version)
        assert book.tags == expected
        model.check_integrity()
    assert model.copy().nodes("Book")[0].tags == book.tags


def test_positions_out_of_range_behave_as_in_a_list(model: Model) -> None:
    book = model.create("Book", tags=["a"])
    with pytest.raises(IndexError):
        del book.tags[1]
    book.tags.insert(-5, "first")
    book.tags.insert(9, "last")
    assert book.tags == ["first", "a", "last"]
