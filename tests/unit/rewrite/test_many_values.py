"""Attributes with many values from files: queries of them, watched or not, and rules that change them."""

from __future__ import annotations

import re

import pytest

from envgraph.errors import RuleError
from envgraph.graph import model_to_json, model_to_xmi
from envgraph.lang import TextFiles, load_workspace
from envgraph.metamodel import metamodel_to_ecore
from envgraph.rewrite import Engine

METAMODEL = """metamodel library
enum Genre { novel, poem }
class Library { contains Book[*] books refers Book[0..1] best }
class Book { string title string[*] tags Genre[0..2] genres @nonunique float[*] marks }
"""
MODEL = """import "m.metamodel"
model m : library {
    library : Library {
        books = [
            a : Book { title = "A", tags = ["x", "y"], genres = ::novel, marks = [1.0, 1, 2] },
            b : Book { title = "B", tags = "y" },
            c : Book { title = "C", genres = [::poem, ::novel] },
        ]
        best = a
    }
}
"""
QUERY = """import "m.metamodel"
pattern tagged(b : Book, t : string) { Book.tags(b, t); }
pattern pairs(a : Book, b : Book, t : string) { Book.tags(a, t); Book.tags(b, t); a != b; }
pattern alone(a : Book, t : string) { Book.tags(a, t); neg find pairs(a, _, t); }
pattern untagged(b : Book) { neg Book.tags(b, _); }
pattern unlike(b : Book, c : Book) { Book.tags(c, t); neg Book.tags(b, t); }
pattern tags(b : Book, n : int) { n == count Book.tags(b, _); }
pattern used(t : string, n : int) { Book.tags(_, t); n == count Book.tags(_, t); }
pattern total(b : Book, s : float) { s == sum Book.marks(b, #); }
pattern genres(g : Genre, n : int) { n == count Book.genres(_, g); }
pattern some(b : Book) { Book.tags(b, _); }
pattern best(t : string) { Library.best.tags(_, t); }
pattern titled(b : Book) { Book.tags(b, t); Book.title(b, t); }
"""
RULES = """import "m.metamodel"
rule add(b : Book, t : string) { lhs { b : Book; Book.tags(other, t); Book(other); } modify { set b.tags += t; } }
rule drop(b : Book, t : string) { lhs { b : Book; Book.tags(b, t); } modify { set b.tags -= t; } }
rule replace(b : Book) { lhs { b : Book; } modify { set b.tags = ["p", b.title, "p"]; set b.marks += [3, 3]; } }
rule clear(b : Book) { lhs { b : Book; } modify { set b.tags = none; set b.marks -= 1; } }
rule make {
    lhs { l : Library; }
    modify { create l -books-> b : Book { title = "N", tags = ["n", "n"], marks = [1, 1] }; }
}
rule name { lhs { } forall { lhs { b : Book; } modify { set b.tags += b.title; } } }
rule both { lhs { } forall { lhs { b : Book; Book.title(b, t); Book(c); } modify { set c.tags += t; } } }
rule odd {
    lhs { b : Book; Book.title(b, "A"); }
    forall { lhs { Book.tags(b, t); } modify { set b.tags += "y"; set b.tags -= t; } }
}
rule full(b : Book) { lhs { b : Book; } modify { set b.title = "full"; set b.genres = [::novel, ::poem, ::novel]; } }
"""
FILES = {"m.metamodel": METAMODEL, "m.model": MODEL, "q.query": QUERY, "r.rules": RULES}
PATTERNS = [line.split()[1].split("(")[0] for line in QUERY.splitlines()[1:]]


def engine() -> Engine:
    return load_workspace(["m.model", "q.query", "r.rules"], files=TextFiles(FILES)).engine()


def rows(engine: Engine, pattern: str) -> list[str]:
    return sorted(repr(match) for match in engine.matches(pattern))


def values(engine: Engine) -> dict[str, tuple[list[object], list[object]]]:
    return {book.title: (list(book.tags), list(book.marks)) for book in engine.model.nodes("Book")}


