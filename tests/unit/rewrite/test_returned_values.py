"""Functions of people that return what means nothing, or do not run when they are called."""

from __future__ import annotations

from collections.abc import Callable, Iterator

import pytest

from envgraph.errors import InvalidArgument
from envgraph.graph import Node
from envgraph.rewrite import Engine, Match
from tests.unit.rewrite.graphs import chain, definitions, patterns


@pytest.mark.parametrize("value", [float("nan"), "abc", 10**400, 0.0, []], ids=repr)
def test_meaningless_function_results_name_the_function(value: object) -> None:
    engine = Engine(chain(3), seed=1)
    engine.add(*patterns("pattern big(a : Item) { Item.n(a, n); check(n > 1); }"))

    @engine.rule("big")
    def shrink(a: Node) -> object:
        a.n = 0
        return value

    @engine.unit
    def whole(engine: Engine) -> object:
        engine.model.nodes("Item")[0].n = 7
        return value

    before = engine.model.state_hash()
    with pytest.raises(InvalidArgument, match=r"rule `shrink` returned an? `.*`, .* must return None"):
        engine.apply("shrink")
    with pytest.raises(InvalidArgument, match=r"unit `whole` returned an? `.*`, but must return False if it failed"):
        engine.run("whole")
    assert engine.model.state_hash() == before


@pytest.mark.parametrize(
    ("by", "message"),
    [
        (lambda match: float("nan"), "`by` is nan at a match of `up`"),
        (lambda match: "x" if match.a.n else 3, "the values of `by` cannot order the matches of `up`"),
        (lambda match: {}, "the values of `by` cannot order the matches of `up`"),
    ],
)
def test_values_without_an_order_name_the_rule(by: Callable[[Match], object], message: str) -> None:
    engine = Engine(chain(3), seed=1)
    engine.add(*definitions("rule up { lhs { a : Item; } modify { set a.n = a.n + 1; } }"))
    with pytest.raises(InvalidArgument, match=message):
        engine.apply("up", by=by)
    assert engine.apply("up", by=lambda match: 10**400 * match.a.n) is not None  # a number like any other


def test_listeners_with_wrong_signatures_are_refused() -> None:
    engine = Engine(chain(3), seed=1)
    engine.add(*patterns("pattern big(a : Item) { Item.n(a, n); check(n > 1); }"))

    async def later(appeared: object, disappeared: object) -> None: ...

    def some(appeared: object, disappeared: object) -> Iterator[int]:
        yield 1

    def job(a: Node) -> Iterator[int]:
        yield 1

    engine.watch("big")
    with pytest.raises(InvalidArgument, match="`later` is a coroutine, whose body a call does not execute"):
        engine.listen("big", later)
    with pytest.raises(InvalidArgument, match="`some` is a generator"):
        engine.listen("big", some)
    with pytest.raises(InvalidArgument, match="`job` is a generator"):
        engine.on("big", appear=job)
