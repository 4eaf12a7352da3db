"""Parse text into syntax trees with an LALR(1) loop that reports each mistake once and continues."""

from __future__ import annotations

import re
from bisect import bisect_left
from collections.abc import Iterable, Iterator
from dataclasses import field

from lark import Token, Tree

from envgraph.code import dataclass
from envgraph.errors import MOST_ERRORS, Diagnostic, Source, Span
from envgraph.lang.syntax._formats import other_language
from envgraph.lang.syntax._grammar import Grammar, grammar
from envgraph.lang.syntax._lexer import END, NO_FRAME, DocComment, Frame, Lexeme
from envgraph.lang.syntax._once import once_for_each_text
from envgraph.lang.syntax._recovery import Recovery
from envgraph.lang.syntax._stack import ERROR, ParseStack
from envgraph.metamodel import Annotation, Value

Branch = Tree[Token] | Token | None

_TO_THE_END = frozenset({"unterminated-comment", "too-many-errors"})
"""Codes of errors after which the rest of a file is not read."""
_NAME = re.compile(r"[^\W\d]\w*")

_DEEPEST = 150

LEVELS = {
    "||": 1, "&&": 2, "==": 3, "!=": 3, "<": 4, "<=": 4, ">": 4, ">=": 4, "+": 5, "-": 5, "*": 6, "/": 6, "%": 6,
}  # fmt: skip
"""Precedence of binary operators; higher binds tighter. Operators of one precedence form chains, except comparisons."""
MEANT = {"=": "==", "===": "==", "!==": "!=", "and": "&&", "or": "||"}
"""By operator of other languages: the operator that was meant."""
EQUALITIES, ORDERINGS = 3, 4


@dataclass(slots=True)
class Parsed:
    """The result of parsing a text, as far as it can be parsed.

    Attributes:
        source: the text.
        tree: the tree of the start rule, without the skipped statements; None if no tree could be built.
        diagnostics: all lexical and syntax errors, in the order of the text.
        docs: the doc comments.
        lost: the names in skipped text. They may be defined there, so later checks must not report them as unknown.
        gaps: the skipped ranges, as offsets in the text.
    """

    source: Source
    tree: Tree[Token] | None
    diagnostics: list[Diagnostic]
    docs: list[DocComment] = field(default_factory=list)
    lost: frozenset[str] = frozenset()
    gaps: tuple[tuple[int, int], ...] = ()

    def span(self, item: Tree[Token] | Token) -> Span:
        """Return the span of a tree or token, brackets and keywords included."""
        return span_of(self.source, item)

    def mended(self, tree: Tree[Token]) -> bool:
        """Return True if the text of a tree contains a mistake, so that the tree is a guess of its meaning."""
        span = self.span(tree)
        return any(
            one.span and one.span.start <= span.end and span.start < one.span.end for one in self.diagnostics
        )

    def doc(self, tree: Tree[Token]) -> str | None:
        """Return the doc comment of a definition, written before it or after its annotations; None without one."""
        found = bisect_left(self.docs, tree.meta.start_pos, key=lambda doc: doc.after)
        if self.docs[found : found + 1] and self.docs[found].after == tree.meta.start_pos:
            return self.docs[found].text
        for part in trees(tree.children, "annotation"):
            end = part.meta.end_pos
            found = bisect_left(self.docs, end, key=lambda doc: doc.before)
            if self.docs[found : found + 1] and self.docs[found].before == end:
                return self.docs[found].text
        return None


def parse(language: str, source: Source) -> Parsed:
    """Return the tree of a text in one of the five languages, with all errors."""
    return parse_tokens(grammar(language), source)[0]


def parse_tokens(grammar: Grammar, source: Source, frame: Frame = NO_FRAME) -> tuple[Parsed, list[Lexeme]]:
    """Parse a text, surrounded by the two texts in `frame`; return the result and the lexemes.

    A `<-` that was read as two signs is two lexemes.
    """
    scan = grammar.core.scan(source, frame)
    if any(problem.code == "nested-too-deeply" for problem in scan.diagnostics):
        return _nothing(source, scan.diagnostics), scan.lexemes
    stack = ParseStack(grammar, source, scan.lexemes)
    mistakes: list[Diagnostic] = []
    tree = _run(stack, scan.diagnostics, mistakes)
    found = sorted([*scan.diagnostics, *mistakes], key=lambda one: one.span.start if one.span else 0)
    other = other_language(grammar.name, source) if found else None
    if other is not None:
        return _nothing(source, [other]), stack.lexemes
    diagnostics = list(once_for_each_text(found)) if found else []
    deep = None if tree is None else _tidy(tree)
    if deep is not None:
        message, hint = "this is nested too deeply to be read", f"use at most {_DEEPEST} levels"
        diagnostics.append(Diagnostic("nested-too-deeply", message, span_of(source, deep), hint))
    if tree is None or deep is not None:
        return _nothing(source, diagnostics), stack.lexemes
    lost = stack.lost.union(_unread(source, found))
    return Parsed(source, tree, diagnostics, scan.docs, frozenset(lost), tuple(stack.gaps)), stack.lexemes


def _nothing(source: Source, diagnostics: list[Diagnostic]) -> Parsed:
    """Return the result for a text that cannot be parsed at all; all names in it count as lost."""
    return Parsed(source, None, diagnostics, lost=frozenset(_NAME.findall(source.text)))


