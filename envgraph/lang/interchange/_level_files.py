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
from envgraph.lang.syntax._xml_parser import XmlPositions, read_tree

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
    """A level with its title ("" if none), the span of its first row, and its rows, top first and equally long.

    `picture` has the spans of all lines if the level is a picture as `envgraph.env.scene_text` draws it; otherwise ().
    """

    title: str
    span: Span
    rows: tuple[tuple[LevelCell, ...], ...]
    picture: tuple[Span, ...] = ()


FLOOR_LETTERS = (BLANK_LETTER, "_", "-")
"""Letters for an empty floor in files of Sokoban. If a legend has only some of them, the others mean the same."""
_XSB = frozenset("#@$.")
"""Letters of Sokoban; a domain that has them reads floors so in `.txt` files, too."""

_BEFORE = re.compile(r"\s*;\s*(.*)")
_BEHIND = re.compile(r"\s*title\s*:\s*(.*)", re.IGNORECASE)
_PICTURE_ROW = re.compile(r"(?: \S |\(\S\)|   )*(?: \S|\(\S\))")
_PICTURE_MARK = re.compile(r".+: (?:column [0-9]{1,6}, row [0-9]{1,6}|nowhere)")
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
    their characters in `letters`. Its title is `; name` before it, or `Title: name` behind it. If a `.txt` file has
    pictures of grids, only these are read.

    Raises:
        LoadError: the file has no level, the map cannot be read, a line of a des-file is not understood, or a line
            adjacent to a row is probably a mistyped row. All problems are reported.
    """
    suffix = suffix_of(source.name)
    if suffix in ("tmx", "tmj", "json"):
        return (read_tiled(source),)
    found, cells, pictures = list[Level](), 0, _pictures(source) if suffix == "txt" else []
    floors = FLOOR_LETTERS if suffix in ("xsb", "sok") or (suffix == "txt" and {*letters} >= _XSB) else ()
    texts = pictures or (_des_levels(source) if suffix == "des" else _text_levels(source, letters, floors))
    for title, rows, things, marks in texts:
        step = 3 if pictures else 1
        width = -(-max(len(row.text) for row in rows) // step)
        cells += width * len(rows)
        if len(found) == scaled_limit("levels") or cells > scaled_limit("cells"):
            most = f"{scaled_limit('levels'):,} levels and {scaled_limit('cells'):,} cells"
            message = f"up to this level the file has {len(found) + 1:,} levels and {cells:,} cells"
            message += f", but at most {most} are read"
            raise LoadError.from_problem(
                "too-many-cells", message, rows[0].span, f"divide the file; {RAISE_LIMIT_HINT}"
            )
        numbered = (enumerate(_row_cells(row, width, step, floors)) for row in rows)
        level = tuple(tuple(things.get((x, y), cell) for x, cell in row) for y, row in enumerate(numbered))
        picture = tuple(line.span for line in (*rows, *marks)) if pictures else ()
        found.append(Level(title, rows[0].span, level, picture))
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


_LevelLines = tuple[str, list[_LevelLine], dict[tuple[int, int], LevelCell], list[_LevelLine]]
"""The title and the rows of a level, the cells with things on them by column and row, and lines below the rows."""


def _text_levels(source: Source, letters: Collection[str], floors: Collection[str]) -> Iterator[_LevelLines]:
    """Yield the lines of each level in a text of letters; raise LoadError for mistyped rows."""
    known = {*letters, *floors, BLANK_LETTER}
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
                yield *level, {}, []
            level, rows, title = (title, rows), [], ""
        if before := _BEFORE.fullmatch(line.text):
            title = before.group(1)
        elif behind := _BEHIND.fullmatch(line.text):
            level = behind.group(1), level[1]
    if level[1]:
        yield *level, {}, []


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


def _row_cells(row: _LevelLine, width: int, step: int, floors: Collection[str]) -> Iterator[LevelCell]:
    """Yield the cells of a row, padded with blank cells to the given width; each has `step` characters."""
    source, start, end = row.span.source, row.span.start, row.span.end
    text = row.text.ljust(step * width)
    for place in range(0, step * width, step):
        letter = text[place + step // 2]
        names = _floor_names(letter) if letter in floors else (letter,)
        yield LevelCell(names, source.span_between(min(start + place, end), min(start + place + step, end)))


def _floor_names(letter: str) -> tuple[str, ...]:
    """Return the names of an empty floor cell; a blank comes last, because trailing blanks cannot be seen in a text."""
    first = () if letter == BLANK_LETTER else (letter,)
    return (*first, *(one for one in FLOOR_LETTERS[1:] if one != letter), BLANK_LETTER)


def _pictures(source: Source) -> list[_LevelLines]:
    """Return the lines of each picture: its rows, and below them lines about its marks. One title may be above."""
    found, problems = list[_LevelLines](), list[Diagnostic]()
    for _, block in groupby(_lines(source), key=lambda line: bool(line.text)):
        lines = list(block)
        are_rows = (_PICTURE_ROW.fullmatch(line.text) for line in lines)
        are_marks = (_PICTURE_MARK.fullmatch(line.text) for line in lines)
        kinds = "".join("r" if row else "m" if mark else "?" for row, mark in zip(are_rows, are_marks, strict=True))
        first = kinds.find("r")
        if re.fullmatch(r"\??r+m*", kinds):
            end = kinds.rindex("r") + 1
            found.append(("".join(line.text.strip("; ") for line in lines[:first]), lines[first:end], {}, lines[end:]))
        elif first >= 0:
            wrong = lines[max(0, kinds.find("?", 1))].span
            problems.append(Diagnostic("unknown-row", "this line is not part of the picture around it", wrong))
    if found and problems:
        raise LoadError(problems[:MAX_ERRORS])
    return found


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
            levels += [(title, [], {}, [])] if inside else []
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
    """Put a thing of a des-file on its cell of the last map; yield a problem if it is not in the map, or not free."""
    word, before, column, row, behind = thing.groups()
    _, rows, things, _ = levels[-1] if levels else ("", [], {}, [])
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
_CSV_HINT = "choose CSV, or Base64 that is not compressed with Zstandard, as the `Tile Layer Format` of the map"


def read_tiled(source: Source) -> Level:
    """Return the level of a Tiled map; the last layer with a tile counts, and a cell without tiles is blank.

    Raises:
        LoadError: the file is not a map, or has unsupported data.
    """
    value, spans = _xml_map(source) if suffix_of(source.name) == "tmx" else parse_json(source)
    where = spans[()]
    if not isinstance(value, dict) or not isinstance(value.get("layers"), list):
        raise LoadError.from_problem("bad-map", "this is not a map of Tiled", where, "give a file with layers")
    if value.get("infinite") in ("1", True):
        hint = "uncheck `Infinite` in the properties of the map"
        raise LoadError.from_problem("bad-map", "infinite maps are not supported", where, hint)
    width, height = _parse_size(value.get("width"), value.get("height"), where)
    cells, classes = [LevelCell((BLANK_LETTER,), where)] * (width * height), dict(_tile_classes(value))
    problems, layers = list[Diagnostic](), 0
    for place, layer in enumerate(value["layers"]):
        if not isinstance(layer, dict) or layer.get("type") != "tilelayer":
            continue
        layers += 1
        tiles = _layer_tiles(layer, ("layers", place), spans)
        if len(tiles) != len(cells):
            message = f"the layer has {len(tiles)} tiles, not {width} x {height}"
            hint = "give the layer the width and height of the map"
            problems.append(Diagnostic("bad-map", message, spans["layers", place], hint))
            continue
        for at, (text, span) in enumerate(tiles):
            number = parse_int(text)
            if number is None or number < 0:
                problems.append(Diagnostic("bad-map", f"`{text}` is not a tile number", span))
            elif number := number & ~_FLIPPED:
                names = (classes.get(number), str(number))
                cells[at] = LevelCell(tuple(name for name in names if name), span)
    if not layers:
        problems.append(Diagnostic("no-level", "the map has no tile layer", where))
    if problems:
        raise LoadError(problems[:MAX_ERRORS])
    return Level("", where, tuple(tuple(cells[at : at + width]) for at in range(0, len(cells), width)))


def _parse_size(width: object, height: object, where: Span) -> tuple[int, int]:
    columns, rows = parse_int(str(width)) or 0, parse_int(str(height)) or 0
    if columns <= 0 or rows <= 0:
        raise LoadError.from_problem("bad-map", "this is not a map of Tiled: it has no `width` and `height`", where)
    if columns * rows > scaled_limit("cells"):
        message = f"the map has more than {scaled_limit('cells'):,} cells"
        raise LoadError.from_problem("bad-map", message, where, RAISE_LIMIT_HINT)
    return columns, rows


def _xml_map(source: Source) -> tuple[object, Mapping[JsonPath, Span]]:
    """Return the map of a `.tmx` file as a `.tmj` file has it, and the spans of the map, its layers and their tiles."""
    places = XmlPositions(source)
    root, problem = read_tree(places)
    if root is None or problem:
        raise LoadError([problem] if problem else [])
    spans: dict[JsonPath, Span] = {(): places.tag_span(root.byte)}
    if root.tag != "map":
        return None, spans
    layers = list[dict[str, object]]()
    for number, layer in enumerate(one for one in root.children if one.tag == "layer"):
        tag = next((one for one in layer.children if one.tag == "data"), layer)
        where = spans["layers", number] = places.tag_span(tag.byte)
        start, data = source.text.index(">", where.end) + 1, cast(object, None)
        end = source.text.find("<", start)
        if tag.get("encoding") == "csv":
            words = list(_NUMBER.finditer(source.text, start, end))
            spans |= {("layers", number, "data", n): source.span_between(*word.span()) for n, word in enumerate(words)}
            data = [word.group() for word in words]
        elif tag.get("encoding") == "base64":
            data = source.text[start:end]
        layers.append({"type": "tilelayer", "data": data, "compression": tag.get("compression")})
    sets = [
        {**one.attributes, "tiles": [{**tile.attributes} for tile in one.children if tile.tag == "tile"]}
        for one in root.children
        if one.tag == "tileset"
    ]
    return {**root.attributes, "layers": layers, "tilesets": sets}, spans


def _layer_tiles(
    layer: Mapping[str, Any], path: JsonPath, spans: Mapping[JsonPath, Span]
) -> Sequence[tuple[str, Span]]:
    """Return the tile numbers of a layer with their spans: a list, or base64 of 4 bytes each, the lowest first."""
    data, compression, where = layer.get("data"), layer.get("compression"), spans[path]
    if isinstance(data, list):
        return [(str(one), spans[(*path, "data", at)]) for at, one in enumerate(data)]
    message = "the data of this layer is neither CSV nor base64"
    if isinstance(data, str) and compression not in (None, "", "zlib", "gzip"):
        message = f"the data of this layer is compressed with `{compression}`, which is not supported"
    elif isinstance(data, str):
        try:
            found = b64decode("".join(data.split()), validate=True)
            if compression:
                found = zlib.decompressobj(zlib.MAX_WBITS | 32).decompress(found, 4 * scaled_limit("cells") + 4)
            return [(str(number), where) for (number,) in struct.iter_unpack("<I", found)]
        except (ValueError, zlib.error, struct.error) as error:
            message = f"the data of this layer cannot be decoded: {error}"
    raise LoadError.from_problem("bad-map", message, where, _CSV_HINT)


def _tile_classes(value: Mapping[str, Any]) -> Iterator[tuple[int, str]]:
    """Yield the number and class of each tile with a class; its key is `type`, or `class` in Tiled 1.9."""
    for tileset in _dicts_in(value.get("tilesets")):
        for tile in _dicts_in(tileset.get("tiles")):
            name = tile.get("type") or tile.get("class")
            first, number = (parse_int(str(one)) for one in (tileset.get("firstgid"), tile.get("id")))
            if isinstance(name, str) and first is not None and number is not None:
                yield first + number, name


def _dicts_in(value: object) -> list[dict[str, Any]]:
    return [one for one in value if isinstance(one, dict)] if isinstance(value, list) else []
