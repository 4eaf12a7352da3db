"""Recorded runs: what is in them, what cannot be, and that they lead to the same states again."""

from __future__ import annotations

import json

import pytest
from jsonschema import Draft202012Validator

from envgraph.errors import Source, TraceError
from envgraph.lang import parse_trace
from envgraph.rewrite import Engine, Firing, Trace, trace_schema, trace_to_text
from tests.unit.rewrite.graphs import chain, definitions, engine, snapshot

RULES = """
rule up(a : Item) { lhs { check a.n < 9; } modify { set a.n = a.n + 1; } }
rule name(a : Item, value : string) { lhs { } modify { set a.label = value; } }
rule grow { lhs { } modify { create new : Item { n = 5 }; } }
unit twice(a : Item) { up(a); up(a); }
"""
QUERIES = "pattern item(a : Item) { Item(a); } pattern nine(a : Item) { Item.n(a, 9); }"


def made() -> Engine:
    return engine(RULES, QUERIES, model=chain(3))


def recorded() -> tuple[Engine, Trace]:
    one = made()
    with one.recording() as trace:
        one.apply("grow")
        one.run("twice", a=1)
        one.apply("name", a=2, value='a "quoted"\nname \N{SNOWMAN}')
    return one, trace


def test_a_trace_as_text_leads_to_the_same_state_and_order_again() -> None:
    one, trace = recorded()
    text = trace_to_text(one, trace)
    other = made()
    read = parse_trace(Source("a.trace", text), other)
    assert read == trace and read.states == trace.states
    other.replay(read)
    assert snapshot(other.model) == snapshot(one.model)
    assert trace_to_text(other, read) == text


def test_every_line_is_valid_by_the_published_schema() -> None:
    validator = Draft202012Validator(trace_schema())
    lines = [json.loads(line) for line in trace_to_text(*recorded()).splitlines()]
    assert [next(iter(line)) for line in lines] == ["format", "rule", "rule", "rule", "rule", "end"]
    for line in lines:
        validator.validate(line)
    assert "state" not in lines[2] and lines[3]["match"] == {"a": 1}
    assert not validator.is_valid({"rule": "up"})


def test_nested_recordings_are_independent() -> None:
    one = made()
    with one.recording() as outer:
        with one.recording() as inner:
            one.apply("up", a=0)
        one.apply("up", a=1)
    assert (inner, outer) == ([("up", (0,))], [("up", (0,)), ("up", (1,))])


def test_rolled_back_applications_are_not_recorded() -> None:
    one = made()
    with one.recording() as trace:
        one.apply("up", a=0)
        with pytest.raises(ZeroDivisionError), one.transaction():
            one.apply("up", a=1)
            raise ZeroDivisionError
        one.apply("up", a=2)
    assert trace == [("up", (0,)), ("up", (2,))]
    made().replay(trace)


# --- what cannot be recorded


@pytest.mark.parametrize("when", [0, 1, 2])
def test_an_edit_from_python_is_refused_at_its_place(when: int) -> None:
    one = made()
    with pytest.raises(TraceError) as caught, one.recording():
        for number in range(2):
            if number == when:
                one.model.node(0).label = "edited"
            one.apply("up", a=number)
        if when == 2:
            one.model.node(0).label = "edited"
    where = f"after application {when}, `up`," if when else "before the first application"
    (problem,) = caught.value.diagnostics
    assert problem.message == f"{where} the model was changed by something other than a rule"
    assert problem.code == "unrecorded-change" and "@engine.rule" in str(problem.hint)


def test_rolled_back_edits_do_not_invalidate_a_trace() -> None:
    one = made()
    with one.recording() as trace:
        with pytest.raises(ZeroDivisionError), one.model.transaction():
            one.model.create("Item")
            raise ZeroDivisionError
        one.apply("up", a=0)
    assert trace == [("up", (0,))]


def test_a_checkout_is_refused() -> None:
    one = made()
    start = one.commit()
    one.apply("up")
    later = one.commit()
    with pytest.raises(TraceError), one.recording():
        one.checkout(start)
        one.apply("up")
    one.checkout(later, discard=True)


