"""The bundled domains: queries against plain Python, every rule somewhere, many mutations, and back."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import suppress

import numpy as np
import pytest

from envgraph.errors import RuleError
from envgraph.graph import Version, check_conformance
from envgraph.lang import bundled_domain, load_workspace
from envgraph.pattern import conformance_patterns
from envgraph.rewrite import Engine
from envgraph.search import Domain
from tests.oracle.domains_by_hand import BY_HAND
from tests.profile import NIGHTLY
from tests.unit.rewrite.domains import domain as domain_engine
from tests.unit.rewrite.graphs import snapshot

MODELS = [
    ("burning_forest", "running_4x4"),
    ("burning_forest", "target_8x8"),
    ("jobshop", "three_jobs"),
    ("keydoor", "two_rooms"),
    ("lava", "vault"),
    ("network", "backbone"),
    ("sokoban", "small"),
    ("taxi", "town"),
    ("triage", "friday"),
    ("warehouse", "small_hall"),
]

NEVER = {
    # Its `from` and `to` are [1], so a link of a valid model has both ends, and `delete` asks for none (dpo).
    "network.dropLink": "dangling",
    # Only one Network: there is no other one to take a link from.
    "network.wiring.swap.Link.links": "no match",
    "network.wiring.move.Link.links": "no match",
}
"""Rules that apply to no model that the rules reach, and why."""


def asked(engine: Engine, pattern: str) -> set[tuple[object, ...]]:
    matches = engine.matches(pattern)
    rows = {match.row for match in matches}
    assert len(rows) == len(matches) == engine.count(pattern)
    return rows


def assert_queries_equal_python(name: str, engine: Engine) -> None:
    """Every query finds what plain Python finds."""
    for pattern, by_hand in BY_HAND[name].items():
        assert asked(engine, f"{name}.{pattern}") == by_hand(engine.model), pattern


@pytest.mark.parametrize(("name", "model"), MODELS)
def test_every_query_of_a_domain_has_a_python_version(name: str, model: str) -> None:
    files = (path for path in bundled_domain(name).glob("*.*") if path.suffix != ".toml")
    texts = load_workspace(sorted(files))
    assert {pattern.qualified_name for pattern in texts.patterns} == {f"{name}.{one}" for one in BY_HAND[name]}


@pytest.mark.parametrize(("name", "model"), MODELS)
def test_queries_of_the_sample_model_equal_their_python_versions(name: str, model: str) -> None:
    assert_queries_equal_python(name, domain_engine(name, model))


def walk(engine: Engine, rng: np.random.Generator, steps: int) -> Iterator[None]:
    """Stop after each of some applications of rules, units and groups at random; what is refused is not done."""
    names = [*engine.rules, *engine.units]
    engine.rng = rng
    for _ in range(steps):
        chosen = names[int(rng.integers(len(names)))]
        with suppress(RuleError):
            if engine.run(chosen) if chosen in engine.units else engine.apply(chosen):
                yield


@pytest.mark.parametrize("watched", [False, True])
@pytest.mark.parametrize(("name", "model"), MODELS)
def test_queries_equal_their_python_versions_after_random_rules(name: str, model: str, watched: bool) -> None:
    engine = domain_engine(name, model)
    if watched:
        engine.watch(*(f"{name}.{pattern}" for pattern in BY_HAND[name]))
    for seed in range(3 if NIGHTLY else 1):
        for _ in walk(engine, np.random.default_rng(seed), 40):
            assert_queries_equal_python(name, engine)
    engine.check_integrity()


@pytest.mark.parametrize(("name", "model"), [one for one in MODELS if one[1] != "running_4x4"])
def test_every_rule_is_applicable_in_some_reachable_model(name: str, model: str) -> None:
    engine = domain_engine(name, model)
    start = engine.commit()
    applied: set[str] = set()
    reasons: dict[str, set[str]] = {}
    rng = np.random.default_rng(1)
    for number in range(100):
        engine.checkout(start, discard=True)
        for _ in walk(engine, rng, 25):
            for rule in engine.rules:
                if rule not in applied:
                    try_out(engine, rule, applied, reasons)
        missing = set(engine.rules) - applied
        if number >= 10 and missing <= set(NEVER):
            break
    assert {rule: reasons[rule] for rule in missing} == {
        rule: {reason} for rule, reason in NEVER.items() if rule.startswith(f"{name}.")
    }
    for unit in engine.units:
        engine.checkout(start, discard=True)
        assert engine.run(unit)


def try_out(engine: Engine, rule: str, applied: set[str], reasons: dict[str, set[str]]) -> None:
    """Apply a rule at each of its matches here, until one works, and note why the others do not."""
    model = engine.model
    matches = engine.matches(rule)
    for match in matches:
        savepoint = model.graph.history.savepoint()
        try:
            assert engine.apply(rule, match) is not None
            applied.add(rule)
        except RuleError as error:
            reasons.setdefault(rule, set()).add(str(error.reason))
        model.graph.history.rollback(savepoint)
        if rule in applied:
            return
    if not matches:
        reasons.setdefault(rule, set()).add("no match")


def test_link_operators_move_links_between_two_networks() -> None:
    engine = domain_engine("network", "backbone")
    model = engine.model
    routers = [model.create("Router", name=name) for name in ("Oslo", "Paris")]
    packet = model.create("Packet", at=routers[0], destination=routers[1])
    link = model.create("Link", to=routers[1], **{"from": routers[0]})
    model.create("Network", routers=routers, packet=packet, links=[link])
    assert check_conformance(model) == []
    for rule in ("wiring.swap.Link.links", "wiring.move.Link.links"):
        application = engine.apply(rule)
        assert application is not None and check_conformance(model) == []


@pytest.mark.parametrize("name", BY_HAND)
def test_mutations_keep_every_constraint_and_can_be_rolled_back(name: str) -> None:
    """As a search mutates: what does not satisfy the constraints that are queries is rolled back."""
    domain = Domain.load(f"{name}/{'paper' if name == 'burning_forest' else 'diverse'}.toml")
    engine = domain.engine()
    problem = domain.problem(engine)
    model, rng = engine.model, np.random.default_rng(7)
    constraints = [one for one in problem.constraints if not str(one).startswith("reachable")]
    start, before = engine.commit(), snapshot(engine.model)
    versions: list[tuple[Version, tuple[object, ...]]] = [(start, before)]
    engine.rng = rng
    accepted = 0
    for number in range(1000 if NIGHTLY else 400):
        savepoint, earlier = model.graph.history.savepoint(), model.state_hash()
        chosen = engine.choose(problem.mutations, rng)
        assert chosen is not None
        try:
            done = bool(engine.fire(*chosen))
        except RuleError as error:
            assert error.reason == "dangling"
            done = False
        if done and all(constraint.holds(engine) for constraint in constraints):
            model.graph.history.release(savepoint)
            accepted += 1
        else:
            model.graph.history.rollback(savepoint)
            assert model.state_hash() == earlier
        if number % 100 == 99:
            check(name, domain, engine)
            versions.append((engine.commit(), snapshot(model)))
    assert accepted > number // 10
    for version, after in reversed(versions):
        engine.checkout(version)
        assert snapshot(model) == after
    assert snapshot(model) == before


def check(name: str, domain: Domain, engine: Engine) -> None:
    """The constraints hold, as plain Python sees it."""
    model, constraints, by_hand = engine.model, domain.spec.constraints, BY_HAND[name]
    assert check_conformance(model) == []
    model.check_integrity()
    rows = {pattern: find(model) for pattern, find in by_hand.items()}
    assert all(rows[str(pattern).rpartition(".")[2]] for pattern in constraints.require)
    assert not any(rows[str(pattern).rpartition(".")[2]] for pattern in constraints.forbid)
    for pattern, (low, high) in constraints.count:
        count = len(rows[str(pattern).rpartition(".")[2]])
        assert low <= count and (high is None or count <= high)


@pytest.mark.parametrize("name", ["burning_forest", "keydoor", "warehouse"])
def test_operators_of_a_derived_group_do_what_their_names_say(name: str) -> None:
    engine = Domain.load(name).engine()
    model = engine.model
    (group,) = engine.groups
    for rule in engine.group(group):
        *_, old, new = rule.split(".")
        cells = [node for node in model.nodes() if node.cls == old]
        assert engine.count(rule) == len(cells)
        for match in engine.matches(rule):
            savepoint = model.graph.history.savepoint()
            engine.apply(rule, match)
            assert match.object.cls == new and check_conformance(model) == []
            model.graph.history.rollback(savepoint)


def test_operators_for_links_keep_the_network_valid() -> None:
    engine = Domain.load("network/diverse.toml").engine()
    model, demands = engine.model, conformance_patterns(engine.model.metamodel)
    engine.add(*demands)
    assert len(engine.group("wiring")) == 9
    for rule in engine.group("wiring"):
        for match in engine.matches(rule):
            savepoint = model.graph.history.savepoint()
            if engine.apply(rule, match) is not None:
                assert not any(engine.exists(demand.qualified_name) for demand in demands)
                assert check_conformance(model) == []
            model.graph.history.rollback(savepoint)
