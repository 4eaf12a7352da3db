"""Watched patterns that ask for objects inside a negation that differ from those outside: against the naive matcher.

`not { y -next-> z : N; }` becomes a pattern over `x` and `y` in which nothing but `z != x` mentions `x`. So do nested
blocks, `count` and conditions over values of both sides.
"""

from __future__ import annotations

from itertools import pairwise

import pytest
from hypothesis import HealthCheck, example, given, settings, strategies as st

from envgraph.graph import Model
from envgraph.metamodel import Attribute, Class, Metamodel, Reference, Scalar
from envgraph.pattern import (
    Binary,
    Check,
    Constraint,
    Library,
    Navigation,
    Parameter,
    Pattern,
    Variable,
)
from tests.oracle.views_walk import Walk, step
from tests.oracle.worlds import Dice, RandomCase
from tests.thresholds import EAGER, set_thresholds
from tests.unit.match.writing import equal, find, fold, is_a, neg, path, pattern, unequal

METAMODEL = Metamodel(
    "differences",
    (
        Class(
            "N",
            features=(
                Attribute("v", Scalar.INT),
                Reference("next", "N", 0, 1),
                Reference("to", "N", 0, None),
                Reference("near", "N", 0, None, opposite="near"),
            ),
        ),
        Class("M", False, ("N",)),
    ),
)
LINKS = ("next", "to", "to", "near")
OUTER, INNER = "xyw", "abc"


def inside(dice: Dice, number: int, called: list[Pattern]) -> Pattern:
    """A pattern over two or three outer objects, some of which only differ from the objects inside."""
    heads = list(OUTER[: dice.one([2, 2, 3])])
    near, names = dice.one(heads), list(INNER[: dice.one([1, 1, 2, 3])])
    found: list[Constraint] = [is_a("N", head) for head in heads]
    for far in names:
        ends = (near, far) if dice.chance(75) else (far, near)
        found.append(path(f"N.{dice.one(LINKS)}", *ends))
        near = dice.one([near, far, far])
    for name in names:
        found += [unequal(name, head) for head in heads if dice.chance(60)]
    if dice.chance(25):
        found.append(Check(_compared(dice, dice.one(names), dice.one(heads))))
    if dice.chance(20):
        found.append(is_a("M", dice.one([*names, *heads])))
    if called and dice.chance(50):
        found.append(_asked(dice, dice.one(called), [*heads, *names]))
    exported = [*heads, *(f"{name} : N" for name in names[: dice.number(0, 1)])]
    typed = [name if ":" in name else f"{name} : N" for name in exported]
    return pattern(f"inside{number}({', '.join(typed)})", found)


def _compared(dice: Dice, one: str, other: str) -> Binary:
    sides = (Navigation(Variable(one), "v"), Navigation(Variable(other), "v"))
    return Binary(dice.one(["<", "!=", "=="]), *sides)


def _asked(dice: Dice, called: Pattern, names: list[str]) -> Constraint:
    """A negation, a number or a call of a pattern, about some of these objects."""
    outer = len([p for p in called.parameters if p.name in OUTER])
    own = len(called.parameters) - outer
    arguments = [dice.one(names) if dice.chance(20) else name for name in (names * 2)[:outer]]
    rest = [dice.one([*names, "_", "_"]) for _ in range(own)]
    over = find(called.name, *arguments, *rest)
    match dice.number(0, 5):
        case 0 | 1 | 2:
            return neg(over)
        case 3:
            return equal(dice.number(0, 2), fold("count", over))
        case _:
            return over


def outside(dice: Dice, number: int, called: list[Pattern]) -> Pattern:
    """A pattern that links outer objects and asks about the inside ones."""
    heads = list(OUTER[: dice.number(2, 3)])
    found: list[Constraint] = [is_a("N", name) for name in heads]
    for one, other in pairwise(heads):
        if dice.chance(85):
            found.append(path(f"N.{dice.one(LINKS)}{dice.one(['', '', '', '', '+'])}", one, other))
        if dice.chance(60):
            found.append(unequal(one, other))
    if dice.chance(20):
        found.append(Check(_compared(dice, *heads[:2])))
    for _ in range(dice.one([1, 1, 2])):
        found.append(_asked(dice, dice.one(called), heads))
    parameters = tuple(Parameter(name, "N") for name in heads[: dice.number(1, len(heads))])
    made = pattern(f"outside{number}(x : N)", found)
    return Pattern(made.name, parameters, made.bodies)


def random_difference_case(seed: int, size: int = 1) -> RandomCase:
    """Such patterns, and a model of a few objects."""
    dice = Dice(seed)
    library, model = Library(METAMODEL), Model(METAMODEL)
    insides: list[Pattern] = []
    for number in range(dice.number(1, 3)):
        insides.append(inside(dice, number, insides[-1:]))
    outsides = [outside(dice, number, insides) for number in range(2)]
    for each in (*insides, *outsides):
        library.add(each)
    found = RandomCase(library, model, dice)
    for _ in range(dice.number(2, 5) * size):
        model.graph.new(dice.one(["N", "N", "M"]))
    found.edit(dice.number(0, 25) * size)
    return found


def stroll(seed: int, patched: bool) -> None:
    """A walk in such a world, with only what is outside watched."""
    with pytest.MonkeyPatch.context() as patch:
        set_thresholds(patch, EAGER if patched else {})
        dice = Dice(seed)
        walk = Walk(seed, watch=0, world=random_difference_case)
        walk.views.watch(*(name for name in walk.sizes if name.startswith("outside") or dice.chance(10)))
        walk.check()
        for _ in range(dice.number(3, 12)):
            step(walk, dice)
            if dice.chance(80):
                walk.check()
        walk.close()


@settings(max_examples=int(0.4 * settings().max_examples), suppress_health_check=list(HealthCheck), deadline=None)
@given(seed=st.integers(0, 2**32), patched=st.booleans())
@example(seed=1, patched=False)
def test_watched_patterns_with_differences_agree_with_the_naive_matcher(seed: int, patched: bool) -> None:
    stroll(seed, patched)
