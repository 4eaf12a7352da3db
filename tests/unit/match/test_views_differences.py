"""Watched rules whose blocks ask for objects that differ from those outside: as many rows as links, not as pairs."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import pytest

from envgraph import Engine, Model, Node, Pattern, Rule
from envgraph.errors import EvaluationError
from envgraph.metamodel import Attribute, Class, Metamodel, Reference, Scalar

NODES = Metamodel(
    "nodes",
    (
        Class(
            "N",
            features=(
                Attribute("mark", Scalar.BOOL, default=False),
                Attribute("v", Scalar.INT, default=0),
                Reference("next", "N", 0, None),
            ),
        ),
    ),
)
LEFT = "x : N -next-> y : N; check !y.mark;"
BLOCKS = {
    "one": "not { y -next-> z : N; check !z.mark; }",
    "two": "not { y -next-> z : N -next-> u : N; check !u.mark; }",
    "nested": "not { y -next-> z : N; not { z -next-> u : N; check !u.mark; } }",
    "value": "not { y -next-> z : N; check z.v > x.v; }",
    "require": "require { y -next-> z : N -next-> u : N -next-> w : N; check !w.mark; }",
}
SIZE = 60


def chain(size: int) -> list[tuple[int, int]]:
    return [(number, number + 1) for number in range(size - 1)]


def star(size: int) -> list[tuple[int, int]]:
    """Links from half of the objects to the first, and from there to the other half."""
    return [(number, 0) if number < size // 2 else (0, number) for number in range(1, size)]


def engine(links: Iterable[tuple[int, int]], *definitions: Pattern | Rule) -> tuple[Engine, list[Node]]:
    model = Model(NODES)
    nodes = [model.create("N") for _ in range(SIZE)]
    for source, target in links:
        nodes[source].next.append(nodes[target])
    made = Engine(model)
    made.add(*definitions)
    return made, nodes


def held(made: Engine) -> int:
    """The rows of all views."""
    network = made.matcher.watched_views.network  # type: ignore[attr-defined]
    return sum(len(getattr(each, "rows", ())) for each in network.operators.values())


def view_of(made: Engine, name: str) -> Any:
    """Return the view of a watched pattern."""
    network = made.matcher.watched_views.network  # type: ignore[attr-defined]
    return network.operators[name]


def rule(block: str) -> Rule:
    return Rule("r", lhs=LEFT, blocks=block, modify="set y.mark = true;")


@pytest.mark.parametrize("name", BLOCKS)
def test_the_rows_of_a_watched_chain_are_as_many_as_its_links(name: str) -> None:
    made, nodes = engine(chain(SIZE), rule(BLOCKS[name]))
    expected = made.count("r")
    made.watch("r")
    assert made.count("r") == expected
    assert held(made) <= 6 * SIZE
    for node in nodes[::2]:
        node.mark = True
    unwatched, others = engine(chain(SIZE), rule(BLOCKS[name]))
    for node in others[::2]:
        node.mark = True
    assert made.count("r") == unwatched.count("r")
    made.check_integrity()


def test_views_of_a_star_take_linear_work_for_bulk_changes(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    queued = 0

    def counted(view: Any) -> None:
        nonlocal queued
        queued += len(view.queue) // 2
        process(view)

    made, nodes = engine(star(SIZE), rule(BLOCKS["one"]))
    made.watch("r")
    assert held(made) <= 4 * SIZE
    view_class = type(view_of(made, "r#lhs"))
    process = view_class.process
    monkeypatch.setattr(view_class, "process", counted)
    for mark in (True, False, True):
        for node in nodes[SIZE // 2 :]:
            node.mark = mark
        # All links to the star match while every `z` is marked; those to the ends match while the ends are not.
        assert made.count("r") == (SIZE // 2 - 1 if mark else SIZE // 2)
    assert queued <= 12 * SIZE
    made.check_integrity()


def test_differing_objects_are_counted_for_the_needed_pairs_only() -> None:
    other = Pattern("other", "x : N, y : N, z : N", "N.next(y, z); x != z;")
    asked = Pattern("asked", "x : N, y : N, n : int", "N.next(x, y); n == count find other(x, y, _);")
    made, nodes = engine([*chain(SIZE), (1, 0), (1, 5)], other, asked)
    made.watch("asked")
    assert held(made) <= 4 * SIZE
    assert made.first("asked", x=nodes[0], y=nodes[1])["n"] == 2  # not back to `x`
    nodes[1].next.remove(nodes[5])
    assert made.first("asked", x=nodes[0], y=nodes[1])["n"] == 1
    made.check_integrity()


def test_blocks_compare_values_of_the_left_side() -> None:
    above = Rule(
        "r",
        lhs="x : N -next-> y : N; N.v(x, k);",
        blocks="not { y -next-> z : N; check z.v > k; }",
        modify="set y.mark = true;",
    )
    made, nodes = engine(chain(SIZE), above)
    made.watch("r")
    assert "recomputed after" not in made.explain("r")
    nodes[2].v = 1
    assert made.count("r") == SIZE - 2
    made.check_integrity()


def test_calls_may_have_only_constant_arguments() -> None:
    apart = Pattern("apart", "i : int, k : int", "N.v(_, i); N.v(_, k); i != k;")
    asked = Pattern("asked", "x : N", "N(x); neg find apart(1, 2); neg find apart(_, 3);")
    made, nodes = engine((), apart, asked)
    made.watch("asked")
    assert made.count("asked") == SIZE
    nodes[0].v, nodes[1].v = 1, 2
    assert made.count("asked") == 0
    nodes[0].v = 0
    assert made.count("asked") == SIZE
    nodes[0].v = 3
    assert made.count("asked") == 0
    made.check_integrity()


def test_the_limit_message_names_the_block_and_unlinked_variables(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("ENVGRAPH_LIMITS", "0.001")
    pairs = Rule("r", lhs="x : N; y : N;", modify="set y.mark = true;")
    made, _ = engine((), pairs)
    with pytest.raises(EvaluationError) as caught:
        made.watch("r")
    assert "`r` has more than 1,000 combinations of objects: nothing connects `y` with" in str(caught.value)
    assert "hint: connect `y` with another variable by a link" in str(caught.value)
    inside = "not { z : N; u : N; check z.v + u.v < 1; }"
    both = Rule("r", lhs="x : N;", blocks=inside, modify="set x.mark = true;", injective=False)
    made, _ = engine((), both)
    with pytest.raises(EvaluationError, match="the `not` block of `r` has more than 1,000 combinations"):
        made.watch("r")
