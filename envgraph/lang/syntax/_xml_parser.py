"""Parse XML with the positions of all its parts, for `.ecore` and `.xmi` files.

The parser is Python's expat, which reports byte positions. lxml, used by pyecore, reports only lines, and fetches
external files that a text names. A document type is refused before it is read, so that no entity is ever expanded and
no file is fetched.
"""

from __future__ import annotations

import codecs
import re
from collections.abc import Callable, Mapping
from dataclasses import field
from itertools import accumulate
from typing import NoReturn
from xml.parsers import expat

from envgraph.code import dataclass
from envgraph.errors import RAISE_LIMIT_HINT, Diagnostic, LoadError, Note, Source, Span, scaled_limit

XSI = "http://www.w3.org/2001/XMLSchema-instance"
XMI = "http://www.omg.org/XMI"

# Python's other codecs are not text encodings (`rot13`, `zip`), or can hide attacks (`utf-7`).
_ENCODINGS = re.compile(
    r"utf[-_]?8|(us[-_]?)?ascii|utf[-_]?16([-_]?[lb]e)?|iso[-_]?8859[-_]\d+|latin[-_]?1|windows[-_]?\d+|cp\d+|koi8[-_][ru]"
    r"|gb\d+|gbk|big5|shift[-_]?jis|euc[-_](jp|kr)",
    re.IGNORECASE,
)
_DECLARED = re.compile(rb"\s*<\?xml[^>]*?\sencoding\s*=\s*[\"']([^\"'>]*)[\"']")
_DECLARED_TEXT = re.compile(r"(\s*<\?xml[^>]*?\sencoding\s*=\s*[\"'])([^\"'>]*)")
_ATTRIBUTE = re.compile(r"\s+([^\s=/>]+)\s*=\s*(\"[^\"]*\"|'[^']*')")
_NAME = re.compile(r"[^\s/>]*")
_WORD = re.compile(r"\S+")
_CONTINUATION_BYTES = bytes(range(0x80, 0xC0))
"""The continuation bytes of UTF-8."""
_BLOCK = 1024


def decode_xml_source(name: str, data: bytes) -> Source:
    """Return the text of an XML file, decoded by its byte order mark or declared encoding, else as UTF-8.

    Raises:
        LoadError: the encoding is unknown, or a byte is invalid in it.
    """
    for mark, encoding in (
        (b"\xef\xbb\xbf", "utf-8"),
        (b"\xff\xfe", "utf-16-le"),
        (b"\xfe\xff", "utf-16-be"),
    ):
        if data.startswith(mark):
            return Source(name, decode_text(name, data[len(mark) :], encoding))
    if data[:2] in (b"<\0", b"\0<"):
        return Source(name, decode_text(name, data, "utf-16-le" if data[:1] == b"<" else "utf-16-be"))
    found = _DECLARED.match(data[:1000])
    if found is None:
        return Source(name, decode_text(name, data, "utf-8"))
    declared = found.group(1).decode("latin-1")
    if not _ENCODINGS.fullmatch(declared) or not _is_known_encoding(declared):
        source = Source(name, data.decode("latin-1"))
        message = f"unknown encoding `{declared}`"
        hint = 'save the file as UTF-8, and write `encoding="UTF-8"`'
        raise LoadError.from_problem("unknown-encoding", message, source.span_between(*found.span(1)), hint)
    # UTF-16 was detected above by its bytes, so a declared `utf...` is UTF-8 here.
    return Source(name, decode_text(name, data, "utf-8" if declared.lower().startswith("utf") else declared))


def declare_utf8(text: str) -> str:
    """Return the text with a declaration of another encoding changed to UTF-8."""
    found = _DECLARED_TEXT.match(text[:1000])
    if found is None or found.group(2).upper() == "UTF-8":
        return text
    return f"{found.group(1)}UTF-8{text[found.end() :]}"


def _is_known_encoding(encoding: str) -> bool:
    try:
        codecs.lookup(encoding)
    except LookupError:
        return False
    return True


