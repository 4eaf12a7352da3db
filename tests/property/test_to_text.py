"""Definitions are read back from their text as they were, and a rule and its text do the same."""

from __future__ import annotations

from dataclasses import replace

from hypothesis import assume, given, settings, strategies as st

from envgraph.errors import InvalidArgument, RuleError, Source, exact_key
from envgraph.lang import Pattern as PatternOf, Rule as RuleOf, Unit as UnitOf, format_text, to_text
from envgraph.lang.read._query_reader import read_query
from envgraph.lang.read._rules_reader import read_rules
from envgraph.lang.syntax._grammar import load_grammar
from envgraph.lang.syntax._parser import parse
from envgraph.lang.write._rule_writer import RuleWriter, definition_as_read
from envgraph.lang.write._term_writer import normalised_doc
from envgraph.metamodel import Annotation
from envgraph.pattern import (
    Aggregate,
    Alap,
    Applicable,
    Assignment,
    AtomicStep,
    Binary,
    Body,
    Check,
    Closure,
    ColumnMark,
    Comparison,
    Conditional,
    Constant,
    CreateAction,
    DeleteEdge,
    DeleteNode,
    EnumLiteral,
    Evaluation,
    FunctionCall,
    IfStep,
    LeftSide,
    MergeAction,
    Modification,
    MoveAction,
    Navigation,
    Negation,
    Parameter,
    PathConstraint,
    Pattern,
    PatternCall,
    RedirectAction,
    Repeat,
    RetypeAction,
    RightSide,
    Rule,
    RuleBlock,
    RuleEdge,
    RuleNode,
    SetAction,
    Step,
    StepSequence,
    TryStep,
    TypeConstraint,
    Unary,
    Unit,
    UnitCall,
    UnitChoice,
    Variable,
)
from envgraph.rewrite import Engine
from tests.oracle.worlds import RandomCase, random_cases
from tests.profile import examples
from tests.property.test_rewrite_oracle import Graph, Sketch, as_model, as_rule, graphs, sketches
from tests.unit.rewrite.graphs import chain

# --- any data that has a text, sense or nonsense

NAMES = st.sampled_from(
    ["a", "b", "x1", "_x", "Größe", "find", "pattern", "rule", "lhs", "to", "in", "all", "true", "none", "count", "set",
     "delete", "else", "check", "operators", "as", "instanceof"]
)  # fmt: skip
QUALIFIED = st.lists(NAMES, min_size=1, max_size=3).map(".".join)
VARIABLES = st.builds(Variable, NAMES | st.just("_"))
TEXTS = st.text(max_size=6)
NUMBERS = st.integers(-(2**63) + 1, 2**63 - 1) | st.floats(allow_nan=False, allow_infinity=False)
VALUES = NUMBERS | TEXTS | st.booleans()
LITERALS = st.builds(EnumLiteral, st.none() | NAMES, NAMES)
CONSTANTS = st.builds(Constant, VALUES)
LINES = st.text("ab *'/", max_size=8).filter(lambda line: "*/" not in line)
DOCS = st.none() | st.lists(LINES, max_size=3).map("\n".join)


def deeper(inner: st.SearchStrategy) -> st.SearchStrategy:
    operators = st.sampled_from(["+", "-", "*", "/", "%", "==", "!=", "<", "<=", ">", ">=", "&&", "||"])
    return st.one_of(
        st.builds(Unary, st.sampled_from("-!"), inner),
        st.builds(Binary, operators, inner, inner),
        st.builds(Conditional, inner, inner, inner),
        st.builds(FunctionCall, NAMES, st.lists(inner, max_size=2).map(tuple)),
        st.builds(Navigation, inner, NAMES),
    )


EXPRESSIONS = st.recursive(VARIABLES | LITERALS | CONSTANTS | st.just(Constant(None)), deeper, max_leaves=6)
CLOSURES = st.sampled_from(Closure)
TERMS = st.deferred(
    lambda: st.one_of(
        VARIABLES,
        CONSTANTS,
        LITERALS,
        st.just(ColumnMark()),
        st.builds(Evaluation, EXPRESSIONS),
        st.builds(Aggregate, st.sampled_from(["count", "sum", "min", "max", "avg"]), RELATIONS),
    )
)
RELATIONS = st.one_of(
    st.builds(TypeConstraint, NAMES, TERMS),
    st.builds(PathConstraint, NAMES, st.lists(NAMES, min_size=1, max_size=2).map(tuple), TERMS, TERMS, CLOSURES),
    st.builds(PatternCall, QUALIFIED, st.lists(TERMS, max_size=3).map(tuple), CLOSURES),
)
CONDITIONS = st.one_of(
    RELATIONS,
    st.builds(Negation, RELATIONS),
    st.builds(Comparison, st.sampled_from(["==", "!="]), TERMS, TERMS),
    st.builds(Check, EXPRESSIONS),
)
PARAMETERS = st.lists(
    st.builds(Parameter, NAMES, st.none() | NAMES, st.sampled_from([None, "in", "out"])), max_size=3
).map(tuple)
ANNOTATIONS = st.lists(
    st.builds(
        Annotation,
        st.sampled_from(["key", "Constraint", "find", "rule"]),
        st.lists(VALUES, max_size=2).map(tuple),
        st.lists(st.tuples(NAMES, VALUES), max_size=3).map(tuple),
    ),
    max_size=2,
).map(tuple)
PATTERNS = st.builds(
    Pattern,
    NAMES,
    PARAMETERS,
    st.lists(
        st.builds(Body, st.lists(CONDITIONS, max_size=3).map(tuple), st.none() | NAMES),
        min_size=1,
        max_size=2,
    ).map(tuple),
    st.just("") | QUALIFIED,
    st.booleans(),
    st.sampled_from([None, "incremental", "search"]),
    ANNOTATIONS,
    DOCS,
)

