"""Random units over the graphs of `tests/unit/rewrite/graphs.py`, as text."""

from __future__ import annotations

from random import Random
from typing import Final

from envgraph.behaviour import Action, Behaviour, Branch, Domain, ObserveFind, ObserveRange, OnRefused, RuleCall
from envgraph.pattern import Constant, Navigation, Parameter, PatternCall, Variable
from envgraph.rewrite import Engine
from tests.unit.rewrite.graphs import chain, definitions, patterns

QUERIES: Final = """
pattern big(a : Item) { Item.n(a, n); check(n > 2); }
pattern linked(a : Item, b : Item) { Item.links(a, b); }
"""

RULES: Final = """
rule up(a : Item) { lhs { check a.n < 6; } modify { set a.n = a.n + 1; } }
rule mark(a : Item, value : int) { lhs { } modify { set a.n = value; } }
rule read(a : Item, out value : int) { lhs { Item.n(a, value); } }
rule next(a : Item, out b : Item) { lhs { a -next-> b; } }
rule link(a : Item, b : Item) { lhs { } not { a -links-> b; } modify { create a -links-> b; } }
rule bind(a : Item, b : Item) { lhs { } not { a -pair-> b; } modify { create a -pair-> b; } }
rule grow { lhs { } modify { create new : Item { n = 3 }; } }
rule born(out new : Item) { lhs { } modify { create new : Special { n = 1 }; } }
rule cut(a : Item) { lhs { } modify { delete a; } }
@semantics(spo) rule drop(a : Item) { lhs { check a.n > 4; } modify { delete a; } }
rule adopt(a : Item, b : Item) { lhs { } modify { move b to a.kids; } }
rule never { lhs { a : Box; } modify { delete a; } }
@weight(3.0) rule heavy { lhs { a : Item; check a.n < 9; } modify { set a.n += 2; } }
@priority(1) rule urgent { lhs { a : Item; check a.n == 0; } modify { set a.n = 5; } }
rule prune(a : Item) { lhs { } forall+ { lhs { a -links-> b : Item; } modify { delete a -links-> b; } } }
derive kinds = retype among { Item, Special };
unit twice(a : Item) { up(a); up(a); }
unit after(a : Item, out c : Item) { next(a, b); next(b, c); }
@priority(1) unit half { grow; never; }
unit value(a : Item, out x : int) { atomic { read(a, x); grow; } }
"""


def random_unit_case(seed: int) -> tuple[Engine, Behaviour]:
    """A unit that an action runs, with so few steps that some take more, and often a meaning of what is refused."""
    model, random = chain(1 + seed % 4), Random(seed + 1)
    model.node(seed % 4).links.append(model.node(0))
    engine = Engine(model)
    engine.add(*patterns(QUERIES), *definitions(RULES + Writer(Random(seed)).unit()))
    engine.step_limit = 15 if seed % 3 == 0 else 150
    actions = [
        Action(name, (Branch(1.0, RuleCall(name, tuple(map(Variable, names)))),), tuple((n, ITEM) for n in names))
        for name, names in (("u", "a"), ("up", "a"), ("link", "ab"), ("cut", "a"))
    ]
    item, number = Parameter("item", "Item"), Navigation(Variable("item"), "n")
    seen = (
        ObserveFind(PatternCall("big", (Variable("_"),)), 3),
        ObserveFind(PatternCall("linked", (Variable("item"), Variable("_"))), random.choice([None, 2]), item),
        ObserveRange(
            number, 0, 6, item, random.choice([None, PatternCall("linked", (Variable("_"), Variable("item")))])
        ),
    )
    rewards = (None, Constant(-0.5), Constant(0.25))
    refused = [
        OnRefused(random.choice(rewards), random.choice([None, None, "failure", "truncation"]))  # type: ignore[arg-type]
        for _ in range(random.choice([0, 1, 1, 2]))
    ]
    return engine, Behaviour("random", actions=tuple(actions), effects=tuple(refused), observations=seen, limit=6)


ITEM: Final = Domain(cls="Item")


