"""Texts at hand to data: whole definitions, and parts of one definition, such as the inside of a `lhs`."""

from __future__ import annotations

from bisect import bisect_left
from collections.abc import Callable, Sequence
from dataclasses import fields, is_dataclass, replace
from typing import Any, Final

from envgraph.code import dataclass
from envgraph.errors import Diagnostic, InvalidArgument, LoadError, Severity, Source, Span
from envgraph.lang.read._query import read_query
from envgraph.lang.read._query_header import DefinitionsFile, Header
from envgraph.lang.read._reading import TypeNames
from envgraph.lang.read._rules import read_rules
from envgraph.lang.syntax._grammar import grammar
from envgraph.lang.syntax._lexer import Lexeme
from envgraph.lang.syntax._parsing import Parsed, parse
from envgraph.pattern import Derivation, FunctionDeclaration, Pattern, Rule, Unit

Definition = Pattern | Rule | Unit | Derivation | FunctionDeclaration


def from_text(text: str, language: str = "rules", name: str = "<text>") -> tuple[Definition, ...]:
    """The definitions that a text has, for `Engine.add`; the way back from `to_text`.

    Imports are not followed: what the definitions mention is looked for in the engine that they are added to.

    Args:
        text: of a `.rules` or a `.query` file.
        language: "rules" or "query".
        name: what the text is called in messages.

    Raises:
        LoadError: all that is wrong with the text before any name is looked up.
        InvalidArgument: another language.

    >>> from envgraph.lang import to_text
    >>> text = "rule burn {\\n    lhs { tile : RoadTile; }\\n    modify { retype tile : BurningTile; }\\n}\\n"
    >>> to_text(*from_text(text)) == text
    True
    """
    if language not in ("query", "rules"):
        raise InvalidArgument(f'definitions are in "rules" or "query", not in {language!r}')
    found, problems, _ = _read(language, Source(name, text))
    _raise_errors(problems)
    return found


def _read(language: str, source: Source) -> tuple[tuple[Definition, ...], tuple[Diagnostic, ...], Header]:
    read: Callable[[Parsed, TypeNames], DefinitionsFile[Any]] = (
        read_query if language == "query" else read_rules
    )
    file = read(parse(language, source), TypeNames())
    return file.definitions, file.diagnostics, file.header


def _raise_errors(problems: Sequence[Diagnostic]) -> None:
    errors = [one for one in problems if one.severity is Severity.ERROR]
    if errors:
        raise LoadError(errors)


# --- parts


@dataclass(frozen=True, slots=True)
class _Frame:
    """The text around a part of a definition.

    Attributes:
        fills: fields of the definition that the part may fill.
        ends: what may stand at the end of the part; else `;` is added. Empty: nothing is.
    """

    language: str
    before: str
    after: str
    fills: tuple[str, ...]
    ends: tuple[str, ...] = ()


_MARKS: Final = ("annotations", "doc", "homomorphic", "injective", "priority", "semantics", "weight")
_FRAMES: Final = {
    "pattern": {
        "annotations": _Frame("query", "", "pattern ^x() { }", _MARKS),
        "parameters": _Frame("query", "pattern ^x(", ") { }", ("parameters",)),
        "body": _Frame("query", "pattern ^x() {", "}", ("bodies",), (";",)),
    },
    "rule": {
        "annotations": _Frame("rules", "", "rule ^x { lhs { } }", _MARKS),
        "parameters": _Frame("rules", "rule ^x(", ") { lhs { } }", ("parameters",)),
        "lhs": _Frame("rules", "rule ^x { lhs {", "} }", ("left",), (";",)),
        "blocks": _Frame("rules", "rule ^x { lhs { } ", "}", ("blocks",)),
        "rhs": _Frame("rules", "rule ^x { lhs { } rhs {", "} }", ("right",), (";",)),
        "modify": _Frame("rules", "rule ^x { lhs { } modify {", "} }", ("right",), (";",)),
    },
    "unit": {
        "annotations": _Frame("rules", "", "unit ^x { }", _MARKS),
        "parameters": _Frame("rules", "unit ^x(", ") { }", ("parameters",)),
        "body": _Frame("rules", "unit ^x {", "}", ("body",), (";", "}")),
    },
}
_OPENING: Final = {"{": "}", "(": ")", "[": "]"}


class Parts:
    """Reads the parts of one definition, and keeps what is wrong with them.

    Args:
        kind: "pattern", "rule" or "unit".
        name: of the definition, for messages.
    """

    def __init__(self, kind: str, name: str) -> None:
        self._frames = _FRAMES[kind]
        self._name = name
        self._problems: list[Diagnostic] = []

    def read(self, part: str, text: str) -> Any:
        """A definition that has nothing but this part; something, if the part has errors."""
        frame = self._frames[part]
        own = Source(f"{part} of {self._name}", text)
        empty, _, _ = _read(frame.language, Source(own.name, frame.before + frame.after))
        lexemes = grammar(frame.language).core.scan(own).lexemes
        misplaced = _misplaced(part, own, lexemes, several=frame.language == "query")
        if misplaced is not None:
            self._problems.append(misplaced)
            return empty[0]
        last = lexemes[-2].value if len(lexemes) > 1 else ""
        end = "\n;" if frame.ends and last and last not in frame.ends else "\n"
        framed = Source(own.name, frame.before + text + end + frame.after)
        found, problems, header = _read(frame.language, framed)
        problems = _but_last_separators(problems, grammar(frame.language).core.scan(framed).lexemes)
        move = _Move(own, len(frame.before))
        self._problems += map(move, _of_the_part(problems, len(frame.before), len(text)))
        if any(one.severity is Severity.ERROR for one in problems) or not found:
            return empty[0]
        alone = len(found) == 1 and header == Header()
        if not alone or _filled(empty[0], found[0]) - {*frame.fills}:
            message = f"there is more here than what belongs into `{part}`"
            hint = "leave the rest out, or read the whole with `envgraph.lang.from_text`"
            self._problems.append(Diagnostic("misplaced-part", message, own.span(0, len(text)), hint))
        return move(found[-1])

    def finish(self) -> None:
        """Raise what is wrong with any of the parts.

        Raises:
            LoadError: all errors together.
        """
        _raise_errors(self._problems)