ASSIGNED = EXPRESSIONS | st.lists(EXPRESSIONS, max_size=2).map(tuple)
ENDS = st.sampled_from(["a", "b", "c", "d", "_"])
EDGES = st.lists(st.builds(RuleEdge, ENDS, NAMES, ENDS, st.sampled_from(["", "+", "*"])), max_size=4).map(tuple)


@st.composite
def nodes(draw: st.DrawFn, values: bool) -> tuple[RuleNode, ...]:
    found = []
    for name in draw(st.lists(st.sampled_from(["a", "b", "c", "d", "e"]), max_size=5, unique=True)):
        type_ = draw(st.none() | NAMES)
        assigned = draw(st.lists(st.builds(Assignment, NAMES, ASSIGNED), max_size=2)) if values and type_ else []
        found.append(RuleNode(name, type_, tuple(assigned)))
    return tuple(found)


ARROWS = st.builds(RuleEdge, ENDS, NAMES, ENDS, st.sampled_from(["", "+", "*"]))
ACTIONS = st.one_of(
    st.builds(CreateAction, nodes(True), EDGES),
    st.builds(DeleteNode, st.builds(Variable, NAMES)),
    st.builds(DeleteEdge, ARROWS),
    st.builds(SetAction, st.builds(Variable, NAMES), NAMES, st.sampled_from(["=", "+=", "-="]), ASSIGNED),
)
IN_MODIFY = st.one_of(
    ACTIONS,
    st.builds(RetypeAction, st.builds(Variable, NAMES), NAMES),
    st.builds(MoveAction, st.builds(Variable, NAMES), st.builds(Variable, NAMES), NAMES),
    st.builds(MergeAction, st.builds(Variable, NAMES), st.builds(Variable, NAMES)),
    st.builds(RedirectAction, ARROWS, st.builds(Variable, NAMES)),
)
LEFTS = st.builds(LeftSide, nodes(False), EDGES, st.lists(CONDITIONS, max_size=2).map(tuple))
RIGHTS = st.one_of(
    st.none(),
    st.builds(Modification, st.lists(IN_MODIFY, max_size=3).map(tuple)),
    st.builds(
        RightSide,
        nodes(True),
        EDGES,
        st.lists(ACTIONS.filter(lambda one: not isinstance(one, CreateAction)), max_size=2).map(tuple),
    ),
)
BLOCKS = st.deferred(
    lambda: st.builds(
        RuleBlock,
        st.sampled_from(["not", "require", "forall", "forall+", "optional"]),
        LEFTS,
        st.lists(BLOCKS, max_size=1).map(tuple),
        RIGHTS,
    )
)
RULES = st.builds(
    Rule,
    NAMES,
    PARAMETERS,
    LEFTS,
    st.lists(BLOCKS, max_size=2).map(tuple),
    RIGHTS,
    st.just("") | QUALIFIED,
    st.floats(0.01, 100),
    st.integers(-5, 5),
    st.sampled_from(["dpo", "spo"]),
    st.booleans(),
    st.lists(st.lists(NAMES, min_size=2, max_size=3).map(tuple), max_size=2).map(tuple),
    ANNOTATIONS,
    DOCS,
)

ARGUMENTS = st.lists(EXPRESSIONS, max_size=2).map(tuple)
# Nothing is applicable at no value, so there is no text that asks it.
ASKED = st.builds(Applicable, NAMES, ARGUMENTS.filter(lambda given: Constant(None) not in given), st.booleans())
WHERE = st.lists(CONDITIONS, max_size=2).map(tuple)
CALLS = st.one_of(
    st.builds(UnitCall, QUALIFIED, ARGUMENTS, st.booleans(), where=WHERE),
    st.builds(UnitCall, QUALIFIED, ARGUMENTS, first=st.just(True), where=WHERE),
    st.builds(UnitCall, QUALIFIED, ARGUMENTS, st.just(True), limit=st.none() | st.integers(1, 9), by=EXPRESSIONS),
)