def decode_text(name: str, data: bytes, encoding: str) -> str:
    """Return the decoded contents of a file.

    Raises:
        LoadError: a byte is invalid in the encoding; the diagnostic shows it with the text around it.
    """
    try:
        return data.decode(encoding)
    except UnicodeDecodeError as error:
        before = data[: error.start].decode(encoding, errors="ignore")
        source = Source(name, before + data[error.start :].decode(encoding, errors="replace"))
        shown = encoding.upper()
        hint = "save the file as UTF-8" + ("" if shown == "UTF-8" else ', and write `encoding="UTF-8"`')
        span = source.span_between(len(before), len(before) + 1)
        message = f"the byte 0x{data[error.start]:02x} is not {shown}"
        code = "not-utf-8" if shown == "UTF-8" else "wrong-encoding"
        raise LoadError.from_problem(code, message, span, hint) from None


@dataclass(slots=True)
class XmlPositions:
    """The positions of the tags of an XML text, found by the offset of their first byte in UTF-8, as expat reports it.

    Spans are computed on request: an `.xmi` file has hundreds of thousands of tags, and few are shown.
    """

    source: Source
    data: bytes = field(init=False, repr=False)
    _is_ascii: bool = field(init=False)
    _blocks: list[int] = field(default_factory=list, repr=False)
    _tag: int = -1
    _found: dict[str, re.Match[str]] = field(default_factory=dict, repr=False)
    _value: tuple[int, str] = (-1, "")
    _words: dict[str, tuple[int, int]] = field(default_factory=dict, repr=False)

    def __post_init__(self) -> None:
        self.data = self.source.text.encode("utf-8", errors="surrogatepass")
        self._is_ascii = len(self.data) == len(self.source.text)

    def free_memory(self) -> None:
        """Free the encoded text if it is pure ASCII; otherwise it is still needed to convert byte offsets."""
        if self._is_ascii:
            self.data = b""

    def character_offset(self, byte: int) -> int:
        """Return the character offset of a byte offset."""
        if self._is_ascii:
            return byte
        if not self._blocks:
            counts = (
                len(self.data[at : at + _BLOCK].translate(None, _CONTINUATION_BYTES))
                for at in range(0, len(self.data), _BLOCK)
            )
            self._blocks = list(accumulate(counts, initial=0))
        block = byte // _BLOCK
        return self._blocks[block] + len(self.data[block * _BLOCK : byte].translate(None, _CONTINUATION_BYTES))

    def tag_span(self, byte: int) -> Span:
        """Return the span of the name of the tag that begins at a byte."""
        start = self.character_offset(byte) + 1
        if self.source.text[start : start + 1] == "/":
            start += 1
        found = _NAME.match(self.source.text, start)
        return self.source.span_between(start, found.end() if found else start)

    def attribute_span(self, byte: int, name: str, word: str | None = None) -> Span:
        """Return the span of an attribute's value, or of the word `word` in it; without the attribute, of the tag."""
        found = self._attributes(byte).get(name)
        if found is None:
            return self.tag_span(byte)
        start, end = found.start(2) + 1, found.end(2) - 1
        one_word = word and self.source.text[start:end] == word
        place = self._words_of(byte, name, start, end).get(word) if word and not one_word else None
        if place:
            return Span(self.source, *place)
        # The span of an empty value is its quotes.
        return Span(self.source, start, end) if end > start else Span(self.source, start - 1, end + 1)

    def attribute_name_span(self, byte: int, name: str) -> Span:
        """Return the span of an attribute's name; of the tag if it has no such attribute."""
        found = self._attributes(byte).get(name)
        return self.source.span_between(*found.span(1)) if found else self.tag_span(byte)

    def _attributes(self, byte: int) -> Mapping[str, re.Match[str]]:
        """Return the attributes of a tag, as regular expression matches; the last tag is cached for repeated calls."""
        if byte != self._tag:
            self._tag, self._found = byte, {}
            at = self.tag_span(byte).end
            while found := _ATTRIBUTE.match(self.source.text, at):
                self._found.setdefault(found.group(1), found)
                at = found.end()
        return self._found

    def _words_of(self, byte: int, name: str, start: int, end: int) -> Mapping[str, tuple[int, int]]:
        """Return the first position of each word in an attribute's value."""
        if (byte, name) != self._value:
            self._value, self._words = (byte, name), {}
            for found in _WORD.finditer(self.source.text, start, end):
                self._words.setdefault(found.group(), found.span())
        return self._words


