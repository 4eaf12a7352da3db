"""Reachable states: what is found, when it ends, and that nothing is left of it."""

from __future__ import annotations

import signal
from collections.abc import Callable

import pytest

from envgraph.errors import EvaluationError, InvalidArgument, RuleError, TransactionError
from envgraph.graph import Model, Node
from envgraph.rewrite import Engine, Exploration, Firing, Transition
from tests.unit.rewrite.graphs import METAMODEL, chain, definitions, engine, patterns, snapshot

RULES = """
rule light { lhs { a : Item; check !a.done; } modify { set a.done = true; } }
rule dark { lhs { a : Item; check a.done; } modify { set a.done = false; } }
rule step { lhs { a : Item; check a.n < 3; } modify { set a.n += 1; } }
rule grow { lhs { a : Item; } modify { create b : Item; } }
rule shrink { lhs { a : Item; b : Item; check a.n == b.n; } modify { delete a; } }
rule remove { lhs { a : Item; } modify { delete a; } }
rule divide { lhs { a : Item; } modify { set a.n = 1 / a.n; } }
rule nothing { lhs { } modify { create b : Box; } }
rule up(k : int) { lhs { a : Item; } modify { set a.n = k; } }
derive kinds = retype among { Item, Special };
unit toggle { light | dark; }
unit both { light; light; }
unit count { repeat 0..2 { step; } }
unit turn(x : Item) { if find lit(x) { dark; } else { light; } }
unit endless { alap { toggle; } }
"""
QUERIES = """
pattern lit(a : Item) { Item.done(a, true); }
pattern allLit() { neg find unlit(_); }
pattern unlit(a : Item) { Item.done(a, false); }
pattern bigger(a : Item, in k : int) { Item.n(a, n); check n > k; }
"""


def made(size: int = 3) -> Engine:
    model = Model(METAMODEL)
    for _ in range(size):
        model.create("Item")
    return engine(RULES, QUERIES, model=model)


def unchanged(one: Engine) -> Callable[[], None]:
    """Asserts, when called, that the engine is as it is now."""
    before, version, depth = snapshot(one.model), one.model.version, one.model.graph.history.savepoint_depth

    def check() -> None:
        assert snapshot(one.model) == before
        assert one.model.version is version and one.model.graph.history.savepoint_depth == depth
        one.check_integrity()

    return check


# --- what is found


def test_states_and_transitions_of_three_lamps() -> None:
    one = made()
    check = unchanged(one)
    found = one.explore(["light", "dark"], predicates=["lit", "allLit"])
    check()
    assert (len(found), len(found.transitions), found.ending, found.complete) == (8, 24, "exhausted", True)
    assert [state.depth for state in found.states] == [0, 1, 1, 1, 2, 2, 2, 3]
    assert [state.holds for state in found.states] == [(), *[("lit",)] * 6, ("lit", "allLit")]
    assert found.holding("allLit") == [7] and found.holding("lit") == [1, 2, 3, 4, 5, 6, 7]
    assert found.transitions[0] == Transition(0, 1, "light", (Firing("light", (0,)),))
    assert found.deadlocks == [] and found.goal is None and {state.version for state in found.states} == {None}
    statistics = found.statistics
    assert (statistics.states, statistics.expanded, statistics.depth, statistics.refused) == (8, 8, 3, 0)
    assert repr(found) == "<Exploration: 8 states, 24 transitions, exhausted>"


def test_depth_first_goes_on_from_each_new_state() -> None:
    found = made().explore("light", strategy="depth")
    assert [state.depth for state in found.states] == [0, 1, 2, 3, 2, 1, 2, 1]
    assert [(t.source, t.target) for t in found.transitions[:3]] == [(0, 1), (1, 2), (2, 3)]
    assert len(found.transitions) == 12 and found.deadlocks == [3]


def test_a_goal_ends_the_search_and_has_a_path() -> None:
    one = made()
    check = unchanged(one)
    found = one.explore("light", goal="allLit")
    check()
    assert found.ending == "goal" and not found.complete and found.goal == 7
    assert found.path() == [("light", (0,)), ("light", (1,)), ("light", (2,))]
    assert found.path(0) == [] and found.path(2) == [Firing("light", (1,))]
    one.replay(found.path())
    assert one.exists("allLit")
    assert one.explore("light", goal="allLit").path() == []


def test_a_goal_can_be_a_function_and_predicates_have_names() -> None:
    one = made()
    found = one.explore(
        "step",
        goal=lambda engine: engine.model.node(1).n == 2,
        predicates={"first": lambda engine: engine.model.node(0).n > 0, "any": "lit"},
    )
    assert found.path() == [Firing("step", (1,)), Firing("step", (1,))]
    assert found.predicates == ("first", "any")
    assert found.holding("first") == [s.number for s in found.states if "first" in s.holds] != []
    assert found.holding("any") == []


