"""`.environment` files as behaviours."""

from typing import Any

import pytest

from envgraph.env import (
    Action,
    Agent,
    Behaviour,
    Branch,
    Domain,
    DrawGraph,
    DrawGrid,
    EachStep,
    Effect,
    Observation,
    ObserveAttribute,
    ObserveFind,
    ObserveObject,
    ObserveRange,
    OnFind,
    OnRefused,
    OnReset,
    RuleCall,
    Token,
)
from envgraph.lang import TextFiles, load_workspace
from envgraph.metamodel import Class, EnumType, Metamodel
from envgraph.pattern import (
    Binary,
    Constant,
    EnumLiteral,
    Expression,
    Navigation,
    Negation,
    Parameter,
    PatternCall,
    Unary,
    Variable,
)
from tests.reading import read_definitions

a, x = Variable("a"), Variable("x")


def read(text: str) -> Any:
    return read_definitions(text, "environment")


def behaviour(clauses: str) -> Behaviour:
    file = read(f"environment E {{ {clauses} }}")
    assert file.diagnostics == ()
    (only,) = file.definitions
    return only


def application_of(rule: str | None, *arguments: Expression) -> tuple[Branch, ...]:
    return (Branch(1.0, RuleCall(rule, arguments)),)


@pytest.mark.parametrize(
    ("text", "data"),
    [
        ("action go = r(x)", Action("go", application_of("r", x))),
        ("action wait = nothing()", Action("wait", application_of(None))),
        (
            "action go(w : Way, n : -1..3) = p.r(x, w) reward -0.5 else reward n",
            Action(
                "go",
                application_of("p.r", x, Variable("w")),
                (("w", Domain(cls="Way")), ("n", Domain(low=-1, high=3))),
                Constant(-0.5),
                Variable("n"),
            ),
        ),
        (
            "action go = 0.9: a() | 0.05: b(1) | 0: nothing() else reward -1",
            Action(
                "go",
                (
                    Branch(0.9, RuleCall("a")),
                    Branch(0.05, RuleCall("b", (Constant(1),))),
                    Branch(0.0, RuleCall(None)),
                ),
                else_reward=Constant(-1),
            ),
        ),
        (
            "action up = r() reward -latency",
            Action("up", application_of("r"), reward=Unary("-", Variable("latency"))),
        ),
    ],
)
def test_an_action_is_parsed_to_its_data(text: str, data: Action) -> None:
    assert behaviour(text).actions == (data,)


@pytest.mark.parametrize(
    ("text", "data"),
    [
        ("each step reward -0.01", EachStep(Constant(-0.01))),
        ("each step apply r()", EachStep(apply=application_of("r"))),
        (
            "each step apply 0.5: r() reward 1",
            EachStep(Constant(1), (Branch(0.5, RuleCall("r")),)),
        ),
        ("on find p(x) terminate failure", OnFind(PatternCall("p", (x,)), end="failure")),
        ("on find p(x) truncate", OnFind(PatternCall("p", (x,)), end="truncation")),
        (
            "on find p(x, ::red) apply r(x) terminate success reward a.n * 2",
            OnFind(
                PatternCall("p", (x, EnumLiteral(None, "red"))),
                Binary("*", Navigation(a, "n"), Constant(2)),
                "success",
                application_of("r", x),
            ),
        ),
        (
            "on find p(x) apply 0.1: r(x) | 0.2: nothing()",
            OnFind(PatternCall("p", (x,)), apply=(Branch(0.1, RuleCall("r", (x,))), Branch(0.2, RuleCall(None)))),
        ),
        ("on refused nothing()", OnRefused()),
        ("on refused truncate reward -a.n", OnRefused(Unary("-", Navigation(a, "n")), "truncation")),
        ("on refused terminate failure", OnRefused(end="failure")),
        ("on neg find p(_) reward 1", OnFind(Negation(PatternCall("p", (Variable("_"),))), Constant(1))),
    ],
)
def test_an_effect_is_parsed_to_its_data(text: str, data: Effect) -> None:
    assert behaviour(text).effects == (data,)