_BLOCKS: Final = ("not", "require", "forall", "optional")
_SIDES: Final = ("lhs", "rhs", "modify")


def _misplaced(part: str, source: Source, lexemes: Sequence[Lexeme], *, several: bool) -> Diagnostic | None:
    """Return what does not belong into a part, where the parser could only be puzzled by the frame."""

    def problem(lexeme: Lexeme, message: str, hint: str | None) -> Diagnostic:
        return Diagnostic("misplaced-part", message, source.span(lexeme.start, lexeme.end), hint)

    stray = _stray(lexemes)
    if stray is not None:
        return problem(stray, f"`{stray.value}` closes nothing in this text", None)
    words = [_word(lexeme) for lexeme in lexemes]
    if part == "parameters" and words[0] == "(":
        return problem(
            lexemes[0], "`parameters` takes what stands between the brackets", "leave the brackets out"
        )
    braces = words[0] == "{" and (part != "body" or several or _closes_last(words))
    if part in (*_SIDES, "body") and (braces or words[:2] == [part, "{"]):
        hint = "leave them out; several bodies are a list of texts" if several else "leave them out"
        return problem(lexemes[0], f"`{part}` takes what stands between its braces", hint)
    if part == "blocks" and words[0] and words[0] not in _BLOCKS:
        hint = "conditions belong into `lhs`, and what happens into `rhs` or `modify`"
        message = "`blocks` takes `not`, `require`, `forall` and `optional` blocks"
        return problem(lexemes[0], message, hint)
    for number, word in enumerate(words if part in _SIDES else ()):
        begins = number == 0 or words[number - 1] in (";", "}")
        after = words[number + 1 : number + 3]
        if begins and word in (*_BLOCKS, *_SIDES) and (after[:1] == ["{"] or after == ["+", "{"]):
            hint = f"give it as `{'blocks' if word in _BLOCKS else word}`"
            return problem(lexemes[number], f"`{word} {{ .. }}` does not stand in `{part}`", hint)
    return None


def _closes_last(words: Sequence[str]) -> bool:
    """Return whether the brace that a text begins with is closed by its last word, or not at all."""
    level = 0
    for number, word in enumerate(words):
        level += (word == "{") - (word == "}")
        if level == 0:
            return not any(words[number + 1 :])
    return True


def _word(lexeme: Lexeme) -> str:
    """A sign, or a word that may be a keyword; "" for anything else."""
    return lexeme.value if lexeme.kind in ("NAME", "punctuation") and not lexeme.escaped else ""


def _but_last_separators(problems: Sequence[Diagnostic], lexemes: Sequence[Lexeme]) -> tuple[Diagnostic, ...]:
    """The problems without a `;` that is missing before a `}`, where the parser has put it in."""
    starts = [lexeme.start for lexeme in lexemes]

    def follows(problem: Diagnostic) -> str:
        return lexemes[bisect_left(starts, problem.span.start)].value if problem.span else ""

    return tuple(
        one for one in problems if one.subject != (";",) or one.code != "missing-token" or follows(one) != "}"
    )


def _of_the_part(problems: Sequence[Diagnostic], start: int, length: int) -> Sequence[Diagnostic]:
    """The problems inside a part; if they are all behind it, the first of them."""
    inside = [one for one in problems if one.span is None or one.span.start < start + length]
    return inside or problems[:1]


def _stray(lexemes: Sequence[Lexeme]) -> Lexeme | None:
    """The first bracket that closes what the text has not opened."""
    waiting: list[str] = []
    for lexeme in lexemes:
        if lexeme.kind == "punctuation" and lexeme.value in _OPENING:
            waiting.append(_OPENING[lexeme.value])
        elif lexeme.kind == "punctuation" and lexeme.value in _OPENING.values():
            if lexeme.value not in waiting:
                return lexeme
            while waiting.pop() != lexeme.value:
                pass  # the parser tells of brackets that pair up wrongly
    return None


def _filled(empty: Definition, found: Definition) -> set[str]:
    """The fields in which the definitions differ."""
    names = [field.name for field in fields(found) if field.compare]
    return {name for name in names if getattr(empty, name, None) != getattr(found, name)}


class _Move:
    """Data with the spans of a framed text, moved to the text itself.

    Args:
        source: the text.
        offset: where it begins in the framed one.
    """

    def __init__(self, source: Source, offset: int) -> None:
        self._source = source
        self._offset = offset

    def __call__(self, data: Any) -> Any:
        """The same data at other places."""
        match data:
            case Span():
                return self._source.span(data.start - self._offset, data.end - self._offset)
            case tuple():
                return tuple(map(self, data))
        if is_dataclass(data) and not isinstance(data, type):
            old = {field.name: getattr(data, field.name) for field in fields(data) if field.init}
            new = {name: self(value) for name, value in old.items()}
            if any(new[name] is not old[name] for name in old):
                return replace(data, **new)
        return data
