"""Compute the features of the states of a level: the inputs of a student."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from envgraph.behaviour import ObserveAround, ObserveObject
from envgraph.env import KeyIndex, Tabular, key_reader
from envgraph.learn.audit._audit_settings import AuditSettings
from envgraph.match import FREE
from envgraph.metamodel import Value
from envgraph.pattern import ObjectType
from envgraph.rewrite import Engine
from envgraph.search import Domain

Feature = tuple[str, tuple[Value, ...]]
"""A name, such as that of a pattern, and the values of a row."""

_PatternView = tuple[str, str, tuple[object, ...], list[tuple[int, Callable[[int], Any]]]]
"""A pattern: its name in the settings, its qualified name, arguments that match all rows, and for each parameter that
is an object, its position and a function that returns the key of an object."""


class StateFeatures:
    """The binary features of the states of a level: the inputs of a student.

    The features of an object that the environment observes are rows of the patterns `sees`: those that begin with the
    object, in the initial model of the level, without their first value. If no pattern of `sees` is about its class,
    the object itself is the feature. Every other observed value except the first of its range is a feature. The rows
    of the patterns `knows` are features of all states of the level.

    Args:
        domain: the domain of the levels.
        engine: an engine that holds the model of a level at each call.
        keys: the indices of objects.
        settings: the settings with the patterns.

    Attributes:
        numbers: the number of each feature that has occurred.
    """

    def __init__(self, domain: Domain, engine: Engine, keys: KeyIndex, settings: AuditSettings) -> None:
        self._engine, self._keys = engine, keys
        self._sees = [self._prepare_pattern(name, 1) for name in settings.sees]
        self._knows = [self._prepare_pattern(name, 0) for name in settings.knows]
        self._components = [*_component_classes(domain, engine, keys)]
        self.numbers: dict[Feature, int] = {}

    def features_of(self, tabular: Tabular) -> list[list[int]]:
        """Return the features of each state in a table of the engine's model, as numbers; number new features."""
        values = _decode_observations(tabular)
        known = [self._feature_number(name, row) for name, rows in self._pattern_rows(self._knows) for row in rows]
        around: dict[Value, list[tuple[str, tuple[Value, ...]]]] = {}
        for name, rows in self._pattern_rows(self._sees):
            for first, *rest in rows:
                around.setdefault(first, []).append((name, tuple(rest)))
        columns = []
        for place, cls in enumerate(self._components):
            objects = self._keys.objects(self._engine.model, cls) if cls else ()
            found: dict[int, list[int]] = {}
            for value in np.unique(values[:, place]).tolist():
                if cls and self._has_pattern_about(cls):
                    node = objects[value] if value < len(objects) else None
                    facts = around.get(node, []) if node is not None else [("none", (max(value - len(objects), 0),))]
                    found[value] = [self._feature_number(f"{place}:{name}", row) for name, row in facts]
                else:
                    found[value] = [self._feature_number(f"{place}", (value,))] if value or cls else []
            columns.append([found[value] for value in values[:, place].tolist()])
        return [sum(parts, known) for parts in zip(*columns, strict=True)]

    def _feature_number(self, name: str, row: tuple[Value, ...]) -> int:
        return self.numbers.setdefault((name, row), len(self.numbers))

    def _pattern_rows(self, patterns: Sequence[_PatternView]) -> Iterator[tuple[str, list[tuple[Value, ...]]]]:
        matcher = self._engine.matcher
        for name, qualified, free, objects in patterns:
            rows = matcher.rows(qualified, free)
            yield name, [_with_object_names(row, objects) for row in rows] if objects else [*map(tuple, rows)]

    def _prepare_pattern(self, name: str, first: int) -> _PatternView:
        """Return a pattern prepared for matching; objects in its rows from position `first` on are named by keys."""
        library = self._engine.library
        qualified = (library.resolve(name) or library.get(name)).qualified_name
        types = library.parameter_types(qualified)
        objects = [
            (place, key_reader(self._engine.model, one.cls))
            for place, one in enumerate(types)
            if place >= first and isinstance(one, ObjectType)
        ]
        return name, qualified, (FREE,) * len(types), objects

    def _has_pattern_about(self, cls: str) -> bool:
        library, metamodel = self._engine.library, self._engine.model.metamodel
        for _, qualified, *_ in self._sees:
            first = library.parameter_types(qualified)[0]
            if isinstance(first, ObjectType) and (metamodel.covers(first.cls, cls) or metamodel.covers(cls, first.cls)):
                return True
        return False


def _with_object_names(row: Sequence[Value], objects: Sequence[tuple[int, Callable[[int], Any]]]) -> tuple[Value, ...]:
    named = list(row)
    for place, read in objects:
        node = row[place]
        assert type(node) is int, "an object"
        named[place] = str(read(node))
    return tuple(named)


def _component_classes(domain: Domain, engine: Engine, keys: KeyIndex) -> Iterator[str | None]:
    """Yield for each component of an observation the class of the objects that it indexes, or None."""
    behaviour = domain.behaviour
    assert behaviour is not None, "the settings were checked"
    for one in behaviour.observations:
        times = keys.size(one.each.type) if one.each and one.each.type else 1
        if isinstance(one, ObserveAround):
            times = 2 * one.width * one.height
        yield from [one.among if isinstance(one, ObserveObject) else None] * times


def _decode_observations(tabular: Tabular) -> NDArray[np.int64]:
    """Return the components of the observation of each state [states, components]."""
    return np.stack(np.unravel_index(tabular.observation, tabular.observation_shape, order="F"), axis=1)
