"""Apply `@suppress("code")`, which hides warnings in a definition."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence

from lark import Token, Tree

from envgraph.code import dataclass
from envgraph.errors import Diagnostic, Severity, Span, has_errors, name_hint
from envgraph.lang.syntax._parser import ParseResult, select_tokens, select_trees, span_of
from envgraph.metamodel import SUPPRESS


@dataclass(frozen=True, slots=True)
class Suppression:
    """A suppressed warning code, with the span of the code and the span of the definition that it applies to."""

    code: str
    code_span: Span
    definition_span: Span

    def suppresses(self, problem: Diagnostic) -> bool:
        """Return True if the diagnostic is a warning with this code inside of the definition."""
        return self.code == problem.code and self.covers(problem)

    def covers(self, problem: Diagnostic) -> bool:
        """Return True if the diagnostic is a warning of any code inside of the definition."""
        span = problem.span
        return (
            problem.severity is Severity.WARNING
            and span is not None
            and span.source.name == self.definition_span.source.name
            and self.definition_span.start <= span.start < self.definition_span.end
        )


def find_suppressions(parsed: ParseResult) -> tuple[list[Suppression], list[Diagnostic]]:
    """Return the suppressions in the `@suppress` annotations of a text, and diagnostics for invalid annotations."""
    found: list[Suppression] = []
    problems: list[Diagnostic] = []
    waiting = [parsed.tree] if parsed.tree and f"@{SUPPRESS}" in parsed.source.text else []
    for tree in waiting:
        below = select_trees(tree.children)
        waiting += below
        for annotation in below:
            if annotation.data == "annotation" and annotation.children[0] == SUPPRESS:
                codes = list(_suppressed_codes(annotation))
                within = span_of(parsed.source, tree)
                found += [Suppression(str(code), span_of(parsed.source, code), within) for code in codes]
                if not codes or len(codes) < len(select_trees(annotation.children)):
                    message = f"`@{SUPPRESS}` takes the codes of warnings"
                    hint = f'write `@{SUPPRESS}("unused-import")`, with the code in the brackets behind a warning'
                    span = span_of(parsed.source, annotation)
                    problems.append(Diagnostic("bad-annotation", message, span, hint))
    return found, problems


def _suppressed_codes(annotation: Tree[Token]) -> Iterator[Token]:
    for argument in select_trees(annotation.children, "annotation_argument"):
        for value in select_trees(argument.children, "annotation_string", "annotation_name"):
            yield from select_tokens(value.children)


def apply_suppressions(diagnostics: Iterable[Diagnostic], suppressions: Sequence[Suppression]) -> Iterator[Diagnostic]:
    """Yield the diagnostics without suppressed warnings, and a warning for each suppression that hides nothing.

    If one of the diagnostics is an error, unused suppressions are not reported, because warnings may still be missing.
    """
    given = list(diagnostics)
    yield from (one for one in given if not any(each.suppresses(one) for each in suppressions))
    for suppression in () if has_errors(given) else suppressions:
        if not any(map(suppression.suppresses, given)):
            message = f"there is no warning `{suppression.code}` to suppress here"
            hint = name_hint(suppression.code, [one.code for one in given if suppression.covers(one)])
            yield Diagnostic(
                "unused-suppress", message, suppression.code_span, hint or "leave it out", Severity.WARNING
            )
