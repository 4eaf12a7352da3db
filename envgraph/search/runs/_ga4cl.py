"""The JSON format ga4cl of the paper's published families, in which maps are rows of letters.

    {"environments": [{"env_id": "env_1", "desc": ["SVR", ...], "reward_schedule": [0.0, ...], "complexity": 0.5}]}

The format has a grid with a letter for each tile, five rewards and one number. Everything else about an environment
comes from the domain into which the file is read.
"""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import field
from typing import Any

from envgraph.code import dataclass
from envgraph.env import GridScene
from envgraph.errors import Diagnostic, LoadError, Source, Span
from envgraph.lang import JsonPath, check_json, parse_json

_ENTRY = {
    "type": "object",
    "required": ["desc"],
    "additionalProperties": False,
    "properties": {
        "env_id": {"type": "string"},
        "desc": {"type": "array", "minItems": 1, "items": {"type": "string"}},
        "reward_schedule": {"type": "array", "items": {"type": "number"}},
        "complexity": {"type": "number"},
    },
}
_LIST = {"type": "array", "minItems": 1, "items": _ENTRY}
_SCHEMA = {"type": "object", "required": ["environments"], "properties": {"environments": _LIST}}


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
    problems = [*check_json(value, spans, _SCHEMA), *_check_rows(value, spans)]
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


def _check_rows(value: Any, spans: Mapping[JsonPath, Span]) -> Iterator[Diagnostic]:
    """Yield an error for each row whose length differs from that of the first row; ignore values of wrong types."""
    entries = value.get("environments") if isinstance(value, dict) else None
    for index, entry in enumerate(entries if isinstance(entries, list) else ()):
        rows = entry.get("desc") if isinstance(entry, dict) else None
        lengths = [len(row) if isinstance(row, str) else 0 for row in rows] if isinstance(rows, list) else []
        for number, length in enumerate(lengths):
            if length != lengths[0] or not length:
                message = f"this row has {length} letters, but the first row has {lengths[0]}"
                place = spans["environments", index, "desc", number]
                yield Diagnostic("bad-format", message, place, "write as many letters in every row")


def grid_rows(scene: GridScene) -> tuple[str, ...]:
    """Return a grid as rows of letters, from the top; a place without a cell is a space."""
    letters = [scene.glyphs[kind].letter if kind < len(scene.glyphs) else " " for kind in scene.cells]
    starts = range(0, len(letters), scene.width)
    return tuple("".join(letters[start : start + scene.width]) for start in starts)
