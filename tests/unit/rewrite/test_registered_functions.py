"""Functions of Python that expressions call: registered, declared, and what happens when they go wrong."""

from __future__ import annotations

import math
from collections.abc import Callable

import pytest

from envgraph import Pattern
from envgraph.errors import FunctionError, InvalidArgument, ResolutionError
from envgraph.lang import TextFiles, from_text, load_workspace, to_text
from envgraph.pattern import Expression, FunctionCall, Navigation, Variable
from envgraph.rewrite import Engine
from tests.oracle.naive._naive import NaiveMatcher
from tests.unit.rewrite.graphs import chain, definitions

ODD = Pattern("odd", "x : Item", "Item(x); check(isOdd(x.n))")
DECLARED = """
/** Whether 2 does not divide it. */
function isOdd(n : int) : bool;
function turned(c : Colour) : Colour;
function heavy(n : int, by : float) : float;

pattern odd(x : Item) { Item(x); check(isOdd(x.n)); }
pattern weights(x : Item, w : float) { Item.n(x, n); w == eval(heavy(n, 2)); }
pattern odds(n : int) { n == count find odd(_); }
"""


def is_odd(n: int) -> bool:
    return n % 2 == 1


def registered(length: int = 5) -> Engine:
    made = Engine(chain(length))
    made.function("isOdd", is_odd)
    made.add(ODD)
    return made


def declared(rules: str = "", length: int = 5) -> Engine:
    made = Engine(chain(length))
    made.add(*from_text(DECLARED, "query"), *definitions(rules))
    return made


def test_a_function_is_called_once_for_each_candidate() -> None:
    calls = []
    made = Engine(chain(5))

    @made.function("isOdd")
    def counted(n: int) -> bool:
        calls.append(n)
        return n % 2 == 1

    made.add(Pattern("odd", "x : Item", "Item(x); check(x.n < 4 && isOdd(x.n))"))
    assert [match.x.id for match in made.matches("odd")] == [1, 3]
    assert calls == [0, 1, 2, 3]
    assert made.functions == ("isOdd",)


def test_all_matchers_agree_on_registered_functions() -> None:
    naive = Engine(chain(5), matcher=NaiveMatcher)
    naive.function("isOdd", is_odd)
    naive.add(ODD)
    assert [match.x.id for match in naive.matches("odd")] == [match.x.id for match in registered().matches("odd")]


def test_views_with_registered_functions_follow_changes() -> None:
    made = declared()
    made.function("isOdd", is_odd)
    made.watch("odd", "odds")
    before = made.commit()
    made.model.node(0).n = 7
    assert [match.x.id for match in made.matches("odd")] == [1, 3, 0]
    assert made.first("odds").n == 3
    made.checkout(before, discard=True)
    assert made.first("odds").n == 2


def test_views_recover_after_a_failing_function() -> None:
    made, broken = declared(), [False]

    def fragile(n: int) -> bool:
        if broken[0]:
            raise KeyError(n)
        return n % 2 == 1

    made.function("isOdd", fragile)
    made.watch("odds")
    broken[0] = True
    with pytest.raises(FunctionError):
        made.model.node(0).n = 7
        made.first("odds")
    broken[0] = False
    made.model.node(0).n = 9
    assert made.first("odds").n == 3
    made.model.check_integrity()


def test_rules_units_and_selections_call_them() -> None:
    made = declared(
        """
        rule heavier(x : Item) { lhs { x : Item; check(isOdd(x.n)); } modify { set x.weight = heavy(x.n, 2); } }
        rule turn { lhs { x : Item; } modify { create y : Item { colour = turned(x.colour) }; } }
        unit last { top 1 turn by heavy(x.n, 1); }
        """
    )
    made.function("isOdd", is_odd)
    made.function("heavy", lambda n, by: n / by)
    made.function("turned", lambda colour: {"red": "green", "green": "blue", "blue": "red"}[colour])
    assert len(made.apply_all("heavier")) == 2
    assert [node.weight for node in made.model.nodes("Item")] == [0.0, 0.5, 0.0, 1.5, 0.0]
    assert made.run("last").matches[0].x.id == 4
    assert [node.colour for node in made.model.nodes("Item")][5:] == ["green"]
    by = FunctionCall("heavy", (Navigation(Variable("x"), "n"), Navigation(Variable("x"), "weight")))
    made.model.node(3).weight = 1.0
    where: Expression = FunctionCall("isOdd", (Navigation(Variable("x"), "n"),))
    assert made.apply("turn", where=where, by=by).match["x"].id == 3


def test_a_declaration_can_be_checked_and_opened_without_code() -> None:
    made = declared()
    with pytest.raises(FunctionError) as raised:
        made.matches("weights")
    assert str(raised.value).splitlines() == [
        "<text>:8:64: function `heavy` is declared, but has no code",
        " 8 | pattern weights(x : Item, w : float) { Item.n(x, n); w == eval(heavy(n, 2)); }",
        "   |                                                                ^^^^^^^^^^^",
        'hint: give the engine its code: `engine.function("heavy", ..)`',
    ]
    made.function("heavy", lambda n, by: n * by)
    assert [match.w for match in made.matches("weights")] == [0.0, 2.0, 4.0, 6.0, 8.0]


def test_incremental_patterns_wait_for_the_code_of_their_functions() -> None:
    made = Engine(chain(3))
    made.add(*from_text(DECLARED.replace("pattern odd(", "incremental pattern odd("), "query"))
    made.function("isOdd", is_odd)
    assert made.count("odd") == 1
    assert made.watched == ("odd",)


def unreadable(n: int, by: float) -> float:
    raise ZeroDivisionError("no")


