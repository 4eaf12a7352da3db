"""Each diagnostic of a query, from a pattern with exactly that mistake."""

import pytest

from envgraph.errors import ResolutionError, Severity, Source
from envgraph.metamodel import Annotation
from envgraph.pattern import Body, FunctionCall, Parameter, PathConstraint, Pattern, Variable
from tests.unit.pattern.building import (
    NONE,
    agg,
    check,
    codes,
    diagnostics,
    eq,
    ev,
    expr,
    find,
    hints,
    isa,
    library,
    ne,
    neg,
    op,
    path,
    pattern,
    text,
)

RIGHT = path("Cell.right", "a", "b")
STEP = pattern("step", "a : Cell, b : Cell", [RIGHT])
WITH_X = pattern("at", "c : Cell, n : int", [path("Cell.x", "c", "n")])


def one(parameters, *constraints, **features):
    return pattern("p", parameters, list(constraints), **features)


# (what is wrong, the codes, the patterns)
CASES = [
    ("nothing", [], [STEP]),
    # --- names
    ("unknown class in a parameter", ["unknown-type"], [one("a : Cel, b : Cell", RIGHT)]),
    ("unknown class in a type constraint", ["unknown-type"], [one("a : Cell", isa("Cel", "a"))]),
    ("unknown class of a path", ["unknown-type"], [one("a : Cell", path("Cel.right", "a", "b"))]),
    ("a path of an enum", ["unknown-type"], [one("a : Colour", path("Colour.right", "a", "b"))]),
    ("unknown feature", ["unknown-feature"], [one("a : Cell", path("Cell.rigth", "a", "_"))]),
    ("unknown feature further on", ["unknown-feature"], [one("a : Cell", path("Cell.right.foo", "a", "_"))]),
    ("a feature of a subclass", ["unknown-feature"], [one("a : Cell", path("Cell.open", "a", True))]),
    ("a step after an attribute", ["attribute-in-path"], [one("a : Cell", path("Cell.x.y", "a", "_"))]),
    ("a path without a feature", ["empty-path"], [one("a : Cell", path("Cell", "a", "_"))]),
    ("a path from a value", ["path-source"], [one("n : int", path("Cell.x", 3, "n"))]),
    ("unknown pattern", ["unknown-pattern"], [STEP, one("a : Cell", find("stop", "a", "_"))]),
    ("wrong number of arguments", ["wrong-arity"], [STEP, one("a : Cell", find("step", "a"))]),
    (
        "private pattern of another package",
        ["private-pattern"],
        [
            pattern("q", "a : Cell", [isa("Cell", "a")], private=True, package="other"),
            pattern("r", "a : Cell", [find("q", "a")], package="other"),
            one("a : Cell", find("other.q", "a")),
        ],
    ),
    (
        "a simple name of two packages",
        ["ambiguous-pattern"],
        [
            pattern("q", "a : Cell", [isa("Cell", "a")], package="one"),
            pattern("q", "a : Cell", [isa("Cell", "a")], package="two"),
            one("a : Cell", find("q", "a")),
        ],
    ),
    ("two patterns of one name", ["duplicate-definition"], [STEP, STEP]),
    ("an unknown enum", ["unknown-enum"], [one("c : Colour", eq("c", "Color::red"))]),
    ("an unknown literal", ["unknown-literal"], [one("c : Colour", eq("c", "Colour::rad"))]),
    (
        "an unknown literal without its enum",
        ["unknown-literal"],
        [one("k : Key", path("Key.colour", "k", "::rad"))],
    ),
    ("an enum that cannot be told", ["unknown-enum"], [one("c", eq("c", "::red"))]),
    # --- header
    ("a parameter twice", ["duplicate-parameter"], [one("a : Cell, a : Cell", isa("Cell", "a"))]),
    ("a parameter like a single-use variable", ["parameter-name"], [one("_a : Cell", isa("Cell", "_a"))]),
    ("no body", ["empty-body"], [Pattern("p", (Parameter("a", "Cell"),), ())]),
    ("an empty body", ["empty-body"], [pattern("p", "a : Cell", [])]),
    ("no parameters", ["W:no-parameters"], [one("", path("Cell.right", "_", "_"))]),
    (
        "an unknown annotation",
        ["W:unknown-annotation"],
        [one("a : Cell", isa("Cell", "a"), annotations=(Annotation("Constrain"),))],
    ),
    (
        "a constraint with an unknown key and severity",
        ["annotation-argument", "annotation-argument"],
        [
            one(
                "a : Cell",
                isa("Cell", "a"),
                annotations=(
                    Annotation("Constraint", (), (("key", ("b",)), ("severity", "bad"), ("message", "m"))),  # type: ignore[arg-type]
                ),
            )
        ],
    ),
    (
        "a constraint without a message",
        ["annotation-argument"],
        [
            one(
                "a : Cell",
                isa("Cell", "a"),
                annotations=(Annotation("Constraint", (), (("key", "a"), ("severity", "error"))),),
            )
        ],
    ),
    (
        "a functional dependency of no parameter",
        ["annotation-argument"],
        [
            one(
                "a : Cell",
                isa("Cell", "a"),
                annotations=(Annotation("FunctionalDependency", (), (("forEach", "a"), ("determines", "c"))),),
            )
        ],
    ),
    # --- references
    (
        "a parameter that is not referenced",
        ["unreferenced-parameter"],
        [one("a : Cell, b : Cell", isa("Cell", "a"))],
    ),
    (
        "a parameter that one of two bodies does not reference",
        ["unreferenced-parameter"],
        [pattern("p", "a : Cell, b : Cell", [RIGHT], [isa("Cell", "a")])],
    ),
    (
        "a value that only a check reads",
        ["not-enumerable"],
        [one("a : Cell, n : int", isa("Cell", "a"), check(op("n", ">", 3)))],
    ),
    (
        "an object that only a negation names",
        ["not-enumerable"],
        [STEP, one("a", neg(find("step", "a", "_")))],
    ),
    ("a declared class is a positive reference", [], [STEP, one("a : Cell", neg(find("step", "a", "_")))]),
    (
        "a declared enum is one, too",
        ["W:cartesian-product"],
        [one("k : Key, c : Colour", isa("Key", "k"), ne("c", "::red"))],
    ),
    ("a data type enumerates", [], [one("n : int", isa("int", "n"))]),
    ("a declared data type does not", ["not-enumerable"], [one("n : int", check(op("n", ">", 1)))]),
    ("two variables that only equal each other", ["not-enumerable"], [one("a, b", eq("a", "b"))]),
    (
        "a local in two negations",
        ["only-negative"],
        [STEP, one("a : Cell", neg(find("step", "a", "z")), neg(find("step", "z", "a")))],
    ),
    (
        "a single-use variable used twice",
        ["single-use-repeated"],
        [one("a : Cell", path("Cell.right", "a", "_b"), isa("Floor", "_b"))],
    ),
    ("a local used once", ["W:used-once"], [one("a : Cell", path("Cell.right", "a", "z"))]),
    ("a single-use local used once", [], [one("a : Cell", path("Cell.right", "a", "_z"))]),
    (
        "a local that a negation quantifies",
        ["W:quantified-variable"],
        [STEP, one("a : Cell", neg(find("step", "a", "z")))],
    ),
    (
        "a local that an aggregate quantifies",
        ["W:quantified-variable"],
        [one("a : World, n : int", eq("n", agg("count", path("World.cells", "a", "z"))))],
    ),
    (
        "a single-use variable beside its namesake",
        ["W:similar-names"],
        [one("a : Cell", path("Cell.right", "a", "b"), isa("Floor", "b"), path("Cell.left", "a", "_b"))],
    ),
    (
        "an eval that reads its own result",
        ["self-evaluation"],
        [one("n : int", eq("n", ev(op("n", "+", 1))))],
    ),
    (
        "evals in a circle",
        ["not-enumerable"],
        [one("n : int, m : int", eq("n", ev(op("m", "+", 1))), eq("m", ev(op("n", "-", 1))), ne("m", "n"))],
    ),
    ("`_` in an inequality", ["not-enumerable"], [one("a : Cell", ne("a", "_"))]),
    ("`_` on both sides", ["not-enumerable"], [one("a : Cell", isa("Cell", "a"), eq("_", "_"))]),
    # --- shape of the body
    (
        "a number that is computed from one aggregate over everything",
        [],
        [
            one(
                "a : Cell, m : int",
                isa("Cell", "a"),
                eq("n", agg("count", path("World.cells", "_", "_"))),
                eq("m", ev(op("n", "-", 1))),
            )
        ],
    ),
    (
        "unconnected parts",
        ["W:cartesian-product"],
        [one("a : Cell, k : Key", isa("Cell", "a"), isa("Key", "k"))],
    ),
    (
        "parts that an inequality links",
        ["W:loose-connection"],
        [one("a : Cell, b : Cell", ne("a", "b"))],
    ),
    (
        "parts that a check links",
        ["W:loose-connection"],
        [one("a : Cell, b : Cell", check(op("a.x", "<", "b.x")))],
    ),
    (
        "parts that an equation in a check joins",
        [],
        [one("a : Cell, b : Cell", check(op("a.x", "==", "b.x")))],
    ),
    (
        "a constant is no part",
        [],
        [one("a : Cell, c : Colour", isa("Cell", "a"), eq("c", "Colour::red"))],
    ),
    (
        "an aggregate belongs to what it is taken over",
        [],
        [one("w : World, n : int", eq("n", agg("count", path("World.cells", "w", "_"))))],
    ),
    (
        "an aggregate over everything is no part",
        [],
        [one("w : World, n : int", isa("World", "w"), eq("n", agg("count", isa("Cell", "_"))))],
    ),
    (
        "an eval over two parts only filters",
        ["W:loose-connection"],
        [
            one(
                "a : Cell, b : Cell, n : int",
                path("Cell.x", "a", "i"),
                path("Cell.x", "b", "j"),
                eq("n", ev(op("i", "+", "j"))),
            )
        ],
    ),
    (
        "a negation of everything",
        ["W:global-negation"],
        [one("w : World", isa("World", "w"), neg(isa("Wall", "_")))],
    ),
    ("two constants", ["W:constant-comparison"], [one("a : Cell", isa("Cell", "a"), eq(1, 2))]),
    ("a variable and itself", ["W:self-comparison"], [one("a : Cell", isa("Cell", "a"), eq("a", "a"))]),
    (
        "a private pattern that nobody calls",
        ["W:unused-private-pattern"],
        [one("a : Cell", isa("Cell", "a"), private=True)],
    ),
    # --- types
    ("no type", ["W:undeclared-type"], [one("a", isa("Cell", "a"))]),
    ("a type that is too general", ["W:less-specific-type"], [one("a : Cell", isa("Floor", "a"))]),
    (
        "a type that the body makes narrower in one of two bodies",
        [],
        [pattern("p", "a : Cell", [isa("Floor", "a")], [isa("Cell", "a")])],
    ),
    ("two classes without a common object", ["type-conflict"], [one("a : Wall", isa("Floor", "a"))]),
    ("a class and a number", ["type-conflict"], [one("a : Cell", path("Cell.x", "a", "a"))]),
    (
        "an int and a float",
        ["type-conflict"],
        [one("d : Door", path("Door.x", "d", "n"), path("Door.weight", "d", "n"))],
    ),
    ("united variables of different types", ["type-conflict"], [one("a : Cell, k : Key", eq("a", "k"))]),
    ("an argument of another class", ["argument-type"], [STEP, one("k : Key", find("step", "k", "_"))]),
    ("a count as a string", ["type-conflict"], [one("n : string", eq("n", agg("count", isa("Cell", "_"))))]),
    (
        "classes that several classes share",
        ["ambiguous-type"],
        [one("a", isa("Swims", "a"), isa("Walks", "a"))],
    ),
    ("the same, declared", [], [one("a : Swims", isa("Swims", "a"), isa("Walks", "a"))]),
    (
        "bodies without a common supertype",
        ["no-common-supertype"],
        [pattern("p", "a", [isa("Cell", "a")], [isa("Hero", "a")])],
    ),
    (
        "bodies with two common supertypes",
        ["ambiguous-type"],
        [pattern("p", "a", [isa("Frog", "a")], [isa("Newt", "a")])],
    ),
    (
        "a type that nothing tells",
        ["untyped-parameter"],
        [pattern("p", "a", [find("p", "a")], annotations=(Annotation("SafeRecursion"),))],
    ),
    ("an arrow from nowhere", ["untyped-source"], [one("a, b : Cell", path(".right", "a", "b"))]),
    # --- literals
    ("a string for an int", ["wrong-type"], [one("a : Cell", path("Cell.x", "a", text("3")))]),
    ("a float for an int", ["wrong-type"], [one("a : Cell", path("Cell.x", "a", 3.5))]),
    ("an int for a float", [], [one("d : Door", path("Door.weight", "d", 3))]),
    ("a number for an object", ["wrong-type"], [one("a : Cell", path("Cell.right", "a", 3))]),
    ("a string for an enum", ["wrong-type"], [one("k : Key", path("Key.colour", "k", text("red")))]),
    ("a literal of another enum", ["wrong-enum"], [one("k : Key", path("Key.colour", "k", "Way::west"))]),
    (
        "a literal of another enum in a comparison",
        ["wrong-enum"],
        [one("k : Key", path("Key.colour", "k", "c"), eq("c", "Way::west"))],
    ),
    ("an enum literal for an int", ["unknown-enum"], [one("a : Cell", path("Cell.x", "a", "::red"))]),
    (
        "a wrong literal in a comparison",
        ["wrong-type"],
        [one("a : Cell, n : int", path("Cell.x", "a", "n"), ne("n", text("3")))],
    ),
    ("a wrong literal in a call", ["wrong-type"], [WITH_X, one("c : Cell", find("at", "c", True))]),
    ("a wrong literal under neg", ["wrong-type"], [WITH_X, one("c : Cell", neg(find("at", "c", True)))]),
    ("a wrong value of an eval", ["wrong-type"], [WITH_X, one("c : Cell", find("at", "c", ev(text("a"))))]),
    ("none as an argument", ["none-argument"], [one("a : Cell", path("Cell.right", "a", NONE))]),
    ("none in a comparison", ["none-argument"], [one("a : Cell", isa("Cell", "a"), eq("a", NONE))]),
    ("none beside a constant", ["none-argument"], [one("a : Cell", isa("Cell", "a"), ne(3, NONE))]),
    (
        "a negation that cannot match",
        ["W:never-matches"],
        [one("k : Key", path("Key.label", "k", text("x")), neg(isa("Cell", "k")))],
    ),
    (
        "an aggregate that cannot match",
        ["W:never-matches"],
        [STEP, one("k : Key, n : int", eq("n", agg("count", find("step", "k", "_"))))],
    ),
    (
        "unequal types",
        ["W:always-different"],
        [one("a : Cell, n : int", path("Cell.x", "a", "n"), ne("a", "n"))],
    ),
    (
        "a negated data type",
        ["data-type-group"],
        [one("a : Cell, n : int", path("Cell.x", "a", "n"), neg(isa("int", "n")))],
    ),
    # --- closures
    (
        "a closure of three parameters",
        ["closure-not-binary"],
        [
            pattern("t", "a : Cell, b : Cell, n : int", [path("Cell.right", "a", "b"), path("Cell.x", "a", "n")]),
            one("a : Cell, b : Cell", find("t", "a", "b", closure="+")),
        ],
    ),
    (
        "a closure whose ends do not meet",
        ["closure-ends"],
        [one("a : World, b : Cell", path("World.cells", "a", "b", "+"))],
    ),
    (
        "a closure of an attribute",
        ["closure-ends"],
        [one("a : Cell, n : int", path("Cell.x", "a", "n", "+"))],
    ),
    (
        "a closure under neg",
        ["closure-in-group"],
        [STEP, one("a : Cell", neg(find("step", "a", "_", closure="+")))],
    ),
    (
        "a closure under count",
        ["closure-in-group"],
        [one("a : Cell, n : int", eq("n", agg("count", path("Cell.right", "a", "_", "*"))))],
    ),
    (
        "a reflexive closure of values",
        ["closure-reflexive"],
        [
            pattern("next", "n : int, m : int", [path("Cell.x", "c", "n"), path("Cell.y", "c", "m")]),
            one("n : int, m : int", find("next", "n", "m", closure="*")),
        ],
    ),
    (
        "a transitive closure of values",
        [],
        [
            pattern("next", "n : int, m : int", [path("Cell.x", "c", "n"), path("Cell.y", "c", "m")]),
            one("n : int, m : int", find("next", "n", "m", closure="+")),
        ],
    ),
    (
        "a reflexive closure without a common supertype",
        ["closure-ends"],
        [
            pattern("s", "a : Swims, b : Walks", [isa("Swims", "a"), isa("Walks", "b"), eq("a", "b")]),
            one("a : Swims", find("s", "a", "_", closure="*")),
        ],
    ),
    # --- aggregates
    ("a hash outside of an aggregate", ["stray-hash"], [one("a : Cell", path("Cell.right", "a", "#"))]),
    ("a hash in a comparison", ["stray-hash"], [one("a : Cell", isa("Cell", "a"), eq("a", "#"))]),
    (
        "a hash in count",
        ["stray-hash"],
        [one("a : Cell, n : int", eq("n", agg("count", path("Cell.x", "a", "#"))))],
    ),
    (
        "a sum without a hash",
        ["missing-hash"],
        [one("a : Cell, n : int", eq("n", agg("sum", path("Cell.x", "a", "_"))))],
    ),
    (
        "a sum with two",
        ["second-hash"],
        [
            pattern("xy", "n : int, m : int", [path("Cell.x", "c", "n"), path("Cell.y", "c", "m")]),
            one("n : int", eq("n", agg("sum", find("xy", "#", "#")))),
        ],
    ),
    (
        "a sum of strings",
        ["aggregate-type"],
        [one("n : string", eq("n", agg("sum", path("Key.label", "_", "#"))))],
    ),
    ("an average of objects", ["aggregate-type"], [one("n : float", eq("n", agg("avg", isa("Cell", "#"))))]),
    ("a maximum of strings", [], [one("n : string", eq("n", agg("max", path("Key.label", "_", "#"))))]),
    (
        "a chain that branches",
        ["W:chain-aggregate"],
        [one("w : World, n : int", eq("n", agg("count", path("World.cells.items", "w", "_"))))],
    ),
    # --- check and eval
    ("a check of a number", ["check-not-boolean"], [one("a : Cell", check("a.x"))]),
    (
        "a bare object in a check",
        ["bare-object"],
        [one("a : Cell, b : Cell", RIGHT, check(op("a", "==", "b")))],
    ),
    (
        "a bare object in an eval",
        ["bare-object"],
        [one("a : Cell, b : Cell", isa("Cell", "a"), eq("b", ev("a")))],
    ),
    ("an unknown feature in a check", ["unknown-feature"], [one("a : Cell", check(op("a.z", "==", 1)))]),
    (
        "a string less a number",
        ["operand-type"],
        [one("k : Key, n : int", isa("Key", "k"), eq("n", ev(op("k.label", "-", 1))))],
    ),
    (
        "an unknown function",
        ["unknown-function"],
        [one("a : Cell", check(op(FunctionCall("absolute", (expr("a.x"),)), ">", 1)))],
    ),
    (
        "none as the value of an eval",
        ["none-argument"],
        [one("a : Cell, n : int", path("Cell.x", "a", "n"), eq("n", ev(NONE)))],
    ),
    # --- recursion
    (
        "recursion",
        ["W:recursive-pattern"],
        [pattern("far", "a : Cell, b : Cell", [RIGHT], [path("Cell.right", "a", "c"), find("far", "c", "b")])],
    ),
    (
        "recursion that is declared safe",
        [],
        [
            pattern(
                "far",
                "a : Cell, b : Cell",
                [RIGHT],
                [path("Cell.right", "a", "c"), find("far", "c", "b")],
                annotations=(Annotation("SafeRecursion"),),
            )
        ],
    ),
    (
        "recursion through neg",
        ["recursion-through-negation"],
        [
            pattern("win", "a : Cell", [path("Cell.right", "a", "b"), find("lose", "b")]),
            pattern("lose", "a : Cell", [neg(find("win", "a"))]),
        ],
    ),
    (
        "recursion through count",
        ["recursion-through-negation"],
        [pattern("p", "a : Cell, n : int", [eq("n", agg("count", find("p", "a", "_")))])],
    ),
    (
        "recursion through a closure",
        ["recursion-through-closure"],
        [pattern("p", "a : Cell, b : Cell", [RIGHT], [find("p", "a", "b", closure="+")])],
    ),
    # --- inputs
    ("a value that callers bind", [], [one("c : Cell, in n : int", check(op("c.x", ">", "n")))]),
    (
        "a call that does not bind it",
        ["unbound-input"],
        [
            pattern("above", "c : Cell, in n : int", [check(op("c.x", ">", "n"))]),
            one("c : Cell", find("above", "c", "_")),
        ],
    ),
    (
        "a call that binds it by nothing but the call",
        ["not-enumerable"],
        [
            pattern("above", "c : Cell, in n : int", [check(op("c.x", ">", "n"))]),
            one("c : Cell, n : int", find("above", "c", "n")),
        ],
    ),
    (
        "a negated call that does not bind it",
        ["unbound-input"],
        [
            pattern("above", "c : Cell, in n : int", [check(op("c.x", ">", "n"))]),
            one("c : Cell", neg(find("above", "c", "_"))),
        ],
    ),
]