class StopParsing(Exception):
    """An exception that a handler raises to end the parse early without an error."""


class XmlReader:
    """A single pass of expat over a text.

    Attributes:
        open_tags: the open tags, each with the byte offset at which it begins.
    """

    def __init__(self, places: XmlPositions) -> None:
        self.places = places
        self.open_tags: list[tuple[str, int]] = []
        self._most_open = scaled_limit("open tags")
        self._parser = expat.ParserCreate("utf-8")
        self._parser.buffer_text = True

    @property
    def current_byte(self) -> int:
        """Return the byte offset of the item that is being parsed."""
        return self._parser.CurrentByteIndex

    def parse(
        self,
        start: Callable[[str, dict[str, str]], object],
        end: Callable[[str], object] | None = None,
        text: Callable[[str], None] | None = None,
    ) -> Diagnostic | None:
        """Parse the text and call handlers; return a diagnostic if it is not valid XML, else None.

        Args:
            start: called with the name and the attributes of each start tag.
            end: called with the name of each end tag.
            text: called with text between tags.
        """
        source = self.places.source
        if not source.text.strip():
            hint = "write `.ecore` and `.xmi` files with `envgraph convert`"
            return Diagnostic("empty-file", "the file is empty", source.span_between(0, 0), hint)
        parser = self._parser
        parser.StartElementHandler = start
        parser.EndElementHandler = end
        parser.CharacterDataHandler = text
        parser.StartDoctypeDeclHandler = self._refuse_doctype
        try:
            parser.Parse(self.places.data, True)
        except expat.ExpatError as error:
            return self._malformed(error)
        except LoadError as error:
            return error.diagnostics[0]
        except StopParsing:
            pass
        return None

    def record_open_tag(self, tag: str) -> int:
        """Record an open tag, and return its byte offset; refuse too deep nesting. Start handlers must call this."""
        byte = self._parser.CurrentByteIndex
        self.open_tags.append((tag, byte))
        if len(self.open_tags) > self._most_open:
            self.raise_limit_exceeded("nested-too-deeply", f"the tags are nested more than {self._most_open:,} deep")
        return byte

    def raise_limit_exceeded(self, code: str, message: str) -> NoReturn:
        """Raise LoadError with this message at the innermost open tag, because a limit is exceeded."""
        place = self.places.tag_span(self.open_tags[-1][1])
        raise LoadError.from_problem(code, message, place, RAISE_LIMIT_HINT)

    def _refuse_doctype(self, *_: object) -> NoReturn:
        text = self.places.source.text
        start = max(text.rfind("<!DOCTYPE", 0, self.places.character_offset(self.current_byte) + 1), 0)
        span = self.places.source.span_between(start, start + len("<!DOCTYPE"))
        hint = "remove it, and replace its entities by their values"
        message = "a document type is not allowed, because it could refer to other files or define endless entities"
        raise LoadError.from_problem("document-type", message, span, hint)

    def _malformed(self, error: expat.ExpatError) -> Diagnostic:
        start = self.places.character_offset(max(self._parser.ErrorByteIndex, 0))
        span = self.places.source.span_between(start, start + 1)
        messages = expat.errors.messages
        word = messages.get(error.code, "")
        if word == "mismatched tag" and self.open_tags:
            return self._mismatched(start)
        if word == "no element found" and self.open_tags:
            return self._unclosed(span)
        message, hint = _EXPAT_MESSAGES.get(word, (f"this is not XML: {word}", None))
        if span.text and not span.text.isprintable() and word.startswith("not well-formed"):
            message, hint = f"`{repr(span.text)[1:-1]}` is not allowed in XML", "remove the character"
        return Diagnostic("syntax", message, span, hint)

    def _mismatched(self, start: int) -> Diagnostic:
        tag, byte = self.open_tags[-1]
        found = re.compile(r"<?/?([^\s>]*)").match(self.places.source.text, start)
        name, span = "", self.places.source.span_between(start, start + 1)
        if found:
            name, span = found.group(1), self.places.source.span_between(found.start(1), found.end(1))
        note = Note("it is opened here", self.places.tag_span(byte))
        message = f"`</{name}>` does not close `<{tag}>`"
        return Diagnostic("syntax", message, span, f"write `</{tag}>`", notes=(note,))

    def _unclosed(self, span: Span) -> Diagnostic:
        tag, byte = self.open_tags[-1]
        note = Note("it is opened here", self.places.tag_span(byte))
        message = f"the file ends before `</{tag}>`"
        return Diagnostic("syntax", message, span, f"write `</{tag}>` at the end", notes=(note,))


