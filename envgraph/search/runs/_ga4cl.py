"""The JSON format ga4cl of the paper's published families, in which maps are rows of letters.

    {"environments": [{"env_id": "env_1", "desc": ["SVR", ...], "reward_schedule": [0.0, ...], "complexity": 0.5}]}

The format has a grid with a letter for each tile, five rewards and one number. Everything else about an environment
comes from the domain into which the file is read.
"""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import field

from envgraph.code import dataclass
from envgraph.env import DrawGrid
from envgraph.errors import Diagnostic, LoadError, Source, Span, name_hint
from envgraph.graph import Model
from envgraph.lang import JsonPath, parse_json

_KEY_TYPES = {
    "env_id": "a string",
    "desc": "a list of strings",
    "reward_schedule": "a list of numbers",
    "complexity": "a number",
}


@dataclass(frozen=True, slots=True)
class GridVariant:
    """An environment of a ga4cl file.

    Attributes:
        name: value of `env_id`.
        rows: value of `desc`, from the top; all rows have the same length.
        rewards: value of `reward_schedule`, or () if the file has none.
        complexity: the published complexity, or None.
        row_spans: span of each row in the file, or ().
    """

    name: str
    rows: tuple[str, ...]
    rewards: tuple[float, ...] = ()
    complexity: float | None = None
    row_spans: tuple[Span, ...] = field(default=(), compare=False, repr=False)


def format_ga4cl(variants: Sequence[GridVariant]) -> str:
    """Format environments as the text of a ga4cl file, which ends with a newline. Numbers are written without loss.

    >>> print(format_ga4cl([GridVariant("env_1", ("SG",), (0.0, 10.0), 0.5)]), end="")
    {
      "environments": [
        {
          "env_id": "env_1",
          "desc": [
            "SG"
          ],
          "reward_schedule": [0.0, 10.0],
          "complexity": 0.5
        }
      ]
    }
    """
    blocks = []
    for variant in variants:
        rows = ",\n".join(f"        {json.dumps(row, ensure_ascii=False)}" for row in variant.rows)
        parts = [f'"env_id": {json.dumps(variant.name, ensure_ascii=False)}', f'"desc": [\n{rows}\n      ]']
        if variant.rewards:
            parts.append(f'"reward_schedule": {json.dumps(list(variant.rewards))}')
        if variant.complexity is not None:
            parts.append(f'"complexity": {json.dumps(variant.complexity)}')
        blocks.append("    {\n" + ",\n".join(f"      {part}" for part in parts) + "\n    }")
    return '{\n  "environments": [\n' + ",\n".join(blocks) + "\n  ]\n}\n"


def parse_ga4cl(source: Source) -> tuple[GridVariant, ...]:
    """Parse a ga4cl file, and return its environments in file order.

    Raises:
        LoadError: the text is not JSON or not of this format; it contains all problems.
    """
    value, spans = parse_json(source)
    problems = list(_check_file(value, spans))
    if problems:
        raise LoadError(problems)
    assert isinstance(value, dict)
    return tuple(_parse_variant(entry, index, spans) for index, entry in enumerate(value["environments"]))


def _parse_variant(entry: Mapping[str, object], index: int, spans: Mapping[JsonPath, Span]) -> GridVariant:
    rows, rewards, complexity = entry["desc"], entry.get("reward_schedule", []), entry.get("complexity")
    assert isinstance(rows, list) and isinstance(rewards, list)
    assert complexity is None or isinstance(complexity, int | float)
    return GridVariant(
        name=str(entry.get("env_id", f"env_{index + 1}")),
        rows=tuple(rows),
        rewards=tuple(float(reward) for reward in rewards),
        complexity=None if complexity is None else float(complexity),
        row_spans=tuple(spans["environments", index, "desc", row] for row in range(len(rows))),
    )


def _check_file(value: object, spans: Mapping[JsonPath, Span]) -> Iterator[Diagnostic]:
    if not isinstance(value, dict) or not isinstance(value.get("environments"), list):
        hint = 'write an object with a list under "environments"'
        yield Diagnostic("bad-format", "this is not a ga4cl file", spans.get(("environments",), spans[()]), hint)
        return
    if not value["environments"]:
        yield Diagnostic(
            "bad-format",
            "the family is empty",
            spans["environments",],
            "add at least one environment",
        )
    for index, entry in enumerate(value["environments"]):
        yield from _check_entry(entry, ("environments", index), spans)


