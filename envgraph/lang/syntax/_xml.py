"""XML with the place of everything in it: what `.ecore` and `.xmi` files have in common.

The parser is expat, which comes with Python and knows where it is. lxml, below pyecore, knows lines alone, and stops at
nothing that a file asks it to fetch. A document type is refused before anything in it is read: no entity is ever
expanded, and nothing is fetched.
"""

from __future__ import annotations

import codecs
import re
from collections.abc import Callable, Mapping
from dataclasses import field
from itertools import accumulate
from typing import Final, NoReturn
from xml.parsers import expat

from envgraph.code import dataclass
from envgraph.errors import RAISE_LIMIT, Diagnostic, LoadError, Note, Source, Span, limit

XSI = "http://www.w3.org/2001/XMLSchema-instance"
XMI = "http://www.omg.org/XMI"

# Other codecs of Python are no encodings of text (`rot13`, `zip`), or cannot be told apart from attacks (`utf-7`).
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
_FOLLOWING = bytes(range(0x80, 0xC0))
"""The bytes of UTF-8 that begin no character."""
_BLOCK = 1024


def xml_source(name: str, data: bytes) -> Source:
    """The text of an XML file, by its byte order mark or the encoding that it declares; else it is UTF-8.

    Raises:
        LoadError: the encoding is unknown, or a byte is none of its.
    """
    for mark, encoding in (
        (b"\xef\xbb\xbf", "utf-8"),
        (b"\xff\xfe", "utf-16-le"),
        (b"\xfe\xff", "utf-16-be"),
    ):
        if data.startswith(mark):
            return Source(name, decoded(name, data[len(mark) :], encoding))
    if data[:2] in (b"<\0", b"\0<"):
        return Source(name, decoded(name, data, "utf-16-le" if data[:1] == b"<" else "utf-16-be"))
    found = _DECLARED.match(data[:1000])
    if found is None:
        return Source(name, decoded(name, data, "utf-8"))
    declared = found.group(1).decode("latin-1")
    if not _ENCODINGS.fullmatch(declared) or not _known(declared):
        source = Source(name, data.decode("latin-1"))
        message = f"unknown encoding `{declared}`"
        hint = 'save the file as UTF-8, and write `encoding="UTF-8"`'
        raise LoadError.of("unknown-encoding", message, source.span(*found.span(1)), hint)
    # A file in UTF-16 was recognised above: this one only says that it is.
    return Source(name, decoded(name, data, "utf-8" if declared.lower().startswith("utf") else declared))


def as_utf8(text: str) -> str:
    """The text as it can be kept in UTF-8: it says no longer that it is in another encoding."""
    found = _DECLARED_TEXT.match(text[:1000])
    if found is None or found.group(2).upper() == "UTF-8":
        return text
    return f"{found.group(1)}UTF-8{text[found.end() :]}"


def _known(encoding: str) -> bool:
    try:
        codecs.lookup(encoding)
    except LookupError:
        return False
    return True


def decoded(name: str, data: bytes, encoding: str) -> str:
    """The text of a file.

    Raises:
        LoadError: a byte is none of the encoding; it is shown in its surroundings, since what comes before is fine.
    """
    try:
        return data.decode(encoding)
    except UnicodeDecodeError as error:
        before = data[: error.start].decode(encoding, errors="ignore")
        source = Source(name, before + data[error.start :].decode(encoding, errors="replace"))
        shown = encoding.upper()
        hint = "save the file as UTF-8" + ("" if shown == "UTF-8" else ', and write `encoding="UTF-8"`')
        span = source.span(len(before), len(before) + 1)
        message = f"the byte 0x{data[error.start]:02x} is not {shown}"
        code = "not-utf-8" if shown == "UTF-8" else "wrong-encoding"
        raise LoadError.of(code, message, span, hint) from None


