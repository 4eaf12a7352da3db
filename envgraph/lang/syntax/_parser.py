"""Parse text into syntax trees with an LALR(1) loop that reports each mistake once and continues."""

from __future__ import annotations

import re
from bisect import bisect_left
from collections.abc import Iterable, Iterator
from dataclasses import field

from lark import Token, Tree

from envgraph.code import dataclass
from envgraph.errors import MAX_ERRORS, Diagnostic, Source, Span, too_many_errors_diagnostic
from envgraph.lang.syntax._error_recovery import Recovery
from envgraph.lang.syntax._file_formats import check_language
from envgraph.lang.syntax._grammar import Grammar, load_grammar
from envgraph.lang.syntax._lexer import END, NO_SURROUNDING_TEXT, DocComment, Lexeme, SurroundingText
from envgraph.lang.syntax._merge_diagnostics import merge_unquoted_text
from envgraph.lang.syntax._parse_stack import ERROR_TREE, ParseStack
from envgraph.metamodel import Annotation, Value

ParseItem = Tree[Token] | Token | None

_REST_UNREAD_CODES = frozenset({"unterminated-comment", "too-many-errors"})
"""Codes of errors after which the rest of a file is not read."""
_NAME = re.compile(r"[^\W\d]\w*")

_MAX_DEPTH = 150

PRECEDENCES = {
    "||": 1, "&&": 2, "==": 3, "!=": 3, "<": 4, "<=": 4, ">": 4, ">=": 4, "+": 5, "-": 5, "*": 6, "/": 6, "%": 6,
}  # fmt: skip
"""Precedence of binary operators; higher binds tighter. Operators of one precedence form chains, except comparisons."""
MEANT_OPERATORS = {"=": "==", "===": "==", "!==": "!=", "and": "&&", "or": "||"}
"""By operator of other languages: the operator that was meant."""
EQUALITIES, ORDERINGS = 3, 4


@dataclass(slots=True)
class ParseResult:
    """The result of parsing a text, as far as it can be parsed.

    Attributes:
        source: the text.
        tree: the tree of the start rule, without the skipped statements; None if no tree could be built.
        diagnostics: all lexical and syntax errors, in the order of the text.
        doc_comments: the doc comments.
        lost_names: the names in skipped text. They may be defined there, so later checks must not report them as
            unknown.
        skipped_ranges: the skipped ranges, as offsets in the text.
    """

    source: Source
    tree: Tree[Token] | None
    diagnostics: list[Diagnostic]
    doc_comments: list[DocComment] = field(default_factory=list)
    lost_names: frozenset[str] = frozenset()
    skipped_ranges: tuple[tuple[int, int], ...] = ()

    def span(self, item: Tree[Token] | Token) -> Span:
        """Return the span of a tree or token, brackets and keywords included."""
        return span_of(self.source, item)

    def has_mistake(self, tree: Tree[Token]) -> bool:
        """Return True if the text of a tree contains a mistake, so that the tree is a guess of its meaning."""
        span = self.span(tree)
        return any(one.span and one.span.start <= span.end and span.start < one.span.end for one in self.diagnostics)

    def doc_comment(self, tree: Tree[Token]) -> str | None:
        """Return the doc comment of a definition, written before it or after its annotations; None without one."""
        found = bisect_left(self.doc_comments, tree.meta.start_pos, key=lambda doc: doc.next_start)
        if self.doc_comments[found : found + 1] and self.doc_comments[found].next_start == tree.meta.start_pos:
            return self.doc_comments[found].text
        for part in select_trees(tree.children, "annotation"):
            end = part.meta.end_pos
            found = bisect_left(self.doc_comments, end, key=lambda doc: doc.previous_end)
            if self.doc_comments[found : found + 1] and self.doc_comments[found].previous_end == end:
                return self.doc_comments[found].text
        return None


def parse(language: str, source: Source) -> ParseResult:
    """Return the tree of a text in one of the five languages, with all errors."""
    return parse_tokens(load_grammar(language), source)[0]


