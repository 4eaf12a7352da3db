"""`grid` literals: rows of letters, and what the letters stand for."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Container, Iterator, Mapping, Sequence
from dataclasses import field

from lark import Token, Tree

from envgraph.code import dataclass
from envgraph.errors import Diagnostic, Note, Span, quoted
from envgraph.lang.syntax._parsing import Parsed, tokens, trees
from envgraph.metamodel import Metamodel

Report = Callable[[Diagnostic], None]


@dataclass(frozen=True, slots=True)
class Entry:
    """What a letter stands for: a class, with features if `body` is there; `cls` None is no object."""

    cls: str | None
    where: Span
    body: Tree[Token] | None = None


@dataclass(frozen=True, slots=True)
class Axis:
    """`column x next right`: the attribute that holds the index, and the reference to the next object."""

    attribute: Token
    next: Token | None


@dataclass(frozen=True, slots=True)
class Cell:
    """A letter of the grid; columns and rows count from 0."""

    column: int
    row: int
    letter: str
    where: Span
    entry: Entry | None


@dataclass(slots=True)
class GridText:
    """A grid literal as it is written; errors in it have been reported."""

    name: Token
    cells: list[Cell]
    width: int
    height: int
    axes: dict[str, Axis] = field(default_factory=dict)


def read_grid(parsed: Parsed, tree: Tree[Token], metamodel: Metamodel | None, report: Report) -> GridText:
    """The cells of a `grid` tree, row by row; a letter that stands for nothing has no entry."""
    parts = _parts(parsed, tree, report)
    name = tokens(tree.children)[0]
    axes: dict[str, Axis] = {kind: _axis(parts[kind]) for kind in ("column", "row") if kind in parts}
    if "rows" not in parts:
        if not parsed.diagnostics:
            hint = 'write `rows """` and the letters, a line for each row'
            report(Diagnostic("missing-rows", f"the grid `{name}` has no rows", parsed.span(name), hint))
        return GridText(name, [], 0, 0, axes)
    legend, given = _legend(parsed, parts.get("legend"), metamodel, report)
    blanks = " " in legend
    lines = list(_lines(parsed, tokens(parts["rows"].children)[0], keep_blanks=blanks))
    usual = _check_lengths(lines, report, "blanks at the end of a row count" if blanks else None)
    # Without the metamodel, whose glyphs the letters are, nothing is known of any of them.
    lost = parsed.lost if given or metamodel else {*"".join(one.text for one in lines)}
    cells = _cells(lines, legend, lost, given, usual, report)
    return GridText(name, cells, max((len(line.text) for line in lines), default=0), len(lines), axes)


def grid_letters(parsed: Parsed, tree: Tree[Token], metamodel: Metamodel) -> dict[str, str | None]:
    """The letters of a `grid` tree without errors; with the class of each that is no more than an object of it."""
    part = next(iter(trees(tree.children, "legend")), None)
    legend, _ = _legend(parsed, part, metamodel, list[Diagnostic]().append)
    return {letter: None if entry.body else entry.cls for letter, entry in legend.items()}


def _parts(parsed: Parsed, tree: Tree[Token], report: Report) -> dict[str, Tree[Token]]:
    parts: dict[str, Tree[Token]] = {}
    for part in trees(tree.children):
        first = parts.setdefault(part.data, part)
        if first is not part:
            note = Note("the first one is here", parsed.span(first))
            message = f"the grid has `{part.data}` twice"
            report(
                Diagnostic("duplicate-definition", message, parsed.span(part), "leave one out", notes=(note,))
            )
    return parts


def _axis(part: Tree[Token]) -> Axis:
    attribute, *after = tokens(part.children)
    return Axis(attribute, after[0] if after else None)


def _legend(
    parsed: Parsed, tree: Tree[Token] | None, metamodel: Metamodel | None, report: Report
) -> tuple[Mapping[str, Entry], bool]:
    """Letter to entry, and whether the file gives the legend; without one it is the glyphs of the classes."""
    if tree is None:
        nowhere = parsed.source.span(0, 0)
        classes = metamodel.class_list if metamodel else ()
        return {cls.glyph.letter: Entry(cls.name, nowhere) for cls in classes if cls.glyph}, False
    legend: dict[str, Entry] = {}
    for part in trees(tree.children):
        key, *cls = tokens(part.children)
        where = parsed.span(cls[0] if cls else key)
        entry = Entry(str(cls[0]) if cls else None, where, next(iter(trees(part.children, "body")), None))
        if len(key) != 1:
            report(
                Diagnostic(
                    "bad-legend", f"`{key}` is not a single letter", parsed.span(key), "write one letter"
                )
            )
        elif key in legend:
            report(
                Diagnostic(
                    "duplicate-definition", f"the legend has `{key}` twice", parsed.span(key), "leave one out"
                )
            )
        else:
            legend[str(key)] = entry
    return legend, True


@dataclass(frozen=True, slots=True)
class _Line:
    text: str
    where: Span


def _lines(parsed: Parsed, token: Token, keep_blanks: bool) -> Iterator[_Line]:
    """The rows without the indentation that they share, or without blanks where a blank means nothing."""
    offset = (token.start_pos or 0) + (3 if token.type == "TEXT" else 1)
    rows: list[tuple[str, int]] = []
    for row in str(token).split("\n"):
        rows.append((row.removesuffix("\r"), offset))
        offset += len(row) + 1
    if rows and not rows[-1][0].strip():
        del rows[-1]  # before the quotes that close
    shared = min((len(row) - len(row.lstrip()) for row, _ in rows if row.strip()), default=0)

    def empty(row: str) -> bool:
        return not (row[shared:] if keep_blanks else row.strip())

    while rows and empty(rows[0][0]):
        del rows[0]
    while rows and empty(rows[-1][0]):
        del rows[-1]
    for row, start in rows:
        indent = shared
        if not keep_blanks:
            row = row.rstrip()
            indent = len(row) - len(row.lstrip())
        yield _Line(row[indent:], parsed.source.span(start + indent, start + len(row)))


def _check_lengths(lines: Sequence[_Line], report: Report, hint: str | None) -> int:
    """Reports rows of another length than the others have, and returns that."""
    advice = "all rows have the same length" + (f": {hint}" if hint else "")
    lengths = Counter(len(line.text) for line in lines)
    usual = next((line for line in lines if 2 * lengths[len(line.text)] > len(lines)), None)
    model = usual or next(iter(lines), None)
    for line in lines:
        if model and len(line.text) != len(model.text):
            note = Note(
                f"{'most rows have' if usual else 'the first row has'} {len(model.text)}", model.where
            )
            message = f"this row has {_count(line.text)}"
            report(Diagnostic("unequal-rows", message, line.where, advice, notes=(note,)))
    return len(model.text) if model else 0


def _count(text: str) -> str:
    return "1 letter" if len(text) == 1 else f"{len(text)} letters"


def _cells(
    lines: Sequence[_Line],
    legend: Mapping[str, Entry],
    lost: Container[str],
    given: bool,
    usual: int,
    report: Report,
) -> list[Cell]:
    """The cells; in a row of another length than usual a letter more is no mistake of its own."""
    cells: list[Cell] = []
    unknown: set[str] = set()
    for row, line in enumerate(lines):
        for column, letter in enumerate(line.text):
            start = line.where.start + column
            where = line.where.source.span(start, start + 1)
            entry = legend.get(letter)
            if entry is None and letter not in unknown and letter not in lost and len(line.text) == usual:
                unknown.add(letter)
                report(_unknown_letter(letter, where, legend, given))
            cells.append(Cell(column, row, letter, where, entry))
    return cells


def _unknown_letter(letter: str, where: Span, legend: Mapping[str, Entry], given: bool) -> Diagnostic:
    known = quoted(legend)
    if given:
        hint = f"the legend has {known}" if known else "the legend is empty"
    else:
        hint = (
            f"the classes have the glyphs {known}"
            if known
            else "give the grid a `legend`, or classes a `@glyph`"
        )
    return Diagnostic("unknown-letter", f"the letter `{letter}` stands for no class", where, hint)
