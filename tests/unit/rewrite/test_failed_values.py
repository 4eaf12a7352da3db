"""A value that cannot be computed: which part of the expression is shown, and what is said about it."""

from __future__ import annotations

import pytest

from envgraph import Rule
from envgraph.errors import EvaluationError
from envgraph.graph import Model, check_conformance
from envgraph.metamodel import Attribute, Class, Metamodel, Reference, Scalar
from envgraph.rewrite import Engine
from tests.unit.rewrite.graphs import chain, engine, snapshot

LARGE = 9223372036854775807


@pytest.mark.parametrize(
    ("expression", "part", "hint"),
    [
        ("1 + 2 / a.n", "2 / a.n", "write `check a.n != 0;` on the left side"),
        ("7 % (a.n * 2)", "7 % (a.n * 2)", "write `check (a.n * 2) != 0;` on the left side"),
        (
            "1 + mod(1, a.n - a.n)",
            "mod(1, a.n - a.n)",
            "write `check (a.n - a.n) != 0;` on the left side",
        ),
        ("1 / a.n > 0 ? 1 : 2", "1 / a.n", "write `check a.n != 0;` on the left side"),
        ("a.n == 0 ? 1 / a.n : 2", "1 / a.n", "write `check a.n != 0;` on the left side"),
        ("a.n == 0 && 1 / a.n > 0 ? 1 : 2", "1 / a.n", "write `check a.n != 0;` on the left side"),
        ("a.n == 1 || 1 / a.n > 0 ? 1 : 2", "1 / a.n", "write `check a.n != 0;` on the left side"),
        ("-(1 / a.n)", "(1 / a.n)", "write `check a.n != 0;` on the left side"),
        ("a.prev.n", "a.prev.n", "write `check a.prev.n != none;` on the left side"),
        ("a.n == 0 ? a.prev.n : 1", "a.n == 0 ? a.prev.n : 1", ""),
        ("1 + a.prev.n", "a.prev.n", "write `check a.prev.n != none;` on the left side"),
        (f"{LARGE} - a.n + 1", f"{LARGE} - a.n + 1", "use smaller numbers"),
        ("1 + 1 + 1 + 1 + 1 + 1 + 1 + 1 / a.n", "1 / a.n", "write `check a.n != 0;` on the left side"),
    ],
)
@pytest.mark.parametrize("block", ["", "forall "])
def test_the_smallest_part_without_a_value_is_shown(expression: str, part: str, hint: str, block: str) -> None:
    right = f"modify {{ set a.n = {expression}; }}"
    made = engine(
        f"rule r(a : Item) {{ lhs {{ }} {f'forall {{ lhs {{ b : Box; }} {right} }}' if block else right} }}",
        model=chain(2),
    )
    if block:
        made.model.create("Box")
    with pytest.raises(EvaluationError, match=r"^test\.rules:1:") as caught:
        made.apply("r", a=0)
    assert caught.value.message.startswith("rule `r` cannot be applied: ")
    assert caught.value.span is not None and caught.value.span.text == part
    assert (caught.value.hint or "").startswith(hint)


def test_evaluation_errors_of_added_values_show_the_action() -> None:
    made = engine(f"rule r(a : Item) {{ lhs {{ }} modify {{ set a.n += {LARGE}; }} }}", model=chain(2))
    with pytest.raises(EvaluationError) as caught:
        made.apply("r", a=1)
    assert caught.value.span is not None and caught.value.span.text == f"set a.n += {LARGE}"
    assert (caught.value.hint or "").endswith("an `int` has at most 64 bits")


@pytest.mark.parametrize(
    "action",
    [
        "create x : Item { n = a.prev.n }",
        "create x : Item { label = a.prev.label }",
        "set a.weight = a.prev.weight",
        "set a.n += a.prev.n",
        "set a.n = a.prev.prev.n",
    ],
)
def test_setting_an_attribute_to_a_missing_value_is_an_error(action: str) -> None:
    made = engine(f"rule r(a : Item) {{ lhs {{ }} modify {{ {action}; }} }}", model=chain(3))
    before = snapshot(made.model)
    with pytest.raises(EvaluationError, match="has no value") as caught:
        made.apply("r", a=0)
    assert caught.value.span is not None and caught.value.span.text.startswith("a.prev")
    assert snapshot(made.model) == before
    assert made.apply("r", a=2) is not None


def test_missing_values_clear_references_and_optional_attributes() -> None:
    cls = Class("A", features=(Attribute("note", Scalar.STRING, lower=0), Reference("next", "A", lower=0)))
    made = Engine(Model(Metamodel("m", (cls,))))
    made.add(Rule("r", "a : A", lhs="", modify="set a.note = a.next.note; set a.next = a.next.next;"))
    a = made.model.create("A", note="x")
    b = made.model.create("A", note="y")
    a.next = b
    made.apply("r", a=a)
    assert (a.note, a.next) == ("y", None)
    made.apply("r", a=a)
    assert (a.note, a.next) == (None, None) and not check_conformance(made.model)


def test_functions_of_strings_need_no_brackets() -> None:
    made = engine(
        """
        rule measure(x : Item) {
            lhs { x : Item; check(x.next.label.length > 1); }
            modify { set x.n = x.next.label.trim.length + x.label.length; }
        }
        unit each { all measure where check(x.label.isEmpty); }
        """,
        model=chain(3),
    )
    for node, label in zip(made.model.nodes("Item"), ("", " abc ", "de"), strict=True):
        node.label = label
    assert made.run("each").applications == 1
    assert [node.n for node in made.model.nodes("Item")] == [3, 1, 2]
