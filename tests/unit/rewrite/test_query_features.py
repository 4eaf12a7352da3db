"""Derived features whose values are the matches of a pattern."""

from __future__ import annotations

from collections.abc import Callable
from random import Random

import pytest

from envgraph import Engine, Pattern
from envgraph.errors import EnvgraphError, InvalidArgument, ResolutionError, TypeMismatch
from envgraph.graph import Model, Node, model_from_json, model_to_json, model_to_xmi
from envgraph.match import FREE
from envgraph.metamodel import Annotation, Attribute, Class, Metamodel, Reference, Scalar
from tests.oracle.naive._naive import NaiveMatcher

DERIVED = (Annotation("derived"),)
KIN = Metamodel(
    "kin",
    [
        Class(
            "Person",
            features=(
                Attribute("name", Scalar.STRING),
                Attribute("age", Scalar.INT),
                Reference("children", "Person", 0, None),
                Reference("descendants", "Person", 0, None, annotations=DERIVED),
                Reference("favourite", "Person", 0, 1, annotations=DERIVED),
                Attribute("total", Scalar.INT, annotations=DERIVED),
                Attribute("nicks", Scalar.STRING, lower=0, upper=None, annotations=DERIVED),
            ),
        )
    ],
)
DEFINING = (
    Pattern(
        "below",
        "this : Person, target : Person",
        ["Person.children(this, target)", "Person.children(this, c); Person.descendants(c, target)"],
        annotations='@QueryBasedFeature(feature = "descendants") @SafeRecursion',
    ),
    Pattern("ages", "p : Person, d : Person, age : int", "Person.descendants(p, d); Person.age(d, age)"),
    Pattern("total", "this : Person, n : int", "n == sum find ages(this, _, #)", annotations="@QueryBasedFeature"),
    Pattern(
        "nicks",
        "this : Person, n : string",
        "Person.descendants.name(this, n)",
        annotations="@QueryBasedFeature",
    ),
    Pattern(
        "favourite",
        "this : Person, p : Person",
        "Person.children(this, p); Person.age(p, 7)",
        annotations="@QueryBasedFeature",
    ),
)
READING = {
    "arrow": ("p : Person, q : Person", "Person.descendants(p, q)"),
    "chain": ("p : Person, q : Person", "Person.descendants.children.descendants(p, q)"),
    "closure": ("p : Person, q : Person", "Person.descendants+(p, q)"),
    "none": ("p : Person", "Person(p); neg Person.descendants(p, _)"),
    "counted": ("p : Person, n : int", "Person(p); n == count Person.descendants(p, _)"),
    "summed": ("p : Person, n : int", "Person(p); n == sum Person.descendants.age(p, #)"),
    "checked": ("p : Person", "Person(p); check(p.total > 10 && p.favourite.age == 7)"),
    "absent": ("p : Person", "Person(p); check(p.favourite == none)"),
    "equal": ("p : Person, q : Person", "Person.total(p, n); Person.total(q, n); p != q"),
    "text": ("p : Person, s : string", "Person.nicks(p, s)"),
}
BY_PATTERN = {
    "arrow": "find below(p, q)",
    "chain": "find below(p, a); Person.children(a, b); find below(b, q)",
    "closure": "find below+(p, q)",
    "none": "Person(p); neg find below(p, _)",
    "counted": "Person(p); n == count find below(p, _)",
    "checked": "Person(p); find total(p, n); check(n > 10); find favourite(p, f); Person.age(f, 7)",
    "absent": "Person(p); neg find favourite(p, _)",
    "equal": "find total(p, n); find total(q, n); p != q",
    "text": "find nicks(p, s)",
}


@pytest.fixture
def engine() -> Engine:
    model = Model(KIN)
    people = {name: model.create("Person", object_name=name, name=name, age=7) for name in "abcd"}
    for one, other in ("ab", "bc", "ad"):
        people[one].children.append(people[other])
    people["d"].age = 8
    engine = Engine(model)
    engine.add(*DEFINING)
    return engine


def test_handles_read_the_matches_of_the_defining_pattern(engine: Engine) -> None:
    model = engine.model
    a, b, c, d = (model[name] for name in "abcd")
    assert sorted(one.name for one in a.descendants) == ["b", "c", "d"] and b.descendants == [c]
    assert (a.total, c.total, len(a.nicks), list(b.nicks)) == (22, 0, 3, ["c"])
    assert (a.favourite, b.favourite, c.favourite) == (b, c, None)
    assert b in a.descendants and a not in a.descendants
    assert {"total", "below"} <= {name.rpartition(".")[2] for name in engine.watched}
    with model.transaction():
        c.children.append(model.create("Person", name="e", age=1))
        assert a.total == 23 and len(a.descendants) == 4
    a.children.remove(b)
    assert a.descendants == [d]


def test_two_matches_for_a_single_valued_feature_are_an_error(engine: Engine) -> None:
    engine.model["d"].age = 7
    with pytest.raises(
        InvalidArgument,
        match=r"`Person.favourite` has at most one value, but query `favourite` returns 2 for",
    ):
        _ = engine.model["a"].favourite


