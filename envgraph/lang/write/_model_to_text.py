"""Write models as `.model` files, with each object nested inside its container."""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator
from math import isfinite

from envgraph.errors import InvalidArgument
from envgraph.graph import Model
from envgraph.lang.format._format_text import format_text
from envgraph.lang.syntax._grammar import load_grammar
from envgraph.lang.write._term_writer import format_string
from envgraph.metamodel import Attribute, EnumType, Reference, Value, simple_name

_NAME = re.compile(r"[^\W\d]\w*")


def model_to_text(model: Model, imports: Iterable[str] = ()) -> str:
    """Return the text of a `.model` file that describes a model.

    A model read from the text has the same objects, values and links. Its ids follow the order of the text. The order
    of links at the other end of two opposite references may change. Objects that are referred to get a name if they
    have none. The grid object `plot[3, 1]` is named `plot_3_1`.

    Args:
        model: the model, in its current state.
        imports: paths of the files that the text imports; the metamodel must be in one of them.

    Raises:
        InvalidArgument: the text cannot express a class name that two packages share, an invalid name, or an infinite
            number.

    >>> from envgraph.metamodel import Class, Metamodel
    >>> print(model_to_text(Model(Metamodel("city", (Class("House"),)), "empty"), ["city.metamodel"]), end="")
    import "city.metamodel"
    <BLANKLINE>
    model empty : city {
    }
    """
    lines = [*(f"import {format_string(path)}" for path in imports), *_ModelWriter(model).model_lines()]
    return format_text("model", "\n".join(lines) + "\n", f"{model.name}.model")


class _ModelWriter:
    def __init__(self, model: Model) -> None:
        self._model = model
        self._keywords = load_grammar("model").lexer.keywords
        nodes = [node.id for node in model.nodes()]
        self._top = [node for node in nodes if model.graph.container(node) is None]
        self._names: dict[int, str] = {}
        self._next_numbers: dict[str, int] = {}
        taken: set[str] = set()
        asked = {
            target
            for node in nodes
            for reference in self._written_references(node)
            for target in model.graph.targets(node, reference)
        }
        for node in nodes:
            name = model.graph.object_name(node)
            if name is not None and _NAME.fullmatch(name):
                self._names[node] = name
                taken.add(name)
        for node in nodes:
            if node in asked and node not in self._names:
                self._names[node] = name = self._unused_name(node, taken)
                taken.add(name)

    def _unused_name(self, node: int, taken: set[str]) -> str:
        cls = simple_name(self._model.graph.class_of(node))
        wanted = re.sub(r"\W+", "_", self._model.graph.object_name(node) or "").strip("_")
        if not _NAME.fullmatch(wanted):
            wanted = cls[:1].lower() + cls[1:]
        if wanted not in taken and wanted != cls:
            return wanted
        number = self._next_numbers.get(wanted, 1)  # from 1 each time, the work would be quadratic in the objects
        while (name := f"{wanted}_{number}") in taken:
            number += 1
        self._next_numbers[wanted] = number + 1
        return name

    def _written_references(self, node: int) -> list[Reference]:
        """Return the references whose targets are written: no containments or their opposites, one of two opposites."""
        model, metamodel = self._model, self._model.metamodel
        found = []
        for feature in metamodel.features(model.graph.class_of(node)).values():
            if isinstance(feature, Reference):
                relation = model.graph.store.relations[feature.index]
                if not (relation.containment or relation.is_contained or relation.is_flipped):
                    found.append(feature)
        return found

    def model_lines(self) -> Iterator[str]:
        yield f"model {self._format_name(self._model.name)} : {self._format_name(self._model.metamodel.name)} {{"
        for node in self._top:
            yield from self._object_lines(node, "")
        yield "}"

    def _object_lines(self, node: int, end: str) -> Iterator[str]:
        model, cls = self._model, self._model.graph.class_of(node)
        if cls != simple_name(cls):
            raise InvalidArgument(
                f"a `.model` file cannot name the class `{cls}`, because two packages have a class of this name: "
                "write .xmi or .json"
            )
        name = self._names.get(node)
        yield f"{self._format_name(name)} : {cls} {{" if name else f"{cls} {{"
        for feature in model.metamodel.features(cls).values():
            if isinstance(feature, Attribute):
                yield from self._attribute_lines(node, feature)
            elif feature.containment and model.graph.targets(node, feature):
                yield f"{self._format_name(feature.name)} = ["
                for part in model.graph.targets(node, feature):
                    yield from self._object_lines(part, ",")
                yield "]"
        for reference in self._written_references(node):
            targets = [self._format_name(self._names[target]) for target in model.graph.targets(node, reference)]
            if targets:
                value = f"[{', '.join(targets)}]" if reference.many else targets[0]
                yield f"{self._format_name(reference.name)} = {value}"
        yield "}" + end

    def _attribute_lines(self, node: int, attribute: Attribute) -> Iterator[str]:
        values = self._model.graph.values(node, attribute)
        initial = attribute.initial
        if attribute.many:
            if values:
                yield (
                    f"{self._format_name(attribute.name)} = "
                    f"[{', '.join(_format_value(attribute, value) for value in values)}]"
                )
        elif (values[0] if values else None) != initial:
            yield f"{self._format_name(attribute.name)} = {_format_value(attribute, values[0]) if values else 'none'}"

    def _format_name(self, name: str) -> str:
        if not _NAME.fullmatch(name):
            raise InvalidArgument(f"`{name}` cannot be a name in a `.model` file: write .xmi or .json")
        return f"^{name}" if name in self._keywords else name


def _format_value(attribute: Attribute, value: Value) -> str:
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(attribute.type, EnumType):
        return f"::{value}"
    if isinstance(value, str):
        return format_string(value)
    if not isfinite(value):
        raise InvalidArgument(f"`{attribute}` is {value}, which a `.model` file cannot contain: write .json")
    return repr(value)
