"""Read levels of other tools as rows of named cells: Sokoban texts (XSB), des-files of MiniHack, and maps of Tiled."""

from __future__ import annotations

import re
import struct
import zlib
from base64 import b64decode
from collections.abc import Collection, Iterator, Mapping, Sequence
from itertools import groupby
from typing import Any, cast

from envgraph.code import dataclass
from envgraph.errors import (
    MAX_ERRORS,
    RAISE_LIMIT_HINT,
    Diagnostic,
    LoadError,
    Note,
    Source,
    Span,
    parse_int,
    scaled_limit,
)
from envgraph.graph import JsonPath
from envgraph.lang.interchange._json_reader import parse_json
from envgraph.lang.syntax._file_formats import suffix_of
from envgraph.lang.syntax._xml_parser import XmlElement, XmlPositions, read_tree

BLANK_LETTER = " "


@dataclass(frozen=True, slots=True)
class LevelCell:
    """A cell of a level: its possible names, the preferred first, and its span.

    A letter has one name, an empty Sokoban floor three. A tile of Tiled has its class, if any, and its number as names.
    """

    names: tuple[str, ...]
    span: Span


@dataclass(frozen=True, slots=True)
class Level:
    """A level with its title ("" if none), the span of its first row, and its rows, top first and equally long."""

    title: str
    span: Span
    rows: tuple[tuple[LevelCell, ...], ...]


FLOOR_LETTERS = (BLANK_LETTER, "_", "-")
"""Letters for an empty floor in files of Sokoban. If a legend has only some of them, the others mean the same."""
_XSB = ("xsb", "sok")

_BEFORE = re.compile(r"\s*;\s*(.*)")
_BEHIND = re.compile(r"\s*title\s*:\s*(.*)", re.IGNORECASE)
_KEY = re.compile(r"\s*\w[\w ]*:")

_DES_TITLE = re.compile(r"(?:MAZE|LEVEL)\s*:\s*\"([^\"]*)\"")
_DES_SETTING = re.compile(r"(FLAGS|GEOMETRY|MESSAGE|REGION|NON_DIGGABLE|NON_PASSWALL|INIT_MAP\s*:\s*solidfill)\b|#")
"""Lines of a des-file that put nothing on the map."""
_DES_THING = re.compile(r"([A-Z]+)\s*:([^{]*?)\(\s*(\d+)\s*,\s*(\d+)\s*(?:,\s*\3\s*,\s*\4\s*)?\)([^{]*)")
"""A thing at a place of the map: `OBJECT:('`',"boulder"),(2,3)`, `STAIR:(6,6),down`, `BRANCH:(6,4,6,4),(0,0,0,0)`."""
_DES_NAMES = (re.compile(r"\"([^\"]+)\""), re.compile(r"'(.)'"), re.compile(r"[a-z]\w*"))
"""The names of a thing: those in double quotes, else its letter, else the words about it."""


def read_levels(source: Source, letters: Collection[str]) -> tuple[Level, ...]:
    """Return the levels of a file, in order; the suffix of the file determines its format.

    `.tmx`, `.tmj` and `.json` are maps of Tiled. In `.des`, each level is between `MAP` and `ENDMAP`, and lines
    behind it put things on its cells. In other files a level is a run of adjacent rows: lines with more than half of
    their characters in `letters`. Its title is `; name` before it, or `Title: name` behind it.

    Raises:
        LoadError: the file has no level, the map cannot be read, a line of a des-file is not understood, or a line
            adjacent to a row is probably a mistyped row. All problems are reported.
    """
    suffix = suffix_of(source.name)
    if suffix in ("tmx", "tmj", "json"):
        return (read_tiled(source),)
    found, cells = list[Level](), 0
    for title, rows, things in _des_levels(source) if suffix == "des" else _text_levels(source, letters):
        width = max(len(row.text) for row in rows)
        cells += width * len(rows)
        if len(found) == scaled_limit("levels") or cells > scaled_limit("cells"):
            most = f"{scaled_limit('levels'):,} levels and {scaled_limit('cells'):,} cells"
            message = f"up to this level the file has {len(found) + 1:,} levels and {cells:,} cells"
            message += f", but at most {most} are read"
            raise LoadError.from_problem(
                "too-many-cells", message, rows[0].span, f"divide the file; {RAISE_LIMIT_HINT}"
            )
        plain = (enumerate(_row_cells(row, width)) for row in rows)
        level = tuple(tuple(things.get((x, y), cell) for x, cell in row) for y, row in enumerate(plain))
        found.append(Level(title, rows[0].span, level))
    if not found:
        hint = "write a map between `MAP` and `ENDMAP`" if suffix == "des" else _letters_hint(letters)
        raise LoadError.from_problem("no-level", "the file has no level", source.span_between(0, 0), hint)
    return tuple(found)