@pytest.mark.parametrize("name", READING)
def test_patterns_read_the_matches_of_the_pattern(engine: Engine, name: str) -> None:
    parameters, body = READING[name]
    engine.add(Pattern("reads", parameters, body))
    if name in BY_PATTERN:
        engine.add(Pattern("calls", parameters, BY_PATTERN[name]))
    random, model = Random(3), engine.model
    naive = NaiveMatcher(model, engine.library)
    engine.watch("reads")
    free = (FREE,) * len(engine.library.parameter_types("reads"))
    for _ in range(6):
        one, other = random.choices([model[each] for each in "abcd"], k=2)
        one.age = random.choice([6, 7, 8])
        if other in one.children:
            one.children.remove(other)
        else:
            one.children.append(other)
        rows = sorted(engine.matcher.rows("reads", free))
        assert rows == sorted(naive.rows("reads", free))
        if name in BY_PATTERN:
            assert rows == sorted(engine.matcher.rows("calls", free))


CHANGES: dict[str, Callable[[Node], object]] = {
    "append": lambda a: a.descendants.append(a),
    "insert": lambda a: a.descendants.insert(0, a),
    "remove": lambda a: a.descendants.remove(a.descendants[0]),
    "clear": lambda a: a.descendants.clear(),
    "targets": lambda a: setattr(a, "descendants", [a]),
    "target": lambda a: setattr(a, "favourite", a),
    "no target": lambda a: setattr(a, "favourite", None),
    "value": lambda a: setattr(a, "total", 3),
    "no value": lambda a: setattr(a, "total", None),
    "add value": lambda a: a.nicks.append("x"),
    "remove value": lambda a: a.nicks.remove(a.nicks[0]),
    "values": lambda a: setattr(a, "nicks", []),
    "create": lambda a: a.model.create("Person", total=3),
}


@pytest.mark.parametrize("change", CHANGES)
def test_writing_is_refused(engine: Engine, change: str) -> None:
    before = model_to_json(engine.model)
    with pytest.raises(TypeMismatch, match=r"is read-only: query `.*` defines its values; change the data"):
        CHANGES[change](engine.model["a"])
    assert model_to_json(engine.model) == before
    engine.model.check_integrity()


def test_xmi_files_lack_defined_features(engine: Engine) -> None:
    assert engine.model["a"].total == 22
    text = model_to_xmi(engine.model)
    assert "total" not in text and "descendants" not in text and "children" in text


def test_a_query_that_is_removed_defines_nothing(engine: Engine) -> None:
    with pytest.raises(InvalidArgument, match="`below` is used by"):
        engine.remove("below")
    engine.remove("total", "nicks", "ages", "below")
    a = engine.model["a"]
    assert a.descendants == [] and a.total == 0
    a.total, a.descendants = 3, [a]
    assert a.favourite == engine.model["b"]
    engine.model.check_integrity()
    with pytest.raises(
        ResolutionError, match=r"query `below` defines `Person.descendants`, but `a` stores a value of it"
    ):
        engine.add(*DEFINING[:2])
    assert "below" not in engine.patterns
    a.delete("spo")  # with the link that it has again
    engine.model.check_integrity()


def test_a_feature_that_a_pattern_reads_cannot_be_defined_later(engine: Engine) -> None:
    engine = Engine(Model(KIN))
    engine.add(Pattern("reads", *READING["arrow"]))
    with pytest.raises(ResolutionError, match=r"`reads` was added before, and reads `Person.descendants`"):
        engine.add(DEFINING[0])


def test_two_engines_of_a_model_keep_their_definitions(engine: Engine) -> None:
    other = Engine(engine.model)
    other.add(Pattern("old", "p : Person", "Person.age(p, 7)"))
    assert engine.model["a"].total == 22
    other.remove("old")
    assert engine.model["a"].total == 22
    annotation = '@QueryBasedFeature(feature = "total")'
    other.add(Pattern("total", "p : Person, n : int", "Person.age(p, n)", annotations=annotation))
    assert engine.model["a"].total == 7  # the last one counts, also where the first engine is gone
    engine.remove("total")
    assert engine.model["a"].total == 7


def test_json_leaves_defined_features_out(engine: Engine) -> None:
    written = model_to_json(engine.model)
    assert "total" not in written["objects"][0]["features"]
    engine.remove("total", "nicks", "ages", "below")
    assert model_to_json(model_from_json(written, KIN)) == model_to_json(engine.model)


def test_rules_read_query_features_but_cannot_write_them(engine: Engine) -> None:
    from envgraph import Rule

    engine.add(Rule("mark", lhs="p : Person -descendants-> q : Person; check p.total > 10", modify="set q.age = 9"))
    assert engine.count("mark") == 3
    assert engine.apply("mark")
    for modify in (
        "set p.total = 3",
        "create p -descendants-> p",
        "delete p -descendants-> p",
        "set p.age = p.total",
    ):
        with pytest.raises(EnvgraphError, match=r"query `\w+` defines"):
            engine.add(Rule("wrong", lhs="p : Person", modify=modify))