def _unread(source: Source, diagnostics: Iterable[Diagnostic]) -> Iterator[str]:
    """Yield the names in text that was not read: words such as `2x`, and all names behind an unclosed comment."""
    for one in diagnostics:
        if one.span and one.code in _TO_THE_END:
            yield from _NAME.findall(source.text, one.span.start)
        elif one.span and one.code == "touching-words":
            yield from _NAME.findall(one.span.text)


def span_of(source: Source, item: Tree[Token] | Token) -> Span:
    """Return the span of a tree or token in the source."""
    if isinstance(item, Token):
        return source.span(item.start_pos or 0, item.end_pos or 0)
    return source.span(item.meta.start_pos, item.meta.end_pos)


def trees(items: Iterable[Branch], *names: str) -> list[Tree[Token]]:
    """Return the items that are trees; if names are given, only trees with one of these names."""
    return [item for item in items if isinstance(item, Tree) and (not names or item.data in names)]


def tokens(items: Iterable[Branch], *types: str) -> list[Token]:
    """Return the items that are tokens; if types are given, only tokens of these types."""
    return [item for item in items if isinstance(item, Token) and (not types or item.type in types)]


def annotation_of(source: Source, tree: Tree[Token]) -> Annotation:
    """Return the annotation that an `annotation` tree describes; a list of values for a key repeats the key."""
    name, *arguments = [child for child in tree.children if child is not None]
    positional: list[Value] = []
    named: list[tuple[str, Value]] = []
    places = [("@", span_of(source, name))]
    for argument in trees(arguments):
        if argument.data == "annotation_named":
            key = str(argument.children[0])
            named.extend((key, _annotation_value(value)) for value in trees(argument.children))
            places.extend((key, span_of(source, value)) for value in trees(argument.children))
        else:
            positional.extend(_annotation_value(value) for value in trees(argument.children))
    return Annotation(str(name), tuple(positional), tuple(named), span_of(source, tree), tuple(places))


def _annotation_value(tree: Tree[Token]) -> Value:
    match tree.data:
        case "annotation_true":
            return True
        case "annotation_false":
            return False
        case "annotation_number":
            return signed(tree)
    return str(tree.children[0])


def number_of(token: Token) -> int | float:
    """Return the value of an INT, LONG or FLOAT token."""
    return float(token) if token.type == "FLOAT" else int(token)


def signed(tree: Tree[Token]) -> int | float:
    """Return the number in a tree, negated if a sign is before it."""
    *sign, number = tokens(tree.children)
    return -number_of(number) if sign else number_of(number)


def qualified_name_of(tree: Tree[Token]) -> str:
    """Return the dotted name of a `qualified_name` tree, such as `a.b.c`."""
    return ".".join(str(part) for part in tree.children)


def _run(stack: ParseStack, lexical: list[Diagnostic], mistakes: list[Diagnostic]) -> Tree[Token] | None:
    """Parse the whole text, and return its tree, which still contains error trees; None if no tree could be built.

    Args:
        stack: the state of the parser.
        lexical: the diagnostics of misspelt tokens.
        mistakes: the list to which the syntax errors are added.
    """
    recovery: Recovery | None = None
    index = errors = 0
    while True:
        terminal = stack.resolve(stack.states, index) or stack.split(stack.states, index)
        if terminal is None:
            # Count the errors, not the diagnostics, because consequences of a misspelt token are not reported.
            errors += 1
            recovery = recovery or Recovery(stack, lexical, mistakes)
            if errors > MOST_ERRORS:
                recovery.stop(index)
                return None
            resumed = recovery.recover(index)
            if resumed is None:
                return None
            index = resumed
            continue
        stack.feed(terminal, stack.lexemes[index], index)
        if terminal == END:
            tree = stack.values[-1]
            assert isinstance(tree, Tree)
            return tree
        index += 1


def level_of(operator: str) -> int | None:
    """Return the precedence of a binary operator, higher binds tighter, or of a foreign one like `and`; else None."""
    return LEVELS.get(MEANT.get(operator, operator))


def follows(left: Tree[Token], tree: Tree[Token]) -> bool:
    """Return True if `left`, such as `a + b` in `a + b - c`, is the left operand of `tree` and continues its chain.

    Operators of one precedence form a chain, except comparisons.
    """
    if left is not tree.children[0] or not left.data.endswith("binary") or not tree.data.endswith("binary"):
        return False
    level, before = level_of(str(tree.children[1])), level_of(str(left.children[1]))
    return level == before and level not in (None, EQUALITIES, ORDERINGS)


def _tidy(root: Tree[Token]) -> Tree[Token] | None:
    """Remove error trees, and return the first tree nested too deeply for recursion, or None.

    The operands of a flat chain such as `a + b - c` count as one level, however long the chain is. Names of imported
    grammar rules lose their prefix: `common__name` becomes `name`.
    """
    level = [root]
    for _ in range(_DEEPEST):
        below: list[Tree[Token]] = []
        for tree in level:  # the list grows during the loop
            if "__" in tree.data:
                tree.data = tree.data.rpartition("__")[2]
            children = [child for child in tree.children if isinstance(child, Tree)]
            if any(child.data == ERROR for child in children):
                tree.children = [c for c in tree.children if not (isinstance(c, Tree) and c.data == ERROR)]
            for child in children:
                if child.data != ERROR:
                    (level if follows(child, tree) else below).append(child)
        level = below
        if not level:
            return None
    return level[0]