def _letters_hint(letters: Collection[str]) -> str:
    return f"the letters are {', '.join(f'`{one}`' for one in letters)}"


@dataclass(frozen=True, slots=True)
class _LevelLine:
    text: str
    span: Span


def _lines(source: Source) -> Iterator[_LevelLine]:
    start = 0
    for line in source.text.split("\n"):
        text = line.rstrip()
        yield _LevelLine(text, source.span_between(start, start + len(text)))
        start += len(line) + 1


_LevelLines = tuple[str, list[_LevelLine], dict[tuple[int, int], LevelCell]]
"""The title and the lines of a level, and the cells with things on them by column and row."""


def _text_levels(source: Source, letters: Collection[str]) -> Iterator[_LevelLines]:
    """Yield the lines of each level in a text of letters; raise LoadError for mistyped rows."""
    known = {*letters, *(FLOOR_LETTERS if suffix_of(source.name) in _XSB else (BLANK_LETTER,))}
    problems = list(_doubtful_line_errors(source, known, letters))
    if problems:
        raise LoadError(problems[:MAX_ERRORS])
    level, rows, title = ("", list[_LevelLine]()), list[_LevelLine](), ""
    for line in (*_lines(source), _LevelLine("", source.span_between(0, 0))):
        if _is_row(line.text, known):
            rows.append(line)
            continue
        if rows:
            if level[1]:
                yield *level, {}
            level, rows, title = (title, rows), [], ""
        if before := _BEFORE.fullmatch(line.text):
            title = before.group(1)
        elif behind := _BEHIND.fullmatch(line.text):
            level = behind.group(1), level[1]
    if level[1]:
        yield *level, {}


def _doubtful_line_errors(
    source: Source, row_letters: Collection[str], letters: Collection[str]
) -> Iterator[Diagnostic]:
    """Yield an error for each line next to rows that starts like a row but has too few of the `row_letters` letters."""
    message = "this line is next to a level, but at least half of its characters are not letters of the model"
    hint = (
        f"{_letters_hint(letters)}; if it is a row, add `--legend x=LETTER` for a letter `x` of it, and "
        "write each cell as a letter, without counts (run-length encoding). If it is other text, put an empty line "
        "between it and the level"
    )
    for _, block in groupby(_lines(source), key=lambda line: bool(line.text)):
        lines = list(block)
        if any(_is_row(line.text, row_letters) for line in lines):
            for line in lines:
                if not _is_row(line.text, row_letters) and _begins_like_a_row(line.text, letters):
                    yield Diagnostic("unknown-row", message, line.span, hint)


def _is_row(line: str, known: Collection[str]) -> bool:
    text = line.strip()
    return text[:1] not in ("", ";") and 2 * sum(letter in known for letter in text) > len(text)


def _begins_like_a_row(line: str, letters: Collection[str]) -> bool:
    """Return True if a line starts with a letter of the model other than floor, perhaps after a count.

    A line of the form `Title: name` is no row.
    """
    first = line.strip().lstrip("0123456789")[:1]
    return first in {*letters} - {*FLOOR_LETTERS} and _KEY.match(line) is None


def _row_cells(row: _LevelLine, width: int) -> Iterator[LevelCell]:
    """Yield the cells of a row, padded with blank cells to the given width."""
    source, start = row.span.source, row.span.start
    floors = FLOOR_LETTERS if suffix_of(source.name) in _XSB else ()
    for column, letter in enumerate(row.text.ljust(width)):
        place = min(start + column, row.span.end)
        names = _floor_names(letter) if letter in floors else (letter,)
        yield LevelCell(names, source.span_between(place, min(place + 1, row.span.end)))


def _floor_names(letter: str) -> tuple[str, ...]:
    """Return the names of an empty floor cell; a blank comes last, because trailing blanks cannot be seen in a text."""
    first = () if letter == BLANK_LETTER else (letter,)
    return (*first, *(one for one in FLOOR_LETTERS[1:] if one != letter), BLANK_LETTER)


