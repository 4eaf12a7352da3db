"""Print the tokens of all bundled files and examples of the documentation, as the parser reads them, as JSON.

The output is a list of `{place, language, text, tokens}`; a token is `[start, end, kind]` with offsets in the text.
"""

from __future__ import annotations

import json
import re
import sys
from collections.abc import Iterator
from pathlib import Path

ROOT = Path(__file__).parents[3]
sys.path += [str(ROOT), str(ROOT / "docs" / "extensions")]

from language_tokens import tokens_of  # noqa: E402

from envgraph.errors import Source  # noqa: E402
from envgraph.lang import LANGUAGES  # noqa: E402
from envgraph.lang.syntax._grammar import load_grammar  # noqa: E402
from envgraph.lang.syntax._parser import parse_tokens  # noqa: E402

_FENCE = re.compile(r"^```(\w+)[^\n`]*\n(.*?)^```$", re.MULTILINE | re.DOTALL)
_KINDS = {"INT": "number", "LONG": "number", "FLOAT": "number", "STRING": "string", "TEXT": "string"}
Token = tuple[int, int, str]


def texts() -> Iterator[tuple[str, str, str]]:
    """Yield the place, the language and the text of each bundled file and of each example in the documentation."""
    for language in LANGUAGES:
        for path in sorted((ROOT / "rules").rglob(f"*.{language}")):
            yield str(path.relative_to(ROOT)), language, path.read_text("utf-8")
    for page in sorted((ROOT / "docs").rglob("*.md")):
        for number, (language, text) in enumerate(_FENCE.findall(page.read_text("utf-8"))):
            if language in LANGUAGES:
                yield f"{page.relative_to(ROOT)}, block {number}", language, text


def tokens_as_parsed(language: str, text: str) -> list[Token] | None:
    """Return the tokens of a text in its order; None if the text has a mistake."""
    result, lexemes = parse_tokens(load_grammar(language), Source("text", text))
    if result.tree is None or result.diagnostics:
        return None
    leaves = result.tree.scan_values(lambda token: token is not None and token.type == "NAME")
    names = {token.start_pos for token in (*leaves, *(tree.children[0] for tree in result.tree.find_data("variable")))}
    tokens, end = [], 0
    for one in lexemes:
        tokens += _comments(language, text, end, one.start)
        if one.start < one.end:
            kind = "name" if one.start in names else "keyword" if one.kind == "NAME" else _KINDS.get(one.kind, "sign")
            tokens.append((one.start, one.end, kind))
        end = one.end
    return tokens


def _comments(language: str, text: str, start: int, end: int) -> list[Token]:
    patterns = tokens_of(language).patterns
    expression = re.compile(f"{patterns['LINE_COMMENT']}|{patterns['BLOCK_COMMENT']}")
    return [(*found.span(), "comment") for found in expression.finditer(text, start, end)]


def main() -> None:
    """Print the tokens of all texts without mistakes."""
    found = [
        {"place": place, "language": language, "text": text, "tokens": tokens}
        for place, language, text in texts()
        if (tokens := tokens_as_parsed(language, text)) is not None
    ]
    assert all(ord(letter) < 0x10000 for one in found for letter in str(one["text"])), "offsets differ in JavaScript"
    json.dump(found, sys.stdout)


if __name__ == "__main__":
    main()
