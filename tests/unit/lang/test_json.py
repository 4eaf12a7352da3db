"""JSON with positions."""

from __future__ import annotations

import json

import pytest
from hypothesis import given, strategies as st

from envgraph.errors import LoadError, Source, TypeMismatch
from envgraph.graph import Model, model_to_json
from envgraph.lang import parse_json, parse_model
from envgraph.metamodel import Attribute, Class, Metamodel, Reference, Scalar

values = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats(allow_nan=False, allow_infinity=False) | st.text(),
    lambda inner: st.lists(inner) | st.dictionaries(st.text(), inner),
    max_leaves=20,
)


@given(values, st.sampled_from([None, 1, "\t"]), st.booleans())
def test_every_span_holds_the_text_of_its_value(value: object, indent: int | str | None, ascii_only: bool) -> None:
    text = json.dumps(value, indent=indent, ensure_ascii=ascii_only)
    found, spans = parse_json(Source("a.json", text))
    assert found == value
    count = 0
    for path, span in spans.items():
        part: object = value
        for step in path:
            part = part[step]  # type: ignore[index]
        assert json.loads(span.text) == part
        count += 1
    assert count == count_values(value)


def count_values(value: object) -> int:
    """How many values there are, containers included."""
    if isinstance(value, dict):
        return 1 + sum(count_values(part) for part in value.values())
    return 1 + sum(count_values(part) for part in value) if isinstance(value, list) else 1


@pytest.mark.parametrize(("text", "column"), [("", 1), ('{"a": }', 7), ("[1, 2", 6), ('"open', 1), ("[" * 100_000, 1)])
def test_invalid_json_is_refused_at_its_position(text: str, column: int) -> None:
    with pytest.raises(LoadError) as caught:
        parse_json(Source("a.json", text))
    (problem,) = caught.value.diagnostics
    assert problem.span is not None and problem.span.column == column


def test_errors_of_a_json_model_have_the_span_of_the_wrong_value() -> None:
    metamodel = Metamodel("m", [Class("A", features=(Attribute("n", Scalar.INT), Reference("to", "A", 0)))])
    text = """{"format": "envgraph-model-1",
 "objects": [
  {"id": 0, "class": "A", "features": {"n": "three"}},
  {"id": 1, "class": "A", "features": {"to": 7}}
 ]}"""
    with pytest.raises(LoadError) as caught:
        parse_model(Source("m.json", text), metamodel)
    first = caught.value.diagnostics[0]
    assert first.span is not None and first.span.text == '"three"' and str(first.span) == "m.json:3:45"


BOX = Metamodel("m", [Class("Box", features=(Attribute("size", Scalar.INT), Attribute("weight", Scalar.FLOAT)))])


@pytest.mark.parametrize(
    ("size", "message"),
    [
        (str(2**63), "`objects[0].features.size`: `Box.size` takes an int of 64 bits"),
        (str(-(2**63) - 1), "`objects[0].features.size`: `Box.size` takes an int of 64 bits"),
        ("1" * 5000, "the number is too large"),
    ],
)
def test_ints_beyond_64_bits_are_refused_at_their_position(size: str, message: str) -> None:
    objects = f'[{{"id": 0, "class": "Box", "features": {{"size": {size}}}}}]'
    head = '"format": "envgraph-model-1", "name": "m", "metamodel": "m", "next_id": 1'
    with pytest.raises(LoadError) as raised:
        parse_model(Source("a.json", f'{{{head}, "objects": {objects}}}'), BOX)
    (problem,) = raised.value.diagnostics
    assert (problem.message, problem.span.text if problem.span else None) == (message, size)


@pytest.mark.parametrize("size", [2**63 - 1, -(2**63)])
def test_ints_of_64_bits_are_read(size: int) -> None:
    model = Model(BOX)
    model.create("Box", size=size)
    text = json.dumps(model_to_json(model))
    assert parse_model(Source("a.json", text), BOX).nodes()[0].size == size


def test_long_values_are_not_shown_at_full_length() -> None:
    box = Model(BOX).create("Box")
    for value in ("x" * 10**6, 10**5000):
        with pytest.raises(TypeMismatch) as raised:
            box.weight = value
        assert len(str(raised.value)) < 200


@pytest.mark.parametrize("half", [r"\ud800", r"\uDFFF"])
def test_a_lone_surrogate_is_refused_at_its_position(half: str) -> None:
    with pytest.raises(LoadError) as raised:
        parse_json(Source("a.json", rf'["\\ud800 \ud83d\ude00", "{half}"]'))
    (problem,) = raised.value.diagnostics
    assert problem.span is not None
    assert (problem.span.text, problem.span.column) == (half, 27)


def test_surrogate_pairs_are_read() -> None:
    value, _ = parse_json(Source("a.json", r'["\ud83d\ude00", "\\ud800"]'))
    assert value == ["\N{GRINNING FACE}", r"\ud800"]


def test_control_characters_are_refused_with_a_message() -> None:
    with pytest.raises(LoadError, match=r"a.json:1:2: not JSON: invalid control character\n"):
        parse_json(Source("a.json", '"\0"'))
