"""Views of aggregates over groups that grow and shrink, against the matcher that reads each group anew."""

from __future__ import annotations

from itertools import repeat

import pytest
from hypothesis import given, settings, strategies as st

from envgraph.graph import Model, Store
from envgraph.lang import from_text
from envgraph.match import FREE, CompiledMatcher, ViewMatcher
from envgraph.match._aggregate_values import aggregate
from envgraph.match._match_costs import ViewCosts
from envgraph.match.views.operators import _group_aggregates as _folds
from envgraph.match.views.operators._running_aggregates import RunningTotal
from envgraph.metamodel import Attribute, Class, Metamodel, Reference, Scalar
from envgraph.pattern import Library, Pattern
from tests.oracle.worlds import Dice

EXAMPLES = settings().max_examples
FUNCTIONS = ("sum", "avg", "min", "max")
SHOP = Metamodel(
    "shop",
    (
        Class("Shop", features=(Reference("items", "Item", 0, None),)),
        Class(
            "Item",
            features=(Attribute("stock", Scalar.INT), Attribute("price", Scalar.FLOAT)),
        ),
    ),
)
(ITEMS,) = SHOP.references
STOCK, PRICE = SHOP.attributes
COLUMNS = {"stock": "int", "price": "float"}
NAMES = tuple(f"{function}_{column}" for column in COLUMNS for function in FUNCTIONS)
TEXT = "".join(
    f"""
    pattern each_{column}(s : Shop, i : Item, v : {type_}) {{ Shop.items(s, i); Item.{column}(i, v); }}
    """
    + "".join(
        f"""
        pattern {function}_{column}(s : Shop, v : {"float" if function == "avg" else type_}) {{
            Shop(s); v == {function} find each_{column}(s, _, #);
        }}
        """
        for function in FUNCTIONS
    )
    for column, type_ in COLUMNS.items()
)
INTS = (0, 1, 1, 2, -3, 7, 2**53 + 1, 2**62, -(2**63))
FLOATS = (0.1, 0.1, 0.2, -0.3, 1e16, 1e308, -1e308, 5e-324, float("inf"))


def library() -> Library:
    """The aggregates."""
    found = Library(SHOP)
    found.add(*(each for each in from_text(TEXT, "query") if isinstance(each, Pattern)))
    return found


class Stock:
    """A model of two shops, its views, and the matcher that knows nothing of them."""

    def __init__(self, size: int) -> None:
        self.model = Model(SHOP)
        self.shops = [self.model.graph.new("Shop") for _ in range(2)]
        self.items = [self.model.graph.new("Item") for _ in range(size)]
        queries = library()
        self.views = ViewMatcher(self.model, queries)
        self.anew = CompiledMatcher(self.model, queries)

    def change(self, dice: Dice) -> None:
        """One link or value."""
        model, item = self.model, dice.one(self.items)
        match dice.number(0, 4):
            case 0 | 1:
                model.graph.link(dice.one(self.shops), ITEMS, item)
            case 2:
                model.graph.unlink(dice.one(self.shops), ITEMS, item)
            case 3:
                model.graph.set_value(item, STOCK, dice.one(INTS))
            case _:
                model.graph.set_value(item, PRICE, dice.one([*FLOATS, None]))

    def values(self) -> dict[str, list[tuple[object, ...]]]:
        """What the views list."""
        return {name: list(self.views.rows(name, (FREE, FREE))) for name in NAMES}

    def check(self) -> None:
        """Compare."""
        for name, rows in self.values().items():
            assert sorted(rows) == sorted(self.anew.rows(name, (FREE, FREE))), name
        self.views.check_integrity()


def episode(dice: Dice, stock: Stock, nested: int) -> None:
    """A transaction, perhaps with others inside."""
    before, savepoint = stock.values(), stock.model.graph.history.savepoint()
    for _ in range(dice.number(1, 8)):
        stock.change(dice)
        if dice.chance(50):
            stock.check()
    if nested and dice.chance(40):
        episode(dice, stock, nested - 1)
    stock.check()
    after = stock.values()
    match dice.number(0, 3):
        case 0 | 1:
            stock.model.graph.history.release(savepoint)
        case 2:
            stock.model.graph.history.rollback(savepoint)
            assert stock.values() == before
        case _:
            shelf = stock.model.graph.history.undo_to(savepoint)
            assert stock.values() == before
            stock.model.graph.history.release(stock.model.graph.history.redo(shelf))
            assert stock.values() == after
    stock.check()


