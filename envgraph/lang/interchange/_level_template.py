"""Convert levels to models: the rows of a level replace the rows of the grid in the text of a model.

The legend of the model's `grid` defines the letters. All other text of the model stays, comments included.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping

from lark import Token, Tree

from envgraph.code import dataclass
from envgraph.errors import MAX_ERRORS, Diagnostic, InvalidArgument, LoadError, Source, Span, escape_unprintable
from envgraph.lang.interchange._level_files import BLANK_LETTER, Level, LevelCell
from envgraph.lang.read._grid import grid_letters
from envgraph.lang.syntax._parser import parse, select_tokens, select_trees
from envgraph.metamodel import Metamodel


@dataclass(frozen=True, slots=True)
class LevelTemplate:
    """The text of a model with a grid, whose rows can be replaced by those of a level.

    Attributes:
        source: the text of the model.
        letters: by letter of the grid's legend: its class and the words about its features; () for no object.
        glyphs: by class, its glyph.
        model: the token of the model's name.
        rows: the token of the grid's rows.
    """

    source: Source
    letters: Mapping[str, tuple[str, ...]]
    glyphs: Mapping[str, str]
    model: Token
    rows: Token

    @classmethod
    def of(cls, source: Source, metamodel: Metamodel) -> LevelTemplate:
        """Return a template from the first model with a grid in a text that has been checked.

        Raises:
            LoadError: no model has a grid.
        """
        parsed = parse("model", source)
        for model in select_trees(parsed.tree.children, "model") if parsed.tree else ():
            for grid in model.find_data("grid"):
                for rows in select_trees(grid.children, "rows"):
                    name, text = _first_token(model), _first_token(rows)
                    glyphs = {one.name: one.glyph.letter for one in metamodel.class_list if one.glyph}
                    return cls(source, grid_letters(parsed, grid, metamodel), glyphs, name, text)
        message = "the model has no grid whose rows a level could replace"
        raise LoadError.from_problem("missing-rows", message, source.span_between(0, 0))

    def model_text(self, level: Level, name: str, chosen_letters: Mapping[str, str]) -> str:
        """Return the text of a model that has the rows of a level.

        Args:
            level: the level.
            name: the name of the new model.
            chosen_letters: by letter, tile class or tile number of the level: the letter of the grid that it means.
                Without an entry, it means the letter that is equal, has this class, or a class with this glyph.

        Raises:
            InvalidArgument: a value of `chosen_letters` is not a letter of the grid.
            LoadError: cells have no letter in the grid; each kind of cell is reported once.
        """
        known = self._letters_by_name(chosen_letters)
        problems: dict[str, Diagnostic] = {}
        rows = ["".join(self._cell_letter(cell, known, problems) for cell in row) for row in level.rows]
        if problems:
            raise LoadError(list(problems.values())[:MAX_ERRORS])
        return self._with_rows(name, level.title, rows)

    def level_span(self, level: Level, text: str, span: Span) -> Span:
        """Return the span in the level's file for a span in its model's text; outside of cells, the level's span."""
        end = text.index('"""', text.index('"""') + 3) + 3  # behind the quotes that end the rows
        line = text.rfind("\n", 0, end) + 1
        row = len(level.rows) - text.count("\n", span.start, end)
        column = span.start - (text.rfind("\n", 0, span.start) + 1) - (end - 3 - line)
        if 0 <= row < len(level.rows) and 0 <= column < len(level.rows[row]):
            return level.rows[row][column].span
        return level.span

    def _letters_by_name(self, given: Mapping[str, str]) -> dict[str, str]:
        for name, letter in given.items():
            if letter not in self.letters:
                message = f"`{name}` cannot mean `{letter}`: {self._legend_text()}"
                raise InvalidArgument(message)
        classes = {words[0]: letter for letter, words in reversed([*self.letters.items()]) if len(words) == 1}
        glyphs = {self.glyphs[cls]: letter for cls, letter in classes.items() if cls in self.glyphs}
        return {**glyphs, **classes, **{letter: letter for letter in self.letters}, **given}

    def _cell_letter(self, cell: LevelCell, known: Mapping[str, str], problems: dict[str, Diagnostic]) -> str:
        """Return the letter of the first of a cell's names that is in `known`; a blank if none is.

        A cell without a letter adds a problem, once for each kind of cell.
        """
        for name in cell.names:
            if name in known:
                return known[name]
        last = cell.names[-1]
        if last not in problems:
            message = f"`{last}` has no meaning in the model"
            hint = f"{self._legend_text()}; add `--legend {last}=LETTER` to choose one of them"
            problems[last] = Diagnostic("unknown-letter", message, cell.span, hint)
        return BLANK_LETTER

    def _legend_text(self) -> str:
        return f"the letters of {self.source.name} are {', '.join(f'`{one}`' for one in self.letters)}"

    def _with_rows(self, name: str, title: str, rows: list[str]) -> str:
        text = self.source.text
        start, end = self.rows.start_pos or 0, self.rows.end_pos or 0
        line = text[text.rfind("\n", 0, start) + 1 : start]
        indent = line[: len(line) - len(line.lstrip())] + "    "
        literal = "\n".join(['"""', *(indent + row for row in rows), f'{indent}"""'])
        before, after = text[: self.model.start_pos], text[self.model.end_pos : start]
        return "".join((*_with_title_comment(before, title), name, after, literal, text[end:]))


def _with_title_comment(before: str, title: str) -> Iterator[str]:
    """Yield the text before the name of a model, with the level's title inserted as a comment."""
    head, line, word = before.rpartition("\n")
    yield head + line
    if title:
        yield f"// {escape_unprintable(title)}\n"
    yield word


def _first_token(tree: Tree[Token]) -> Token:
    return select_tokens(tree.children)[0]