def _check_entry(entry: object, path: JsonPath, spans: Mapping[JsonPath, Span]) -> Iterator[Diagnostic]:
    if not isinstance(entry, dict):
        yield Diagnostic(
            "bad-format", "an environment must be an object", spans[path], 'write `{"desc": ["..", ".."]}`'
        )
        return
    if "desc" not in entry:
        yield Diagnostic(
            "bad-format",
            'the environment has no "desc", which contains its rows of letters',
            spans[path],
            'write `"desc": ["..", ".."]`',
        )
    for key, value in entry.items():
        here = (*path, key)
        if key not in _KEY_TYPES:
            yield Diagnostic("unknown-key", f"unknown key `{key}`", spans[here], name_hint(key, _KEY_TYPES))
        elif not _has_right_type(key, value):
            yield Diagnostic("wrong-type", f"`{key}` must be {_KEY_TYPES[key]}", spans[here])
        elif key == "desc":
            yield from _check_rows(value, here, spans)


def _has_right_type(key: str, value: object) -> bool:
    match key:
        case "env_id":
            return isinstance(value, str)
        case "desc":
            return isinstance(value, list) and bool(value) and all(isinstance(row, str) for row in value)
        case "reward_schedule":
            return isinstance(value, list) and all(type(reward) in (int, float) for reward in value)
        case _:
            return type(value) in (int, float)


def _check_rows(rows: Sequence[str], path: JsonPath, spans: Mapping[JsonPath, Span]) -> Iterator[Diagnostic]:
    width = len(rows[0])
    for number, row in enumerate(rows):
        if len(row) != width or not row:
            message = f"this row has {len(row)} letters, but the first row has {width}"
            yield Diagnostic("bad-format", message, spans[(*path, number)], "write as many letters in every row")


def grid_rows(model: Model, draw: DrawGrid) -> tuple[str, ...]:
    """Return the drawn grid of a model as rows of letters, from the top; a cell without object or glyph is a space."""
    cells = grid_cells(model, draw)
    classes = model.metamodel.classes
    letters = {
        place: glyph.letter for place, node in cells.items() if (glyph := classes[model.graph.class_of(node)].glyph)
    }
    if not cells:
        return ()
    columns = range(min(column for column, _ in cells), max(column for column, _ in cells) + 1)
    lines = range(min(row for _, row in cells), max(row for _, row in cells) + 1)
    return tuple("".join(letters.get((column, row), " ") for column in columns) for row in lines)


def grid_cells(model: Model, draw: DrawGrid) -> dict[tuple[int, int], int]:
    """Return the id of the object at each (column, row) of the drawn grid."""
    column = model.metamodel.feature(draw.cls, draw.column)
    row = model.metamodel.feature(draw.cls, draw.row)
    cells: dict[tuple[int, int], int] = {}
    for node in model.graph.extent(draw.cls):
        x, y = model.graph.value(node, column), model.graph.value(node, row)  # type: ignore[arg-type]
        if isinstance(x, int) and isinstance(y, int):
            cells[x, y] = node
    return cells


def retype_grid(model: Model, draw: DrawGrid, variant: GridVariant) -> None:
    """Retype every cell of the grid to the class whose glyph is at its place in the rows of a variant.

    Raises:
        LoadError: the size differs, or a letter is not the glyph of a concrete cell class; it contains all problems.
    """
    cells = grid_cells(model, draw)
    mm = model.metamodel
    by_letter = {glyph.letter: name for name in mm.concrete_classes(draw.cls) if (glyph := mm.classes[name].glyph)}
    problems = list(_check_grid(variant, cells, by_letter))
    if problems:
        raise LoadError(problems)
    left, top = min(column for column, _ in cells), min(row for _, row in cells)
    for (column, row), node in cells.items():
        wanted = by_letter[variant.rows[row - top][column - left]]
        if model.graph.class_of(node) != wanted:
            model.graph.retype(node, wanted)


def _check_grid(
    variant: GridVariant, cells: Mapping[tuple[int, int], int], by_letter: Mapping[str, str]
) -> Iterator[Diagnostic]:
    spans = variant.row_spans or (None,) * len(variant.rows)
    width, height = (len({place[axis] for place in cells}) for axis in (0, 1))
    if (len(variant.rows[0]), len(variant.rows)) != (width, height):
        size = f"{len(variant.rows[0])} x {len(variant.rows)}"
        message = f"the size of `{variant.name}` is {size}, but that of the domain's model is {width} x {height}"
        yield Diagnostic(
            "bad-format", message, spans[0], "name a domain whose model has this size: `--domain DIRECTORY`"
        )
        return
    for row, span in zip(variant.rows, spans, strict=True):
        for place, letter in enumerate(row):
            if letter not in by_letter:
                at = span and span.source.span_between(span.start + 1 + place, span.start + 2 + place)
                hint = "use one of the letters " + ", ".join(f"`{known}` {name}" for known, name in by_letter.items())
                yield Diagnostic("unknown-glyph", f"no cell class has the glyph `{letter}`", at, hint)
