"""Levels that rules make, and what a student sees of them."""

import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from envgraph.env import Tabular, explore
from envgraph.env.schedules import Buffer
from envgraph.errors import EvaluationError, LoadError
from envgraph.lang import data_path
from envgraph.learn.audit import (
    EDITING,
    parse_audit_settings,
)
from envgraph.learn.audit._accel import (
    LevelEditor,
)
from envgraph.learn.audit._audit_levels import (
    AuditLevels,
    LevelGenerator,
    make_levels,
)
from envgraph.learn.audit._audit_settings import AuditProtocol
from envgraph.learn.audit._state_features import StateFeatures, _decode_observations
from envgraph.learn.audit._student_run import (
    run_method,
)
from envgraph.search import Domain
from envgraph.solve import certify
from envgraph.solve.learning import PolicyLearner

SMALL = {"levels": 8, "probed": 2, "held_out": 4}


@pytest.fixture(scope="module")
def domain() -> Domain:
    return Domain.load("network/audit/audit.toml")


@pytest.fixture(scope="module")
def levels(domain: Domain) -> AuditLevels:
    return make_levels(domain, replace(parse_audit_settings(domain), **SMALL))


def test_groups_of_levels_are_disjoint_and_held_out_levels_solvable(levels: AuditLevels) -> None:
    groups = levels.training, levels.probed, levels.held_out, levels.hard
    assert [len(one) for one in groups] == [8, 2, 4, 2]
    assert np.concatenate(groups).tolist() == list(range(16))
    assert levels.solvable[levels.held_out].all()
    assert not levels.solvable[levels.training].all()
    assert levels.plan[levels.hard].min() > np.quantile(levels.plan[levels.held_out], 0.8)


def test_certificates_of_tables_agree_with_the_levels(domain: Domain, levels: AuditLevels) -> None:
    policy = parse_audit_settings(domain).policy
    for number in (0, 3, 11):
        begin, end = levels.tables.first[number : number + 2]
        one = table_of(levels, number)
        found = certify(one, limit=policy.limit, discount=policy.discount)
        assert found.optimal_return == pytest.approx(levels.optimum[number])
        assert (found.shortest_plan if found.solvable else 0) == levels.plan[number]
        assert one.n_states == end - begin


def table_of(levels: AuditLevels, number: int) -> Tabular:
    """The table of a level once more."""
    tables = levels.tables
    begin, end = tables.first[number : number + 2]
    shape = (end - begin, tables.actions, tables.width)
    rows = slice(begin * tables.actions, end * tables.actions)
    starts = slice(*tables.start_first[number : number + 2])
    return Tabular(
        next_state=(tables.to[rows] - begin).reshape(shape).astype(np.int32),
        probability=tables.chance[rows].reshape(shape),
        reward=tables.reward[rows].reshape(shape),
        terminated=tables.ended[rows].reshape(shape),
        observation=np.arange(end - begin),
        start_states=(tables.starts[starts] - begin).astype(np.int32),
        start_probability=tables.start_chance[starts],
        n_observations=int(end - begin),
        observation_shape=(int(end - begin),),
        action_names=tuple(map(str, range(tables.actions))),
    )


def test_a_student_observes_the_pattern_rows_at_its_position(domain: Domain) -> None:
    engine, keys = domain.engine(), domain.keys()
    assert domain.behaviour is not None
    features = StateFeatures(domain, engine, keys, parse_audit_settings(domain))
    table = explore(engine, domain.behaviour, keys).tabular
    seen = features.features_of(table)
    names = {number: feature for feature, number in features.numbers.items()}
    at, destination = _decode_observations(table).T
    routers = [key[0] for key in keys.keys_of("Router")]
    for state, features in enumerate(seen):
        here, there = routers[at[state]], routers[destination[state]]
        following = {"l": "a"}.get(here, chr(ord(here) + 1))
        found = {names[one] for one in features}
        assert ("0:itself", (f"('{here}',)",)) in found
        assert ("1:itself", (f"('{there}',)",)) in found
        assert {row for name, row in found if name == "0:ahead"} == {(f"('{following}',)",)}


def test_levels_are_read_back(levels: AuditLevels, tmp_path: Path) -> None:
    levels.save(tmp_path / "levels.npz")
    again = AuditLevels.load(tmp_path / "levels.npz")
    assert again.tables.to.tolist() == levels.tables.to.tolist()
    assert again.tables.seen.tolist() == levels.tables.seen.tolist()
    assert (again.tables.inputs, again.drawn) == (levels.tables.inputs, levels.drawn)
    assert again.plan.tolist() == levels.plan.tolist()


