"""The exception tree."""

import copy
import pickle

import pytest

from envgraph import errors
from envgraph.errors import (
    Diagnostic,
    DiagnosticError,
    EnvgraphError,
    EvaluationError,
    InvalidArgument,
    LoadError,
    ResolutionError,
    RuleError,
    Source,
    TypeMismatch,
)

PROBLEMS = (
    Diagnostic("a", "first"),
    Diagnostic("b", "second", Source("f", "text").span_between(0, 4), "mend it"),
)


def test_all_exceptions_have_one_root():
    exceptions = [item for item in vars(errors).values() if isinstance(item, type) and issubclass(item, Exception)]
    assert len(exceptions) == 11
    assert all(issubclass(item, EnvgraphError) for item in exceptions)


def test_invalid_argument_is_a_value_error():
    assert issubclass(InvalidArgument, ValueError)


def test_diagnostics_are_shown_together():
    error = LoadError(PROBLEMS)
    assert isinstance(error, DiagnosticError)
    assert error.diagnostics == PROBLEMS
    assert str(error) == "first\n\nf:1:1: second\n 1 | text\n   | ^^^^\nhint: mend it"


def test_a_rule_error_has_a_line_for_each_detail():
    error = RuleError("`t` cannot go", rule="drop", reason="dangling", details=["`a` -r-> `t`", "`b` -r-> `t`"])
    assert str(error) == "`t` cannot go\n  `a` -r-> `t`\n  `b` -r-> `t`"
    assert (error.rule, error.reason, error.details) == ("drop", "dangling", ("`a` -r-> `t`", "`b` -r-> `t`"))


PLACE = Source("f.rules", "rule r { 1 / 0 }").span_between(9, 14)


def test_a_rule_error_with_a_span_is_shown_like_a_diagnostic():
    rule = RuleError("no room", rule="r", reason="full", details=["one", "two"], span=PLACE, hint="make room")
    assert str(rule).splitlines() == [
        "f.rules:1:10: no room",
        " 1 | rule r { 1 / 0 }",
        "   |          ^^^^^",
        "note: one",
        "note: two",
        "hint: make room",
    ]
    (found,) = rule.diagnostics
    assert (found.code, found.message, found.span, found.hint) == ("full", "no room", PLACE, "make room")
    value = EvaluationError("division by zero", PLACE)
    assert str(value) == "f.rules:1:10: division by zero\n 1 | rule r { 1 / 0 }\n   |          ^^^^^"
    assert [one.code for one in value.diagnostics] == ["no-value"]


def test_an_error_without_a_span_shows_its_message_and_hint():
    assert str(EvaluationError("too large", hint="take less")) == "too large\nhint: take less"
    assert (EvaluationError("too large").diagnostics, RuleError("no", reason="full").diagnostics) == ((), ())


@pytest.mark.parametrize("again", [lambda e: pickle.loads(pickle.dumps(e)), copy.copy])
def test_errors_are_pickled_and_copied_unchanged(again):
    for error in (LoadError(PROBLEMS), ResolutionError(PROBLEMS)):
        copied = again(error)
        assert type(copied) is type(error)
        assert str(copied) == str(error)
        assert [d.message for d in copied.diagnostics] == ["first", "second"]
    error = RuleError("`t` cannot go", rule="drop", reason="full", details=["one", "two"])
    copied = again(error)
    assert (str(copied), copied.rule, copied.reason, copied.details) == (
        str(error), "drop", "full", ("one", "two"),
    )  # fmt: skip
    for placed in (
        RuleError("no", reason="full", details=["one"], span=PLACE, hint="yes"),
        EvaluationError("no", PLACE, "yes"),
    ):
        assert str(again(placed)) == str(placed)
    assert again(InvalidArgument("no")).args == ("no",)


@pytest.mark.parametrize("kind", [InvalidArgument, TypeMismatch])
def test_a_hint_follows_the_message_and_is_an_attribute(kind: type[EnvgraphError]) -> None:
    error = pickle.loads(pickle.dumps(kind("unknown class `Bxo`", "did you mean `Box`?")))
    assert str(error) == "unknown class `Bxo`; did you mean `Box`?"
    assert (error.message, error.hint) == ("unknown class `Bxo`", "did you mean `Box`?")
    plain = kind("unknown class `Bxo`")
    assert (str(plain), plain.hint) == (plain.message, None)
