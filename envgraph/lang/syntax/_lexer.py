"""Text to lexemes: what is a word, a number, a string, punctuation; where comments and errors are.

Lark's contextual lexer asks at each position for the tokens of the parser's state. This one splits the whole text
first, once, with the terminals of the grammar, and leaves only two questions to the parser: whether a word is a
keyword here, and whether `<-` is one sign or two. So the words of a mistyped statement can be looked at again, an
error can see how the brackets pair up, and building a parser costs no regular expression for each state.
"""

from __future__ import annotations

import re
from collections.abc import Container, Iterable
from dataclasses import field, replace
from inspect import cleandoc

from lark.lexer import PatternStr, TerminalDef

from envgraph.code import dataclass
from envgraph.errors import MOST_ERRORS, MOST_NESTED, Diagnostic, Source, Span, parse_float, parse_int
from envgraph.metamodel import LARGEST_INT

END = "$END"
PUNCTUATION = "punctuation"
_IGNORED_KINDS = frozenset({"WHITESPACE", "LINE_COMMENT"})
_ESCAPES = {"n": "\n", "t": "\t", "r": "\r", "\\": "\\", '"': '"', "'": "'"}
_ESCAPE = re.compile(r"\\(u[0-9a-fA-F]{4}|.)")
_MEANT = {
    "\u2212": "-", "\u2013": "-", "\u2014": "-", "\u00d7": "*", "\u00f7": "/", "\u2264": "<=", "\u2265": ">=",
    "\u2260": "!=", "\u2227": "&&", "\u2228": "||", "\u00ac": "!", "\u2192": "->", "\u2190": "<-",
    "\uff08": "(", "\uff09": ")", "\uff1b": ";", "\uff0c": ",", "\uff1a": ":", "\u037e": ";",
    "&": "&&", "|": "||", "~": "!", "[": "(", "]": ")",
}  # fmt: skip
"""Signs of print, and what they are here."""
_QUOTES = "\u2018\u2019\u201a\u201b\u201c\u201d\u201e\u201f\u00ab\u00bb\u2039\u203a`\u00b4"
_CURLY = re.compile(
    '[\u2018-\u201f\u00ab\u2039]([^\u2018-\u201f\u00bb\u203a"\n]*)[\u2018-\u201f\u00bb\u203a"]'
)
_WORDS = re.compile(r"\w+(?:\.\w+)*")
_NO_TERM = r"#(?![ \t]*(?:[=!]=|[<>]))"
_REMARK = re.compile(_NO_TERM + r"[ \t]")
_WORD_REMARK = re.compile(_NO_TERM + r"(?:[ \t!\n]|[^\W\d]|$)")
_TOUCHING = re.compile(r"[\w#@$]")


Frame = tuple[str, str]
"""Texts that are read before and after another one, as if they stood there and took up no room."""
NO_FRAME: Frame = ("", "")


@dataclass(slots=True)
class Lexeme:
    """A stretch of text that is one token, whatever the parser makes of it.

    Attributes:
        kind: name of the regular terminal (NAME, INT, STRING ...), or "punctuation", or "$END".
        value: the word without `^`, the contents of a string, otherwise the text itself.
        escaped: the word was written `^word` and is never a keyword.
        braces: how many `{` are open before it.
        bracketed: whether a `(` or `[` is open before it, inside the innermost `{`.
    """

    kind: str
    value: str
    start: int
    end: int
    escaped: bool = False
    braces: int = 0
    bracketed: bool = False


@dataclass(frozen=True, slots=True)
class DocComment:
    """A `/** */`: its text, where the token before it ends and where the token after it starts."""

    text: str
    before: int
    after: int


@dataclass(slots=True)
class Scan:
    """All lexemes of a source (the last is the end), and what is wrong with its spelling."""

    lexemes: list[Lexeme] = field(default_factory=list)
    docs: list[DocComment] = field(default_factory=list)
    diagnostics: list[Diagnostic] = field(default_factory=list)


