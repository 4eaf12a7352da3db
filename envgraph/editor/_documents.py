"""Convert between places in a text and positions of the Language Server Protocol."""

from __future__ import annotations

from typing import Any

from envgraph.code import dataclass
from envgraph.errors import Source, Span

JsonObject = dict[str, Any]
"""An object of the protocol, as JSON."""


@dataclass(frozen=True, slots=True)
class Document:
    """The text of a file that is open in an editor.

    Attributes:
        uri: the name of the file in the protocol.
        source: the text; the name of the source is the name of the file for `Files`.
        version: the number that the editor gave this text.
    """

    uri: str
    source: Source
    version: int = 0

    def position(self, offset: int) -> JsonObject:
        r"""Return a character offset as a position: line and column from 0, columns counted in UTF-16 code units.

        >>> Document("file:///a", Source("a", "x\n\N{SMILING FACE WITH SMILING EYES}y")).position(3)
        {'line': 1, 'character': 2}
        """
        line, column = self.source.line_and_column(offset)
        before = self.source.text[offset - column + 1 : offset]
        return {"line": line - 1, "character": len(before.encode("utf-16-le", "surrogatepass")) // 2}

    def range(self, span: Span) -> JsonObject:
        """Return a span of this text as a range of the protocol."""
        return {"start": self.position(span.start), "end": self.position(span.end)}

    def offset(self, position: JsonObject) -> int:
        r"""Return the character offset of a position; a position after the end of a line or text is moved to that end.

        >>> document = Document("file:///a", Source("a", "x\n\N{SMILING FACE WITH SMILING EYES}y"))
        >>> document.offset({"line": 1, "character": 2})
        3
        """
        line = self.source.line_text(position["line"] + 1)
        start = self.source.line_start(position["line"] + 1)
        before = line.encode("utf-16-le", "surrogatepass")[: 2 * position["character"]]
        return start + len(before.decode("utf-16-le", "ignore"))
