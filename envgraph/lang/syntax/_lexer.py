"""Split text into lexemes: words, numbers, strings and punctuation; find doc comments and lexical errors.

Lark's contextual lexer asks at each position for the tokens allowed by the parser's state. This lexer instead splits
the whole text once, in advance, with the terminals of the grammar. The parser decides only two questions: whether a
word is a keyword here, and whether `<-` is one sign or two. So error recovery can read lexemes again and sees how
brackets pair up, and no regular expressions are built for each parser state.
"""

from __future__ import annotations

import re
from collections.abc import Container, Iterable
from dataclasses import field, replace
from inspect import cleandoc

from lark.lexer import PatternStr, TerminalDef

from envgraph.code import dataclass
from envgraph.errors import (
    MAX_ERRORS,
    MAX_NESTING,
    Diagnostic,
    Edit,
    ReplacementHint,
    Source,
    Span,
    parse_float,
    parse_int,
)
from envgraph.metamodel import LARGEST_INT

END = "$END"
PUNCTUATION = "punctuation"
_IGNORED_KINDS = frozenset({"WHITESPACE", "LINE_COMMENT"})
_ESCAPES = {"n": "\n", "t": "\t", "r": "\r", "\\": "\\", '"': '"', "'": "'"}
_ESCAPE = re.compile(r"\\(u[0-9a-fA-F]{4}|.)")
_MEANT_SIGNS = {
    "\u2212": "-", "\u2013": "-", "\u2014": "-", "\u00d7": "*", "\u00f7": "/", "\u2264": "<=", "\u2265": ">=",
    "\u2260": "!=", "\u2227": "&&", "\u2228": "||", "\u00ac": "!", "\u2192": "->", "\u2190": "<-",
    "\uff08": "(", "\uff09": ")", "\uff1b": ";", "\uff0c": ",", "\uff1a": ":", "\u037e": ";",
    "&": "&&", "|": "||", "~": "!", "[": "(", "]": ")",
}  # fmt: skip
"""By typographic or foreign sign: the sign of the languages that was probably meant."""
_FOREIGN_QUOTES = "\u2018\u2019\u201a\u201b\u201c\u201d\u201e\u201f\u00ab\u00bb\u2039\u203a`\u00b4"
_CURLY = re.compile('[\u2018-\u201f\u00ab\u2039]([^\u2018-\u201f\u00bb\u203a"\n]*)[\u2018-\u201f\u00bb\u203a"]')
_WORDS = re.compile(r"\w+(?:\.\w+)*")
_NO_TERM = r"#(?![ \t]*(?:[=!]=|[<>]))"
_FOREIGN_COMMENT = re.compile(_NO_TERM + r"[ \t]")
_FOREIGN_COMMENT_LINE = re.compile(_NO_TERM + r"(?:[ \t!\n]|[^\W\d]|$)")
_TOUCHING_CHARACTER = re.compile(r"[\w#@$]")


SurroundingText = tuple[str, str]
"""Two texts that are read before and after another text; their lexemes have width 0, so positions do not change."""
NO_SURROUNDING_TEXT: SurroundingText = ("", "")


@dataclass(slots=True)
class Lexeme:
    """A piece of text that becomes one token.

    Attributes:
        kind: name of the regular terminal (NAME, INT, STRING ...), or "punctuation", or "$END".
        value: a word without `^`, the contents of a string, otherwise the text itself.
        start, end: the range of the lexeme, as offsets in the text.
        is_escaped: True if the word was written `^word`, so that it is never a keyword.
        brace_depth: the number of `{` that are open before the lexeme.
        is_bracketed: True if a `(` or `[` is open before the lexeme, inside the innermost `{`.
        terminal: the terminal as which the parser read the lexeme; "" if the lexeme was not read or was repaired.
    """

    kind: str
    value: str
    start: int
    end: int
    is_escaped: bool = False
    brace_depth: int = 0
    is_bracketed: bool = False
    terminal: str = ""


@dataclass(frozen=True, slots=True)
class DocComment:
    """A `/** */` comment: its text, the end of the token before it, and the start of the token after it."""

    text: str
    previous_end: int
    next_start: int


@dataclass(slots=True)
class ScanResult:
    """The result of the lexer: all lexemes (the last is the end of the text), doc comments, and lexical errors."""

    lexemes: list[Lexeme] = field(default_factory=list)
    docs: list[DocComment] = field(default_factory=list)
    diagnostics: list[Diagnostic] = field(default_factory=list)


