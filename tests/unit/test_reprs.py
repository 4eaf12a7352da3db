"""The `repr` of everything public fits on two lines of a terminal, whatever it holds; notebooks show more."""

from __future__ import annotations

import inspect
from collections.abc import Iterator
from dataclasses import fields, is_dataclass, replace
from enum import Enum
from importlib import import_module
from typing import Any

import pytest

import envgraph
from envgraph.draw import html_picture
from envgraph.errors import EnvgraphError, InvalidArgument
from envgraph.learn import FamilyMember, TrainingSettings, best_way, compare, run_experiment, sequences
from envgraph.report import family_report
from envgraph.search import Family, Outcome, certificates, generate, verify

PACKAGES = (
    "envgraph",
    "envgraph.errors",
    "envgraph.metamodel",
    "envgraph.draw",
    "envgraph.graph",
    "envgraph.pattern",
    "envgraph.match",
    "envgraph.rewrite",
    "envgraph.env",
    "envgraph.lang",
    "envgraph.search",
    "envgraph.learn",
    "envgraph.report",
)
LONG = "x\x1b[31m" * 60


def public_objects() -> Iterator[tuple[str, Any]]:
    for package in PACKAGES:
        module = import_module(package)
        yield from ((f"{package}.{name}", getattr(module, name)) for name in module.__all__)


CLASSES = {
    item: name for name, item in public_objects() if inspect.isclass(item) and item.__module__.startswith("envgraph")
}


def has_short_repr(item: object) -> bool:
    text = repr(item)
    return len(text) < 200 and text.isprintable()


@pytest.mark.parametrize("cls", [cls for cls in CLASSES if is_dataclass(cls)], ids=CLASSES.get)
def test_data_with_long_and_hostile_parts_has_a_short_repr(cls: type) -> None:
    one = object.__new__(cls)
    for value in (LONG, (LONG,) * 20, {LONG: LONG}, None):
        for field in fields(cls):
            object.__setattr__(one, field.name, value)
        try:
            text = repr(one)
        except (
            AttributeError,
            TypeError,
            ValueError,
        ):  # a repr that counts on the types: real ones are below
            continue
        assert len(text) < 200 and text.isprintable()


@pytest.fixture(scope="module")
def family(tmp_path_factory: pytest.TempPathFactory) -> Family:
    place = tmp_path_factory.mktemp("run") / "run.sqlite"
    return generate("burning_forest/paper.toml", place, generations=0, population=3)


@pytest.fixture(scope="module")
def world(family: Family) -> list[object]:
    """Something of every kind that people meet."""
    engine = envgraph.open("burning_forest")
    engine.model.graph.set_object_name(0, LONG)
    engine.model.name = "<script>"
    heard = engine.on("burningTile", appear=lambda engine: None, existing=False)
    with engine.recording() as trace:
        applied = engine.apply("changeRoadToBurning")
    version = engine.commit()
    table = family.explored(family.members[0], pictures=True)
    members = [FamilyMember(one.name, table.tabular) for one in family.members]
    settings = TrainingSettings(steps_per_environment=20, seeds=1)
    curricula = [sequences([one.name for one in members], kind)[0] for kind in ("full", "direct")]
    experiment = run_experiment(members, settings, curricula)
    certified = [*verify(family.subset([1]))]
    environment = envgraph.make(domain="burning_forest", render_mode="ansi").unwrapped
    environment.reset(seed=0)
    with pytest.raises(EnvgraphError) as failed:
        envgraph.load(engine, "no/such.rules")
    return [
        engine, engine.model, engine.model.metamodel, engine.model.node(0), engine.model.node(0).states,
        engine.model.picture(), engine.matches("burningTile"), engine.first("burningTile"), engine.library, heard,
        engine.agenda, applied, applied and applied.firing, trace, version, engine.why_not("onFire"),
        engine.why_not("startTileFixedLocation"), engine.explain("solvable"), engine.run("burnDown"),
        engine.explore("changeBurningToRoad", limit=3), failed.value, *failed.value.diagnostics,
        family, *family.members, family.domain, family.domain.workspace, family.domain.spec, family.bundle, family.keys,
        family.behaviour, Outcome.of(family), table, table.tabular, *table.pictures[:2], experiment,
        *experiment.runs, *experiment.summaries(), *compare(experiment), settings, family_report(family), *certified,
        best_way(experiment, members[-1].name), certificates(family, family.members[0]), environment, curricula[0],
        envgraph.optimise(engine.copy(), "changeRoadToBurning", maximise="burningTile", steps=5),
        *family.domain.workspace.patterns, *family.domain.workspace.rules,
    ]  # fmt: skip