@pytest.mark.parametrize(("expected", "patterns"), [case[1:] for case in CASES], ids=[case[0] for case in CASES])
def test_one_mistake_gives_one_diagnostic(expected, patterns):
    assert codes(*patterns) == expected


def test_every_error_refuses_the_library_and_every_warning_does_not():
    for _, expected, patterns in CASES:
        if all(code.startswith("W:") for code in expected):
            assert library(*patterns).names()
        else:
            with pytest.raises(ResolutionError) as caught:
                library(*patterns)
            assert all(d.severity is Severity.ERROR for d in caught.value.diagnostics)


@pytest.mark.parametrize(
    ("hint", "made"),
    [
        ("did you mean `Cell`?", one("a : Cel", isa("Cell", "a"))),
        ("did you mean `right`?", one("a : Cell", path("Cell.rigth", "a", "_"))),
        (
            "constrain the object with `Door(..)`: this subclass has the feature",
            one("a : Cell", path("Cell.open", "a", True)),
        ),
        ("did you mean `Colour`?", one("c : Colour", eq("c", "Color::red"))),
        ("did you mean `red`?", one("c : Colour", eq("c", "Colour::rad"))),
        ("did you mean `Colour::red`?", one("k : Key", path("Key.colour", "k", text("red")))),
        (
            "did you mean `tile`?",
            one("a : Cell", path("Cell.right", "a", "tile"), isa("Floor", "tile"), isa("Floor", "tlie")),
        ),
        (
            "did you mean `Constraint`?",
            one("a : Cell", isa("Cell", "a"), annotations=(Annotation("Constrain"),)),
        ),
    ],
)
def test_hints_name_the_nearest_candidate(hint, made):
    assert hint in hints(made)