def test_a_pattern_has_one_match_for_each_value() -> None:
    found = engine()
    assert [(match["b"].title, match["t"]) for match in found.matches("tagged")] == [
        ("A", "x"),
        ("A", "y"),
        ("B", "y"),
    ]
    assert [match["n"] for match in found.matches("tags")] == [2, 1, 0]
    assert {match["t"]: match["n"] for match in found.matches("used")} == {"x": 1, "y": 2}
    assert [match["s"] for match in found.matches("total")] == [3.0, 0.0, 0.0]  # each value once
    assert {match["g"]: match["n"] for match in found.matches("genres")} == {"novel": 2, "poem": 1}
    assert [match["b"].title for match in found.matches("tagged", t="y")] == ["A", "B"]
    assert found.count("pairs") == 2 and found.count("unlike", b=found.model["c"]) == 2


def test_a_join_by_value_looks_values_up() -> None:
    assert "for v1 in i0(v2):" in str(engine().explain("pairs"))


@pytest.mark.parametrize(
    ("rule", "bound", "tags", "marks"),
    [
        ("add", {"b": "a", "t": "y"}, ["x", "y"], [1.0, 1.0, 2.0]),
        ("add", {"b": "c", "t": "x"}, ["x"], []),
        ("drop", {"b": "a", "t": "x"}, ["y"], [1.0, 1.0, 2.0]),
        ("replace", {"b": "b"}, ["p", "B"], [3.0, 3.0]),
        ("clear", {"b": "a"}, [], [2.0]),
    ],
)
def test_rules_add_remove_and_set(rule: str, bound: dict[str, str], tags: list[str], marks: list[float]) -> None:
    plain, watching = engine(), engine()
    watching.watch(*PATTERNS)
    for each in (plain, watching):
        version = each.commit()
        before = {pattern: rows(each, pattern) for pattern in PATTERNS}
        given = {key: each.model[value] if key == "b" else value for key, value in bound.items()}
        assert each.apply(rule, **given) is not None
        book = each.model[bound["b"]]
        assert (book.tags, book.marks) == (tags, marks)
        each.model.check_integrity()
        after = {pattern: rows(each, pattern) for pattern in PATTERNS}
        now = each.commit()
        each.checkout(version)
        assert {pattern: rows(each, pattern) for pattern in PATTERNS} == before
        each.checkout(now)
        assert {pattern: rows(each, pattern) for pattern in PATTERNS} == after
        each.model.check_integrity()
    for pattern in PATTERNS:
        assert rows(plain, pattern) == rows(watching, pattern)


def test_rules_set_many_values_of_new_objects_and_several_matches() -> None:
    found = engine()
    found.apply("make")
    found.apply("name")
    assert values(found) == {
        "A": (["x", "y", "A"], [1.0, 1.0, 2.0]),
        "B": (["y", "B"], []),
        "C": (["C"], []),
        "N": (["n", "N"], [1.0, 1.0]),
    }
    found.apply("both")
    assert set(values(found)["C"][0]) == {"A", "B", "C", "N"}


def test_matches_that_add_and_remove_one_value_contradict_each_other() -> None:
    with pytest.raises(RuleError, match="'y' is both added to and removed from `tags` of `a`"):
        engine().apply("odd")


def test_a_list_in_a_rule_has_each_value_once_and_upper_bounds_hold() -> None:
    found = engine()
    found.apply("full", b=found.model["b"])
    assert found.model["b"].genres == ["novel", "poem"]
    narrow = FILES | {"m.metamodel": METAMODEL.replace("Genre[0..2]", "Genre[0..1]").replace("[*] tags", "[0..2] tags")}
    narrow["m.model"] = MODEL.replace("[::poem, ::novel]", "::poem")
    narrow["r.rules"] = (
        'import "m.metamodel"\nrule add { lhs { b : Book; Book.title(b, "A"); } '
        'modify { set b.title = "Z"; set b.tags += "z"; } }'
    )
    refused = load_workspace(["m.model", "r.rules"], files=TextFiles(narrow)).engine()
    before = model_to_json(refused.model)
    with pytest.raises(RuleError, match="would have 3 of at most 2 values of `tags`"):
        refused.apply("add")
    assert model_to_json(refused.model) == before