def steps(inner: st.SearchStrategy) -> st.SearchStrategy:
    return st.one_of(
        st.builds(StepSequence, st.lists(inner, max_size=3).map(tuple)),
        st.builds(UnitChoice, st.lists(CALLS, min_size=1, max_size=3).map(tuple)),
        st.builds(UnitChoice, st.lists(inner, min_size=2, max_size=3).map(tuple)),
        st.builds(Alap, inner),
        st.builds(Repeat, EXPRESSIONS, st.integers(0, 3) | EXPRESSIONS, inner),
        st.builds(AtomicStep, inner),
        st.builds(lambda low, more, body: Repeat(low, low + more, body), st.integers(0, 3), st.integers(0, 3), inner),
        st.builds(TryStep, inner, st.none() | inner),
        st.builds(IfStep, CONDITIONS | ASKED, inner, st.none() | inner),
    )


STEPS: st.SearchStrategy[Step] = st.recursive(CALLS, steps, max_leaves=6)
UNITS = st.builds(Unit, NAMES, PARAMETERS, STEPS, st.just("") | QUALIFIED, st.floats(0.01, 9), st.integers(0, 3))


def patterns_of(text: str) -> tuple[Pattern, ...]:
    return read_query(parse("query", Source("", text))).definitions


def rules_of(text: str) -> tuple[object, ...]:
    return read_rules(parse("rules", Source("", text))).definitions


@settings(max_examples=examples(40))
@given(PATTERNS)
def test_any_pattern_is_read_back_from_its_text(pattern: Pattern) -> None:
    text = to_text(pattern)
    (found,) = patterns_of(text)
    assert exact_key(found) == exact_key(replace(pattern, doc=normalised_doc(pattern.doc)))
    assert format_text("query", text) == text
    assert to_text(found) == text


@settings(max_examples=examples(40))
@given(RULES)
def test_any_rule_is_read_back_from_its_text(rule: Rule) -> None:
    text = to_text(rule)
    (found,) = rules_of(text)
    assert found == definition_as_read(rule)
    assert format_text("rules", text) == text
    assert to_text(found) == text


@settings(max_examples=examples(40))
@given(UNITS)
def test_any_unit_is_read_back_from_its_text(unit: Unit) -> None:
    text = to_text(unit)
    (found,) = rules_of(text)
    assert found == definition_as_read(unit)
    assert format_text("rules", text) == text
    assert to_text(found) == text


@settings(max_examples=examples(40))
@given(random_cases())
def test_random_library_patterns_are_read_back_from_their_text(world: RandomCase) -> None:
    for pattern in world.library.patterns:
        try:
            text = to_text(pattern)
        except InvalidArgument as error:
            assert "conditions also allow subclasses" in str(error) or "a path needs" in str(error)
            continue
        assert patterns_of(text) == (pattern,)
        assert format_text("query", text) == text


# --- parts of definitions, in texts and in data


WRITER = RuleWriter("it", load_grammar("rules").lexer.keywords)


def fields_of(rule: Rule) -> dict[str, object]:
    """What `Rule(...)` takes besides the parts."""
    return {
        "package": rule.package,
        "weight": rule.weight,
        "priority": rule.priority,
        "semantics": rule.semantics,
        "injective": rule.injective,
        "homomorphic": rule.homomorphic,
        "annotations": rule.annotations,
        "doc": rule.doc,
    }


def inside(text: str) -> str:
    """What stands in the braces of a text."""
    return text[text.index("{") + 1 : text.rindex("}")]


@settings(max_examples=examples(40))
@given(RULES, st.booleans())
def test_rule_built_from_parts_equals_the_rule_read_from_text(rule: Rule, texts: bool) -> None:
    right: dict[str, object] = {}
    if rule.right is not None:
        part = "modify" if isinstance(rule.right, Modification) else "rhs"
        right = {part: inside(WRITER.format_right_side(rule.right)) if texts else rule.right}
    made = RuleOf(
        rule.name,
        inside("{" + WRITER.format_parameters(rule.parameters)[1:-1] + "}") if texts else rule.parameters,
        WRITER.format_left_side(rule.left) if texts else rule.left,
        blocks="\n".join(map(WRITER.format_block, rule.blocks)) if texts else rule.blocks,
        **right,
        **fields_of(rule),
    )
    assert made == definition_as_read(rule)
    assert (to_text(made),) == (to_text(rule),)