class Writer:
    """Writes one unit `u(a : Item)`, which takes few steps."""

    def __init__(self, random: Random) -> None:
        self._random = random
        self._names = 0

    def unit(self) -> str:
        """Its text."""
        return f"unit u(a : Item) {self._block(['a'], [], 3)}"

    def _block(self, nodes: list[str], values: list[str], depth: int) -> str:
        nodes, values = list(nodes), list(values)
        steps = [self._step(nodes, values, depth) for _ in range(self._random.randint(1, 3))]
        return f"{{ {' '.join(steps)} }}"

    def _step(self, nodes: list[str], values: list[str], depth: int) -> str:
        kinds = ["call"] * 6 + ["new"] * 3 + ["choice"] * 2
        kinds += ["alap", "repeat", "try", "try", "if", "atomic"] if depth else []
        inner = depth - 1
        match self._random.choice(kinds):
            case "call":
                return f"{self._call(nodes, values)};"
            case "new":
                return f"{self._binding(nodes, values)};"
            case "choice":
                count = self._random.randint(2, 4)
                return f"{' | '.join(self._alternative(nodes, values, depth) for _ in range(count))};"
            case "alap":
                return (
                    f"alap {{ {self._random.choice(['up', 'heavy', 'urgent', 'up(a)', 'drop'])}; "
                    f"try {self._block(nodes, values, inner)} }}"
                )
            case "repeat":
                return f"repeat {self._bounds(nodes, values)} {self._block(nodes, values, inner)}"
            case "try":
                rest = self._random.choice(["", f" else {self._block(nodes, values, inner)}"])
                return f"try {self._block(nodes, values, inner)}{rest}"
            case "if":
                rest = self._random.choice(["", f" else {self._block(nodes, values, inner)}"])
                return f"if {self._asked(nodes)} {self._block(nodes, values, inner)}{rest}"
            case _:
                return f"atomic {self._block(nodes, values, inner)}"

    def _alternative(self, nodes: list[str], values: list[str], depth: int) -> str:
        if depth and self._random.random() < 0.3:
            return self._block(nodes, values, depth - 1)
        return self._call(nodes, values)

    def _bounds(self, nodes: list[str], values: list[str]) -> str:
        lower = self._random.randint(0, 2)
        count = self._random.choice([*values, f"{self._random.choice(nodes)}.n", "a.next.n"])
        return self._random.choice(
            [f"{lower}..{lower + self._random.randint(0, 2)}"] * 3
            + [f"{count} % 3", f"{lower}..{lower} + {count} % 2", f"{count} % 2..2"]
        )

    def _call(self, nodes: list[str], values: list[str]) -> str:
        one = self._random.choice([*nodes, "_"])
        two = self._random.choice([*nodes, "_"])
        match self._random.randrange(8):
            case 0:
                return self._random.choice(["kinds", "all kinds", "half", f"twice({self._random.choice(nodes)})"])
            case 1:
                return f"mark({one}, {self._value(nodes, values)})"
            case 2:
                return self._random.choice(["grow", "never", "heavy", "urgent"])
            case 3:
                return f"{self._random.choice(['', 'first ', 'all '])}{self._pairs()}({one}, {two})"
            case 4:
                rule = self._random.choice(["up", "drop", "cut", "prune"])
                order = self._random.choice(["a.n", "-a.n", "a.next.n", "1"])
                which = self._random.choice(["all", "top 1", "top 2"])
                return f"{which} {rule}{self._where('a')} by {order}"
            case 5:
                rule, which = (
                    self._random.choice(["up", "drop", "cut", "prune"]),
                    self._random.choice(["", "first "]),
                )
                return f"{which}{rule}{self._where('a')}"
            case _:
                return f"{self._random.choice(['up', 'drop', 'cut', 'prune'])}({one})"

    def _pairs(self) -> str:
        return self._random.choice(["link", "bind", "adopt"])

    def _binding(self, nodes: list[str], values: list[str]) -> str:
        """A call with an `out` argument: most often a new variable."""
        owner, self._names = self._random.choice(nodes), self._names + 1
        kind = self._random.randrange(5)
        pool = values if kind in (1, 4) else nodes
        old = kind != 3 and self._random.random() < 0.25 and pool
        name = self._random.choice(pool) if old else f"x{self._names}"
        if not old:
            pool.append(name)
        calls = {0: f"next({owner}, {name})", 1: f"read({owner}, {name})", 2: f"after({owner}, {name})"}
        return calls.get(kind) or (f"born({name})" if kind == 3 else f"value({owner}, {name})")

    def _value(self, nodes: list[str], values: list[str]) -> str:
        one = self._random.choice(nodes)
        return self._random.choice([f"{one}.n + 1", f"{one}.next.n", "4", *values, *(f"{v} % 3" for v in values)])

    def _where(self, name: str) -> str:
        return self._random.choice(["", f" where {self._condition([name])}"])

    def _asked(self, nodes: list[str]) -> str:
        """A condition of an `if`, which may ask a rule."""
        if self._random.random() < 0.6:
            return self._condition(nodes)
        one, two = self._random.choice([*nodes, "_"]), self._random.choice([*nodes, "_"])
        single = self._random.choice(["up", "cut", "drop", "prune", "born"])
        rules = [f"{single}({'_' if single == 'born' else one})", f"{self._pairs()}({one}, {two})"]
        rules.append(self._random.choice(["grow", "never", "kinds", "cut", "heavy()"]))
        return self._random.choice(["", "neg "]) + self._random.choice(rules)

    def _condition(self, nodes: list[str]) -> str:
        one = self._random.choice(nodes)
        conditions = [f"find big({one})", f"neg find big({one})", f"find linked({one}, _)", "find big(_)"]
        other = self._random.choice(nodes)
        conditions += [f"{one} == {other}", f"{one} != {other}", f"Special({one})", f"neg Special({one})"]
        conditions += [f"check {one}.n > 1", f"check {one}.next.n < 3", f"neg find linked(_, {one})"]
        return self._random.choice(conditions)
