"""Parse `grid` literals: rows of letters, and the legend that maps each letter to a class."""

from __future__ import annotations

from collections import Counter
from collections.abc import Container, Iterator, Mapping, Sequence
from dataclasses import field

from lark import Token, Tree

from envgraph.code import dataclass
from envgraph.errors import Note, Span, count_with_noun, quote_names
from envgraph.lang.read._file_reading import FileReading
from envgraph.lang.syntax._parser import ParseResult, select_tokens, select_trees
from envgraph.metamodel import Metamodel


@dataclass(frozen=True, slots=True)
class LegendEntry:
    """A line of a legend: the class of the objects that a letter creates (None: no object), and their features."""

    cls: str | None
    where: Span
    body: Tree[Token] | None = None


@dataclass(frozen=True, slots=True)
class GridAxis:
    """The names in `column x next right`: the attribute for the index, and the reference to the next object or None."""

    attribute: Token
    next_reference: Token | None


@dataclass(frozen=True, slots=True)
class GridCell:
    """A letter of the grid with its column and row (counted from 0); `entry` is None if the letter is unknown."""

    column: int
    row: int
    where: Span
    entry: LegendEntry | None


@dataclass(slots=True)
class GridText:
    """A parsed grid literal; its errors have already been reported."""

    name: Token
    cells: list[GridCell]
    width: int
    height: int
    axes: dict[str, GridAxis] = field(default_factory=dict)


def parse_grid(reading: FileReading, tree: Tree[Token], metamodel: Metamodel | None) -> GridText:
    """Parse a `grid` tree into its cells, row by row; report errors. The cell of an unknown letter has no entry."""
    parts = _grid_parts(reading, tree)
    name = select_tokens(tree.children)[0]
    axes: dict[str, GridAxis] = {kind: _parse_axis(parts[kind]) for kind in ("column", "row") if kind in parts}
    if "rows" not in parts:
        if not reading.parsed.diagnostics:
            hint = 'write `rows """` and the letters, a line for each row'
            reading.error("missing-rows", f"the grid `{name}` has no rows", name, hint)
        return GridText(name, [], 0, 0, axes)
    legend, given = _parse_legend(reading, parts.get("legend"), metamodel)
    blanks = " " in legend
    lines = list(_split_rows(reading.parsed, select_tokens(parts["rows"].children)[0], keep_blanks=blanks))
    usual = _check_row_lengths(reading, lines, "blanks at the end of a row count" if blanks else None)
    # Without the metamodel the glyphs are unknown, so no letter can be reported as unknown.
    lost = reading.parsed.lost_names if given or metamodel else {*"".join(one.text for one in lines)}
    cells = _make_cells(reading, lines, legend, lost, given, usual)
    return GridText(name, cells, max((len(line.text) for line in lines), default=0), len(lines), axes)


def grid_letters(parsed: ParseResult, tree: Tree[Token], metamodel: Metamodel) -> dict[str, tuple[str, ...]]:
    """Map each letter of a valid `grid` tree to the words of its entry in the legend: the class, then its features.

    A letter that stands for no object has no words.
    """
    part = next(iter(select_trees(tree.children, "legend")), None)
    legend, _ = _parse_legend(FileReading(parsed), part, metamodel)
    bodies = {letter: entry.body.scan_values(lambda _: True) if entry.body else () for letter, entry in legend.items()}
    return {letter: tuple(filter(None, (legend[letter].cls, *map(str, body)))) for letter, body in bodies.items()}


def _grid_parts(reading: FileReading, tree: Tree[Token]) -> dict[str, Tree[Token]]:
    parts: dict[str, Tree[Token]] = {}
    for part in select_trees(tree.children):
        first = parts.setdefault(part.data, part)
        if first is not part:
            notes = (Note("the first one is here", reading.span(first)),)
            message = f"the grid has `{part.data}` twice"
            reading.error("duplicate-definition", message, part, "leave one out", notes)
    return parts


def _parse_axis(part: Tree[Token]) -> GridAxis:
    attribute, *after = select_tokens(part.children)
    return GridAxis(attribute, after[0] if after else None)


