"""How diagnostics read, as text and as data."""

import pytest

from envgraph.errors import Diagnostic, Note, Severity, Source, did_you_mean, has_errors, sort_diagnostics

SOURCE = Source("split.rule", "rule r {\n  c: Class { metods = 3 }\n}")
SPAN = SOURCE.span_between(22, 28)


def test_a_diagnostic_shows_place_excerpt_notes_and_hint():
    diagnostic = Diagnostic(
        "unknown-attribute",
        "unknown attribute `metods` on `Class`",
        SPAN,
        "did you mean `methods`?",
        notes=(Note("the rule is here", SOURCE.span_between(0, 4)), Note("attributes are typed")),
    )
    assert str(diagnostic) == (
        "split.rule:2:14: unknown attribute `metods` on `Class`\n"
        " 2 |   c: Class { metods = 3 }\n"
        "   |              ^^^^^^\n"
        "note: split.rule:1:1: the rule is here\n"
        " 1 | rule r {\n"
        "   | ^^^^\n"
        "note: attributes are typed\n"
        "hint: did you mean `methods`?"
    )


def test_a_diagnostic_without_a_text_is_its_message():
    assert str(Diagnostic("c", "wrong")) == "wrong"
    assert str(Diagnostic("c", "odd", severity=Severity.WARNING)) == "warning: odd [c]"


def test_warnings_are_marked_as_warnings():
    assert str(Diagnostic("c", "odd", SPAN, severity=Severity.WARNING)).startswith("split.rule:2:14: warning: odd [c]")


def test_an_unreadable_file_has_no_excerpt():
    assert str(Diagnostic("c", "cannot be read", Source("a", "").span_between(0, 0))) == "a:1:1: cannot be read"


def test_a_diagnostic_as_data():
    assert Diagnostic("c", "wrong", SPAN, "mend it", notes=(Note("here", SPAN), Note("so"))).to_dict() == {
        "severity": "error",
        "code": "c",
        "message": "wrong",
        "hint": "mend it",
        "file": "split.rule",
        "start": {"line": 2, "column": 14},
        "end": {"line": 2, "column": 20},
        "notes": [
            {
                "message": "here",
                "file": "split.rule",
                "start": {"line": 2, "column": 14},
                "end": {"line": 2, "column": 20},
            },
            {"message": "so"},
        ],
    }
    assert Diagnostic("c", "wrong", severity=Severity.WARNING).to_dict() == {
        "severity": "warning",
        "code": "c",
        "message": "wrong",
        "hint": None,
    }


def test_has_errors_ignores_warnings():
    warning = Diagnostic("c", "odd", severity=Severity.WARNING)
    assert not has_errors([])
    assert not has_errors([warning])
    assert has_errors([warning, Diagnostic("c", "wrong")])


def test_diagnostics_are_sorted_by_file_and_place():
    other = Source("a.rule", "abc")
    late, early = Diagnostic("c", "late", SPAN), Diagnostic("c", "early", SOURCE.span_between(0, 1))
    elsewhere, nowhere = Diagnostic("c", "elsewhere", other.span_between(0, 1)), Diagnostic("c", "nowhere")
    assert sort_diagnostics([late, elsewhere, early, nowhere]) == [nowhere, early, late, elsewhere]


@pytest.mark.parametrize(
    ("name", "known", "hint"),
    [
        ("metods", ["methods", "fields"], "did you mean `methods`?"),
        ("TILE", ["Tilt", "tile"], "did you mean `tile`?"),
        ("tile", ["TILE", "Tile"], "did you mean `TILE`?"),
        ("xyz", ["methods", "fields"], None),
        ("x", [], None),
    ],
)
def test_hints_suggest_similar_names(name, known, hint):
    assert did_you_mean(name, known) == hint
    assert did_you_mean(name, reversed(known)) == hint


def test_no_part_of_a_message_contains_control_characters() -> None:
    span = Source("a", "x \u202e\x1b[31m y").span_between(0, 1)
    said = str(Diagnostic("code", "unknown `a\nb`", span, "write `\x1b[2J`", notes=(Note("\r", span),)))
    assert not any(character in said for character in "\x1b\u202e\r")
    assert len(said.split("\n")) == 7


def test_long_names_are_shortened_in_messages() -> None:
    said = str(Diagnostic("code", f"unknown name `{'x' * 100_000}`"))
    assert len(said) < 2100
    assert said.startswith("unknown name `xxx") and said.endswith("xxx`")


def test_control_characters_of_names_are_shown_as_escapes() -> None:
    source = Source("a\x1b.rules", "x")
    text = str(Diagnostic("c", "no `\x9b\n\u202e`", source.span_between(0, 1), "call it `\x07`", notes=(Note("\x00"),)))
    assert all(c.isprintable() or c == "\n" for c in text)
    assert text.splitlines()[0] == "a\\x1b.rules:1:1: no `\\x9b\\n\\u202e`"
    assert text.splitlines()[-2:] == ["note: \\x00", "hint: call it `\\x07`"]