def test_the_hint_for_an_unknown_pattern_knows_other_packages():
    other = pattern("stepping", "a : Cell, b : Cell", [RIGHT], package="other")
    assert "did you mean `stepping`?" in hints(other, one("a : Cell", find("steping", "a", "_")))


def test_a_misspelt_parameter_gives_one_diagnostic():
    found = diagnostics(one("from : Cell, to : Cell", path("Cell.right", "form", "to")))
    assert [d.code for d in found] == ["unreferenced-parameter"]
    assert found[0].hint == "write `from` there"


def test_the_cycle_of_a_recursion_is_shown():
    patterns = [
        pattern("win", "a : Cell", [path("Cell.right", "a", "b"), find("lose", "b")]),
        pattern("lose", "a : Cell", [neg(find("win", "a"))]),
    ]
    assert diagnostics(*patterns)[0].message == "recursion through a negation: lose -> neg win -> lose"


def test_the_parts_of_a_cartesian_product_are_listed():
    made = one("a : Cell, b : Cell, k : Key", RIGHT, isa("Key", "k"))
    assert diagnostics(made)[0].message.endswith("{a, b}, {k}")


def test_errors_of_all_patterns_are_reported_together():
    first = pattern("p", "a : Cel", [isa("Cell", "a")])
    second = pattern("q", "a : Cell", [path("Cell.rigth", "a", "_")])
    assert codes(first, second) == ["unknown-type", "unknown-feature"]


