"""Parse or check the parts of a pattern, rule or unit that Python code passes, such as the contents of a `lhs`."""

from __future__ import annotations

from bisect import bisect_left
from collections.abc import Iterable, Sequence
from dataclasses import replace
from typing import Any, Final

from envgraph.code import dataclass, differing_fields
from envgraph.errors import Diagnostic, InvalidArgument, Severity, Source
from envgraph.lang.read._from_text import raise_errors, read_framed
from envgraph.lang.read._query_header import Header
from envgraph.lang.syntax._grammar import load_grammar
from envgraph.lang.syntax._lexer import Lexeme
from envgraph.lang.write._rule_writer import (
    block_as_read,
    left_side_as_read,
    right_side_as_read,
    steps_as_read,
)
from envgraph.lang.write._term_writer import TermWriter
from envgraph.metamodel import Annotation
from envgraph.pattern import (
    Action,
    Body,
    Constraint,
    DeleteEdge,
    DeleteNode,
    LeftSide,
    Modification,
    Parameter,
    RightSide,
    RuleBlock,
    RuleEdge,
    RuleNode,
    SetAction,
    Step,
    StepSequence as Steps,
)


@dataclass(frozen=True, slots=True)
class _PartTemplate:
    """A template that completes the text of one part to a whole definition, so that the usual parser can read it.

    Attributes:
        language: the language of the definition.
        before, after: the text in front of the part and behind it.
        fields: the fields of the definition that the part may set; the first is the field that the part is for.
        endings: a `;` is appended to the part unless its last token is one of these. Empty: nothing is appended.
    """

    language: str
    before: str
    after: str
    fields: tuple[str, ...]
    endings: tuple[str, ...] = ()


_ANNOTATION_FIELDS: Final = (
    "annotations",
    "doc",
    "homomorphic",
    "injective",
    "priority",
    "semantics",
    "weight",
)
_TEMPLATES: Final = {
    "pattern": {
        "annotations": _PartTemplate("query", "", "pattern ^x() { }", _ANNOTATION_FIELDS),
        "parameters": _PartTemplate("query", "pattern ^x(", ") { }", ("parameters",)),
        "body": _PartTemplate("query", "pattern ^x() {", "}", ("bodies",), (";",)),
    },
    "rule": {
        "annotations": _PartTemplate("rules", "", "rule ^x { lhs { } }", _ANNOTATION_FIELDS),
        "parameters": _PartTemplate("rules", "rule ^x(", ") { lhs { } }", ("parameters",)),
        "lhs": _PartTemplate("rules", "rule ^x { lhs {", "} }", ("left",), (";",)),
        "blocks": _PartTemplate("rules", "rule ^x { lhs { } ", "}", ("blocks",)),
        "rhs": _PartTemplate("rules", "rule ^x { lhs { } rhs {", "} }", ("right",), (";",)),
        "modify": _PartTemplate("rules", "rule ^x { lhs { } modify {", "} }", ("right",), (";",)),
    },
    "unit": {
        "annotations": _PartTemplate("rules", "", "unit ^x { }", _ANNOTATION_FIELDS),
        "parameters": _PartTemplate("rules", "unit ^x(", ") { }", ("parameters",)),
        "body": _PartTemplate("rules", "unit ^x {", "}", ("body",), (";", "}")),
    },
}


