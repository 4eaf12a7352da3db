"""Write models as JSON and read them with ids and every order restored. Reading reports all problems at once."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping
from contextlib import suppress
from typing import Any

from envgraph.errors import MAX_ERRORS, Diagnostic, EnvgraphError, LoadError, RuleError, Source, name_hint
from envgraph.graph.model._model import Model
from envgraph.graph.store._relation import AdjacencyColumn, ReferenceStorage
from envgraph.graph.write._write_errors import wrong_value_error
from envgraph.metamodel import (
    LARGEST_INT,
    Attribute,
    EnumType,
    Feature,
    Metamodel,
    Reference,
    Scalar,
    Value,
    accepts,
)

FORMAT = "envgraph-model-1"

JsonPath = tuple[str | int, ...]
"""The keys and indices on the way from the root of JSON data to a value."""

_INFINITIES = {"inf": float("inf"), "-inf": float("-inf")}


def model_to_json(model: Model) -> dict[str, Any]:
    """Return the current state as data for `json.dump`. Equal states give equal data.

    For example::

        {
          "format": "envgraph-model-1",
          "name": "running_4x4",
          "metamodel": "burning_forest",
          "next_id": 18,
          "objects": [
            {"id": 0, "class": "Forest", "name": "forest", "features": {"states": [1, 2], "agent": 17}},
            {"id": 1, "class": "StartTile", "features": {"x": 0, "y": 0, "right": 2}}
          ]
        }

    Objects are in the order of the extents. `features` has every attribute: its value, null if unset, or a list if
    multi-valued. It also has every reference with links: an id, or a list of ids for a many-reference. Of two opposite
    references only the one declared first is written. Infinite floats are "inf" and "-inf". If reading would give
    another order of the links that lead to an object, a list "orders" follows with entries such as {"node": 2,
    "reference": "Agent.currentState", "sources": [5, 3]}.
    """
    store = model.graph.store
    data: dict[str, Any] = {
        "format": FORMAT,
        "name": model.name,
        "metamodel": model.metamodel.name,
        "next_id": store.next_id,
        "objects": [_object_to_json(model, node) for node in store.nodes()],
    }
    orders = [order for relation in store.relations for order in _source_orders(model, relation)]
    if orders:
        data["orders"] = orders
    return data


def model_schema() -> dict[str, Any]:
    """Return the JSON Schema (2020-12) of the format, from the file `model.schema.json` in this package.

    The schema does not include the classes and features of a metamodel.
    """
    from importlib.resources import files  # its import takes as long as reading a small model

    text = files("envgraph.graph.interchange").joinpath("model.schema.json").read_text("utf-8")
    schema: dict[str, Any] = json.loads(text)
    return schema


def _object_to_json(model: Model, node: int) -> dict[str, Any]:
    entry: dict[str, Any] = {"id": node, "class": model.graph.class_of(node)}
    name = model.graph.object_name(node)
    if name is not None:
        entry["name"] = name
    features: dict[str, Any] = {}
    for feature in model.metamodel.features(entry["class"]).values():
        if feature in model.graph.defined_features:
            continue
        if isinstance(feature, Attribute):
            values = [str(v) if v in _INFINITIES.values() else v for v in model.graph.values(node, feature)]
            features[feature.name] = values if feature.many else values[0] if values else None
        elif not model.graph.store.relations[feature.index].is_flipped:
            targets = list(model.graph.targets(node, feature))
            if targets:
                features[feature.name] = targets if feature.many else targets[0]
    entry["features"] = features
    return entry


def _source_orders(model: Model, relation: ReferenceStorage) -> Iterator[dict[str, Any]]:
    """Yield "orders" entries for the nodes whose sources would be in another order after reading the objects."""
    if relation.is_flipped:
        return
    read: dict[int, list[int]] = {}
    for node in model.graph.store.nodes():
        for target in relation.forward[node]:
            if relation.is_symmetric:
                first = read.setdefault(node, [])
                if target in first:
                    continue
                first.append(target)
            if not (relation.is_symmetric and target == node):
                read.setdefault(target, []).append(node)
    for node in model.graph.store.nodes():
        sources = list(relation.backward[node])
        if sources != read.get(node, []):
            yield {"node": node, "reference": str(relation.reference), "sources": sources}


def model_from_json(data: str | Mapping[str, Any], metamodel: Metamodel, *, file: str = "<json>") -> Model:
    """Read a model from JSON in the form that `model_to_json` returns. "name", "next_id" and "orders" are optional.

    Args:
        data: the decoded JSON, or its text.
        metamodel: the metamodel of the objects. If the data name a metamodel, it must have the same name.
        file: the name of the file in diagnostics.

    Raises:
        LoadError: the data are malformed or violate the metamodel. Messages start with the place in the data, such as
            `objects[3].features.x`.
    """
    decoded = _decode(data, file) if isinstance(data, str) else data
    reader = _JsonModelReader(metamodel)
    with suppress(_TooManyProblems):
        reader.read(decoded)
    if reader.problems:
        raise LoadError(reader.problems)
    return reader.model


def _decode(text: str, file: str) -> Any:
    try:
        return json.loads(text)
    except json.JSONDecodeError as error:
        span = Source(file, text).span_between(error.pos, error.pos + 1)
        problem = Diagnostic("syntax", error.msg[:1].lower() + error.msg[1:], span, "write the file as valid JSON")
    except (RecursionError, ValueError) as error:
        problem = Diagnostic("syntax", f"`{file}` cannot be read as JSON: {error}")
    raise LoadError([problem])


_ID_HINT = 'write the id of an object in "objects"'
_VALUE_HINTS: Mapping[Scalar | EnumType, str] = {
    Scalar.INT: "write a whole number",
    Scalar.FLOAT: "write a number",
    Scalar.BOOL: "write `true` or `false`",
    Scalar.STRING: 'write a text, `"..."`',
}


class _TooManyProblems(Exception):
    """Raised to stop the reading after the maximal number of problems."""


def json_place(path: JsonPath) -> str:
    """Return the text for a place in JSON data, for messages.

    >>> json_place(("objects", 3, "features", "name"))
    'objects[3].features.name'
    """
    return "".join(f"[{step}]" if isinstance(step, int) else f".{step}" for step in path).removeprefix(".")


class _JsonModelReader:
    """A reader of one model from JSON. It collects problems in `problems` and continues after most of them."""

    def __init__(self, metamodel: Metamodel) -> None:
        self.metamodel = metamodel
        self.model = Model(metamodel)
        self.problems: list[Diagnostic] = []
        self._max_id = 0

    def read(self, data: Any) -> None:
        if not self._check_mapping((), data, ("format", "name", "metamodel", "next_id", "objects", "orders")):
            return
        if data.get("format") != FORMAT:
            self._report(
                ("format",),
                "bad-format",
                f"expected {FORMAT!r}, not {data.get('format')!r}",
                f'begin the file with `"format": "{FORMAT}"`',
            )
            return
        if data.get("metamodel", self.metamodel.name) != self.metamodel.name:
            text = f"the model is of metamodel {data['metamodel']!r}, not of {self.metamodel.name!r}"
            hint = "read it with the metamodel that it was written with"
            self._report(("metamodel",), "other-metamodel", text, hint)
            return
        name = data.get("name", "model")
        if isinstance(name, str):
            self.model.name = name
        else:
            self._report(("name",), "wrong-type", f"expected a text, not {name!r}", 'write `"name": "..."`')
        objects = data.get("objects")
        if not isinstance(objects, list):
            self._report(("objects",), "wrong-type", "expected a list of objects", 'write `"objects": [ .. ]`')
            return
        self._max_id = 1_000_000 + 1_000 * len(objects)
        with self.model.loading():
            self._read_objects(objects)
            self._read_next_id(data.get("next_id", self.model.graph.store.next_id))
            self._read_orders(data.get("orders", []))

    def _read_objects(self, objects: list[Any]) -> None:
        features: list[tuple[JsonPath, int, Mapping[str, Any]]] = []
        for index, entry in enumerate(objects):
            path: JsonPath = ("objects", index)
            node = self._read_object(path, entry)
            if node is not None and self._check_mapping((*path, "features"), entry.get("features", {})):
                features.append(((*path, "features"), node, entry.get("features", {})))
        for path, node, values in features:
            for name, value in values.items():
                self._read_feature((*path, name), node, name, value)

    def _read_object(self, path: JsonPath, entry: Any) -> int | None:
        if not self._check_mapping(path, entry, ("id", "class", "name", "features")):
            return None
        node, cls, name = entry.get("id"), entry.get("class"), entry.get("name")
        model = self.model
        if not self._check_id((*path, "id"), node):
            return None
        if model.graph.alive(node):
            message = f"two objects have the id {node}"
            self._report((*path, "id"), "duplicate-definition", message, "give each object a different id")
        elif not isinstance(cls, str):
            message = f"expected the name of a class, not {cls!r}"
            self._report((*path, "class"), "wrong-type", message, 'write `"class": "..."`')
        elif name is not None and not isinstance(name, str):
            message = f"expected a text, not {name!r}"
            self._report((*path, "name"), "wrong-type", message, 'write `"name": "..."`, or leave it out')
        elif name is not None and name in model:
            message = f"another object has the name `{name}` too"
            self._report((*path, "name"), "duplicate-definition", message, "choose another name, or leave it out")
        else:
            try:
                return model.graph.new_at(node, cls, name)
            except EnvgraphError as error:
                known = [one for one, found in self.metamodel.classes.items() if not found.abstract]
                hint = error.hint or name_hint(cls, known)
                self._report((*path, "class"), "unknown-class", error.message, hint)
        return None

    def _read_feature(self, path: JsonPath, node: int, name: str, value: Any) -> None:
        cls = self.model.graph.class_of(node)
        feature: Feature | None = self.metamodel.feature(cls, name)
        if feature is None:
            hint = name_hint(name, self.metamodel.features(cls))
            self._report(path, "unknown-feature", f"`{cls}` has no feature `{name}`", hint)
        elif isinstance(feature, Attribute):
            self._read_value(path, node, feature, value)
        elif isinstance(value, list):
            for index, target in enumerate(value):
                self._read_link((*path, index), node, feature, target)
        elif value is not None:
            self._read_link(path, node, feature, value)

    def _read_value(self, path: JsonPath, node: int, attribute: Attribute, value: Any) -> None:
        if attribute.many and isinstance(value, list):
            found = [self._checked_value((*path, i), attribute, one) for i, one in enumerate(value)]
        else:
            found = [] if value is None else [self._checked_value(path, attribute, value)]
        values = [one for one in found if one is not None]
        if len(values) < len(found):
            return  # the wrong values have been reported
        try:
            self.model.graph.set_value(node, attribute, values if attribute.many else values[0] if values else None)
        except EnvgraphError as error:
            self._report(path, "wrong-value", error.message, error.hint or "leave some of the values out")

    def _checked_value(self, path: JsonPath, attribute: Attribute, value: Any) -> Value | None:
        """Return a value as the model takes it. If it has the wrong type, report this and return None."""
        if attribute.type is Scalar.FLOAT and isinstance(value, str):
            value = _INFINITIES.get(value, value)
        if accepts(attribute.type, value):
            return value  # type: ignore[no-any-return]
        if attribute.type is Scalar.INT and type(value) is int:
            hint = f"write an int from {-LARGEST_INT - 1} to {LARGEST_INT}"
            self._report(path, "wrong-type", f"`{attribute}` takes an int of 64 bits", hint)
        else:
            wrong = wrong_value_error(attribute, value)
            hint = wrong.hint or _VALUE_HINTS.get(attribute.type, "write a literal of the enum as a text")
            self._report(path, "wrong-type", wrong.message, hint)
        return None

    def _read_link(self, path: JsonPath, source: int, reference: Reference, target: Any) -> None:
        model = self.model
        if type(target) is not int or not model.graph.alive(target):
            self._report(path, "unknown-object", f"there is no object {target!r}", _ID_HINT)
            return
        if model.graph.has_link(source, reference, target):  # the opposite reference lists the link too
            return
        relation = model.graph.store.relations[reference.index]
        child = target if relation.containment else source if relation.is_contained else None
        if child is not None and model.graph.container(child) is not None:
            message = f"{model.graph.describe(child)} is in another container already"
            self._report(
                path,
                "containment",
                message,
                "leave out one of the links: an object has at most one container",
            )
            return
        try:
            model.graph.link(source, reference, target)
        except EnvgraphError as error:
            hint = (
                "leave one of the links out"
                if isinstance(error, RuleError)
                else f"link an object of class `{reference.target}`"
            )
            self._report(path, "wrong-link", error.message, hint)

    def _read_next_id(self, next_id: Any) -> None:
        if not self._check_id(("next_id",), next_id):
            return
        if next_id < self.model.graph.store.next_id:
            message = f"{next_id} is not greater than all ids of objects"
            hint = f"write {self.model.graph.store.next_id} or more, or leave it out"
            self._report(("next_id",), "bad-id", message, hint)
            return
        self.model.graph.store.reserve_ids(next_id)
        self.model.graph.store.next_id = next_id

    def _read_orders(self, orders: Any) -> None:
        if not isinstance(orders, list):
            self._report(("orders",), "wrong-type", "expected a list", "write `[ .. ]`, or leave it out")
            return
        names = {str(reference): reference for reference in self.metamodel.references}
        for index, entry in enumerate(orders):
            path = ("orders", index)
            if not self._check_mapping(path, entry, ("node", "reference", "sources")):
                continue
            node, sources, reference = entry.get("node"), entry.get("sources"), entry.get("reference")
            if not isinstance(reference, str) or reference not in names:
                hint = name_hint(str(reference), names)
                message = f"unknown reference {reference!r}"
                self._report((*path, "reference"), "unknown-reference", message, hint)
            elif type(node) is not int or not self.model.graph.alive(node):
                self._report((*path, "node"), "unknown-object", f"there is no object {node!r}", _ID_HINT)
            else:
                self._reorder(
                    (*path, "sources"), self.model.graph.store.backward[names[reference].index], node, sources
                )

    def _reorder(self, path: JsonPath, column: AdjacencyColumn, node: int, sources: Any) -> None:
        same = isinstance(sources, list) and all(type(source) is int for source in sources)
        if not same or sorted(sources) != sorted(column[node]):
            message = f"expected the ids {sorted(column[node])} in some order"
            self._report(path, "bad-order", message, "list each object with a link of this reference to the node, once")
            return
        column[node] = self.model.graph.store.as_adjacency(sources)

    def _check_id(self, path: JsonPath, value: Any) -> bool:
        if type(value) is not int or value < 0:
            self._report(path, "bad-id", f"expected an int from 0, not {value!r}", "write a whole number")
        elif value > self._max_id:
            # Columns are as long as the largest id, so a wrong digit must not use up the memory.
            message = f"id {value} is too large: at most {self._max_id} is allowed here"
            self._report(path, "bad-id", message, "number the objects from 0")
        else:
            return True
        return False

    def _check_mapping(self, path: JsonPath, value: Any, known: tuple[str, ...] | None = None) -> bool:
        if not isinstance(value, Mapping) or not all(isinstance(key, str) for key in value):
            self._report(path, "wrong-type", "expected an object in braces", "write `{ .. }`")
            return False
        for key in value:
            if known is not None and key not in known:
                place, hint = (*path, key), name_hint(key, known)
                self._report(place, "unknown-key", "unknown key", hint)
        return True

    def _report(self, path: JsonPath, code: str, message: str, hint: str | None = None) -> None:
        where = f"`{json_place(path)}`: " if path else ""
        self.problems.append(Diagnostic(code, f"{where}{message}", hint=hint, subject=path))
        if len(self.problems) == MAX_ERRORS:
            text = f"{where}too many mistakes: the rest of the file is not read"
            self.problems.append(Diagnostic("too-many-errors", text, hint="correct these mistakes first", subject=path))
            raise _TooManyProblems