@dataclass(slots=True)
class XmlPlaces:
    """Where the tags of a text stand, by the byte at which they begin in UTF-8, as expat counts.

    Spans are worked out when they are wanted: an `.xmi` file has hundreds of thousands, and few are shown.
    """

    source: Source
    data: bytes = field(init=False, repr=False)
    _plain: bool = field(init=False)
    _blocks: list[int] = field(default_factory=list, repr=False)
    _tag: int = -1
    _found: dict[str, re.Match[str]] = field(default_factory=dict, repr=False)
    _value: tuple[int, str] = (-1, "")
    _words: dict[str, tuple[int, int]] = field(default_factory=dict, repr=False)

    def __post_init__(self) -> None:
        self.data = self.source.text.encode("utf-8", errors="surrogatepass")
        self._plain = len(self.data) == len(self.source.text)

    def forget(self) -> None:
        """Frees what is not needed once the text is read."""
        if self._plain:
            self.data = b""

    def offset(self, byte: int) -> int:
        """The character at a byte."""
        if self._plain:
            return byte
        if not self._blocks:
            counts = (
                len(self.data[at : at + _BLOCK].translate(None, _FOLLOWING))
                for at in range(0, len(self.data), _BLOCK)
            )
            self._blocks = list(accumulate(counts, initial=0))
        block = byte // _BLOCK
        return self._blocks[block] + len(self.data[block * _BLOCK : byte].translate(None, _FOLLOWING))

    def tag(self, byte: int) -> Span:
        """The name of the tag that begins at a byte."""
        start = self.offset(byte) + 1
        if self.source.text[start : start + 1] == "/":
            start += 1
        found = _NAME.match(self.source.text, start)
        return self.source.span(start, found.end() if found else start)

    def attribute(self, byte: int, name: str, part: str | None = None) -> Span:
        """The value of an attribute of a tag, or a word in it; the tag if it has no such attribute."""
        found = self._attributes(byte).get(name)
        if found is None:
            return self.tag(byte)
        start, end = found.start(2) + 1, found.end(2) - 1
        one_word = part and self.source.text[start:end] == part
        place = self._words_of(byte, name, start, end).get(part) if part and not one_word else None
        if place:
            return Span(self.source, *place)
        # An empty value is shown by its quotes.
        return Span(self.source, start, end) if end > start else Span(self.source, start - 1, end + 1)

    def name_of(self, byte: int, name: str) -> Span:
        """The name of an attribute of a tag."""
        found = self._attributes(byte).get(name)
        return self.source.span(*found.span(1)) if found else self.tag(byte)

    def _attributes(self, byte: int) -> Mapping[str, re.Match[str]]:
        """The attributes of a tag; those of the last one are kept, since all of them may be asked for in turn."""
        if byte != self._tag:
            self._tag, self._found = byte, {}
            at = self.tag(byte).end
            while found := _ATTRIBUTE.match(self.source.text, at):
                self._found.setdefault(found.group(1), found)
                at = found.end()
        return self._found

    def _words_of(self, byte: int, name: str, start: int, end: int) -> Mapping[str, tuple[int, int]]:
        """Return where each word of a value stands first."""
        if (byte, name) != self._value:
            self._value, self._words = (byte, name), {}
            for found in _WORD.finditer(self.source.text, start, end):
                self._words.setdefault(found.group(), found.span())
        return self._words


_MOST_OPEN: Final = 100_000
"""Tags inside each other above which a file is not read."""
_MOST_TAGS: Final = 100_000
"""Tags in a file above which no tree is made of it; UML's own metamodel has 10,000."""


class Stop(Exception):
    """Raised by a handler that wants no more of the text."""


class Reader:
    """One reading of one text.

    Attributes:
        open: the tags that are open, with the byte at which each begins.
    """

    def __init__(self, places: XmlPlaces) -> None:
        self.places = places
        self.open: list[tuple[str, int]] = []
        self._most_open = limit(_MOST_OPEN)
        self._parser = expat.ParserCreate("utf-8")
        self._parser.buffer_text = True

    @property
    def at(self) -> int:
        """The byte at which what is just being read begins."""
        return self._parser.CurrentByteIndex

    def read(
        self,
        start: Callable[[str, dict[str, str]], object],
        end: Callable[[str], object],
        text: Callable[[str], None],
    ) -> Diagnostic | None:
        """Reads the text; says why it is no XML, or None.

        Args:
            start: called with a tag and its attributes.
            end: called at the end of a tag.
            text: called with text between tags.
        """
        source = self.places.source
        if not source.text.strip():
            hint = "`envgraph convert` writes `.ecore` and `.xmi` files"
            return Diagnostic("empty-file", "the file is empty", source.span(0, 0), hint)
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
        except Stop:
            pass
        return None

    def begin(self, tag: str) -> int:
        """Notes a tag that is open now; the byte at which it begins. Handlers call it for each."""
        byte = self._parser.CurrentByteIndex
        self.open.append((tag, byte))
        if len(self.open) > self._most_open:
            self.refuse("too-deep", f"the tags are nested more than {self._most_open:,} deep")
        return byte

    def refuse(self, code: str, message: str) -> NoReturn:
        """A limit is passed at the innermost open tag."""
        place = self.places.tag(self.open[-1][1])
        raise LoadError.of(code, message, place, RAISE_LIMIT)

    def _refuse_doctype(self, *_: object) -> NoReturn:
        text = self.places.source.text
        start = max(text.rfind("<!DOCTYPE", 0, self.places.offset(self.at) + 1), 0)
        span = self.places.source.span(start, start + len("<!DOCTYPE"))
        hint = "leave it out, and write what its entities stand for"
        message = "a document type is not read: it could name other files, or entities without end"
        raise LoadError.of("document-type", message, span, hint)

    def _malformed(self, error: expat.ExpatError) -> Diagnostic:
        start = self.places.offset(max(self._parser.ErrorByteIndex, 0))
        span = self.places.source.span(start, start + 1)
        messages = expat.errors.messages
        word = messages.get(error.code, "")
        if word == "mismatched tag" and self.open:
            return self._mismatched(start)
        if word == "no element found" and self.open:
            return self._unclosed(span)
        message, hint = _WORDS.get(word, (f"this is not XML: {word}", None))
        if span.text and not span.text.isprintable() and word.startswith("not well-formed"):
            message, hint = f"`{repr(span.text)[1:-1]}` cannot stand in XML", "take the character out"
        return Diagnostic("syntax", message, span, hint)

    def _mismatched(self, start: int) -> Diagnostic:
        tag, byte = self.open[-1]
        found = re.compile(r"<?/?([^\s>]*)").match(self.places.source.text, start)
        name, span = "", self.places.source.span(start, start + 1)
        if found:
            name, span = found.group(1), self.places.source.span(found.start(1), found.end(1))
        note = Note("it is opened here", self.places.tag(byte))
        message = f"`</{name}>` does not close `<{tag}>`"
        return Diagnostic("syntax", message, span, f"write `</{tag}>`", notes=(note,))

    def _unclosed(self, span: Span) -> Diagnostic:
        tag, byte = self.open[-1]
        note = Note("it is opened here", self.places.tag(byte))
        message = f"the file ends before `</{tag}>`"
        return Diagnostic("syntax", message, span, f"write `</{tag}>` at the end", notes=(note,))