def _des_levels(source: Source) -> Iterator[_LevelLines]:
    """Yield the lines and things of each level in a des-file; raise LoadError for lines that are not understood."""
    title, inside, levels, problems = "", cast("_LevelLine | None", None), list[_LevelLines](), list[Diagnostic]()
    for line in _lines(source):
        word = line.text.strip()
        span = source.span_between(line.span.end - len(word), line.span.end)
        if inside and word != "ENDMAP":
            levels[-1][1].append(line)
        elif word == ("ENDMAP" if inside else "MAP"):
            inside = None if inside else line
            levels += [(title, [], {})] if inside else []
        elif named := _DES_TITLE.match(word):
            title = named.group(1)
        elif thing := _DES_THING.fullmatch(word):
            problems += _put_thing(thing, span, levels)
        elif word and not _DES_SETTING.match(word):
            hint = "remove it, give it a fixed place as in `STAIR:(2,3),down`, or write its letter into the map"
            problems.append(Diagnostic("unknown-line", "this line is not understood", span, hint))
    if inside:
        problems.append(Diagnostic("unclosed", "this map is never closed", inside.span, "write `ENDMAP` behind it"))
    if problems:
        raise LoadError(problems[:MAX_ERRORS])
    yield from (level for level in levels if level[1])


def _put_thing(thing: re.Match[str], span: Span, levels: Sequence[_LevelLines]) -> Iterator[Diagnostic]:
    """Put a thing of a des-file on its cell of the last map; yield a problem if it is not free."""
    word, before, column, row, behind = thing.groups()
    _, rows, things = levels[-1] if levels else ("", [], {})
    place = int(column), int(row)
    if place[1] >= len(rows) or place[0] >= max(len(one.text) for one in rows):
        yield Diagnostic("bad-place", f"column {column}, row {row} is not in a map before this line", span)
    elif place in things:
        note = Note("the first thing is here", things[place].span)
        yield Diagnostic("bad-place", "a cell can have one thing", span, "remove one of the lines", notes=(note,))
    said = (pattern.findall(before + behind) for pattern in _DES_NAMES)
    things[place] = LevelCell(tuple(next(filter(None, said), [word])), span)


_FLIPPED = 0xF000_0000
"""Bits of a tile number that encode how the tile is flipped or rotated."""
_NUMBER = re.compile(r"[^\s,]+")
_CSV_HINT = (
    "choose `Tile Layer Format: CSV`, or Base64 without compression or with zlib or gzip, in the map's properties"
)


@dataclass(frozen=True, slots=True)
class _TileLayer:
    """A layer of a Tiled map: the tile numbers row by row with their spans; 0 means no tile."""

    span: Span
    tiles: Sequence[tuple[str, Span]]


@dataclass(frozen=True, slots=True)
class _TiledMap:
    width: int
    height: int
    span: Span
    layers: Sequence[_TileLayer]
    classes: Mapping[int, str]


def read_tiled(source: Source) -> Level:
    """Return the level of a Tiled map; the last layer with a tile counts, and a cell without tiles is blank.

    Raises:
        LoadError: the file is not a map, or has unsupported data.
    """
    found = _xml_map(source) if suffix_of(source.name) == "tmx" else _json_map(source)
    cells = [LevelCell((BLANK_LETTER,), found.span)] * (found.width * found.height)
    problems: list[Diagnostic] = []
    for layer in found.layers:
        if len(layer.tiles) != len(cells):
            message = f"the layer has {len(layer.tiles)} tiles, not {found.width} x {found.height}"
            problems.append(
                Diagnostic("bad-map", message, layer.span, "give the layer the width and height of the map")
            )
            continue
        for place, (text, where) in enumerate(layer.tiles):
            number = parse_int(text)
            if number is None or number < 0:
                problems.append(Diagnostic("bad-map", f"`{text}` is not a tile number", where))
            elif number := number & ~_FLIPPED:
                names = (found.classes.get(number), str(number))
                cells[place] = LevelCell(tuple(name for name in names if name), where)
    if not found.layers:
        problems.append(Diagnostic("no-level", "the map has no tile layer", found.span))
    if problems:
        raise LoadError(problems[:MAX_ERRORS])
    rows = (tuple(cells[at : at + found.width]) for at in range(0, len(cells), found.width))
    return Level("", found.span, tuple(rows))


def _parse_size(width: object, height: object, where: Span) -> tuple[int, int]:
    columns, rows = parse_int(str(width)) or 0, parse_int(str(height)) or 0
    if columns <= 0 or rows <= 0:
        raise LoadError.from_problem("bad-map", "this is not a map of Tiled: it has no `width` and `height`", where)
    if columns * rows > scaled_limit("cells"):
        message = f"the map has more than {scaled_limit('cells'):,} cells"
        raise LoadError.from_problem("bad-map", message, where, RAISE_LIMIT_HINT)
    return columns, rows