def test_callers_of_a_pattern_with_errors_get_no_errors():
    broken = pattern("q", "a, n", [path("Cell.foo", "a", "n")])
    found = codes(broken, one("a, n", find("q", "a", "n")))
    assert [code for code in found if not code.startswith("W:")] == ["unknown-feature"]


def test_an_error_is_reported_at_the_narrowest_span():
    source = Source("m.query", "pattern p(a : Cell) { Cell.rigth.left(a, _); }")
    made = PathConstraint(
        "Cell",
        ("rigth", "left"),
        Variable("a", source.span_between(38, 39)),
        Variable("_"),
        span=source.span_between(22, 43),
        type_span=source.span_between(22, 26),
        feature_spans=(source.span_between(27, 32), source.span_between(33, 37)),
    )
    found = diagnostics(Pattern("p", (Parameter("a", "Cell"),), (Body((made,)),)))
    assert [d.span.text for d in found] == ["rigth"]


def test_a_conflict_points_at_both_places():
    source = Source("m.query", "pattern p(a : Wall) { Floor(a); }")
    constraint = isa("Floor", Variable("a", source.span_between(28, 29)))
    parameter = Parameter("a", "Wall", span=source.span_between(10, 11))
    [found] = diagnostics(Pattern("p", (parameter,), (Body((constraint,)),)))
    assert (found.span.start, found.notes[0].span.start) == (28, 10)


def test_a_private_pattern_of_another_file_is_hidden_even_in_its_package():
    one_file, other_file = Source("a.query", "q" * 9), Source("b.query", "p" * 9)
    private = pattern("q", "a : Cell", [isa("Cell", "a")], private=True, span=one_file.span_between(0, 1))
    user = pattern("r", "a : Cell", [find("q", "a")], span=one_file.span_between(2, 3))
    assert codes(private, user) == []
    stranger = pattern("p", "a : Cell", [find("q", "a")], span=other_file.span_between(0, 1))
    assert codes(private, user, stranger) == ["private-pattern"]