class PartReader:
    """A reader for the parts of one definition, given as texts or data.

    Errors in a text are recorded for `raise_errors`, and the part is then empty. Wrong data raises InvalidArgument at
    once.

    Args:
        kind: "pattern", "rule" or "unit".
        name: the name of the definition.
    """

    def __init__(self, kind: str, name: str) -> None:
        if not isinstance(name, str) or not name:
            raise InvalidArgument(f"the name of a {kind} must be a string that is not empty, not {name!r}")
        TermWriter(name, ()).format_name(name)
        self._templates = _TEMPLATES[kind]
        self._name = name
        self._problems: list[Diagnostic] = []

    def raise_errors(self) -> None:
        """Raise an error if any of the texts read so far has errors; otherwise do nothing.

        Raises:
            LoadError: contains all errors.
        """
        raise_errors(self._problems)

    # --- texts and data

    def read_annotations(self, given: str | Iterable[Annotation]) -> Any:
        """Return a definition that has only the given annotations, and the fields such as the weight that they state.

        If they are a text, its doc comment is set too.
        """
        if isinstance(given, str):
            return self._parse_part("annotations", given)
        found = self._check_items("annotations", given, Annotation, "annotations")
        writer = TermWriter(self._name, load_grammar(self._templates["annotations"].language).lexer.keywords)
        text = "\n".join(map(writer.format_annotation, found))
        return replace(self._parse_part("annotations", text), annotations=found)

    def read_parameters(self, given: str | Iterable[Parameter]) -> Any:
        """Return the parameters of the definition, from the text between its parentheses or from data."""
        if isinstance(given, str):
            return self._parse_field("parameters", given)
        return self._check_items("parameters", given, Parameter, "parameters")

    def read_bodies(self, given: str | Body | Iterable[str | Body | Constraint]) -> tuple[Body, ...]:
        """Return the bodies of a pattern: one with the given constraints, or else one for each text or `Body`."""
        wanted = "constraints, or several texts or bodies"
        items = self._check_items("body", given, str | Body | Constraint, wanted)
        conditions = [item for item in items if isinstance(item, Constraint)]
        if not items or (conditions and len(conditions) < len(items)):
            raise InvalidArgument(f"`body` of `{self._name}` takes a text or {wanted}, not {given!r}")
        if conditions:
            return (Body(tuple(conditions)),)
        return tuple(self._parse_field("body", one)[0] if isinstance(one, str) else one for one in items)

    def read_left_side(self, given: str | LeftSide | Iterable[RuleNode | RuleEdge | Constraint]) -> Any:
        """Return the left-hand side of a rule; given data also gets a node for each end of an edge that lacks one."""
        if isinstance(given, str):
            return self._parse_field("lhs", given)
        if not isinstance(given, LeftSide):
            kinds = RuleNode | RuleEdge | Constraint
            given = LeftSide(
                *_split_graph_items(self._check_items("lhs", given, kinds, "nodes, edges and constraints"))
            )
        return left_side_as_read(given)

    def read_right_side(self, given: str | RightSide | Iterable[RuleNode | RuleEdge | Action]) -> Any:
        """Return the right-hand side of a rule; given data also gets a node for each end of an edge that lacks one."""
        if isinstance(given, str):
            return self._parse_field("rhs", given)
        if not isinstance(given, RightSide):
            kinds = RuleNode | RuleEdge | SetAction | DeleteNode | DeleteEdge
            given = RightSide(*_split_graph_items(self._check_items("rhs", given, kinds, "nodes, edges and `Set`s")))
        return right_side_as_read(given)

    def read_modification(self, given: str | Modification | Iterable[Action] | None) -> Any:
        """Return the changes of a rule, with each `Create` divided into chains of arrows; None if None is given."""
        if isinstance(given, str):
            return self._parse_field("modify", given)
        if not (given is None or isinstance(given, Modification)):
            given = Modification(self._check_items("modify", given, Action, "actions"))
        return right_side_as_read(given)

    def read_blocks(self, given: str | Iterable[RuleBlock]) -> Any:
        """Return the nested conditions and nested rules of a rule, from a text or from data."""
        if isinstance(given, str):
            return self._parse_field("blocks", given)
        return tuple(map(block_as_read, self._check_items("blocks", given, RuleBlock, "blocks")))

    def read_steps(self, given: str | Step | Iterable[str | Step]) -> Steps:
        """Return the body of a unit: one flat sequence of all steps in the given texts and steps."""
        items = self._check_items("body", given, str | Step, "steps")
        found = (self._parse_field("body", one) if isinstance(one, str) else steps_as_read(one) for one in items)
        return Steps(tuple(step for one in found for step in one.steps))

    def _check_items(self, part: str, given: Any, kinds: Any, wanted: str) -> tuple[Any, ...]:
        """Return the given item, or the items of the given iterable, as a tuple; `wanted` describes them in messages.

        Raises:
            InvalidArgument: an item is not of the allowed kinds.
        """
        single = isinstance(given, kinds)
        items = (given,) if single else tuple(given) if isinstance(given, Iterable) else None
        for item in (given,) if items is None else items:
            if not isinstance(item, kinds):
                raise InvalidArgument(f"`{part}` of `{self._name}` takes a text or {wanted}, not {item!r}")
        return items or ()

    # --- texts

    def _parse_field(self, part: str, text: str) -> Any:
        """Parse the text of a part, and return the field that the part is for; after errors the field is empty."""
        return getattr(self._parse_part(part, text), self._templates[part].fields[0])

    def _parse_part(self, part: str, text: str) -> Any:
        """Parse the text of a part inside its template, and return a definition that contains nothing else.

        After errors, which are recorded, the definition is empty. Text that sets fields of other parts is an error too.
        """
        frame = self._templates[part]
        own = Source(f"{part} of {self._name}", text)
        (empty,) = read_framed(frame.language, Source(own.name, frame.before + frame.after))[0].definitions
        lexemes = load_grammar(frame.language).lexer.split_text(own).lexemes
        misplaced = _check_misplaced(part, own, lexemes, allows_several_bodies=frame.language == "query")
        if misplaced is not None:
            self._problems.append(misplaced)
            return empty
        last = lexemes[-2].value if len(lexemes) > 1 else ""
        end = ";" if frame.endings and last and last not in frame.endings else ""
        file, lexemes = read_framed(frame.language, own, (frame.before, end + frame.after))
        problems = _without_last_separators(file.diagnostics, lexemes)
        self._problems += _problems_in_part(problems, len(text))
        found = file.definitions
        if any(one.severity is Severity.ERROR for one in problems) or not found:
            return empty
        alone = len(found) == 1 and file.header == Header()
        if not alone or {*differing_fields(found[0], empty)} - {*frame.fields}:
            message = f"this text contains more than `{part}` can have"
            hint = "remove the rest, or read a whole definition with `envgraph.lang.from_text`"
            self._problems.append(Diagnostic("misplaced-part", message, own.span_between(0, len(text)), hint))
        return found[-1]


