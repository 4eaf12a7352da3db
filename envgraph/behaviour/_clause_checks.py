"""The base class of the checks of a behaviour's clauses."""

from __future__ import annotations

from collections import Counter
from collections.abc import Collection, Iterable, Mapping
from dataclasses import replace

from envgraph.behaviour._helper_patterns import HelperPattern, is_bound_by_match, variable_occurrences
from envgraph.errors import Diagnostic, Note, Severity, Span, did_you_mean, quote_with_article
from envgraph.metamodel import Feature, Metamodel
from envgraph.pattern import (
    Expression,
    Library,
    Navigation,
    Negation,
    ObjectType,
    Parameter,
    PatternCall,
    StaticType,
    Variable,
    base_of,
    check_expression,
    class_warning,
    misspelling_warnings,
    static_type,
    type_text,
)
from envgraph.rewrite import Engine

Scope = dict[str, StaticType | None]
"""The type of every name in scope; None if the declaration of the name has an error."""


class CheckBase:
    """A collector of diagnostics in a list that all checks of one behaviour share."""

    def __init__(self, engine: Engine, problems: list[Diagnostic]) -> None:
        self.engine = engine
        self.library: Library = engine.library
        self.metamodel: Metamodel = engine.model.metamodel
        self.problems = problems

    def report(
        self,
        code: str,
        message: str,
        span: Span | None,
        hint: str | None = None,
        severity: Severity = Severity.ERROR,
        notes: tuple[Note, ...] = (),
    ) -> None:
        """Add a diagnostic to `problems`."""
        self.problems.append(Diagnostic(code, message, span, hint, severity, notes))

    def parameter_class(self, parameter: Parameter) -> ObjectType | None:
        """Return the class of an object parameter; None if it is missing or unknown, which is reported."""
        if parameter.type is None:
            message = f"parameter `{parameter.name}` needs a class"
            self.report("unknown-class", message, parameter.span, f"write `{parameter.name} : Class`")
            return None
        return self.check_class(parameter.type, parameter.type_span or parameter.span)

    def check_class(self, name: str, span: Span | None, others: Iterable[str] = ()) -> ObjectType | None:
        """Return the class of this name; report a name that is no class, perhaps one of `others`, and return None."""
        if name in self.metamodel.classes:
            return ObjectType(name)
        if static_type(name, self.metamodel) is not None:
            wanted = "class or an enum" if others else "class"
            self.report("unknown-class", f"`{name}` is not a class", span, f"write the name of a {wanted}")
        else:
            hint = did_you_mean(name, others) or self.metamodel.suggest_class(name)
            self.report("unknown-class", f"unknown class `{name}`", span, hint)
        return None

    def check_helper(
        self,
        question: HelperPattern,
        condition: PatternCall | Negation,
        scope: Scope,
        names_elsewhere: Collection[str] = (),
    ) -> bool:
        """Report errors in a helper pattern, and calls that never match; return True if there are no errors.

        Misspelt variables are reported too. Other warnings would be about a pattern that is not in the file.

        Args:
            question: the helper pattern.
            condition: the condition in the file.
            scope: the bound names and their types.
            names_elsewhere: names in the rest of the clause.
        """
        checked = self.library.analyse(question.pattern)
        self.problems += (
            one for one in checked.problems if one.severity is Severity.ERROR or one.code == "never-matches"
        )
        if not checked.invalid_names:
            self._check_misspelt(condition, scope, names_elsewhere)
        return not checked.invalid_names

    def _check_misspelt(
        self, condition: PatternCall | Negation, scope: Scope, names_elsewhere: Collection[str]
    ) -> None:
        places = [one for one in variable_occurrences(condition) if is_bound_by_match(one, scope)]
        uses = Counter([*names_elsewhere, *(one.name for one in places)])
        for one in places:
            if uses[one.name] == 1:
                misspelt = [*misspelling_warnings(one, scope)]
                for found in misspelt:
                    self.problems.append(replace(found, hint=f"{found.hint} for any value, write `_`"))
                if not misspelt and one.name in self.metamodel.classes:
                    self.problems.append(class_warning(one))

    def check_path(self, path: Expression, scope: Scope) -> StaticType | None:
        """Return the type of the value at the end of a path; report an expression that is no path and return None."""
        type_, problems = check_expression(path, scope, self.metamodel)
        self.problems.extend(problems)
        if not problems and not isinstance(base_of(path)[0], Variable):
            hint = "write a path, or observe each part of the expression"
            self.report("no-path", "a path such as `x.feature` is needed here", path.span, hint)
            return None
        return type_

    def last_feature(self, path: Expression, scope: Scope) -> Feature | None:
        """Return the last feature of a path; None if the path is a variable only, or if the feature is unknown."""
        if not isinstance(path, Navigation):
            return None
        owner, _ = check_expression(path.object, scope, self.metamodel)
        return self.metamodel.feature(owner.cls, path.feature) if isinstance(owner, ObjectType) else None


def type_names(scope: Mapping[str, StaticType | None]) -> dict[str, str]:
    """Return the type name of each name in a scope; names whose type is unknown because of an error are left out."""
    return {name: type_text(type_) for name, type_ in scope.items() if type_ is not None}


def type_with_article(type_: StaticType) -> str:
    """Return the name of a type with its article, for messages."""
    return quote_with_article(type_text(type_))
