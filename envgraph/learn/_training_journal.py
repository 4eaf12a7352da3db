"""Store the results of an unfinished training in a file of JSON lines, to which each agent is added when it is trained.

The first line describes the training. If the process is killed, only the line that was being written is lost.
"""

from __future__ import annotations

import json
import os
from collections.abc import Iterator, Mapping
from dataclasses import asdict, fields
from hashlib import sha256
from pathlib import Path
from typing import Any, Self

import numpy as np

from envgraph.env import Tabular
from envgraph.errors import InvalidArgument, exact_key
from envgraph.files import open_input, replace_file
from envgraph.learn._results import RunResult, make_result
from envgraph.solve.learning import Curve, InProgram

FORMAT = "envgraph-training-2"


class TrainingJournal:
    """The trained agents of an unfinished training, in memory and in a file.

    Invariant: the file has the data of `about` and `results_of`, in whole lines.

    Attributes:
        path: the path of the file.
        about: the description of the training that `create` was given.
    """

    def __init__(self, path: Path, about: Mapping[str, Any]) -> None:
        self.path = path
        self.about = about
        self._found: dict[tuple[str, str], list[RunResult]] = {}

    @classmethod
    def create(cls, path: Path, about: Mapping[str, Any]) -> Self:
        """Create or replace the file, and return its journal. `about` must be serialisable as JSON."""
        replace_file(path, json.dumps({"format": FORMAT, **about}, ensure_ascii=False) + "\n")
        return cls(path, about)

    @classmethod
    def open(cls, path: Path) -> Self:
        """Read a file, remove an incomplete last line from it, and return its journal, to continue the training.

        Raises:
            InvalidArgument: the file does not exist, or a line is not a valid result.
        """
        try:
            with open_input(path) as file:
                *lines, _ = file.read().split(b"\n")  # a line without an end was interrupted
        except OSError as error:
            raise InvalidArgument(f"{path}: {error.strerror}") from error
        journal, number = cls(path, {}), 1
        try:
            head = json.loads(lines[0])
            if head.pop("format") != FORMAT:
                raise ValueError
            journal.about = head
            for line in lines[1:]:
                number += 1
                entry = json.loads(line)
                journal._record(str(entry["part"]), str(entry["target"]), _parse_result(entry["agent"]))
        except (ValueError, LookupError, TypeError, AttributeError, ArithmeticError, RecursionError) as error:
            raise InvalidArgument(f"{path}:{number}: the line is not part of an unfinished training") from error
        with path.open("r+b") as kept:
            kept.truncate(sum(len(line) + 1 for line in lines))
        return journal

    def __len__(self) -> int:
        return sum(map(len, self._found.values()))

    def results_of(self, part: str, target: str) -> tuple[RunResult, ...]:
        """Return the results that were added for a part of the training and a target."""
        return tuple(self._found.get((part, target), ()))

    def add(self, part: str, target: str, result: RunResult) -> None:
        """Add the result of an agent, and write it to the disk at once; raise OSError if the file was removed."""
        entry = {"part": part, "target": target, "agent": asdict(result)}
        with open(os.open(self.path, os.O_WRONLY | os.O_APPEND), "ab") as file:  # fails if the file was removed
            file.write(json.dumps(entry, ensure_ascii=False).encode() + b"\n")
            file.flush()
            os.fsync(file.fileno())
        self._record(part, target, result)

    def _record(self, part: str, target: str, result: RunResult) -> None:
        self._found.setdefault((part, target), []).append(result)


def fingerprint(tabulars: Mapping[str, Tabular | InProgram], *settings: object) -> str:
    """Return a hash of all data that the results of a training depend on: environments by name, and settings."""
    found = sha256(repr(exact_key((tuple(tabulars), settings))).encode())
    for tabular in tabulars.values():
        for value in _environment_data(tabular):
            found.update(value.tobytes() if isinstance(value, np.ndarray) else repr(value).encode())
    return found.hexdigest()


def _environment_data(tabular: Tabular | InProgram) -> Iterator[Any]:
    """Yield all data of an environment that affect results."""
    if isinstance(tabular, Tabular):
        yield from (getattr(tabular, field.name) for field in fields(tabular))
        return
    program, member = tabular.program, tabular.member
    arrays = program.arrays
    yield from (program.source, program.action_names, program.observation_shape, arrays.offsets)
    yield from (each[member] for each in (arrays.tables, arrays.reals, arrays.ints, arrays.floats))


def _parse_result(data: Mapping[str, Any]) -> RunResult:
    """Return the result that `asdict` has converted to `data`.

    Raises:
        ValueError, TypeError, LookupError: the data have another form.
    """
    points = data["curve"]
    whole = {name: tuple(map(int, points[name])) for name in ("steps", "episodes", "successes")}
    curve = Curve(reward=tuple(map(float, points["reward"])), **whole)
    if any(len(column) != len(curve.reward) for column in whole.values()):
        raise ValueError("the columns of a curve have different lengths")
    return make_result(data, curve)