def test_the_edits_of_a_job_are_refused_and_its_rules_recorded() -> None:
    one = made()
    rule = one.on("nine", appear=lambda a, engine: engine.apply("name", a=a, value="nine"))
    with one.recording() as trace:
        one.model.node(0)
        while one.model.node(0).n < 9:
            one.apply("up", a=0)
    assert trace[-2:] == [("up", (0,)), ("name", (0, "nine"))]
    other = made()
    other.replay(trace)
    assert snapshot(other.model) == snapshot(one.model)
    rule.cancel()

    def edit(a: object) -> None:
        a.label = "edited"  # type: ignore[attr-defined]

    two = made()
    two.model.node(0).n = 8
    two.on("nine", appear=edit)
    with pytest.raises(TraceError, match="after application 1, `up`"), two.recording():
        two.apply("up", a=0)


def test_a_python_rule_is_one_application_whatever_it_does() -> None:
    def register(one: Engine) -> None:
        @one.rule("item")
        def both(a: object, engine: Engine) -> None:
            engine.apply("up", a=a)
            a.label = "twice"  # type: ignore[attr-defined]
            engine.apply("up", a=a)

    one, other = made(), made()
    register(one)
    register(other)
    with one.recording() as trace:
        one.apply("both", a=1)
    assert trace == [("both", (1,))]
    other.replay(trace)
    assert snapshot(other.model) == snapshot(one.model)


def test_the_edits_of_a_python_unit_are_refused_where_they_are_and_not_taken_back() -> None:
    one = made()

    @one.unit
    def edits(engine: Engine, wanted: bool) -> bool:
        engine.apply("up", a=0)
        engine.model.node(1).label = "edited"
        engine.apply("up", a=2)
        return wanted

    one.add(*definitions("unit u { up; edits(true); } unit v { try { edits(false); } up; }"))
    with pytest.raises(TraceError, match="after application 3, `up`"), one.recording():
        one.apply("grow")
        one.run("u")
    with one.recording() as trace:
        one.run("v")
    assert len(trace) == 1


def test_what_event_rules_applied_is_part_of_what_fire_and_run_say() -> None:
    one = made()
    one.on("nine", appear="grow")
    one.model.node(0).n = 8
    one.settle()
    assert one.fire("up", (0,)) == (("up", (0,)), ("grow", ()))
    one.model.node(1).n = 7
    one.settle()
    result = one.run("twice", a=1)
    assert result.applications == 2 and result.events == (("grow", ()),)
    assert result.firings == (("up", (1,)), ("up", (1,)), ("grow", ()))


# --- replaying


def test_a_replay_from_another_state_is_refused_unless_it_is_only_a_list() -> None:
    _, trace = recorded()
    other = made()
    other.model.node(0).label = "other"
    before = snapshot(other.model)
    with pytest.raises(TraceError, match="the recorded run began in state") as caught:
        other.replay(trace)
    assert caught.value.diagnostics[0].code == "other-state" and snapshot(other.model) == before
    other.replay(list(trace))
    assert other.model.node(0).label == "other"


def test_diverging_replays_are_stopped_and_rolled_back() -> None:
    one, other = made(), made()
    labels = iter(["here", "there"])
    for each in (one, other):

        @each.rule("item")
        def chance(a: object) -> None:
            a.label = next(labels)  # type: ignore[attr-defined]

    with one.recording() as trace:
        one.apply("up", a=0)
        one.apply("chance", a=0)
    before = snapshot(other.model)
    with pytest.raises(TraceError, match="application 2, `chance`, leads to state"):
        other.replay(trace)
    assert snapshot(other.model) == before


def read(text: str) -> Trace:
    return parse_trace(Source("a.trace", text), made())


def mistakes(text: str) -> str:
    one = made()
    with pytest.raises(TraceError) as caught:
        one.replay(parse_trace(Source("a.trace", text), one))
    assert snapshot(one.model) == snapshot(made().model)
    return str(caught.value)