def parse_tokens(
    grammar: Grammar, source: Source, frame: SurroundingText = NO_SURROUNDING_TEXT
) -> tuple[ParseResult, list[Lexeme]]:
    """Parse a text, surrounded by the two texts in `frame`; return the result and the lexemes.

    A `<-` that was read as two signs is two lexemes.
    """
    scan = grammar.lexer.split_text(source, frame)
    if any(problem.code == "nested-too-deeply" for problem in scan.diagnostics):
        return _unparsed_result(source, scan.diagnostics), scan.lexemes
    stack = ParseStack(grammar, source, scan.lexemes)
    mistakes: list[Diagnostic] = []
    tree = _parse_text(stack, scan.diagnostics, mistakes)
    found = sorted([*scan.diagnostics, *mistakes], key=lambda one: one.span.start if one.span else 0)
    other = check_language(grammar.name, source) if found else None
    if other is not None:
        return _unparsed_result(source, [other]), stack.lexemes
    diagnostics = list(merge_unquoted_text(found)) if found else []
    deep = None if tree is None else _remove_error_trees(tree)
    if deep is not None:
        message, hint = "this is nested too deeply to be read", f"use at most {_MAX_DEPTH} levels"
        diagnostics.append(Diagnostic("nested-too-deeply", message, span_of(source, deep), hint))
    if tree is None or deep is not None:
        return _unparsed_result(source, diagnostics), stack.lexemes
    lost = stack.lost_names.union(_unread_names(source, found))
    return ParseResult(
        source, tree, diagnostics, scan.docs, frozenset(lost), tuple(stack.skipped_ranges)
    ), stack.lexemes


def states_before(grammar: Grammar, source: Source, lexemes: Iterable[Lexeme], offset: int) -> list[int] | None:
    """Return the parser states after all lexemes that start before an offset; None if the text there is skipped.

    Mistakes before the offset are repaired as in `parse_tokens`.
    """
    stack = ParseStack(grammar, source, list(lexemes))
    recovery = Recovery(stack, [], [])
    index = 0
    while stack.lexemes[index].start < offset and stack.lexemes[index].kind != END:
        terminal = stack.terminal_of(stack.states, index) or stack.split_sign(stack.states, index)
        if terminal is not None:
            stack.read_token(terminal, stack.lexemes[index], index)
            index += 1
            continue
        resumed = recovery.recover(index)
        if resumed is None or len(recovery.diagnostics) > MAX_ERRORS or stack.lexemes[max(0, resumed - 1)].end > offset:
            return None
        index = resumed
    return stack.states


def _unparsed_result(source: Source, diagnostics: list[Diagnostic]) -> ParseResult:
    """Return the result for a text that cannot be parsed at all; all names in it count as lost."""
    return ParseResult(source, None, diagnostics, lost_names=frozenset(_NAME.findall(source.text)))


def _unread_names(source: Source, diagnostics: Iterable[Diagnostic]) -> Iterator[str]:
    """Yield the names in text that was not read: words such as `2x`, and all names behind an unclosed comment."""
    for one in diagnostics:
        if one.span and one.code in _REST_UNREAD_CODES:
            yield from _NAME.findall(source.text, one.span.start)
        elif one.span and one.code == "touching-words":
            yield from _NAME.findall(one.span.text)


def span_of(source: Source, item: Tree[Token] | Token) -> Span:
    """Return the span of a tree or token in the source."""
    if isinstance(item, Token):
        return source.span_between(item.start_pos or 0, item.end_pos or 0)
    return source.span_between(item.meta.start_pos, item.meta.end_pos)


def select_trees(items: Iterable[ParseItem], *names: str) -> list[Tree[Token]]:
    """Return the items that are trees; if names are given, only trees with one of these names."""
    return [item for item in items if isinstance(item, Tree) and (not names or item.data in names)]


def select_tokens(items: Iterable[ParseItem], *types: str) -> list[Token]:
    """Return the items that are tokens; if types are given, only tokens of these types."""
    return [item for item in items if isinstance(item, Token) and (not types or item.type in types)]