@settings(max_examples=examples(30))
@given(PATTERNS, UNITS, st.booleans())
def test_patterns_and_units_built_from_parts_equal_those_read_from_text(
    pattern: Pattern, unit: Unit, texts: bool
) -> None:
    bodies = [body for body in pattern.bodies if body.name is None] or [Body(())]
    pattern = replace(pattern, bodies=tuple(bodies))
    assume("# " not in WRITER.format_statements(unit.body))  # a mark of a column, which belongs to an aggregate
    made = PatternOf(
        pattern.name,
        WRITER.format_parameters(pattern.parameters)[1:-1] if texts else pattern.parameters,
        ["".join(f"{WRITER.format_condition(one)};" for one in b.constraints) if texts else b for b in bodies],
        package=pattern.package,
        private=pattern.private,
        strategy=pattern.strategy,
        annotations=pattern.annotations,
        doc=pattern.doc,
    )
    assert made == replace(pattern, doc=normalised_doc(pattern.doc))
    other = UnitOf(
        unit.name,
        WRITER.format_parameters(unit.parameters)[1:-1] if texts else unit.parameters,
        WRITER.format_statements(unit.body) if texts else unit.body,
        package=unit.package,
        weight=unit.weight,
        priority=unit.priority,
    )
    assert other == definition_as_read(unit)


# --- what rules do


@settings(max_examples=examples(40))
@given(graphs(), sketches(), st.booleans(), st.integers(0, 99))
def test_rule_read_from_its_text_is_applied_alike(graph: Graph, sketch: Sketch, modify: bool, seed: int) -> None:
    rule = as_rule(sketch, modify)
    (read,) = rules_of(to_text(rule))
    states = []
    for one in (rule, read):
        engine = Engine(as_model(graph), seed=seed)
        engine.add(one)
        said: list[object] = [match.row for match in engine.matches("r")]
        for _ in range(4):
            try:
                application = engine.apply("r")
                said.append(application and application.match.row)
            except RuleError as error:
                said.append(error.reason)
        states.append((said, engine.model.state_hash()))
    assert states[0] == states[1]


RULES_TO_CALL = """
rule grow { lhs { x : Item; check x.n < 3; } modify { set x.n += 1; } }
rule cut(x : Item) { lhs { x -next-> y : Item; } modify { delete x -next-> y; } }
@priority(1) rule drop { lhs { x : Item; } modify { delete x; } }
@weight(3.0) rule join(x : Item, y : Item) { lhs { } modify { create x -next-> y; } }
derive kinds = retype among { Item, Special };
"""


def runnable(inner: st.SearchStrategy) -> st.SearchStrategy:
    test = st.sampled_from(
        [
            Negation(PathConstraint("Item", ("next",), Variable("_"), Variable("_"))),
            *(TRUE, FALSE, Applicable("grow"), Applicable("drop", negated=True)),
            *(Applicable("cut", (Variable("_"),)), Applicable("join", (Variable("_"), Variable("_")))),
        ]
    )
    return st.one_of(
        st.builds(StepSequence, st.lists(inner, min_size=1, max_size=3).map(tuple)),
        st.builds(UnitChoice, st.lists(RUNNABLE_CALLS, min_size=1, max_size=3).map(tuple)),
        st.builds(UnitChoice, st.lists(inner, min_size=2, max_size=3).map(tuple)),
        st.builds(AtomicStep, inner),
        st.builds(lambda low, more, body: Repeat(low, low + more, body), st.integers(0, 2), st.integers(0, 2), inner),
        st.builds(TryStep, inner, st.none() | inner),
        st.builds(IfStep, test, inner, st.none() | inner),
    )


TRUE, FALSE = (Check(Binary("==", Constant(1), Constant(number))) for number in (1, 2))
RUNNABLE_CALLS = st.one_of(
    st.builds(UnitCall, st.sampled_from(["grow", "cut", "drop", "join", "kinds"])),
    st.builds(UnitCall, st.sampled_from(["grow", "drop", "join"]), every=st.just(True)),
    st.builds(UnitCall, st.just("cut"), first=st.just(True)),
    st.builds(
        UnitCall,
        st.just("grow"),
        every=st.just(True),
        limit=st.integers(1, 2),
        by=st.just(Unary("-", Navigation(Variable("x"), "n"))),
        where=st.just((Check(Binary("!=", Navigation(Variable("x"), "n"), Constant(1))),)),
    ),
)


@settings(max_examples=examples(40))
@given(st.recursive(RUNNABLE_CALLS, runnable, max_leaves=6), st.integers(0, 99))
def test_unit_read_from_its_text_runs_alike(body: Step, seed: int) -> None:
    unit = Unit("u", (), body)
    (read,) = rules_of(to_text(unit))
    states = []
    for one in (unit, read):
        made = Engine(chain(3), seed=seed)
        made.add(*rules_of(RULES_TO_CALL), one)
        said = [(result.firings, bool(result)) for result in (made.run("u") for _ in range(3))]
        states.append((said, made.model.state_hash()))
    assert states[0] == states[1]