GOOD = trace_to_text(*recorded())
TAMPERED = [
    ("", "", "the file contains no trace"),
    ('"match": {"a": 2', '"match": {"a": 1', "a.trace:5:79: application 4, `name`, leads to state"),
    ('"match": {"a": 2', '"match": {"a": 77', "a.trace:5:27: application 4: name(a=<deleted #77>, value="),
    ('"match": {"a": 2', '"match": {"b": 2', "a.trace:5:33: `name` has no variable `b`"),
    ('"match": {"a": 2', '"match": {"a": "2"', "a.trace:5:33: `a` of `name` takes a `Item`, not '2'"),
    ('"match": {"a": 2, ', '"match": {', "a.trace:5:27: the match of `name` lacks `a`"),
    ('"rule": "name"', '"rule": "nam"', "a.trace:5:10: unknown rule `nam`"),
    ('"rule": "name"', '"rule": 7', "a.trace:5:10: the name of a rule must be a string"),
    ('"rule": "name"', '"rule": "twice"', "a.trace:5:10: `twice` is a unit, not a rule"),
    ('"rule": "name", "match"', '"rule": "name", "mtach"', "a.trace:5:27: unknown entry `mtach`"),
    ('{"rule": "name"', '{"rule": "name",', "a.trace:5:17: not JSON: expecting property name"),
    ('{"end": 4', '{"end": 5', "a.trace:6:9: `end` is 5, but the trace has 4 applications"),
    ('{"end": 4', '{"ende": 4', "a.trace:6:1: this is not a line of a trace"),
    ("envgraph-trace-1", "envgraph-trace-2", 'the format must be `envgraph-trace-1`, not "envgraph-trace-2"'),
    ('"metamodel": "graphs"', '"metamodel": "grafs"', 'a.trace:1:63: the trace is of a model of "grafs"'),
    ('{"format"', '{"end": 0}\n{"format"', "a.trace:1:1: the first line is missing"),
]


@pytest.mark.parametrize(("old", "new", "message"), TAMPERED, ids=lambda text: text[:30])
def test_a_tampered_trace_is_refused_at_its_place(old: str, new: str, message: str) -> None:
    assert message in mistakes(GOOD.replace(old, new) if old else "")


def test_all_mistakes_of_a_trace_are_reported_together() -> None:
    text = GOOD.replace('"rule": "name"', '"rule": "nam"').replace('"rule": "up"', '"rule": "upp"')
    assert mistakes(text).count("unknown rule") == 3


@pytest.mark.parametrize(
    ("old", "new"),
    [
        ('"rule": "name"', '"rule": "nam"'),  # the last one: another state stands before the end
        ('"match": {"a": 2, ', '"match": {'),
        ('{"format"', "{format"),
        (GOOD, "{"),
    ],
    ids=lambda text: text[:20],
)
def test_consequences_of_trace_errors_are_not_reported(old: str, new: str) -> None:
    with pytest.raises(TraceError) as caught:
        read(GOOD.replace(old, new))
    assert len(caught.value.diagnostics) == 1


def test_missing_and_duplicate_lines_are_reported() -> None:
    lines = GOOD.splitlines(keepends=True)
    assert "ends after 3 applications, without its last line" in mistakes("".join(lines[:4]))
    assert "but the trace has 3 applications" in mistakes("".join(lines[:4] + lines[5:]))
    assert "the trace has begun already" in mistakes(lines[0] + GOOD)
    assert "the trace has ended" in mistakes(GOOD + lines[1])
    assert "16 hexadecimal digits" in mistakes(GOOD.replace('"state": "', '"state": "g', 1))


def test_a_trace_without_states_is_replayed_unchecked() -> None:
    lines = [json.loads(line) for line in GOOD.splitlines()]
    text = "\n".join(json.dumps({k: v for k, v in line.items() if k != "state"}) for line in lines)
    one = made()
    trace = parse_trace(Source("a.trace", text), one)
    assert trace.states == {} and trace[0] == Firing("grow", ())
    one.replay(trace)
    assert one.model.state_hash() == recorded()[0].model.state_hash()