def annotation_of(source: Source, tree: Tree[Token]) -> Annotation:
    """Return the annotation that an `annotation` tree describes; a list of values for a key repeats the key."""
    name, *arguments = [child for child in tree.children if child is not None]
    positional: list[Value] = []
    named: list[tuple[str, Value]] = []
    places = [("@", span_of(source, name))]
    for argument in select_trees(arguments):
        if argument.data == "annotation_named":
            key = str(argument.children[0])
            named.extend((key, _annotation_value(value)) for value in select_trees(argument.children))
            places.extend((key, span_of(source, value)) for value in select_trees(argument.children))
        else:
            positional.extend(_annotation_value(value) for value in select_trees(argument.children))
    return Annotation(str(name), tuple(positional), tuple(named), span_of(source, tree), tuple(places))


def _annotation_value(tree: Tree[Token]) -> Value:
    match tree.data:
        case "annotation_true":
            return True
        case "annotation_false":
            return False
        case "annotation_number":
            return signed_number_of(tree)
    return str(tree.children[0])


def number_of(token: Token) -> int | float:
    """Return the value of an INT, LONG or FLOAT token."""
    return float(token) if token.type == "FLOAT" else int(token)


def signed_number_of(tree: Tree[Token]) -> int | float:
    """Return the number in a tree, negated if a sign is before it."""
    *sign, number = select_tokens(tree.children)
    return -number_of(number) if sign else number_of(number)


def qualified_name_of(tree: Tree[Token]) -> str:
    """Return the dotted name of a `qualified_name` tree, such as `a.b.c`."""
    return ".".join(str(part) for part in tree.children)


def _parse_text(stack: ParseStack, lexical: list[Diagnostic], mistakes: list[Diagnostic]) -> Tree[Token] | None:
    """Parse the whole text, and return its tree, which still contains error trees; None if no tree could be built.

    Args:
        stack: the state of the parser.
        lexical: the diagnostics of misspelt tokens.
        mistakes: the list to which the syntax errors are added.
    """
    recovery: Recovery | None = None
    index = errors = 0
    while True:
        terminal = stack.terminal_of(stack.states, index) or stack.split_sign(stack.states, index)
        if terminal is None:
            # Count the errors, not the diagnostics, because consequences of a misspelt token are not reported.
            errors += 1
            recovery = recovery or Recovery(stack, lexical, mistakes)
            if errors > MAX_ERRORS:
                mistakes.append(too_many_errors_diagnostic(stack.span(stack.lexemes[index])))
                return None
            resumed = recovery.recover(index)
            if resumed is None:
                return None
            index = resumed
            continue
        stack.read_token(terminal, stack.lexemes[index], index)
        if terminal == END:
            tree = stack.values[-1]
            assert isinstance(tree, Tree)
            return tree
        index += 1


def precedence_of(operator: str) -> int | None:
    """Return the precedence of a binary operator, higher binds tighter, or of a foreign one like `and`; else None."""
    return PRECEDENCES.get(MEANT_OPERATORS.get(operator, operator))


def continues_chain(left: Tree[Token], tree: Tree[Token]) -> bool:
    """Return True if `left`, such as `a + b` in `a + b - c`, is the left operand of `tree` and continues its chain.

    Operators of one precedence form a chain, except comparisons.
    """
    if left is not tree.children[0] or not left.data.endswith("binary") or not tree.data.endswith("binary"):
        return False
    level, before = precedence_of(str(tree.children[1])), precedence_of(str(left.children[1]))
    return level == before and level not in (None, EQUALITIES, ORDERINGS)


def _remove_error_trees(root: Tree[Token]) -> Tree[Token] | None:
    """Remove error trees, and return the first tree nested too deeply for recursion, or None.

    The operands of a flat chain such as `a + b - c` count as one level, however long the chain is. Names of imported
    grammar rules lose their prefix: `common__name` becomes `name`.
    """
    level = [root]
    for _ in range(_MAX_DEPTH):
        below: list[Tree[Token]] = []
        for tree in level:  # the list grows during the loop
            if "__" in tree.data:
                tree.data = tree.data.rpartition("__")[2]
            children = [child for child in tree.children if isinstance(child, Tree)]
            if any(child.data == ERROR_TREE for child in children):
                tree.children = [c for c in tree.children if not (isinstance(c, Tree) and c.data == ERROR_TREE)]
            for child in children:
                if child.data != ERROR_TREE:
                    (level if continues_chain(child, tree) else below).append(child)
        level = below
        if not level:
            return None
    return level[0]