class TextLexer:
    """The lexer of one grammar; its terminals are sorted into keywords, punctuation signs and regular terminals."""

    def __init__(self, terminals: Iterable[TerminalDef]) -> None:
        self.keywords: dict[str, str] = {}
        self.signs: dict[str, str] = {}
        regular: list[TerminalDef] = []
        for terminal in terminals:
            value = terminal.pattern.value
            if not isinstance(terminal.pattern, PatternStr):
                regular.append(terminal)
            elif value[0].isalpha() or value[0] == "_":
                self.keywords[value] = terminal.name
            else:
                self.signs[value] = terminal.name
        regular.sort(key=lambda terminal: (-terminal.priority, terminal.name))
        # A `/*` without an end is an open comment, not a division.
        signs = "|".join(
            re.escape(sign) + (r"(?!\*)" if sign == "/" else "") for sign in sorted(self.signs, key=len, reverse=True)
        )
        groups = [f"(?P<{terminal.name}>{terminal.pattern.to_regexp()})" for terminal in regular]
        self._token = re.compile("|".join([*groups, f"(?P<{PUNCTUATION}>{signs})"] if signs else groups))

    def split_text(self, source: Source, frame: SurroundingText = NO_SURROUNDING_TEXT) -> ScanResult:
        """Split a text into lexemes, with those of the two texts in `frame` around it; return mistakes, never raise."""
        before, after = (self.split_text(Source("", one)).lexemes[:-1] if one else () for one in frame)
        return _Scanner(source, self._token, self.signs, self.keywords).scan_text(before, after)