def _parse_legend(
    reading: FileReading, tree: Tree[Token] | None, metamodel: Metamodel | None
) -> tuple[Mapping[str, LegendEntry], bool]:
    """Return the legend as a mapping of letters to entries, and True if the file contains a legend.

    If the file has no legend, the letters are the glyphs of the metamodel's classes. Invalid keys are reported.
    """
    if tree is None:
        nowhere = reading.parsed.source.span_between(0, 0)
        classes = metamodel.class_list if metamodel else ()
        return {cls.glyph.letter: LegendEntry(cls.name, nowhere) for cls in classes if cls.glyph}, False
    legend: dict[str, LegendEntry] = {}
    for part in select_trees(tree.children):
        key, *cls = select_tokens(part.children)
        where = reading.span(cls[0] if cls else key)
        entry = LegendEntry(str(cls[0]) if cls else None, where, next(iter(select_trees(part.children, "body")), None))
        if len(key) != 1:
            reading.error("bad-legend", f"`{key}` is not a single letter", key, "write one letter")
        elif key in legend:
            reading.error("duplicate-definition", f"the legend has `{key}` twice", key, "leave one out")
        else:
            legend[str(key)] = entry
    return legend, True


@dataclass(frozen=True, slots=True)
class _GridRow:
    text: str
    where: Span


def _split_rows(parsed: ParseResult, token: Token, keep_blanks: bool) -> Iterator[_GridRow]:
    """Yield the rows of the grid text without empty rows at both ends, and without their common indentation.

    If `keep_blanks` is False, blanks at both ends of each row are removed too.
    """
    offset = (token.start_pos or 0) + (3 if token.type == "TEXT" else 1)
    rows: list[tuple[str, int]] = []
    for row in str(token).split("\n"):
        rows.append((row.removesuffix("\r"), offset))
        offset += len(row) + 1
    if rows and not rows[-1][0].strip():
        del rows[-1]  # the indentation of the closing quotes
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
        yield _GridRow(row[indent:], parsed.source.span_between(start + indent, start + len(row)))


def _check_row_lengths(reading: FileReading, lines: Sequence[_GridRow], hint: str | None) -> int:
    """Return the length of most rows, or of the first row without a majority; report each row of another length."""
    advice = "make all rows equally long" + (f": {hint}" if hint else "")
    lengths = Counter(len(line.text) for line in lines)
    usual = next((line for line in lines if 2 * lengths[len(line.text)] > len(lines)), None)
    model = usual or next(iter(lines), None)
    for line in lines:
        if model and len(line.text) != len(model.text):
            what = "most rows have" if usual else "the first row has"
            notes = (Note(f"{what} {len(model.text)}", model.where),)
            message = f"this row has {count_with_noun(len(line.text), 'letter')}, but {what} {len(model.text)}"
            reading.error("unequal-rows", message, line.where, advice, notes)
    return len(model.text) if model else 0


def _make_cells(
    reading: FileReading,
    lines: Sequence[_GridRow],
    legend: Mapping[str, LegendEntry],
    unreported: Container[str],
    has_legend: bool,
    usual_length: int,
) -> list[GridCell]:
    """Return the cells of all rows; report each unknown letter once, but none in rows of a wrong length.

    Args:
        unreported: letters that are not reported, because their definitions may be in text that could not be read.
        has_legend: True if the file contains a legend.
        usual_length: the length of a correct row.
    """
    cells: list[GridCell] = []
    unknown: set[str] = set()
    for row, line in enumerate(lines):
        for column, letter in enumerate(line.text):
            start = line.where.start + column
            where = line.where.source.span_between(start, start + 1)
            entry = legend.get(letter)
            if entry is None and letter not in unknown and letter not in unreported and len(line.text) == usual_length:
                unknown.add(letter)
                hint = _known_letters_hint(legend, has_legend)
                reading.error("unknown-letter", f"unknown letter `{letter}` in the grid", where, hint)
            cells.append(GridCell(column, row, where, entry))
    return cells


def _known_letters_hint(legend: Mapping[str, LegendEntry], has_legend: bool) -> str:
    known = quote_names(legend)
    if has_legend:
        return f"the legend defines {known}" if known else "the legend is empty"
    return f"the classes have the glyphs {known}" if known else "add a `legend` to the grid, or a `@glyph` to classes"