def _split_graph_items(items: Sequence[Any]) -> tuple[tuple[Any, ...], tuple[Any, ...], tuple[Any, ...]]:
    """Return three tuples: the nodes, the edges, and the remaining items."""
    nodes = tuple(one for one in items if isinstance(one, RuleNode))
    edges = tuple(one for one in items if isinstance(one, RuleEdge))
    return nodes, edges, tuple(one for one in items if not isinstance(one, RuleNode | RuleEdge))


_OPENING: Final = {"{": "}", "(": ")", "[": "]"}


_BLOCKS: Final = ("not", "require", "forall", "optional")
_SIDES: Final = ("lhs", "rhs", "modify")


def _check_misplaced(
    part: str, source: Source, lexemes: Sequence[Lexeme], *, allows_several_bodies: bool
) -> Diagnostic | None:
    """Return a diagnostic for text that does not belong in a part, or None; `allows_several_bodies` is True for
    patterns.

    The parser would report these mistakes confusingly, because it also sees the template around the part.
    """

    def problem(lexeme: Lexeme, message: str, hint: str | None) -> Diagnostic:
        return Diagnostic("misplaced-part", message, source.span_between(lexeme.start, lexeme.end), hint)

    stray = _first_stray_bracket(lexemes)
    if stray is not None:
        return problem(stray, f"`{stray.value}` has no opening bracket in this text", "remove it")
    words = [_sign_or_word(lexeme) for lexeme in lexemes]
    if part == "parameters" and words[0] == "(":
        return problem(lexemes[0], "`parameters` takes only the text between the brackets", "remove the brackets")
    braces = words[0] == "{" and (part != "body" or allows_several_bodies or _first_brace_closes_last(words))
    if part in (*_SIDES, "body") and (braces or words[:2] == [part, "{"]):
        hint = (
            "remove the braces; give several bodies as a list of texts"
            if allows_several_bodies
            else "remove the braces"
        )
        return problem(lexemes[0], f"`{part}` takes only the text between its braces", hint)
    if part == "blocks" and words[0] and words[0] not in _BLOCKS:
        hint = "write conditions in `lhs`, and actions in `rhs` or `modify`"
        message = "`blocks` takes only `not`, `require`, `forall` and `optional` blocks"
        return problem(lexemes[0], message, hint)
    for number, word in enumerate(words if part in _SIDES else ()):
        begins = number == 0 or words[number - 1] in (";", "}")
        after = words[number + 1 : number + 3]
        if begins and word in (*_BLOCKS, *_SIDES) and (after[:1] == ["{"] or after == ["+", "{"]):
            hint = f"pass it as the argument `{'blocks' if word in _BLOCKS else word}`"
            return problem(lexemes[number], f"`{word} {{ .. }}` is not allowed in `{part}`", hint)
    return None


def _first_brace_closes_last(words: Sequence[str]) -> bool:
    """Return True if the brace at the start of a text is closed by the last word of the text, or is never closed."""
    level = 0
    for number, word in enumerate(words):
        level += (word == "{") - (word == "}")
        if level == 0:
            return not any(words[number + 1 :])
    return True


def _sign_or_word(lexeme: Lexeme) -> str:
    """Return the text of a sign or of a word without `^`, which may be a keyword; "" for any other lexeme."""
    return lexeme.value if lexeme.kind in ("NAME", "punctuation") and not lexeme.is_escaped else ""


def _without_last_separators(problems: Sequence[Diagnostic], lexemes: Sequence[Lexeme]) -> tuple[Diagnostic, ...]:
    """Return the problems without those about a missing `;` before a `}`, because a part may lack this `;`."""
    starts = [lexeme.start for lexeme in lexemes]

    def follows(problem: Diagnostic) -> str:
        return lexemes[bisect_left(starts, problem.span.start)].value if problem.span else ""

    return tuple(one for one in problems if one.subject != (";",) or one.code != "missing-token" or follows(one) != "}")


def _problems_in_part(problems: Sequence[Diagnostic], part_length: int) -> Sequence[Diagnostic]:
    """Return the problems in the first `part_length` characters, the part's own text; if it has none, the first
    problem.
    """
    inside = [one for one in problems if one.span is None or one.span.start < part_length]
    return inside or problems[:1]


def _first_stray_bracket(lexemes: Sequence[Lexeme]) -> Lexeme | None:
    """Return the first closing bracket that has no opening bracket in the text, or None."""
    waiting: list[str] = []
    for lexeme in lexemes:
        if lexeme.kind == "punctuation" and lexeme.value in _OPENING:
            waiting.append(_OPENING[lexeme.value])
        elif lexeme.kind == "punctuation" and lexeme.value in _OPENING.values():
            if lexeme.value not in waiting:
                return lexeme
            while waiting.pop() != lexeme.value:
                pass  # the parser reports brackets that do not match
    return None
