"""Selection of matches of a rule from Python: by a condition, the first, or the best by a value."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from math import isnan
from typing import Any, Literal

from envgraph.errors import InvalidArgument
from envgraph.match import FREE
from envgraph.pattern import Expression, value_of
from envgraph.rewrite._matches import Match, Row
from envgraph.rewrite.engine._catalog import Catalog
from envgraph.rewrite.run._rule_runner import RuleRunner
from envgraph.rewrite.run._unit_runtime import largest_first, read_feature

Choose = Literal["random", "first"] | Callable[[list[Match]], "Match | None"]
"""The way to choose a match: draw it uniformly, take the first, or call a function of the user."""

Where = str | Expression | Callable[[Match], object]
"""A condition on matches: the name of a pattern whose parameters are bound to the match variables of the same names, an
expression over the variables of the match, or a function."""

By = Expression | Callable[[Match], Any]
"""The value by which matches are ordered: an expression over their variables, or a function."""


def select_rows(
    catalog: Catalog,
    rule: RuleRunner,
    rows: Sequence[Row],
    where: Where | None,
    by: By | None,
    top: int | None,
) -> list[Row]:
    """Return the rows for which `where` holds. With `by`, sort them by value, largest first, and return at most `top`.

    Rows with equal values keep their order.

    Raises:
        InvalidArgument: the pattern is unknown or shares no variable with the rule, `top` is invalid, or values of `by`
            cannot be ordered.
    """
    if top is not None and (type(top) is not int or top < 1):
        raise InvalidArgument(f"`top` is {top!r}, but must be a whole number from 1")
    if top is not None and by is None:
        raise InvalidArgument("`top` needs `by`, which orders the matches")
    found = list(filter_rows(catalog, rule, rows, where))
    return found if by is None else _best_by_user_value(found, _row_value(catalog, rule, by), rule, top)


def _best_by_user_value(
    rows: Sequence[Row], value: Callable[[Row], Any], rule: RuleRunner, top: int | None
) -> list[Row]:
    """Return the rows with the largest values, largest first, at most `top` if it is set. Values of None are left out.

    Raises:
        InvalidArgument: a value is nan, or the values cannot be ordered.
    """
    valued = {row: value(row) for row in rows}
    if any(isinstance(one, float) and isnan(one) for one in valued.values()):
        raise InvalidArgument(f"`by` is nan at a match of `{rule.name}`: return None if there is no value")
    try:
        return largest_first(rows, valued.__getitem__, top)
    except TypeError as error:
        raise InvalidArgument(f"the values of `by` cannot order the matches of `{rule.name}`: {error}") from error


def filter_rows(catalog: Catalog, rule: RuleRunner, rows: Iterable[Row], where: Where | None) -> Iterator[Row]:
    """Yield the rows for which `where` holds, in their order. Exceptions are raised as in `select_rows`."""
    return iter(rows) if where is None else filter(_row_condition(catalog, rule, where), rows)


def choose_row(
    catalog: Catalog, rule: RuleRunner, rows: Sequence[Row], choose: Choose, pick: Callable[[int], int]
) -> Row | None:
    """Return the row that `choose` chooses; None if there are no rows or a function `choose` returns None.

    `pick` draws a random index below a number.

    Raises:
        InvalidArgument: `choose` is no valid choice, or the function returns something other than one of its matches.
    """
    if not (choose in ("random", "first") or callable(choose)):
        raise InvalidArgument(f'`choose` must be "random", "first" or a function, not {choose!r}')
    if not rows:
        return None
    if choose == "random":
        return rows[pick(len(rows))]
    if choose == "first":
        return rows[0]
    assert not isinstance(choose, str)
    matches = [Match(catalog.model, rule.shape, row) for row in rows]
    chosen = choose(matches)
    if chosen is not None and chosen not in matches:
        raise InvalidArgument(f"`choose` must return one of the matches passed to it or None, not {chosen!r}")
    return None if chosen is None else chosen.row


def _row_condition(catalog: Catalog, rule: RuleRunner, where: Where) -> Callable[[Row], bool]:
    if isinstance(where, str):
        return _pattern_condition(catalog, rule, where)
    value = _row_value(catalog, rule, where)
    return lambda row: bool(value(row))


def _pattern_condition(catalog: Catalog, rule: RuleRunner, name: str) -> Callable[[Row], bool]:
    pattern, names = catalog.pattern_parameters(name)
    own = rule.shape.names
    if not set(names) & set(own):
        known = ", ".join(f"`{variable}`" for variable in own) or "none"
        raise InvalidArgument(
            f"`{name}` has no parameter that is a variable of `{rule.name}`, whose variables are {known}"
        )
    places = [own.index(parameter) if parameter in own else None for parameter in names]
    exists = catalog.matcher.exists
    return lambda row: exists(pattern, tuple(FREE if place is None else row[place] for place in places))


def _row_value(catalog: Catalog, rule: RuleRunner, asked: Expression | Callable[[Match], Any]) -> Callable[[Row], Any]:
    model, shape = catalog.model, rule.shape
    if isinstance(asked, Expression):
        expression = catalog.library.with_functions_resolved(asked)
        return lambda row: value_of(
            expression,
            dict(zip(shape.names, row, strict=True)),
            lambda node, feature: read_feature(model, node, feature),
        )
    if not callable(asked):
        raise InvalidArgument(
            f"expected a function of the match, or an expression of `envgraph.pattern`, not {asked!r}: "
            "write `lambda match: ..`"
        )
    function = asked
    return lambda row: function(Match(model, shape, row))
