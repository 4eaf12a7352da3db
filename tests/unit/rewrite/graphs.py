"""A small metamodel with every kind of feature, and rules as text, for the tests of this package."""

from __future__ import annotations

from itertools import pairwise
from textwrap import dedent

from envgraph.errors import Diagnostic
from envgraph.graph import Model
from envgraph.metamodel import Metamodel
from envgraph.pattern import Derivation, Pattern, Rule, Unit
from envgraph.rewrite import Engine
from tests.reading import read_definitions, read_metamodel_text

METAMODEL_TEXT = """\
metamodel graphs

enum Colour { red, green, blue }

abstract class Thing { int n }

class Item extends Thing {
    float weight
    string label
    bool done
    Colour colour
    refers Item[0..1] next opposite prev
    refers Item[0..1] prev opposite next
    refers Item[0..*] links
    refers Item[0..2] pair
    refers Item[0..*] friends opposite friends
    contains Item[0..*] kids opposite parent
    refers Item[0..1] parent opposite kids
}

class Special extends Item {
    int extra = 7
    refers Item[0..1] favourite
}

class Box extends Thing {
    contains Item[0..2] content
    refers Item[1] must
}
"""


def _metamodel() -> Metamodel:
    found = read_metamodel_text(METAMODEL_TEXT)
    assert found.metamodel is not None, [str(diagnostic) for diagnostic in found.diagnostics]
    return found.metamodel


METAMODEL = _metamodel()


def patterns(text: str) -> tuple[Pattern, ...]:
    """The patterns of a query text."""
    read = read_definitions(dedent(text), "query", "test")
    assert not read.diagnostics, [str(diagnostic) for diagnostic in read.diagnostics]
    return read.definitions


def definitions(text: str) -> tuple[Rule | Unit | Derivation, ...]:
    """The definitions of a rules text."""
    read = read_definitions(dedent(text), "rules", "test")
    assert not read.diagnostics, [str(diagnostic) for diagnostic in read.diagnostics]
    return read.definitions


def rule(text: str) -> Rule:
    """The one rule of a text."""
    (found,) = definitions(text)
    assert isinstance(found, Rule)
    return found


def engine(rules: str = "", queries: str = "", *, model: Model | None = None, seed: int = 0) -> Engine:
    """An engine over a model (an empty one, unless given) with the definitions of two texts."""
    made = Engine(Model(METAMODEL) if model is None else model, seed=seed)
    made.add(*patterns(queries), *definitions(rules))
    return made


def problems(rules: str, queries: str = "") -> list[Diagnostic]:
    """What is wrong with the definitions of two texts."""
    return Engine(Model(METAMODEL)).check(*patterns(queries), *definitions(rules))


def chain(length: int, cls: str = "Item") -> Model:
    """Items 0, 1, ... linked by `next`; `n` is the id."""
    model = Model(METAMODEL)
    nodes = [model.create(cls, n=number) for number in range(length)]
    for left, right in pairwise(nodes):
        left.next = right
    return model


def snapshot(model: Model) -> tuple[object, ...]:
    """Everything about a state, order included."""
    metamodel = model.metamodel
    rows: list[object] = []
    for cls in metamodel.class_list:
        if cls.abstract:
            continue
        for node in model.graph.exact_extent(cls.name):
            values = [
                model.graph.value(node, feature)
                for feature in metamodel.attributes
                if metamodel.is_a(cls.name, feature.owner)
            ]
            ends = [
                (tuple(model.graph.targets(node, reference)), tuple(model.graph.sources(node, reference)))
                for reference in metamodel.references
            ]
            rows.append((cls.name, node, tuple(values), tuple(ends), model.graph.object_name(node)))
    return (*rows, model.state_hash())