class LexicalCore:
    """The terminals of one grammar, sorted into words, regular tokens and punctuation."""

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
        # A `/*` that is not closed is an open comment, not a division.
        signs = "|".join(
            re.escape(sign) + (r"(?!\*)" if sign == "/" else "")
            for sign in sorted(self.signs, key=len, reverse=True)
        )
        groups = [f"(?P<{terminal.name}>{terminal.pattern.to_regexp()})" for terminal in regular]
        self._token = re.compile("|".join([*groups, f"(?P<{PUNCTUATION}>{signs})"] if signs else groups))

    def scan(self, source: Source, frame: Frame = NO_FRAME) -> Scan:
        """Splits a text; nothing in it can make this raise."""
        before, after = (self.scan(Source("", one)).lexemes[:-1] if one else () for one in frame)
        return _Scanner(source, self._token, self.signs, self.keywords).run(before, after)


class _Scanner:
    def __init__(
        self, source: Source, token: re.Pattern[str], signs: Container[str], keywords: Container[str]
    ) -> None:
        self._source = source
        self._signs = signs
        self._keywords = keywords
        self._text = source.text
        self._token = token
        self._scan = Scan()
        self._doc: tuple[str, int] | None = None
        self._open: list[str] = []
        self._braces = 0
        self._too_deep = False
        self._remarks_end = 0

    def run(self, before: Iterable[Lexeme], after: Iterable[Lexeme]) -> Scan:
        match = self._token.match
        text, position, end = self._text, 0, len(self._text)
        for one in before:
            self._append(replace(one, start=0, end=0))
        while position < end:
            if len(self._scan.diagnostics) >= MOST_ERRORS:
                message = "too many mistakes: the rest of the file is not read"
                self._report("too-many-errors", message, position, hint="mend these first")
                break
            found = match(text, position)
            if text[position] == "#" and self._is_remark(position):
                position = self._remark(position)
                continue
            if found is None:
                position = self._unknown(position)
                continue
            kind = found.lastgroup or ""
            if kind not in _IGNORED_KINDS:
                self._take(kind, position, found.end())
            position = found.end()
        for one in (*after, Lexeme(END, "", end, end)):
            self._append(replace(one, start=end, end=end))
        return self._scan

    def _take(self, kind: str, start: int, end: int) -> None:
        text = self._text[start:end]
        if kind == "BLOCK_COMMENT":
            self._comment(text)
        elif kind == "NAME":
            escaped = text[0] == "^"
            self._append(Lexeme(kind, text[1:] if escaped else text, start, end, escaped))
        elif kind == PUNCTUATION:
            self._append(Lexeme(kind, text, start, end))
        elif kind == "STRING":
            self._append(Lexeme(kind, self._unescape(text[1:-1], start + 1), start, end))
        elif kind == "TEXT":
            self._append(Lexeme(kind, text[3:-3], start, end))
        else:
            self._number(kind, text, start, end)

    def _append(self, lexeme: Lexeme) -> None:
        if self._doc:
            self._scan.docs.append(DocComment(*self._doc, lexeme.start))
            self._doc = None
        lexeme.braces = self._braces
        lexeme.bracketed = bool(self._open) and self._open[-1] != "{"
        if lexeme.kind == PUNCTUATION:
            self._nest(lexeme)
        self._scan.lexemes.append(lexeme)

    def _nest(self, lexeme: Lexeme) -> None:
        if lexeme.value in {"{", "(", "["}:
            self._open.append(lexeme.value)
            self._braces += lexeme.value == "{"
            if len(self._open) > MOST_NESTED and not self._too_deep:
                self._too_deep = True
                message = f"more than {MOST_NESTED} brackets inside each other"
                hint = "a bracket before it may not be closed; else make a definition of a part"
                self._report("nested-too-deeply", message, lexeme.start, hint=hint)
        elif lexeme.value in {"}", ")", "]"} and self._open:
            self._open.pop()
            self._braces = max(0, self._braces - (lexeme.value == "}"))

    def _comment(self, text: str) -> None:
        if text.startswith("/**") and len(text) > 4:
            lines = cleandoc(text[3:-2]).splitlines()
            prose = [re.sub(r"^\s*\* ?", "", line).rstrip() for line in lines]
            before = self._scan.lexemes[-1].end if self._scan.lexemes else 0
            self._doc = ("\n".join(prose).strip(), before)

    def _number(self, kind: str, text: str, start: int, end: int) -> None:
        if text[:2] in ("0x", "0X"):
            digits = str(int(text[2:18], 16)) if len(text.lstrip("0xX")) <= 16 else "9" * 20
        else:
            digits = text.replace("_", "").rstrip("lLfFdDbBiI")
        # With the sign before it: the least int is `-9223372036854775808`.
        sign = "-" if self._scan.lexemes and self._scan.lexemes[-1].value == "-" else ""
        if (parse_float(digits) if kind == "FLOAT" else parse_int(sign + digits)) is None:
            most = "1.8e308" if kind == "FLOAT" else str(LARGEST_INT)
            hint = f"{'a float' if kind == 'FLOAT' else 'an int'} has 64 bits: it is {most} at most"
            self._report("number-too-large", "the number is too large", start, end, hint)
            kind, digits = "INT", "1"  # which may stand wherever a number may
        following = re.compile(r"\w+").match(self._text, end)
        if following:
            word = following.group()
            self._report(
                "touching-words",
                f"`{self._text[start : following.end()]}` is neither a number nor a name",
                start,
                following.end(),
                f"write `{text} {word}`, or a name that does not start with a digit",
            )
        self._append(Lexeme(kind, digits, start, end))

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
                    f"`\\{code}` means nothing in a string",
                    start + found.start(),
                    start + found.end(),
                    "write `\\\\` for a backslash; there are \\n \\t \\r \\\" \\' and \\uXXXX",
                )
            return _ESCAPES.get(code, "")

        return _ESCAPE.sub(character, body)

    def _unknown(self, start: int) -> int:
        """Reports what starts no token, and returns where to go on."""
        text = self._text
        if text.startswith("/*", start):
            self._report(
                "unterminated-comment", "the comment is not closed", start, start + 2, "close it with `*/`"
            )
            return len(text)
        if text.startswith('"""', start):
            self._report(
                "unterminated-text", "the text is not closed", start, start + 3, 'close it with `"""`'
            )
            self._append(Lexeme("TEXT", text[start + 3 :], start, len(text)))
            return len(text)
        if text[start] in "\"'":
            return self._unterminated(start)
        if self._instead(start):
            return start + 1
        curly = _CURLY.match(text, start)
        if curly:
            message = f"`{text[start]}` is no quotation mark here"
            self._report("stray-character", message, start, curly.end(), f'write `"{curly.group(1)[:30]}"`')
            self._append(Lexeme("STRING", curly.group(1), start, curly.end()))
            return curly.end()
        return self._stray(start)

    def _is_remark(self, start: int) -> bool:
        """Whether a `#` stands for a comment, as in other languages: alone, or before words at the start of a line."""
        before = self._scan.lexemes[-1].value if self._scan.lexemes else ""
        if before in {"(", ","}:  # it marks the column of an aggregate
            return False
        return bool(
            (_WORD_REMARK if first_on_line(self._source, start) else _REMARK).match(self._text, start)
        )

    def _remark(self, start: int) -> int:
        """Reports a comment of other languages, those on the lines after it included, and returns its end."""
        if self._text[self._remarks_end : start].strip() or not self._remarks_end:
            self._report("unexpected-token", "`#` starts no comment", start, hint="write `//`")
        end = self._text.find("\n", start)
        self._remarks_end = len(self._text) if end < 0 else end
        return self._remarks_end

    def _instead(self, start: int) -> bool:
        """A sign that other languages write here: what is meant is read for it."""
        sign, words = self._text[start], [one.value for one in self._scan.lexemes[-2:]]
        if len(words) < 2:
            return False
        following = _WORDS.match(self._text, start + 1)
        if sign == "." and words[0] == "import" and following:
            hint = f'the path of a file stands in quotes: `import "{words[1]}.{following.group()}"`'
        elif sign == "." and following and "::" in self._signs and self._scan.lexemes[-1].kind == "NAME":
            hint = f"a literal of an enum is written `{words[1]}::{following.group()}`"
        elif sign in ":<" and words[0] == "class":
            hint = f"write `class {words[1]} extends`"
        elif sign == "|" and words[1] == "}" and "or" in self._keywords:
            hint = "write `or` between two bodies"
        else:
            return False
        self._report("unexpected-token", f"unexpected `{sign}`", start, hint=hint)
        kind, value = {".": (PUNCTUATION, "::"), "|": ("NAME", "or")}.get(sign, ("NAME", "extends"))
        self._append(Lexeme(kind, value, start, start + 1))
        return True

    def _unterminated(self, start: int) -> int:
        end = self._text.find("\n", start)
        end = len(self._text) if end < 0 else end
        # What ends a statement or closes a bracket at the end of the line was hardly meant to stand in the string.
        end = start + len(self._text[start:end].rstrip(" \t\r;,)]}")) or start + 1
        quote = self._text[start]
        self._report(
            "unterminated-string",
            "the string is not closed on its line",
            self._closed_too_soon(start),
            end,
            f'close it with `{quote}`; a text of several lines stands between `"""`',
        )
        self._append(Lexeme("STRING", self._text[start + 1 : end], start, end))
        return end

    def _closed_too_soon(self, start: int) -> int:
        """Return where the strings of this line begin to be wrong: in `"S, "#b0"` it is the first that lacks its end.

        Nothing but a sign may touch the end of a string. What was wrong since then is the same mistake.
        """
        line = self._text.rfind("\n", 0, start) + 1
        for lexeme in reversed(self._scan.lexemes):
            if lexeme.start < line:
                break
            if lexeme.kind == "STRING" and _TOUCHING.match(self._text, lexeme.end):
                start = lexeme.start
        found = self._scan.diagnostics
        while found and found[-1].span is not None and found[-1].span.start >= start:
            found.pop()
        return start

    def _stray(self, start: int) -> int:
        end = start + 1
        while end < len(self._text) and self._token.match(self._text, end) is None:
            if self._text[end] in "\"'/":
                break
            end += 1
        shown = self._text[start:end]
        hint = "take it out: such a character stands in strings and comments only"
        if _MEANT.get(shown) in self._signs:
            hint = f"write `{_MEANT[shown]}`"
        elif shown[0] in _QUOTES:
            hint = 'a string stands between two `"`'
        before = self._scan.lexemes[-1] if self._scan.lexemes else None
        if before is not None and before.kind == "STRING" and before.end == start:
            string = self._text[before.start : start][-20:]
            hint = f"the string {string} ends right before it: is a quotation mark missing?"
        if not shown.isprintable():
            shown = repr(shown)[1:-1]
            hint = "take the character out, which cannot be seen"
            if end > start + 1:
                hint = "take these characters out, which cannot all be seen"
        self._report("stray-character", f"`{shown[:20]}` means nothing here", start, end, hint)
        return end

    def _report(
        self, code: str, message: str, start: int, end: int | None = None, hint: str | None = None
    ) -> None:
        if len(self._scan.diagnostics) > MOST_ERRORS:
            return
        span = self._source.span(start, start + 1 if end is None else end)
        self._scan.diagnostics.append(Diagnostic(code, message, span, hint))


def first_on_line(source: Source, offset: int) -> bool:
    """Return whether only blanks stand before a character of the text on its line."""
    start = source.text.rfind("\n", 0, offset) + 1
    return not source.text[start:offset].strip()


def overlapping(diagnostics: Iterable[Diagnostic], span: Span) -> bool:
    """Return whether one of the diagnostics is about characters of the span, its ends included."""
    return any(
        diagnostic.span is not None
        and diagnostic.span.start <= span.end
        and span.start <= diagnostic.span.end
        for diagnostic in diagnostics
    )
