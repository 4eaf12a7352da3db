"""Text to trees: an LALR(1) loop that reports every mistake once and goes on."""

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
"""After these nothing of a file is read."""
_NAME = re.compile(r"[^\W\d]\w*")

_DEEPEST = 150

LEVELS = {
    "||": 1, "&&": 2, "==": 3, "!=": 3, "<": 4, "<=": 4, ">": 4, ">=": 4, "+": 5, "-": 5, "*": 6, "/": 6, "%": 6,
}  # fmt: skip
"""How tightly operators bind. Of one number any number may follow each other, but for comparisons."""
MEANT = {"=": "==", "===": "==", "!==": "!=", "and": "&&", "or": "||"}
"""Operators of other languages."""
EQUALITIES, ORDERINGS = 3, 4


@dataclass(slots=True)
class Parsed:
    """What a text says, as far as it can be read.

    Attributes:
        tree: the tree of the start rule, without what was given up; None when nothing could be saved.
        diagnostics: all lexical and syntax errors, in the order of the text.
        lost: the names in what could not be read; that one of them is unknown says nothing.
        gaps: where that stood, as offsets of the text.
    """

    source: Source
    tree: Tree[Token] | None
    diagnostics: list[Diagnostic]
    docs: list[DocComment] = field(default_factory=list)
    lost: frozenset[str] = frozenset()
    gaps: tuple[tuple[int, int], ...] = ()

    def span(self, item: Tree[Token] | Token) -> Span:
        """The characters that a tree or token was made of, brackets and keywords included."""
        return span_of(self.source, item)

    def mended(self, tree: Tree[Token]) -> bool:
        """Return whether a mistake in the text of a tree was mended: what it says may not be what was meant."""
        span = self.span(tree)
        return any(
            one.span and one.span.start <= span.end and span.start < one.span.end for one in self.diagnostics
        )

    def doc(self, tree: Tree[Token]) -> str | None:
        """The doc comment before a definition, or between its annotations and the rest of it."""
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
    """The tree of a text in one of the five languages, and all its errors."""
    return parse_tokens(grammar(language), source)[0]


def parse_tokens(grammar: Grammar, source: Source, frame: Frame = NO_FRAME) -> tuple[Parsed, list[Lexeme]]:
    """As `parse`, with all lexemes as the tree has them: where `<-` was two signs, it is two lexemes."""
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
        message, hint = "this is nested too deeply to be read", f"there may be {_DEEPEST} levels"
        diagnostics.append(Diagnostic("nested-too-deeply", message, span_of(source, deep), hint))
    if tree is None or deep is not None:
        return _nothing(source, diagnostics), stack.lexemes
    lost = stack.lost.union(_unread(source, found))
    return Parsed(source, tree, diagnostics, scan.docs, frozenset(lost), tuple(stack.gaps)), stack.lexemes


def _nothing(source: Source, diagnostics: list[Diagnostic]) -> Parsed:
    """Return what is left of a text of which nothing can be read: all that it defines is unknown."""
    return Parsed(source, None, diagnostics, lost=frozenset(_NAME.findall(source.text)))


def _unread(source: Source, diagnostics: Iterable[Diagnostic]) -> Iterator[str]:
    """The names in tokens that could not be read, and in what comes after a comment that is not closed."""
    for one in diagnostics:
        if one.span and one.code in _TO_THE_END:
            yield from _NAME.findall(source.text, one.span.start)
        elif one.span and one.code == "touching-words":
            yield from _NAME.findall(one.span.text)


def span_of(source: Source, item: Tree[Token] | Token) -> Span:
    """The characters that a tree or token was made of."""
    if isinstance(item, Token):
        return source.span(item.start_pos or 0, item.end_pos or 0)
    return source.span(item.meta.start_pos, item.meta.end_pos)


def trees(items: Iterable[Branch], *names: str) -> list[Tree[Token]]:
    """Those of the items that are trees, of one of the names if any are given."""
    return [item for item in items if isinstance(item, Tree) and (not names or item.data in names)]


def tokens(items: Iterable[Branch], *types: str) -> list[Token]:
    """Those of the items that are tokens, of one of the types if any are given."""
    return [item for item in items if isinstance(item, Token) and (not types or item.type in types)]


def annotation_of(source: Source, tree: Tree[Token]) -> Annotation:
    """The data of an `annotation` tree; a list of values for one key repeats the key."""
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
    """The value of an INT, LONG or FLOAT."""
    return float(token) if token.type == "FLOAT" else int(token)


def signed(tree: Tree[Token]) -> int | float:
    """The number of a tree that has one, negative if a sign stands before it."""
    *sign, number = tokens(tree.children)
    return -number_of(number) if sign else number_of(number)


def qualified_name_of(tree: Tree[Token]) -> str:
    """`a.b.c` of a `qualified_name` tree."""
    return ".".join(str(part) for part in tree.children)


def _run(stack: ParseStack, lexical: list[Diagnostic], mistakes: list[Diagnostic]) -> Tree[Token] | None:
    """The tree of the whole text, with error trees in it; None when nothing could be saved.

    Args:
        stack: of the parse.
        lexical: the misspelt tokens.
        mistakes: to which the others are added.
    """
    recovery: Recovery | None = None
    index = errors = 0
    while True:
        terminal = stack.resolve(stack.states, index) or stack.split(stack.states, index)
        if terminal is None:
            # Counted, and not the diagnostics: what follows from a misspelt token is not reported.
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
    """Return how tightly an operator binds; None for other signs."""
    return LEVELS.get(MEANT.get(operator, operator))


def follows(left: Tree[Token], tree: Tree[Token]) -> bool:
    """Return whether one tree is the `a + b` of `a + b - c`."""
    if left is not tree.children[0] or not left.data.endswith("binary") or not tree.data.endswith("binary"):
        return False
    level, before = level_of(str(tree.children[1])), level_of(str(left.children[1]))
    return level == before and level not in (None, EQUALITIES, ORDERINGS)


def _tidy(root: Tree[Token]) -> Tree[Token] | None:
    """Removes the trees of what was given up; returns a tree that lies too deep for recursion, or None.

    The left sides of a flat `a + b - c`, however long, lie as deep as the whole of it.

    The rules of an imported grammar are known by their own names: `name` for Lark's `common__name`.
    """
    level = [root]
    for _ in range(_DEEPEST):
        below: list[Tree[Token]] = []
        for tree in level:  # which grows
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
