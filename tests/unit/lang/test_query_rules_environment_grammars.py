"""What the grammars of queries, rules and environments have in common: positions, robustness, speed."""

from collections.abc import Iterator, Sequence
from dataclasses import fields, is_dataclass
from pathlib import Path
from time import process_time
from typing import Protocol

import pytest
from hypothesis import given, settings, strategies as st

from envgraph.errors import Diagnostic, Span
from envgraph.lang import data_path
from tests.profile import AT_NIGHT, NIGHTLY, examples
from tests.reading import lexeme_places, read_definitions

SHARED = Path(__file__).parents[2] / "golden" / "shared"
LANGUAGES = ("query", "rules", "environment")
TEXTS = {
    path.name: path.read_text(encoding="utf-8")
    for folder in (SHARED, data_path("rules"))
    for path in sorted(folder.rglob("*"))
    if path.suffix.removeprefix(".") in LANGUAGES
}


class File(Protocol):
    @property
    def diagnostics(self) -> tuple[Diagnostic, ...]: ...


def read(name: str, text: str) -> File:
    stem, _, language = name.rpartition(".")
    return read_definitions(text, language, stem)


# --- the example domains


@pytest.mark.parametrize("name", TEXTS)
def test_files_of_the_example_domains_are_parsed_without_diagnostics(name: str) -> None:
    assert read(name, TEXTS[name]).diagnostics == ()


@pytest.mark.parametrize("name", TEXTS)
def test_every_name_in_the_data_has_its_exact_span(name: str) -> None:
    checked = 0
    for text, span in places(read(name, TEXTS[name])):
        assert span is not None, text
        assert span.text.removeprefix("^").replace(" ", "") == text
        checked += 1
    assert checked > 5


NAMED = {
    "Variable": ["name"],
    "Parameter": ["name", "type"],
    "Pattern": ["name"],
    "Rule": ["name"],
    "Unit": ["name"],
    "Derivation": ["name", "classes"],
    "Behaviour": ["name"],
    "Action": ["name"],
    "Agent": ["variable", "cls"],
    "RuleNode": ["name", "type"],
    "RuleEdge": ["source", "reference", "target"],
    "TypeConstraint": ["type"],
    "PathConstraint": ["type", "features"],
    "PatternCall": ["pattern"],
    "EnumLiteral": ["enum", "literal"],
    "Navigation": ["feature"],
    "FunctionCall": ["function"],
    "Assignment": ["feature"],
    "SetAction": ["feature"],
    "RetypeAction": ["type"],
    "MoveAction": ["reference"],
    "UnitCall": ["name"],
    "RuleCall": ["rule"],
    "ObserveObject": ["among"],
    "Token": ["cls"],
    "DrawGrid": ["cls", "column", "row"],
    "DrawGraph": ["cls", "label"],
}
SEVERAL = {"features": "feature_spans", "classes": "class_spans"}


def places(data: object) -> Iterator[tuple[str, Span | None]]:
    """Each name in the data with the span that is kept for it."""
    if isinstance(data, tuple):
        for item in data:
            yield from places(item)
    if not is_dataclass(data) or isinstance(data, Span | Diagnostic | type):
        return
    for name in NAMED.get(type(data).__name__, []):
        value = getattr(data, name)
        if name in SEVERAL:
            spans: Sequence[Span] = getattr(data, SEVERAL[name])
            assert len(spans) == len(value)
            yield from zip(value, spans, strict=True)
        elif value is not None:
            yield value, getattr(data, f"{name}_span", data.span)  # type: ignore[attr-defined]
    for part in fields(data):
        yield from places(getattr(data, part.name))


# --- robustness

PIECES = [
    *"{}()[];,.:|#@?!^=<>+-*/%\\\"'\x00é",
    *("->", "<-", "::", "..", "==", "&&", "/*", "*/", "//", '"""', "1.5", "0l", "9" * 30, "x", "_"),
    *(f" {word} " for word in ("find", "neg", "check", "eval", "count", "or", "pattern", "rule", "lhs", "not")),
    *(f" {word} " for word in ("modify", "create", "set", "forall+", "if", "else", "on", "each", "action", "observe")),
]


@settings(max_examples=examples(70))
@given(st.sampled_from(sorted(TEXTS)), st.data())
def test_files_with_random_edits_give_only_diagnostics_with_spans(name: str, data: st.DataObject) -> None:
    text = TEXTS[name]
    for _ in range(data.draw(st.integers(1, 5))):
        start = data.draw(st.integers(0, len(text)))
        length = data.draw(st.sampled_from([0, 0, 1, 1, 2, 10, 100]))
        text = text[:start] + data.draw(st.sampled_from(["", *PIECES])) + text[start + length :]
    for problem in read(name, text).diagnostics:
        assert problem.span is not None
        assert str(problem)


EVERY = 7 if NIGHTLY else 14


@pytest.mark.parametrize("name", TEXTS)
def test_a_missing_token_gives_at_most_two_errors(name: str) -> None:
    text = TEXTS[name]
    for start, end in lexeme_places(text, name.rpartition(".")[2])[::EVERY]:
        assert len(read(name, text[:start] + text[end:]).diagnostics) <= 2, text[start:end]


# --- speed

PATTERN = """
/** Documented. */
pattern p{0}(a : Tile, b : Tile) {{
    Tile.right(a, c);
    find p{0}(c, b);
    check((x == 0) && (y == {0}) || name != "abc");
    n == count find p{0}(a, _);
}} or {{
    neg find q{0}(a, b);
}}
"""


def seconds(text: str) -> float:
    started = process_time()
    assert len(read("big.query", text).diagnostics) <= 101  # and that the rest is not read
    return process_time() - started


@pytest.mark.parametrize("call", ["find p", "fnd p"])
def test_a_large_file_is_read_in_time_proportional_to_its_size(call: str) -> None:
    pattern = PATTERN.replace("find p", call)
    small, large = ("".join(pattern.format(number) for number in range(count)) for count in (100, 400))
    seconds(small)
    assert seconds(large) < 12 * seconds(small)


@AT_NIGHT
def test_a_file_of_a_megabyte_is_read_within_half_a_minute() -> None:
    text = "".join(PATTERN.format(number) for number in range(4800))
    assert len(text) > 1_000_000
    assert seconds(text) < 30
    assert seconds(text.replace("find p", "fnd p")) < 30