@pytest.mark.parametrize(
    ("text", "data"),
    [
        ("a.at among Cell", ObserveObject(Navigation(a, "at"), "Cell")),
        ("a.b.c among Cell or none", ObserveObject(Navigation(Navigation(a, "b"), "c"), "Cell", True)),
        (
            "x.at among Cell or none for x : Key",
            ObserveObject(Navigation(x, "at"), "Cell", True, Parameter("x", "Key")),
        ),
        ("a.n in -3..50", ObserveRange(Navigation(a, "n"), -3, 50)),
        ("a.n in 0..1 if find p(a)", ObserveRange(Navigation(a, "n"), 0, 1, None, PatternCall("p", (a,)))),
        (
            "x.open if find p(x) for x : Key",
            ObserveAttribute(Navigation(x, "open"), Parameter("x", "Key"), PatternCall("p", (x,))),
        ),
        ("x.n in 0..1 for x : Key", ObserveRange(Navigation(x, "n"), 0, 1, Parameter("x", "Key"))),
        ("find p(a, _)", ObserveFind(PatternCall("p", (a, Variable("_"))))),
        ("count find p(a) up to 4", ObserveFind(PatternCall("p", (a,)), 4)),
        ("x.open for x : Door", ObserveAttribute(Navigation(x, "open"), Parameter("x", "Door"))),
        ("a.open", ObserveAttribute(Navigation(a, "open"))),
    ],
)
def test_an_observation_is_parsed_to_its_data(text: str, data: Observation) -> None:
    assert behaviour(f"observe {text}").observations == (data,)


@pytest.mark.parametrize(
    ("text", "data"),
    [
        ("draw grid Cell at (x, y)", DrawGrid("Cell", "x", "y")),
        (
            "draw grid Cell at (x, y) with a at a.at, r : Robot at r.place.cell",
            DrawGrid(
                "Cell",
                "x",
                "y",
                (
                    Token("a", Navigation(a, "at")),
                    Token("r", Navigation(Navigation(Variable("r"), "place"), "cell"), "Robot"),
                ),
            ),
        ),
        ("draw graph Router", DrawGraph("Router")),
        (
            "draw graph Router label name with a at a.at",
            DrawGraph("Router", "name", (Token("a", Navigation(a, "at")),)),
        ),
    ],
)
def test_a_draw_clause_is_parsed_to_its_data(text: str, data: DrawGrid | DrawGraph) -> None:
    assert behaviour(text).draw == data


def test_a_file_with_all_clauses_is_parsed() -> None:
    text = """
        import "q.query"
        import "r.rules"

        /** What it is. */
        environment Hall(hall : Hall) {
            agent robot : Robot {
                action wait = nothing();
                on find low(robot) reward -1.0
                observe robot.at among Cell
            }
            on reset apply start(hall);
            each step reward 1.0
            on find done(hall) terminate success
            each step reward 2.0
            limit 30 steps;
        }
    """
    file = read(text)
    assert file.diagnostics == ()
    assert [one.path for one in file.header.imports] == ["q.query", "r.rules"]
    robot = Variable("robot")
    assert file.definitions == (
        Behaviour(
            "Hall",
            parameters=(Parameter("hall", "Hall"),),
            effects=(
                EachStep(Constant(1.0)),
                OnFind(PatternCall("done", (Variable("hall"),)), end="success"),
                EachStep(Constant(2.0)),
            ),
            resets=(OnReset((Branch(1.0, RuleCall("start", (Variable("hall"),))),)),),
            agents=(
                Agent(
                    "robot",
                    "Robot",
                    (Action("wait", application_of(None)),),
                    (OnFind(PatternCall("low", (robot,)), Constant(-1.0)),),
                    (ObserveObject(Navigation(robot, "at"), "Cell"),),
                ),
            ),
            limit=30,
            doc="What it is.",
        ),
    )


@pytest.mark.parametrize("name", ["action", "reward", "take", "step", "among", "up", "with", "agent", "limit"])
def test_keywords_are_names_where_they_are_not_expected(name: str) -> None:
    found = behaviour(f"action {name}({name} : {name}) = {name}({name}) observe {name}.{name} among {name}")
    assert found.actions[0].name == name
    assert found.observations == (ObserveObject(Navigation(Variable(name), name), name),)


def test_the_domain_of_an_action_parameter_is_an_enum_or_class_of_the_metamodel() -> None:
    metamodel = Metamodel("m", [Class("Cell")], [EnumType("Way", ("west",))])
    text = "action a(w : Way, c : Cell, n : 0..1) = r() agent x : Cell { action b(w : Way) = r() }"
    files = TextFiles({"t.environment": f"environment E {{ {text} }}"})
    (found,) = load_workspace(["t.environment"], files=files, metamodel=metamodel).behaviours
    assert [domain for _, domain in found.actions[0].parameters] == [
        Domain(enum="Way"), Domain(cls="Cell"), Domain(low=0, high=1)
    ]  # fmt: skip
    assert found.agents[0].actions[0].parameters == (("w", Domain(enum="Way")),)


def test_several_environments_in_a_file() -> None:
    file = read("environment A { action a = r() }\nenvironment B { action b = r() }")
    assert [one.name for one in file.definitions] == ["A", "B"]
    assert file.diagnostics == ()