_WORDS: Mapping[str, tuple[str, str | None]] = {
    "not well-formed (invalid token)": (
        "this is not XML",
        "write `&lt;` for `<` and `&amp;` for `&` in a text",
    ),
    "syntax error": ("this is not XML", "an XML file begins with a tag"),
    "no element found": (
        "the file has no XML element",
        "an XML file is one element, with tags and texts in it",
    ),
    "unclosed token": (
        "this is never closed",
        "a tag ends with `>`, a comment with `-->`, a value with the quotation mark it began with",
    ),
    "duplicate attribute": ("this attribute stands here twice", "leave one out"),
    "undefined entity": (
        "unknown entity",
        "XML knows `&lt;`, `&gt;`, `&amp;`, `&quot;`, `&apos;` and `&#38;`",
    ),
    "junk after document element": (
        "the file goes on after its only element",
        "put everything into one element, such as `<xmi:XMI>`",
    ),
    "XML or text declaration not at start of entity": (
        "`<?xml ...?>` is the first thing in a file",
        "take out what stands before it, blanks included",
    ),
    "unbound prefix": ("this prefix is not declared", 'write `xmlns:prefix="..."` in the first tag'),
}


@dataclass(slots=True, eq=False)
class Element:
    """A tag with what is inside; `byte` is where it begins, `scope` the namespaces by prefix, `name` has no prefix."""

    tag: str
    name: str
    byte: int
    attributes: Mapping[str, str]
    scope: Mapping[str, str]
    children: list[Element] = field(default_factory=list)
    text: str = ""

    def get(self, name: str) -> str:
        """The value of an attribute, "" if it is not there."""
        return self.attributes.get(name, "")

    @property
    def namespace(self) -> str | None:
        """What the prefix of the tag stands for; None without one."""
        return self.scope.get(self.tag.rpartition(":")[0])

    def qualified(self, name: str, *namespaces: str) -> str | None:
        """The attribute of this name in one of the namespaces, as it is written (`xsi:type`)."""
        for key in self.attributes:
            prefix, _, local = key.rpartition(":")
            if local == name and prefix and self.scope.get(prefix, "") in namespaces:
                return key
        return None


def read_tree(places: XmlPlaces) -> tuple[Element | None, Diagnostic | None]:
    """The root of a text, or why it is no XML."""
    reader = Reader(places)
    roots: list[Element] = []
    path: list[Element] = []
    count, most = 0, limit(_MOST_TAGS)

    def start(tag: str, attributes: dict[str, str]) -> None:
        nonlocal count
        byte = reader.begin(tag)
        count += 1
        if count > most:
            reader.refuse("too-many-tags", f"the file has more than {most:,} tags")
        scope = path[-1].scope if path else {"xml": "http://www.w3.org/XML/1998/namespace"}
        own = namespaces(attributes)
        element = Element(tag, tag.rpartition(":")[2], byte, attributes, {**scope, **own} if own else scope)
        (path[-1].children if path else roots).append(element)
        path.append(element)

    def end(_: str) -> None:
        path.pop()
        reader.open.pop()

    def text(data: str) -> None:
        path[-1].text += data

    problem = reader.read(start, end, text)
    return (None, problem) if problem or not roots else (roots[0], None)


def namespaces(attributes: Mapping[str, str]) -> dict[str, str]:
    """The namespaces that a tag declares, by prefix; "" is for tags without one."""
    return {key[6:]: value for key, value in attributes.items() if key == "xmlns" or key.startswith("xmlns:")}