def test_without_a_goal_in_reach_there_is_no_path() -> None:
    found = made().explore("dark", goal="lit")
    assert found.ending == "exhausted" and found.goal is None and found.deadlocks == [0]
    with pytest.raises(InvalidArgument, match="no goal was found"):
        found.path()
    with pytest.raises(InvalidArgument, match="state 3 does not exist"):
        found.path(3)
    with pytest.raises(InvalidArgument, match="`lot` is not a predicate of this exploration"):
        found.holding("lot")


@pytest.mark.parametrize("strategy", ["breadth", "depth"])
def test_the_limit_ends_the_exploration(strategy: str) -> None:
    one = made()
    check = unchanged(one)
    found = one.explore("grow", limit=5, strategy=strategy)  # type: ignore[arg-type]
    check()
    assert (len(found), found.ending, found.complete) == (5, "limit", False)
    assert all(transition.target < 5 for transition in found.transitions)
    exactly = one.explore(["light", "dark"], limit=8, strategy=strategy)  # type: ignore[arg-type]
    assert exactly.complete
    assert one.explore("nothing", limit=1).ending == "limit"


def test_a_group_is_its_rules_and_each_counts_once() -> None:
    found = made(2).explore(["kinds", "kinds.Item.Special", "kinds"])
    assert (len(found), len(found.transitions)) == (4, 8)
    assert {transition.name for transition in found.transitions} == {
        "kinds.Item.Special",
        "kinds.Special.Item",
    }


def test_explorations_cover_every_run_of_a_unit() -> None:
    found = made(3).explore("both")
    # A unit that fails keeps what it did before: the last lamp is lit, too.
    assert [transition.source for transition in found.transitions] == [0] * 6 + [1, 2, 3]
    assert [state.depth for state in found.states] == [0, 1, 1, 1, 2]
    first = found.transitions[0]
    assert first.name == "both" and first.firings == (("light", (0,)), ("light", (1,)))
    assert found.path(1) == list(first.firings)
    steps = made(1).explore("count")
    assert [(t.source, t.target, len(t.firings)) for t in steps.transitions][:2] == [(0, 1, 1), (0, 2, 2)]
    assert len(steps) == 4
    toggles = made(2).explore("toggle")
    assert (len(toggles), {t.firings[0].rule for t in toggles.transitions}) == (4, {"light", "dark"})


def test_units_with_too_many_runs_end_the_exploration() -> None:
    one = made(4)
    found = one.explore("both", limit=7)
    assert found.ending == "limit" and len(found) <= 7
    one.step_limit = 30
    check = unchanged(one)
    with pytest.raises(EvaluationError, match="more than 30 steps"):
        one.explore("endless")
    check()


def test_refused_moves_are_counted_and_errors_raised() -> None:
    one = engine(RULES, QUERIES, model=chain(3))
    check = unchanged(one)
    found = one.explore("remove")
    assert (len(found), found.statistics.refused, len(found.transitions)) == (1, 3, 0)
    assert found.deadlocks == [0]
    with pytest.raises(EvaluationError):
        one.explore("divide")
    check()


def test_a_match_without_variables_is_a_move() -> None:
    found = made(0).explore("nothing", limit=3)
    assert found.transitions[0].firings == (Firing("nothing", ()),) and len(found) == 3


def test_a_move_that_changes_nothing_leads_to_the_same_state() -> None:
    one = made(1)
    one.add(*definitions("rule keep { lhs { a : Item; } modify { set a.n = a.n; } }"))
    found = one.explore("keep")
    assert [(t.source, t.target) for t in found.transitions] == [(0, 0)]


# --- up to isomorphism


def test_up_to_isomorphism_only_the_number_of_lit_lamps_counts() -> None:
    found = made().explore(["light", "dark"], up_to="isomorphism")
    assert (len(found), found.statistics.merged) == (4, 4)
    assert [len(found.path(state.number)) for state in found.states] == [0, 1, 2, 3]
    assert sum(t.source == 0 for t in found.transitions) == 3


def test_rules_that_create_and_delete_come_back_up_to_isomorphism() -> None:
    one = made(2)
    assert one.explore(["nothing", "remove"], limit=20).ending == "limit"
    one.add(
        *definitions(
            "rule less { lhs { b : Box; } modify { delete b; } } rule once { lhs { check true; } "
            "not { b : Box; } modify { create b : Box; } }"
        )
    )
    found = one.explore(["once", "less"], up_to="isomorphism")
    assert (len(found), found.complete) == (2, True)