_EXPAT_MESSAGES: Mapping[str, tuple[str, str | None]] = {
    "not well-formed (invalid token)": (
        "this is not XML",
        "write `&lt;` for `<` and `&amp;` for `&` in a text",
    ),
    "syntax error": ("this is not XML", "begin the file with a tag"),
    "no element found": (
        "the file has no XML element",
        "write one element that contains all tags and texts",
    ),
    "unclosed token": (
        "this is never closed",
        "close a tag with `>`, a comment with `-->`, a value with the quotation mark at its start",
    ),
    "duplicate attribute": ("this attribute is given twice", "leave one out"),
    "undefined entity": (
        "unknown entity",
        "use only `&lt;`, `&gt;`, `&amp;`, `&quot;`, `&apos;` and numbers such as `&#38;`",
    ),
    "junk after document element": (
        "the file continues after the end of its root element",
        "put everything into one element, such as `<xmi:XMI>`",
    ),
    "XML or text declaration not at start of entity": (
        "`<?xml ...?>` must be at the very start of the file",
        "remove all text before it, blanks included",
    ),
    "unbound prefix": ("this prefix is not declared", 'write `xmlns:prefix="..."` in the first tag'),
}


@dataclass(slots=True, eq=False)
class XmlElement:
    """An XML element.

    Attributes:
        tag: the name of the tag, with its prefix.
        name: the name without its prefix.
        byte: the byte offset of the tag.
        scope: the namespaces declared here and around, by prefix.
        text: the text directly inside.
    """

    tag: str
    name: str
    byte: int
    attributes: Mapping[str, str]
    scope: Mapping[str, str]
    children: list[XmlElement] = field(default_factory=list)

    def get(self, name: str) -> str:
        """Return the value of an attribute; "" if the attribute is missing."""
        return self.attributes.get(name, "")

    @property
    def namespace(self) -> str | None:
        """Return the namespace of the tag's prefix; None if the prefix is not declared."""
        return self.scope.get(self.tag.rpartition(":")[0])

    def qualified_key(self, name: str, *namespaces: str) -> str | None:
        """Return the key (such as `xsi:type`) of the attribute with this name in one of the namespaces, or None."""
        for key in self.attributes:
            prefix, _, local = key.rpartition(":")
            if local == name and prefix and self.scope.get(prefix, "") in namespaces:
                return key
        return None


def read_tree(places: XmlPositions) -> tuple[XmlElement | None, Diagnostic | None]:
    """Parse a text into a tree; return its root and None, or None and a diagnostic if it is not valid XML."""
    reader = XmlReader(places)
    roots: list[XmlElement] = []
    path: list[XmlElement] = []
    count, most = 0, scaled_limit("tags")

    def start(tag: str, attributes: dict[str, str]) -> None:
        nonlocal count
        byte = reader.record_open_tag(tag)
        count += 1
        if count > most:
            reader.raise_limit_exceeded("too-many-tags", f"the file has more than {most:,} tags")
        scope = path[-1].scope if path else {"xml": "http://www.w3.org/XML/1998/namespace"}
        own = declared_namespaces(attributes)
        element = XmlElement(tag, tag.rpartition(":")[2], byte, attributes, {**scope, **own} if own else scope)
        (path[-1].children if path else roots).append(element)
        path.append(element)

    def end(_: str) -> None:
        path.pop()
        reader.open_tags.pop()

    problem = reader.parse(start, end)
    return (None, problem) if problem or not roots else (roots[0], None)


def declared_namespaces(attributes: Mapping[str, str]) -> dict[str, str]:
    """Return the namespaces that a tag declares, by prefix; "" is the prefix of the default namespace."""
    return {key[6:]: value for key, value in attributes.items() if key == "xmlns" or key.startswith("xmlns:")}
