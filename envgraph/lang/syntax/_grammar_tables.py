"""The LALR(1) tables of a grammar: built by Lark, and kept as JSON, since building them takes longer than all the rest.

Lark keeps tables as pickles; these are the same data as text. A file says which grammar it was made from, and is made
anew when that is another one.
"""

from __future__ import annotations

import json
from contextlib import suppress
from hashlib import sha256
from pathlib import Path
from typing import Any, cast

import lark
from lark import Lark, Tree
from lark.grammar import Rule
from lark.lexer import TerminalDef
from lark.parse_tree_builder import ParseTreeBuilder
from lark.parsers.lalr_analysis import IntParseTable
from lark.utils import SerializeMemoizer

from envgraph.code import dataclass
from envgraph.files import cache_directory, replace_file
from envgraph.lang.syntax._lexer import LexicalCore

_NAMESPACE = {"Rule": Rule, "TerminalDef": TerminalDef}


@dataclass(frozen=True, slots=True)
class Tables:
    """What a parser needs of a grammar.

    Attributes:
        table: for each state, what to do at each terminal and where to go after each rule.
        rules: all of the grammar.
        terminals: likewise.
        ignored: names of terminals that stand anywhere.
    """

    table: IntParseTable
    rules: list[Rule]
    terminals: list[TerminalDef]
    ignored: list[str]

    def callbacks(self) -> dict[Any, Any]:
        """For each rule what builds its tree from the parts."""
        builder: Any = ParseTreeBuilder
        found: dict[Any, Any] = builder(self.rules, Tree, maybe_placeholders=True).create_callback()
        return found


def tables(path: Path) -> Tables:
    """The tables of a grammar file; a conflict in it is an exception when they are built."""
    directory, key = cache_directory(), _key(path)
    kept = directory / f"grammar-{path.stem}.json" if directory else None
    if kept is not None:
        with suppress(OSError, ValueError, LookupError, TypeError, AttributeError):  # not there, or damaged
            data = json.loads(kept.read_bytes(), object_hook=_with_numbers)
            if data["key"] == key:
                return _made(data)
    built = _built(path)
    if kept is not None:
        with suppress(OSError):
            replace_file(kept, json.dumps({"key": key, **_plain(built)}))
    return built


def _key(path: Path) -> str:
    """A hash of all that tables depend on: the grammars, which import each other, and Lark."""
    texts = [one.read_text(encoding="utf-8") for one in sorted(path.parent.glob("*.lark"))]
    return sha256("\0".join([lark.__version__, *texts]).encode()).hexdigest()


def _built(path: Path) -> Tables:
    with path.open(encoding="utf-8") as text:
        made = Lark(text, parser="lalr", lexer=LexicalCore, strict=True)
    return Tables(
        made.parser.parser._parse_table, made.rules, list(made.terminals), sorted(made.ignore_tokens)
    )


def _plain(built: Tables) -> dict[str, Any]:
    memo, table = SerializeMemoizer([Rule, TerminalDef]), cast("Any", built.table)
    data = {
        "table": table.serialize(memo),
        "rules": [rule.serialize(memo) for rule in built.rules],
        "terminals": [terminal.serialize(memo) for terminal in built.terminals],
        "ignored": built.ignored,
    }
    return {**data, "memo": memo.serialize()}


def _made(data: dict[str, Any]) -> Tables:
    memo, table = SerializeMemoizer.deserialize(data["memo"], _NAMESPACE, {}), cast("Any", IntParseTable)
    return Tables(
        table.deserialize(data["table"], memo),
        [Rule.deserialize(one, memo) for one in data["rules"]],
        [TerminalDef.deserialize(one, memo) for one in data["terminals"]],
        data["ignored"],
    )


def _with_numbers(found: dict[str, Any]) -> dict[Any, Any]:
    """Numbers of states and of terminals are keys, which JSON writes as texts."""
    return {int(key): value for key, value in found.items()} if next(iter(found), "").isdigit() else found
