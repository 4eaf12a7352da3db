"""Convert levels to models: the rows of a level replace the rows of the grid in the text of a model.

The legend of the model's `grid` defines the letters. All other text of the model stays, comments included.
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
    """The text of a model with a grid, whose rows can be replaced by those of a level.

    Attributes:
        source: the text of the model.
        letters: by letter of the grid's legend: its class, or None if the legend says more than a class.
        model: the token of the model's name.
        rows: the token of the grid's rows.
    """

    source: Source
    letters: Mapping[str, str | None]
    model: Token
    rows: Token

    @classmethod
    def of(cls, source: Source, metamodel: Metamodel) -> LevelTemplate:
        """Return a template from the first model with a grid in a text that has been checked.

        Raises:
            LoadError: no model has a grid.
        """
        parsed = parse("model", source)
        for model in trees(parsed.tree.children, "model") if parsed.tree else ():
            for grid in model.find_data("grid"):
                for rows in trees(grid.children, "rows"):
                    name, text = _token(model), _token(rows)
                    return cls(source, grid_letters(parsed, grid, metamodel), name, text)
        message = "the model has no grid whose rows a level could replace"
        raise LoadError.of("missing-rows", message, source.span(0, 0))

    def text(self, level: Level, name: str, given: Mapping[str, str]) -> str:
        """Return the text of a model that has the rows of a level.

        Args:
            level: the level.
            name: the name of the new model.
            given: by letter, tile class or tile number of the level: the letter of the grid that it means. Without an
                entry, it means the letter that is equal or has this class.

        Raises:
            InvalidArgument: a value of `given` is not a letter of the grid.
            LoadError: cells have no letter in the grid; each kind of cell is reported once.
        """
        known = self._known(given)
        problems: dict[str, Diagnostic] = {}
        rows = ["".join(self._letter(cell, known, problems) for cell in row) for row in level.rows]
        if problems:
            raise LoadError(list(problems.values())[:MOST_ERRORS])
        return self._with(name, level.title, rows)

    def place(self, level: Level, text: str, span: Span) -> Span:
        """Return the span in the level's file for a span in its model's text; outside of cells, the level's span."""
        tail = len(self.source.text) - (self.rows.end_pos or 0)
        end = len(text) - tail  # behind the quotes that end the rows
        line = text.rfind("\n", 0, end) + 1
        row = len(level.rows) - text.count("\n", span.start, end)
        column = span.start - (text.rfind("\n", 0, span.start) + 1) - (end - 3 - line)
        if 0 <= row < len(level.rows) and 0 <= column < len(level.rows[row]):
            return level.rows[row][column].where
        return level.where

    def _known(self, given: Mapping[str, str]) -> dict[str, str]:
        for name, letter in given.items():
            if letter not in self.letters:
                message = f"`{name}` cannot mean `{letter}`: {self._legend()}"
                raise InvalidArgument(message)
        classes = {cls: letter for letter, cls in reversed([*self.letters.items()]) if cls}
        return {**classes, **{letter: letter for letter in self.letters}, **given}

    def _letter(self, cell: LevelCell, known: Mapping[str, str], problems: dict[str, Diagnostic]) -> str:
        """Return the letter that a known name of a cell means, the first name first; if none is known, return a blank.

        A cell without a letter adds a problem, once for each kind of cell.
        """
        for name in cell.names:
            if name in known:
                return known[name]
        last = cell.names[-1]
        if last not in problems:
            message = f"`{last}` has no meaning in the model"
            hint = f"{self._legend()}; add `--legend {last}=LETTER` to choose one of them"
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
    """Yield the text before the name of a model, with the level's title inserted as a comment."""
    head, line, word = before.rpartition("\n")
    yield head + line
    if title:
        yield f"// {visible(title)}\n"
    yield word


def _token(tree: Tree[Token]) -> Token:
    return tokens(tree.children)[0]