def _xml_map(source: Source) -> _TiledMap:
    places = XmlPositions(source)
    root, problem = read_tree(places)
    if root is None or problem:
        raise LoadError([problem] if problem else [])
    where = places.tag_span(root.byte)
    size = root.attributes
    if root.tag != "map":
        raise LoadError.from_problem(
            "bad-map", f"`<{root.tag}>` is not a map of Tiled", where, "give a file with a tag `<map>`"
        )
    if size.get("infinite") == "1":
        raise LoadError.from_problem(
            "bad-map",
            "infinite maps are not supported",
            where,
            "uncheck `Infinite` in the properties of the map",
        )
    width, height = _parse_size(size.get("width"), size.get("height"), where)
    layers = tuple(_xml_layer(places, layer) for layer in root.children if layer.tag == "layer")
    return _TiledMap(width, height, where, layers, dict(_xml_classes(root)))


def _xml_layer(places: XmlPositions, layer: XmlElement) -> _TileLayer:
    data = next((one for one in layer.children if one.tag == "data"), None)
    where = places.tag_span((data or layer).byte)
    said = {} if data is None else data.attributes
    if said.get("encoding") not in ("csv", "base64"):
        raise LoadError.from_problem("bad-map", "the data of this layer is neither CSV nor base64", where, _CSV_HINT)
    start = places.source.text.index(">", where.end) + 1
    end = places.source.text.index("<", start)
    if said["encoding"] == "base64":
        return _TileLayer(where, _decode_tiles(places.source.text[start:end], said.get("compression"), where))
    words = _NUMBER.finditer(places.source.text, start, end)
    return _TileLayer(where, [(word.group(), places.source.span_between(*word.span())) for word in words])


def _decode_tiles(text: str, compression: object, where: Span) -> list[tuple[str, Span]]:
    """Return the tile numbers of a layer that is written in base64, as 4 bytes each, the lowest first."""
    if compression not in (None, "", "zlib", "gzip"):
        message = f"the data of this layer is compressed with `{compression}`, which is not supported"
        raise LoadError.from_problem("bad-map", message, where, _CSV_HINT)
    try:
        data = b64decode("".join(text.split()), validate=True)
        if compression:
            data = zlib.decompressobj(wbits=zlib.MAX_WBITS | 32).decompress(data, 4 * scaled_limit("cells") + 4)
        return [(str(number), where) for (number,) in struct.iter_unpack("<I", data)]
    except (ValueError, zlib.error, struct.error) as error:
        message = f"the data of this layer cannot be decoded: {error}"
        raise LoadError.from_problem("bad-map", message, where, _CSV_HINT) from error


def _xml_classes(root: XmlElement) -> Iterator[tuple[int, str]]:
    """Yield the number and class of each tile with a class; its key is `type`, or `class` in Tiled 1.9."""
    for tileset in (one for one in root.children if one.tag == "tileset"):
        for tile in (one for one in tileset.children if one.tag == "tile"):
            name = tile.attributes.get("type") or tile.attributes.get("class")
            given = tileset.attributes.get("firstgid", ""), tile.attributes.get("id", "")
            first, number = map(parse_int, given)
            if name and first is not None and number is not None:
                yield first + number, name


def _json_map(source: Source) -> _TiledMap:
    value, spans = parse_json(source)
    where = spans[()]
    if not isinstance(value, dict) or not isinstance(value.get("layers"), list):
        raise LoadError.from_problem("bad-map", "this is not a map of Tiled", where, "give a file with `layers`")
    width, height = _parse_size(value.get("width"), value.get("height"), where)
    layers = tuple(_json_layers(value["layers"], spans))
    return _TiledMap(width, height, where, layers, dict(_json_classes(value)))


def _json_layers(layers: Sequence[Any], spans: Mapping[JsonPath, Span]) -> Iterator[_TileLayer]:
    for number, layer in enumerate(layers):
        if isinstance(layer, dict) and layer.get("type") == "tilelayer":
            data, path = layer.get("data"), ("layers", number)
            if isinstance(data, str):
                yield _TileLayer(spans[path], _decode_tiles(data, layer.get("compression"), spans[path]))
                continue
            if not isinstance(data, list):
                raise LoadError.from_problem("bad-map", "the layer has no list of tiles", spans[path], _CSV_HINT)
            yield _TileLayer(spans[path], [(str(one), spans[(*path, "data", at)]) for at, one in enumerate(data)])


def _json_classes(value: Mapping[str, Any]) -> Iterator[tuple[int, str]]:
    for tileset in _dicts_in(value.get("tilesets")):
        for tile in _dicts_in(tileset.get("tiles")):
            name = tile.get("type") or tile.get("class")
            first, number = tileset.get("firstgid"), tile.get("id")
            if isinstance(name, str) and isinstance(first, int) and isinstance(number, int):
                yield first + number, name


def _dicts_in(value: object) -> list[dict[str, Any]]:
    return [one for one in value if isinstance(one, dict)] if isinstance(value, list) else []