def test_too_few_different_levels_are_an_error_with_a_hint(domain: Domain, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(AuditProtocol, "patience", 1)
    with pytest.raises(EvaluationError, match="too few different levels") as raised:
        make_levels(domain, replace(parse_audit_settings(domain), levels=8, probed=2, held_out=20))
    assert "initial_applications" in str(raised.value)


def load_error_after_change(tmp_path: Path, old: str, new: str) -> str:
    """What is said of a copy of the network's audit with something else in it."""
    shutil.copytree(data_path("rules", "network"), tmp_path / "network")
    path = tmp_path / "network" / "audit" / "audit.toml"
    path.write_text(path.read_text().replace(old, new))
    with pytest.raises(LoadError) as raised:
        parse_audit_settings(Domain.load(str(path)))
    return str(raised.value).replace(str(tmp_path), "")


def test_all_errors_of_the_audit_table_are_reported_with_positions(tmp_path: Path) -> None:
    said = load_error_after_change(
        tmp_path,
        'sees = ["itself", "ahead", "behind", "onward"]',
        'sees = ["itself", "ahaed"]\nhiden = 64\nlevels = "many"',
    )
    assert "did you mean `hidden`?" in said
    assert "`levels` must be a whole number, not a string" in said
    line = 'sees = ["itself", "ahaed"]'
    caret = said.index("unknown pattern `ahaed`")
    shown = said[caret:].split("\n")
    assert shown[1].endswith(line)
    assert shown[2].index("^") - shown[1].index(line) == line.index('"ahaed"')
    assert "did you mean `ahead`?" in said


def test_a_family_without_an_audit_table_is_refused_with_a_hint(tmp_path: Path) -> None:
    said = load_error_after_change(tmp_path, '[audit]\nsees = ["itself", "ahead", "behind", "onward"]', "")
    assert "the family file has no `[audit]`" in said
    assert "patterns that say what a student sees" in said


def test_float_columns_in_observed_patterns_are_refused(tmp_path: Path) -> None:
    shutil.copytree(data_path("rules", "network"), tmp_path / "network")
    query = tmp_path / "network" / "audit" / "audit.query"
    slow = "pattern slow(router : Router, latency : float) { Router.ports.latency(router, latency); }"
    query.write_text(f"{query.read_text()}\n{slow}\n")
    path = tmp_path / "network" / "audit" / "audit.toml"
    path.write_text(path.read_text().replace('"onward"', '"slow"'))
    with pytest.raises(LoadError, match="`slow` has a float"):
        parse_audit_settings(Domain.load(str(path)))


def test_a_level_is_recreated_from_its_number(domain: Domain, levels: AuditLevels) -> None:
    maker = LevelGenerator(domain, parse_audit_settings(domain))
    for level in (9, 2, 13):
        assert maker.make_model(int(levels.numbers[level]))
        taken = maker.table_if_new()
        assert taken is not None
        assert are_equal(taken[0], table_of(levels, level))
        assert taken[1] == levels.plan[level]
    assert not maker.is_new_model(), "it was there before"


def are_equal(one: Tabular, other: Tabular) -> bool:
    names = ("next_state", "probability", "terminated", "start_states")
    return all(np.array_equal(getattr(one, name), getattr(other, name)) for name in names)


def test_edits_make_new_levels_that_hold_the_constraints(domain: Domain, levels: AuditLevels) -> None:
    settings = replace(parse_audit_settings(domain), **SMALL)
    student, rng = PolicyLearner(levels.tables, settings.policy, 0, native=False), np.random.default_rng(0)
    before = student.evaluate(levels.held_out)
    editor = LevelEditor(domain, settings, levels, student)
    children = editor(levels.training, rng)
    assert (children[children != levels.training] >= 16).all()
    made = len(editor.levels.plan) - 16
    assert made >= 6
    grandchildren = editor(np.array([16, 16, 17]), rng)
    assert len({*grandchildren.tolist()} & {*range(16 + made, 19 + made)}) >= 2
    assert np.array_equal(before, student.evaluate(levels.held_out)), "what is known of the others stays"
    problem = editor._maker._variation._problem
    tables = [table_of(editor.levels, level) for level in range(len(editor.levels.plan))]
    for level, version in editor._versions.items():
        problem.engine.checkout(version, discard=True)
        assert problem.is_valid()
        found = certify(tables[level], limit=settings.policy.limit, discount=settings.policy.discount)
        assert (found.shortest_plan if found.solvable else 0) == editor.levels.plan[level]
        assert are_equal(editor._maker._tables.build(problem.engine, editor._maker._keys), tables[level])
    played = student.play(np.array([16, 17, 18, 3]))
    assert (played.length > 0).all()
    assert editor.levels.tables.seen.max() < levels.tables.inputs


def test_runs_with_edited_levels_are_reproducible(domain: Domain, levels: AuditLevels) -> None:
    settings = parse_audit_settings(domain)
    policy = replace(settings.policy, hidden=2, levels=4, minibatches=1, epochs=1, steps=8, limit=8)
    given = replace(settings, policy=policy, steps=24 * 4 * 8)
    quick = replace(EDITING[0], choice=Buffer(size=8, replay=0.9, fresh_learned=False))
    first, again = (run_method(levels, given, quick, 1, domain=domain, native=False) for _ in range(2))
    assert first == again
    assert 4 < first.updates[-1] < 14, "what is edited is scored alone"
