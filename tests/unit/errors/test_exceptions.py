"""The exception tree."""

import copy
import pickle

import pytest

from envgraph import errors
from envgraph.errors import (
    Diagnostic,
    DiagnosticError,
    EnvgraphError,
    InvalidArgument,
    LoadError,
    ResolutionError,
    RuleError,
    Source,
)

PROBLEMS = (Diagnostic("a", "first"), Diagnostic("b", "second", Source("f", "text").span(0, 4), "mend it"))


def test_all_exceptions_have_one_root():
    exceptions = [
        item for item in vars(errors).values() if isinstance(item, type) and issubclass(item, Exception)
    ]
    assert len(exceptions) == 10
    assert all(issubclass(item, EnvgraphError) for item in exceptions)


def test_wrong_arguments_are_value_errors_too():
    assert issubclass(InvalidArgument, ValueError)


def test_diagnostics_are_shown_together():
    error = LoadError(PROBLEMS)
    assert isinstance(error, DiagnosticError)
    assert error.diagnostics == PROBLEMS
    assert str(error) == "first\n\nf:1:1: second\n 1 | text\n   | ^^^^\nhint: mend it"


def test_a_rule_error_has_a_line_for_each_detail():
    error = RuleError(
        "`t` cannot go", rule="drop", reason="dangling", details=["`a` -r-> `t`", "`b` -r-> `t`"]
    )
    assert str(error) == "`t` cannot go\n  `a` -r-> `t`\n  `b` -r-> `t`"
    assert (error.rule, error.reason, error.details) == ("drop", "dangling", ("`a` -r-> `t`", "`b` -r-> `t`"))


@pytest.mark.parametrize("again", [lambda e: pickle.loads(pickle.dumps(e)), copy.copy])
def test_errors_survive_the_way_from_a_worker_process(again):
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
    assert again(InvalidArgument("no")).args == ("no",)