@pytest.mark.parametrize(
    ("code", "message"),
    [
        (lambda n, by: math.nan, "`heavy(0, 2.0)` returned nan, which is not of type `float`"),
        (lambda n, by: -math.inf, "`heavy(0, 2.0)` returned -inf, which is not of type `float`"),
        (lambda n, by: None, "`heavy(0, 2.0)` returned None, which is not of type `float`"),
        (lambda n, by: "abc", "`heavy(0, 2.0)` returned 'abc', which is not of type `float`"),
        (lambda n, by: True, "`heavy(0, 2.0)` returned True, which is not of type `float`"),
        (lambda n, by: 10**400, "`heavy(0, 2.0)` returned 1000000000000000"),
        (unreadable, "`heavy(0, 2.0)` raised ZeroDivisionError: no"),
    ],
)
def test_wrong_results_of_functions_are_errors_at_the_call(code: Callable[..., object], message: str) -> None:
    made = declared()
    made.function("heavy", code)
    with pytest.raises(FunctionError) as raised:
        made.matches("weights")
    assert raised.value.message.startswith(message)
    assert raised.value.function == "heavy"
    assert raised.value.span is not None
    assert raised.value.span.text == "heavy(n, 2)"
    assert (raised.value.__cause__ is not None) == (code is unreadable)


@pytest.mark.parametrize("result", [3, "purple", 1.0])
def test_an_enum_has_its_literals(result: object) -> None:
    made = declared("rule turn { lhs { x : Item; } modify { set x.colour = turned(x.colour); } }")
    made.function("turned", lambda colour: result)
    before = made.model.state_hash()
    with pytest.raises(FunctionError, match="which is not of type `Colour`"):
        made.apply("turn")
    assert made.model.state_hash() == before


def test_a_copy_has_the_functions_too() -> None:
    made = declared()
    made.function("isOdd", is_odd)
    twin = made.copy()
    twin.function("heavy", lambda n, by: n * by)
    assert twin.count("odd") == made.count("odd") == 2
    with pytest.raises(FunctionError):
        made.matches("weights")


def test_a_declaration_is_written_and_read() -> None:
    made = declared()
    text = to_text(*made.definitions)
    assert "/** Whether 2 does not divide it. */\nfunction isOdd(n : int) : bool;\n" in text
    assert from_text(text, "query") == made.definitions


def test_types_come_from_annotations_arguments_or_the_declaration() -> None:
    made = declared()
    made.function("hypot", math.hypot, {"x": float, "y": "float"}, float)
    made.function("way", lambda colour, text: colour, {"colour": "Colour", "text": str}, "Colour")
    made.function("isOdd", is_odd, {"n": int}, bool)
    signatures = [function.declaration.signature for function in made.library.functions.values()]
    assert signatures[3:] == [
        "hypot(x : float, y : float) : float",
        "way(colour : Colour, text : string) : Colour",
    ]
    made.function(unreadable)
    assert made.functions == ("isOdd", "turned", "heavy", "hypot", "way", "unreadable")


def test_wrong_function_registrations_are_refused() -> None:
    made = declared()
    made.function("isOdd", is_odd)
    refused: list[tuple[str, Callable[..., object], str]] = [
        ("isOdd", is_odd, "`isOdd` is already registered"),
        ("a", lambda x: x, "parameter `x` of function `a` has no type: write `int`"),
        ("not a name", is_odd, "a function needs a name"),
        ("heavy", is_odd, r"`heavy` must take 2 arguments, but its signature is `\(n: "),
        ("b", lambda *x: x, r"a parameter of function `b` must be positional and have no default: `\*x`"),
    ]
    for name, code, message in refused:
        with pytest.raises(InvalidArgument, match=message):
            made.function(name, code)
    with pytest.raises(InvalidArgument, match="expected a function to register, not 3"):
        made.function("c", 3)  # type: ignore[call-overload]
    with pytest.raises(
        InvalidArgument, match=r'must be a mapping from names to types, such as `\{"x": int\}`, not \(\('
    ):
        made.function("c", is_odd, (("n", int),), bool)  # type: ignore[call-overload]
    for name, types, message in (
        ("heavy", {"n": int}, "function `heavy` is declared twice, with different types"),
        ("sqrt", {"n": float}, "`sqrt` is a function of the language"),
        ("d", {"n": "Item"}, "`Item` is a class, but a function takes and returns values of data types"),
        ("e", {"n": "Colr"}, "unknown type `Colr`"),
    ):
        with pytest.raises(ResolutionError, match=message):
            made.function(name, lambda n: 1.0, types, float)
    assert made.functions == ("isOdd", "turned", "heavy")


def test_files_share_a_declaration() -> None:
    metamodel = "metamodel m\nclass P { int x }"
    one = 'import "m.metamodel"\nfunction f(x : int) : int;\npattern a(p : P) { P(p); check(f(p.x) > 1); }'
    other = 'import "one.query"\nfunction f(y : int) : int;\npattern b(p : P) { P(p); check(f(p.x) > 1); }'
    rules = 'import "one.query"\nrule r { lhs { p : P; } modify { set p.x = f(p.x); } }'
    files = TextFiles({"m.metamodel": metamodel, "one.query": one, "other.query": other, "r.rules": rules})
    workspace = load_workspace(["other.query", "r.rules"], files=files)
    assert not workspace.diagnostics
    assert workspace.engine().functions == ("f",)


def test_unknown_functions_get_a_suggestion() -> None:
    with pytest.raises(ResolutionError, match=r"unknown function `isodd`(.|\n)*hint: did you mean `isOdd`"):
        registered().add(Pattern("p", "x : Item", "Item(x); check(isodd(x.n))"))
