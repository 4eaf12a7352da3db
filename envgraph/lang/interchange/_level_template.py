"""Levels as models: the text of a model with the rows of a level in place of its own.

So the legend of the model's `grid` says what the letters mean, and everything else of it stays, comments too.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping

from lark import Token, Tree

from envgraph.code import dataclass
from envgraph.errors import MOST_ERRORS, Diagnostic, InvalidArgument, LoadError, Source, Span, visible
from envgraph.lang.interchange._levels import BLANK, Level, LevelCell
from envgraph.lang.read._grid import grid_letters
from envgraph.lang.syntax._parsing import parse, tokens, trees
from envgraph.metamodel import Metamodel


@dataclass(frozen=True, slots=True)
class LevelTemplate:
    """A model with a grid.

    Attributes:
        source: its text.
        letters: for each letter of the grid the class that it stands for, where it says no more than that; else None.
        model: the token of the model's name.
        rows: the token of the grid's rows.
    """

    source: Source
    letters: Mapping[str, str | None]
    model: Token
    rows: Token

    @classmethod
    def of(cls, source: Source, metamodel: Metamodel) -> LevelTemplate:
        """Read the text of a model that has been checked: its first model, and the first grid in that.

        Raises:
            LoadError: it has no grid.
        """
        parsed = parse("model", source)
        for model in trees(parsed.tree.children, "model") if parsed.tree else ():
            for grid in model.find_data("grid"):
                for rows in trees(grid.children, "rows"):
                    name, text = _token(model), _token(rows)
                    return cls(source, grid_letters(parsed, grid, metamodel), name, text)
        message = "the model has no grid whose rows a level could take the place of"
        raise LoadError.of("missing-rows", message, source.span(0, 0))

    def text(self, level: Level, name: str, given: Mapping[str, str]) -> str:
        """The text of a model with the rows of a level.

        Args:
            level: what stands in the rows.
            name: of the model.
            given: letters of the grid, by other letters, and by the classes and numbers of tiles.

        Raises:
            InvalidArgument: something given is no letter of the grid.
            LoadError: a cell has no letter; each kind is reported once.
        """
        known = self._known(given)
        problems: dict[str, Diagnostic] = {}
        rows = ["".join(self._letter(cell, known, problems) for cell in row) for row in level.rows]
        if problems:
            raise LoadError(list(problems.values())[:MOST_ERRORS])
        return self._with(name, level.title, rows)

    def place(self, level: Level, text: str, span: Span) -> Span:
        """Where in the file of a level that stands which a span of its model is about; the level if it is no cell."""
        tail = len(self.source.text) - (self.rows.end_pos or 0)
        end = len(text) - tail  # behind the quotes that close the rows
        line = text.rfind("\n", 0, end) + 1
        row = len(level.rows) - text.count("\n", span.start, end)
        column = span.start - (text.rfind("\n", 0, span.start) + 1) - (end - 3 - line)
        if 0 <= row < len(level.rows) and 0 <= column < len(level.rows[row]):
            return level.rows[row][column].where
        return level.where

    def _known(self, given: Mapping[str, str]) -> dict[str, str]:
        for name, letter in given.items():
            if letter not in self.letters:
                message = f"`{name}` cannot be read as `{letter}`: {self._legend()}"
                raise InvalidArgument(message)
        classes = {cls: letter for letter, cls in reversed([*self.letters.items()]) if cls}
        return {**classes, **{letter: letter for letter in self.letters}, **given}

    def _letter(self, cell: LevelCell, known: Mapping[str, str], problems: dict[str, Diagnostic]) -> str:
        """The letter of a cell; a blank, and a problem, if it has none."""
        for name in cell.names:
            if name in known:
                return known[name]
        last = cell.names[-1]
        if last not in problems:
            message = f"`{last}` stands for nothing"
            hint = f"{self._legend()}; `--legend {last}=LETTER` says which of them it is"
            problems[last] = Diagnostic("unknown-letter", message, cell.where, hint)
        return BLANK

    def _legend(self) -> str:
        return f"the letters of {self.source.name} are {', '.join(f'`{one}`' for one in self.letters)}"

    def _with(self, name: str, title: str, rows: list[str]) -> str:
        text = self.source.text
        start, end = self.rows.start_pos or 0, self.rows.end_pos or 0
        line = text[text.rfind("\n", 0, start) + 1 : start]
        indent = line[: len(line) - len(line.lstrip())] + "    "
        literal = "\n".join(['"""', *(indent + row for row in rows), f'{indent}"""'])
        before, after = text[: self.model.start_pos], text[self.model.end_pos : start]
        return "".join((*_commented(before, title), name, after, literal, text[end:]))


def _commented(before: str, title: str) -> Iterator[str]:
    """Yield what stands before the name of a model, with a title as a comment before it."""
    head, line, word = before.rpartition("\n")
    yield head + line
    if title:
        yield f"// {visible(title)}\n"
    yield word


def _token(tree: Tree[Token]) -> Token:
    return tokens(tree.children)[0]