def test_objects_of_public_classes_have_a_short_repr(world: list[object]) -> None:
    for one in world:
        assert has_short_repr(one), f"{type(one)}: {repr(one)[:300]}"


def test_parts_of_objects_of_public_classes_have_a_short_repr(world: list[object]) -> None:
    seen: dict[int, object] = {}
    waiting = list(world)
    kinds = set()
    while waiting:
        one = waiting.pop()
        if id(one) in seen or isinstance(one, str | bytes | int | float | Enum | type | None):
            continue
        seen[id(one)] = one
        if isinstance(one, tuple | list):
            waiting.extend(one[:50])
        elif isinstance(one, dict):
            waiting.extend(list(one.values())[:50])
        elif is_dataclass(one):
            waiting.extend(getattr(one, field.name) for field in fields(one))
        if type(one) in CLASSES:
            kinds.add(type(one))
            assert has_short_repr(one), f"{type(one)}: {repr(one)[:300]}"
    assert len(kinds) > 80


def test_a_short_repr_shows_all_fields() -> None:
    from envgraph.metamodel import Glyph, Reference
    from envgraph.pattern import Constant, Variable

    assert repr(Glyph("B", "#e8590c")) == "Glyph(letter='B', colour='#e8590c')"
    assert repr((Constant(1), Variable("x"))) == "(Constant(value=1), Variable(name='x'))"
    assert repr(Reference("next", "Link", doc="to " * 90)).startswith("Reference(name='next', target='Link', lower=1,")


def test_public_functions_and_constants_have_a_short_repr() -> None:
    for name, item in public_objects():
        if not inspect.isclass(item) and type(item).__module__.startswith("envgraph"):
            assert has_short_repr(item), name


def test_html_for_notebooks_is_short_and_escaped(world: list[object]) -> None:
    shown = {}
    for one in world:
        html = getattr(one, "_repr_html_", lambda: None)()
        if html is not None:
            shown[type(one).__name__] = html
            assert "<script>" not in html and "\x1b" not in html and len(html) < 300_000, type(one)
            assert html.count("<table>") == html.count("</table>") and html.count("<pre>") == html.count("</pre>")
    assert "&lt;script&gt;" in shown["Engine"] and "startTileFixedLocation" in shown["Engine"]
    assert "<th>environments</th><td>BurningForest</td>" in shown["Workspace"]
    assert "<td>burning_forest.environment, burning_forest.metamodel" in shown["Workspace"], "without their folder"
    assert "<caption>E1</caption>" in shown["Verification"] and "<th>shortest plan</th>" in shown["Verification"]
    assert "<td>curriculum</td><td>E1-E" in shown["Experiment"]
    assert "<svg" in shown["ExploredEnvironment"] and "<svg" in shown["EnvgraphEnv"]
    assert {"Trace", "Application", "Exploration", "Optimum", "Comparison", "BestWay", "Certificates"} <= shown.keys()


def test_pictures_that_fail_or_are_too_large_are_replaced_by_a_sentence() -> None:
    def fail() -> str:
        raise InvalidArgument("the truck <b> is nowhere")

    assert html_picture(fail) == "<p>no picture: the truck &lt;b&gt; is nowhere</p>"
    assert html_picture(lambda: "<svg>" + " " * 500_000) == "<p>the picture is too large for a notebook</p>"
    assert html_picture(lambda: "<svg></svg>") == "<svg></svg>"


def test_notebooks_show_some_members_of_a_large_family(family: Family) -> None:
    many = replace(family, members=tuple(replace(family.members[0], name=f"E{place}") for place in range(1, 51)))
    html = many._repr_html_()
    assert html.count("<figure") == 24 and "(26 members before E50 are not shown)" in html and "<b>E50</b>" in html


def test_notebooks_show_matches_reasons_plans_and_tables(family: Family) -> None:
    engine = envgraph.open("burning_forest")
    matches = engine.matches("burningTile")
    html = matches._repr_html_()
    assert html.count("<tr>") == len(matches) + 1
    assert "&lt;BurningTile#" in html
    assert matches[0]._repr_html_().count("<tr>") == 2
    assert engine.matches("onFire")._repr_html_() == "no matches"
    assert engine.matches("neighbour")._repr_html_().endswith("<p>and 124 more</p>")
    assert "then fails" in engine.why_not("onFire")._repr_html_()
    assert "<br>body 1: about" in engine.explain("solvable")._repr_html_()
    table = family.explored(family.members[0]).tabular._repr_html_()
    assert "<th>states</th>" in table
    assert "left, down, right, up" in table
