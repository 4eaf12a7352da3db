"""A value that cannot be computed: which part of the expression is shown, and what is said about it."""

from __future__ import annotations

import pytest

from envgraph.errors import EvaluationError
from tests.unit.rewrite.graphs import chain, engine

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
        ("1 + a.prev.n", "a.prev.n", "write `check a.prev.n != none;` on the left side"),
        (f"{LARGE} - a.n + 1", f"{LARGE} - a.n + 1", "an `int` has at most 64 bits"),
        ("1 + 1 + 1 + 1 + 1 + 1 + 1 + 1 / a.n", "1 / a.n", "write `check a.n != 0;` on the left side"),
    ],
)
@pytest.mark.parametrize("block", ["", "forall "])
def test_the_smallest_part_without_a_value_is_shown(
    expression: str, part: str, hint: str, block: str
) -> None:
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


def test_what_is_added_shows_the_action() -> None:
    made = engine(f"rule r(a : Item) {{ lhs {{ }} modify {{ set a.n += {LARGE}; }} }}", model=chain(2))
    with pytest.raises(EvaluationError) as caught:
        made.apply("r", a=1)
    assert caught.value.span is not None and caught.value.span.text == f"set a.n += {LARGE}"
    assert (caught.value.hint or "").startswith("an `int` has at most 64 bits")