class _Scanner:
    def __init__(self, source: Source, token: re.Pattern[str], signs: Container[str], keywords: Container[str]) -> None:
        self._source = source
        self._signs = signs
        self._keywords = keywords
        self._text = source.text
        self._token = token
        self._scan = ScanResult()
        self._doc: tuple[str, int] | None = None
        self._open: list[str] = []
        self._braces = 0
        self._too_deep = False
        self._remarks_end = 0

    def scan_text(self, leading_lexemes: Iterable[Lexeme], trailing_lexemes: Iterable[Lexeme]) -> ScanResult:
        match = self._token.match
        text, position, end = self._text, 0, len(self._text)
        for one in leading_lexemes:
            self._add_lexeme(replace(one, start=0, end=0))
        while position < end:
            if len(self._scan.diagnostics) >= MAX_ERRORS:
                message = "too many mistakes: the rest of the file is not read"
                self._report("too-many-errors", message, position, hint="correct these mistakes first")
                break
            found = match(text, position)
            if text[position] == "#" and self._is_foreign_comment(position):
                position = self._report_foreign_comment(position)
                continue
            if found is None:
                position = self._report_unknown(position)
                continue
            kind = found.lastgroup or ""
            if kind not in _IGNORED_KINDS:
                self._add_token(kind, position, found.end())
            position = found.end()
        for one in (*trailing_lexemes, Lexeme(END, "", end, end)):
            self._add_lexeme(replace(one, start=end, end=end))
        return self._scan

    def _add_token(self, kind: str, start: int, end: int) -> None:
        text = self._text[start:end]
        if kind == "BLOCK_COMMENT":
            self._record_doc_comment(text)
        elif kind == "NAME":
            escaped = text[0] == "^"
            self._add_lexeme(Lexeme(kind, text[1:] if escaped else text, start, end, escaped))
        elif kind == PUNCTUATION:
            self._add_lexeme(Lexeme(kind, text, start, end))
        elif kind == "STRING":
            self._add_lexeme(Lexeme(kind, self._unescape(text[1:-1], start + 1), start, end))
        elif kind == "TEXT":
            self._add_lexeme(Lexeme(kind, text[3:-3], start, end))
        else:
            self._scan_number(kind, text, start, end)

    def _add_lexeme(self, lexeme: Lexeme) -> None:
        if self._doc:
            self._scan.docs.append(DocComment(*self._doc, lexeme.start))
            self._doc = None
        lexeme.brace_depth = self._braces
        lexeme.is_bracketed = bool(self._open) and self._open[-1] != "{"
        if lexeme.kind == PUNCTUATION:
            self._count_brackets(lexeme)
        self._scan.lexemes.append(lexeme)

    def _count_brackets(self, lexeme: Lexeme) -> None:
        if lexeme.value in {"{", "(", "["}:
            self._open.append(lexeme.value)
            self._braces += lexeme.value == "{"
            if len(self._open) > MAX_NESTING and not self._too_deep:
                self._too_deep = True
                message = f"more than {MAX_NESTING} brackets are nested in each other"
                hint = "look for a bracket that is not closed; else move a part into its own definition"
                self._report("nested-too-deeply", message, lexeme.start, hint=hint)
        elif lexeme.value in {"}", ")", "]"} and self._open:
            self._open.pop()
            self._braces = max(0, self._braces - (lexeme.value == "}"))

    def _record_doc_comment(self, text: str) -> None:
        if text.startswith("/**") and len(text) > 4:
            lines = cleandoc(text[3:-2]).splitlines()
            prose = [re.sub(r"^\s*\* ?", "", line).rstrip() for line in lines]
            before = self._scan.lexemes[-1].end if self._scan.lexemes else 0
            self._doc = ("\n".join(prose).strip(), before)

    def _scan_number(self, kind: str, text: str, start: int, end: int) -> None:
        if text[:2] in ("0x", "0X"):
            digits = str(int(text[2:18], 16)) if len(text.lstrip("0xX")) <= 16 else "9" * 20
        else:
            digits = text.replace("_", "").rstrip("lLfFdDbBiI")
        # Include the sign, because the least int is `-9223372036854775808`.
        sign = "-" if self._scan.lexemes and self._scan.lexemes[-1].value == "-" else ""
        if (parse_float(digits) if kind == "FLOAT" else parse_int(sign + digits)) is None:
            most = "1.8e308" if kind == "FLOAT" else str(LARGEST_INT)
            hint = f"{'a float' if kind == 'FLOAT' else 'an int'} has 64 bits: write {most} at most"
            self._report("number-too-large", "the number is too large", start, end, hint)
            kind, digits = "INT", "1"  # an INT is allowed wherever any number is
        following = re.compile(r"\w+").match(self._text, end)
        if following:
            word = re.sub(r"^x(?=\d)", "x ", following.group())  # the size `7x7` of a window
            self._report(
                "touching-words",
                f"`{self._text[start : following.end()]}` is neither a number nor a name",
                start,
                following.end(),
                f"write `{text} {word}`, or a name that does not start with a digit",
            )
        self._add_lexeme(Lexeme(kind, digits, start, end))

    def _unescape(self, body: str, start: int) -> str:
        if "\\" not in body:
            return body

        def character(found: re.Match[str]) -> str:
            code = found.group(1)
            if len(code) == 5 and not 0xD800 <= int(code[1:], 16) < 0xE000:
                return chr(int(code[1:], 16))
            if code not in _ESCAPES:
                self._report(
                    "bad-escape",
                    f"`\\{code}` is not an escape sequence",
                    start + found.start(),
                    start + found.end(),
                    "write `\\\\` for a backslash; other escapes are \\n \\t \\r \\\" \\' and \\uXXXX",
                )
            return _ESCAPES.get(code, "")

        return _ESCAPE.sub(character, body)

    def _report_unknown(self, start: int) -> int:
        """Report a character that starts no token, and return the position where scanning continues.

        If the meaning is likely, a token is read, such as an unclosed string or the language's sign for a foreign one.
        """
        text = self._text
        if text.startswith("/*", start):
            self._report("unterminated-comment", "the comment is not closed", start, start + 2, "close it with `*/`")
            return len(text)
        if text.startswith('"""', start):
            self._report("unterminated-text", "the text is not closed", start, start + 3, 'close it with `"""`')
            self._add_lexeme(Lexeme("TEXT", text[start + 3 :], start, len(text)))
            return len(text)
        if text[start] in "\"'":
            return self._report_unterminated_string(start)
        if self._replace_foreign_sign(start):
            return start + 1
        curly = _CURLY.match(text, start)
        if curly:
            message = f"`{text[start]}` is not a quotation mark of the language"
            hint = ReplacementHint(f'write `"{curly.group(1)[:30]}"`', curly.group(), f'"{curly.group(1)}"')
            self._report("stray-character", message, start, curly.end(), hint)
            self._add_lexeme(Lexeme("STRING", curly.group(1), start, curly.end()))
            return curly.end()
        return self._report_stray_characters(start)

    def _is_foreign_comment(self, start: int) -> bool:
        """Return True if a `#` seems to start a comment, as in other languages.

        A blank must follow, or at the start of a line a word. After `(` or `,` a `#` never starts a comment.
        """
        before = self._scan.lexemes[-1].value if self._scan.lexemes else ""
        if before in {"(", ","}:  # here `#` marks the column of an aggregate
            return False
        return bool(
            (_FOREIGN_COMMENT_LINE if is_first_on_line(self._source, start) else _FOREIGN_COMMENT).match(
                self._text, start
            )
        )

    def _report_foreign_comment(self, start: int) -> int:
        """Report a `#` comment, and return its end; comments on adjacent lines are reported once."""
        if self._text[self._remarks_end : start].strip() or not self._remarks_end:
            self._report("unexpected-token", "`#` does not start a comment", start, hint="write `//`")
        end = self._text.find("\n", start)
        self._remarks_end = len(self._text) if end < 0 else end
        return self._remarks_end

    def _replace_foreign_sign(self, start: int) -> bool:
        """Report a sign of other languages and append the intended lexeme; return False for unknown signs."""
        sign, words = self._text[start], [one.value for one in self._scan.lexemes[-2:]]
        if len(words) < 2:
            return False
        following = _WORDS.match(self._text, start + 1)
        if sign == "." and words[0] == "import" and following:
            hint = f'write the path of the file in quotes: `import "{words[1]}.{following.group()}"`'
        elif sign == "." and following and "::" in self._signs and self._scan.lexemes[-1].kind == "NAME":
            hint = f"write `{words[1]}::{following.group()}` for a literal of an enum"
        elif sign in ":<" and words[0] == "class":
            hint = f"write `class {words[1]} extends`"
        elif sign == "|" and words[1] == "}" and "or" in self._keywords:
            hint = "write `or` between two bodies"
        else:
            return False
        self._report("unexpected-token", f"unexpected `{sign}`", start, hint=hint)
        kind, value = {".": (PUNCTUATION, "::"), "|": ("NAME", "or")}.get(sign, ("NAME", "extends"))
        self._add_lexeme(Lexeme(kind, value, start, start + 1))
        return True

    def _report_unterminated_string(self, start: int) -> int:
        end = self._text.find("\n", start)
        end = len(self._text) if end < 0 else end
        # Signs at the end of the line that end a statement or close a bracket were hardly meant as part of the string.
        end = start + len(self._text[start:end].rstrip(" \t\r;,)]}")) or start + 1
        quote, first = self._text[start], self._first_unclosed_string(start)
        self._report(
            "unterminated-string",
            "the string is not closed on its line",
            first,
            end,
            f'close it with `{quote}`; write a text of several lines between `"""`',
            (Edit(self._source.span_between(end, end), quote),) if first == start else (),
        )
        self._add_lexeme(Lexeme("STRING", self._text[start + 1 : end], start, end))
        return end

    def _first_unclosed_string(self, start: int) -> int:
        """Return the start of the string on this line that lacks its closing quote: in `"S, "#b0"` it is the first one.

        A string directly before a word or `#` lacks it, since only punctuation may follow. The errors found behind this
        start have the same cause and are removed.
        """
        line = self._text.rfind("\n", 0, start) + 1
        for lexeme in reversed(self._scan.lexemes):
            if lexeme.start < line:
                break
            if lexeme.kind == "STRING" and _TOUCHING_CHARACTER.match(self._text, lexeme.end):
                start = lexeme.start
        found = self._scan.diagnostics
        while found and found[-1].span is not None and found[-1].span.start >= start:
            found.pop()
        return start

    def _report_stray_characters(self, start: int) -> int:
        end = start + 1
        while end < len(self._text) and self._token.match(self._text, end) is None:
            if self._text[end] in "\"'/":
                break
            end += 1
        shown = self._text[start:end]
        hint = "remove it: such a character is allowed only in strings and comments"
        if _MEANT_SIGNS.get(shown) in self._signs:
            hint = ReplacementHint(f"write `{_MEANT_SIGNS[shown]}`", shown, _MEANT_SIGNS[shown])
        elif shown[0] in _FOREIGN_QUOTES:
            hint = 'write a string between two `"`'
        before = self._scan.lexemes[-1] if self._scan.lexemes else None
        if before is not None and before.kind == "STRING" and before.end == start:
            string = self._text[before.start : start][-20:]
            hint = f"look for a missing quotation mark: the string {string} ends right before it"
        if not shown.isprintable():
            shown = repr(shown)[1:-1]
            hint = "remove this invisible character"
            if end > start + 1:
                hint = "remove these characters, which are partly invisible"
        self._report("stray-character", f"`{shown[:20]}` is not allowed here", start, end, hint)
        return end

    def _report(
        self,
        code: str,
        message: str,
        start: int,
        end: int | None = None,
        hint: str | None = None,
        edits: tuple[Edit, ...] = (),
    ) -> None:
        if len(self._scan.diagnostics) > MAX_ERRORS:
            return
        span = self._source.span_between(start, start + 1 if end is None else end)
        self._scan.diagnostics.append(Diagnostic(code, message, span, hint, edits=edits))


def is_first_on_line(source: Source, offset: int) -> bool:
    """Return True if only blanks are before this character on its line."""
    start = source.text.rfind("\n", 0, offset) + 1
    return not source.text[start:offset].strip()


def has_overlap(diagnostics: Iterable[Diagnostic], span: Span) -> bool:
    """Return True if one of the diagnostics overlaps or touches the span."""
    return any(
        diagnostic.span is not None and diagnostic.span.start <= span.end and span.start <= diagnostic.span.end
        for diagnostic in diagnostics
    )