@settings(max_examples=EXAMPLES // 2)
@given(seed=st.integers(0, 2**32), large=st.sampled_from((0, 2, 5)))
def test_incremental_aggregates_equal_recomputed_aggregates(seed: int, large: int) -> None:
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(ViewCosts, "large", large)
        dice = Dice(seed)
        stock = Stock(dice.number(1, 12))
        for _ in range(dice.number(0, 20)):
            stock.change(dice)
        stock.views.watch(*NAMES)
        versions = []
        for _ in range(dice.number(1, 5)):
            episode(dice, stock, 2)
            if dice.chance(40):
                versions.append((stock.model.commit(), stock.values()))
            while versions and dice.chance(40):
                for _ in range(dice.number(0, 4)):
                    stock.change(dice)
                    stock.check()
                version, values = dice.one(versions)
                stock.model.checkout(version, discard=True)
                assert stock.values() == values
                stock.check()


def test_change_in_a_large_group_does_not_recompute_its_aggregate(monkeypatch: pytest.MonkeyPatch) -> None:
    stock = Stock(500)
    for number, item in enumerate(stock.items):
        stock.model.graph.set_value(item, STOCK, number)
        stock.model.graph.set_value(item, PRICE, number / 10)
        stock.model.graph.link(stock.shops[0], ITEMS, item)
    stock.views.watch(*NAMES)
    first, last = stock.items[0], stock.items[-1]
    stock.model.graph.set_value(first, STOCK, -1)  # from here on the aggregates run
    stock.model.graph.set_value(last, PRICE, 100.5)
    stock.check()
    read: list[str] = []
    monkeypatch.setattr(_folds, "aggregate", lambda function, _: read.append(function))
    savepoint = stock.model.graph.history.savepoint()
    for item in (first, last):
        stock.model.graph.unlink(stock.shops[0], ITEMS, item)
        stock.model.graph.set_value(item, STOCK, 1000)
        stock.model.graph.link(stock.shops[0], ITEMS, item)
    assert stock.views.count("max_stock", (stock.shops[0], 1000)) == 1
    assert stock.views.count("min_stock", (stock.shops[0], 1)) == 1
    stock.model.graph.history.rollback(savepoint)
    assert stock.views.count("max_stock", (stock.shops[0], 499)) == 1
    assert not read
    monkeypatch.undo()
    stock.check()


def test_memory_of_extremes_is_bounded_under_repeated_changes() -> None:
    stock = Stock(100)
    for number, item in enumerate(stock.items):
        stock.model.graph.set_value(item, STOCK, number)
        stock.model.graph.link(stock.shops[0], ITEMS, item)
    stock.views.watch("min_stock")
    for round_ in range(2_000):
        stock.model.graph.set_value(stock.items[50], STOCK, 1_000 + round_)
        stock.views.watched_views.process_pending()
    operators = stock.views.watched_views.network.operators.values()
    (fold,) = (operator for operator in operators if isinstance(operator, _folds.AggregateOperator))
    (running,) = fold._running.values()
    assert isinstance(running, _folds.RunningExtreme)
    assert len(running._heap) <= 2 * 100 + 64
    assert len(running._counts) <= 2 * 100 + 64
    stock.check()


@given(
    st.sampled_from(("sum", "avg")),
    st.lists(st.sampled_from((*INTS, *FLOATS, float("-inf"))), min_size=1, max_size=6),
    st.lists(st.sampled_from((*INTS, *FLOATS)), max_size=4),
)
def test_incremental_totals_equal_the_aggregate_or_are_unknown(
    function: str, values: list[int | float], gone: list[int | float]
) -> None:
    totals = RunningTotal(Store(SHOP), function, [*values, *gone])
    totals.apply_changes([(value, -1) for value in gone])
    mixed = len({type(value) for value in values}) > 1
    assert not (mixed and totals.is_exact)
    if totals.is_exact:
        assert totals.value() == aggregate(function, values)


@pytest.mark.parametrize(
    "values",
    [
        [1e308, 1e308, -1e308],
        [-1e308, 1e308, 1e308],
        [0.1] * 10,
        [1e16, 1.0, -1e16],
        [5e-324] * 3,
        [1e308, 1e308],
    ],
)
def test_the_sum_of_floats_does_not_depend_on_their_order(values: list[float]) -> None:
    orders = [values, values[::-1], sorted(values)]
    assert len({repr(aggregate("sum", order)) for order in orders}) == 1
    assert len({repr(aggregate("avg", order)) for order in orders}) == 1


def test_sums_that_overflow_are_none() -> None:
    assert aggregate("sum", [1e308] * 2) is None
    assert aggregate("sum", list(repeat(2**62, 2))) is None
    assert aggregate("sum", [float("inf"), float("-inf")]) is None