def test_listeners_are_notified_of_value_matches() -> None:
    found = engine()
    heard: list[tuple[str, str, str]] = []

    def changed(appeared: object, disappeared: object) -> None:
        for sign, matches in (("+", appeared), ("-", disappeared)):
            heard.extend((sign, match["b"].title, match["t"]) for match in matches)  # type: ignore[attr-defined]

    found.listen("tagged", changed)
    with found.transaction():
        found.model["a"].tags = ["y", "z"]
        found.model["b"].tags.append("q")
        found.model["b"].tags.remove("q")
        found.model["a"].marks.append(7)
    assert sorted(heard) == [("+", "A", "z"), ("-", "A", "x")]


def test_ecore_and_xmi_round_trips_keep_many_values() -> None:
    found = engine()
    files = {"m.ecore": metamodel_to_ecore(found.model.metamodel), "m.xmi": model_to_xmi(found.model)}
    assert {'name="marks"', 'unique="false"', 'upperBound="-1"'} < {*re.split(" |/>", files["m.ecore"])}
    again = load_workspace(["m.ecore", "m.xmi"], files=TextFiles(files)).model()
    again.name = found.model.name
    assert again.metamodel.class_list == found.model.metamodel.class_list
    assert model_to_json(again) == model_to_json(found.model)


def test_xmi_has_many_values_in_tags_or_in_one_attribute_and_says_what_is_wrong() -> None:
    ecore = metamodel_to_ecore(engine().model.metamodel)

    def read(body: str) -> object:
        text = f'<l:Library xmlns:l="library" xmlns:xsi="http://www.w3.org/2001/XMLSchema-instance">{body}</l:Library>'
        return load_workspace(["m.ecore", "m.xmi"], files=TextFiles({"m.ecore": ecore, "m.xmi": text}))

    good = read('<books title="A" tags="u v" marks="1 1.5"><tags>w w</tags><marks>1</marks><tags></tags></books>')
    (book,) = good.model().nodes("Book")  # type: ignore[attr-defined]
    assert (book.tags, book.marks) == (["u", "v", "w w", ""], [1.0, 1.5, 1.0])
    wrong = read(
        '<books title="A" tags="u u"><tags>u</tags><tags xsi:nil="true"/><marks>x</marks></books>'
        "<books><genres>novel</genres><genres>poem</genres><genres>lyric</genres></books>"
    )
    assert [(one.code, one.message) for one in wrong.diagnostics] == [  # type: ignore[attr-defined]
        ("duplicate-value", "`Book.tags` already has this value"),
        ("duplicate-value", "`Book.tags` already has this value"),
        ("missing-value", "a value of `Book.tags` is missing"),
        ("wrong-type", "`Book.marks` takes a `float`, not `x`"),
        ("unknown-literal", "`Genre` has no literal `lyric`"),
    ]


def test_derived_operators_do_not_change_many_values() -> None:
    boxes = """metamodel m
class Root { contains Item[*] items contains Box[*] boxes }
class Item { string[*] tags }
class Box { int[1..*] sizes }
"""
    model = 'import "m.metamodel"\nmodel a : m { r : Root { items = Item { tags = "a" } } }'

    def derived(cls: str) -> object:
        rules = f'import "m.metamodel"\nderive grow = operators for {cls};'
        files = {"m.metamodel": boxes, "m.model": model, "r.rules": rules}
        return load_workspace(["m.model", "r.rules"], files=TextFiles(files))

    engine = derived("Item").engine(seed=1)  # type: ignore[attr-defined]
    for _ in range(6):
        engine.apply("grow")
        assert all(item.tags in ([], ["a"]) for item in engine.model.nodes("Item"))
    (problem,) = derived("Box").errors  # type: ignore[attr-defined]
    assert problem.message == "`Box` requires values of a multi-valued attribute: there is no operator for it"