def test_different_states_with_equal_hashes_are_distinguished() -> None:
    """Six items in one ring of six, or in two of three: colour refinement sees no difference."""
    model = Model(METAMODEL)
    items = [model.create("Item") for _ in range(6)]
    one = engine(
        """
        @match(homomorphic)
        rule swap {
            lhs { a : Item -next-> b : Item; c : Item -next-> d : Item; a != c; }
            modify { delete a -next-> b; delete c -next-> d; create a -next-> d; create c -next-> b; }
        }
        """,
        model=model,
    )
    for place, item in enumerate(items):
        item.next = items[(place + 1) % 6]
    hashes = {}
    found = one.explore(
        "swap",
        up_to="isomorphism",
        predicates={"hashed": lambda engine: hashes.setdefault(len(hashes), engine.model.canonical_hash()) is not None},
    )
    # The ways to write 6 as a sum: the lengths of the rings.
    assert len(found) == 11 and len(set(hashes.values())) < 11


# --- what is left


def test_versions_are_kept_on_request() -> None:
    one = made()
    start = one.commit()
    found = one.explore(["light", "dark"], keep=True, predicates=["allLit"])
    assert one.model.version is start and found.states[0].version is start
    for state in found.states:
        assert state.version is not None
        one.checkout(state.version)
        assert one.count("lit") == state.depth and one.exists("allLit") == ("allLit" in state.holds)
    one.checkout(start)
    deep = one.explore("step", strategy="depth", keep=True)
    assert len(deep) == 64 and one.model.version is start
    versions = [state.version for state in deep.states]
    one.checkout(versions[-1])  # type: ignore[arg-type]
    one.check_integrity()


def test_versions_cannot_be_kept_inside_a_transaction() -> None:
    one = made()
    with one.transaction():
        one.apply("light", a=0)
        check = unchanged(one)
        with pytest.raises(TransactionError):
            one.explore("light", keep=True)
        assert len(one.explore("light")) == 4
        check()
    assert one.count("lit") == 1


@pytest.mark.parametrize("keep", [False, True])
@pytest.mark.parametrize("strategy", ["breadth", "depth"])
@pytest.mark.parametrize("error", [ZeroDivisionError, KeyboardInterrupt])
def test_an_exception_leaves_the_engine_as_it_was(error: type[BaseException], strategy: str, keep: bool) -> None:
    one = made()
    one.watch("lit")
    start = one.commit()
    check = unchanged(one)

    @one.rule("unlit")
    def enlighten(a: Node) -> None:
        a.done = True
        if a.id == 2 and one.count("lit") == 3:
            raise error

    def third(_: Engine) -> bool:
        if one.count("lit") == 2:
            raise error
        return False

    with pytest.raises(error):
        one.explore("enlighten", strategy=strategy, keep=keep)  # type: ignore[arg-type]
    check()
    with pytest.raises(error):
        one.explore("light", strategy=strategy, goal=third, keep=keep)  # type: ignore[arg-type]
    check()
    assert one.model.version is start


@pytest.mark.parametrize("strategy", ["breadth", "depth"])
def test_control_c_waits_for_the_end_of_the_move(strategy: str) -> None:
    one = made()
    check, done = unchanged(one), []

    def interrupt(_: Engine) -> bool:
        signal.raise_signal(signal.SIGINT)
        done.append(True)
        return False

    with pytest.raises(KeyboardInterrupt):
        one.explore("light", goal=interrupt, strategy=strategy)  # type: ignore[arg-type]
    assert done == [True]
    check()
    assert signal.getsignal(signal.SIGINT) is signal.default_int_handler


def test_the_second_control_c_does_not_wait() -> None:
    one, done = made(), []

    def hang(_: Engine) -> bool:
        signal.raise_signal(signal.SIGINT)
        done.append("waits")
        signal.raise_signal(signal.SIGINT)
        done.append("never")
        return False

    check = unchanged(one)
    with pytest.raises(KeyboardInterrupt):
        one.explore("light", goal=hang)
    assert done == ["waits"]
    check()


@pytest.mark.parametrize("keep", [False, True])
def test_explorations_leave_the_engine_unchanged(keep: bool) -> None:
    one, told = made(), []
    one.listen("lit", lambda came, went: told.append((len(came), len(went))))
    one.on("allLit", appear=lambda engine: told.append("all"), existing=False)
    one.on("unlit", appear=lambda: told.append("unlit"))  # pending
    assert len(one.agenda) == 3
    generator = one.rng.bit_generator.state
    with one.recording() as trace:
        found = one.explore(["toggle", "light"], keep=keep)
    assert len(found) == 8 and trace == [] and len(one.agenda) == 3 and told == []
    assert one.rng.bit_generator.state == generator
    del found
    told.clear()
    one.settle()
    assert [entry for entry in told if entry != "unlit"] == []
    with one.transaction():
        for number in range(3):
            one.model.node(number).done = True
    assert told[-2:] == [(3, 0), "all"]


def test_function_rules_take_part() -> None:
    one = made()

    @one.rule("unlit")
    def enlighten(a: Node, engine: Engine) -> None:
        engine.apply("light", a=a)

    found = one.explore("enlighten")
    assert (len(found), len(found.transitions)) == (8, 12)
    assert found.transitions[0].firings[0].rule == "enlighten"


def test_the_result_is_a_function_of_the_state() -> None:
    def run(watch: bool) -> Exploration:
        one = made(4)
        if watch:
            one.watch("light", "dark", "lit")
        return one.explore(["kinds", "toggle", "light"], limit=50)

    first, second = run(False), run(False)
    assert first.transitions == second.transitions and first.states == second.states
    assert run(True).transitions == run(True).transitions


# --- as a graph


def test_the_graph_has_states_and_moves() -> None:
    one = made(2)
    found = one.explore(["light", "both"], predicates=["allLit"])
    graph = found.graph
    assert graph is found.graph and graph.number_of_nodes() == 4
    assert graph.nodes[3] == {"depth": 1, "holds": ("allLit",), "version": None}
    assert graph.number_of_edges() == len(found.transitions)
    edges = [data for _, _, data in graph.edges(data=True)]
    light = next(data for data in edges if data["name"] == "light")
    assert light["match"].row == light["firings"][0].values and light["match"].definition == "light"
    assert next(data for data in edges if data["name"] == "both")["match"] is None
    assert graph.graph == {"ending": "exhausted", "goal": None}


# --- mistakes


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"rules": []}, "pass at least one name of a rule, group or unit"),
        ({"rules": "lght"}, "did you mean `light`"),
        ({"rules": "light", "limit": 0}, "`limit` is 0"),
        ({"rules": "light", "strategy": "best"}, "not 'best'"),
        ({"rules": "light", "up_to": "hash"}, "not 'hash'"),
        ({"rules": "up"}, "rule `up` needs a value for `k`"),
        ({"rules": "turn"}, "unit `turn` needs values for `x`"),
        ({"rules": "light", "goal": "litt"}, "did you mean `lit`"),
        ({"rules": "light", "goal": 3}, "a predicate must be the name of a pattern or a function, not 3"),
        ({"rules": "light", "predicates": ["bigger"]}, "needs values for `k`"),
    ],
)
def test_wrong_arguments_of_explorations_are_reported(arguments: dict[str, object], message: str) -> None:
    with pytest.raises(InvalidArgument, match=message):
        made().explore(**arguments)  # type: ignore[arg-type]


def test_refusals_of_other_kinds_are_raised() -> None:
    one = made(2)
    one.add(*patterns("pattern any(a : Item) { Item(a); }"))
    one.add(*definitions("rule clash { lhs { a : Item; } forall { lhs { b : Item; } modify { set a.n = b.n; } } }"))
    one.model.node(0).n = 4
    one.model.create("Item", n=5)
    check = unchanged(one)
    with pytest.raises(RuleError) as error:
        one.explore("clash")
    assert error.value.reason == "ambiguous"
    check()


def test_wrong_rule_names_are_refused() -> None:
    for rules in (5, [5], None):
        with pytest.raises(InvalidArgument, match=r"expected (names|the name) of"):
            made().explore(rules)  # type: ignore[arg-type]
    with pytest.raises(InvalidArgument, match="expected names of predicates, not 5"):
        made().explore("light", predicates=5)  # type: ignore[arg-type]
    assert made(1).explore("light", predicates="allLit").predicates == ("allLit",)


def test_a_depth_limit_excludes_more_distant_states() -> None:
    made = engine("rule up(a : Item) { lhs { check a.n < 5; } modify { set a.n += 1; } }", model=chain(1))
    for depth in range(5):
        found = made.explore("up", depth=depth)
        assert [state.depth for state in found.states] == list(range(depth + 1))
        assert (found.ending, found.complete, found.deadlocks) == ("depth", False, [])
    found = made.explore("up", depth=6)
    assert (len(found), found.ending, found.deadlocks) == (6, "exhausted", [5])
    assert made.explore("up", depth=3, goal=lambda engine: engine.model.node(0).n == 3).ending == "goal"
    for wrong in (-1, 1.5, True):
        with pytest.raises(InvalidArgument, match="but must be a whole number from 0"):
            made.explore("up", depth=wrong)  # type: ignore[arg-type]
    with pytest.raises(InvalidArgument, match="needs `strategy="):
        made.explore("up", depth=3, strategy="depth")
