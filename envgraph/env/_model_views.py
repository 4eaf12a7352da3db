"""Observations of the whole model: an image of its grid, its graph, or a text.

The spaces fit all members of a family: an image has the size of the largest member, and each number has the same
meaning in all members.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Container, Iterable, Iterator, Sequence
from dataclasses import replace
from itertools import product
from typing import Any

import numpy as np
from gymnasium import spaces
from numpy.typing import NDArray

from envgraph.behaviour import (
    Behaviour,
    DrawGrid,
    ObserveAround,
    ObserveObject,
    feature_reader,
)
from envgraph.env._flat_observations import FlatLayout
from envgraph.env._float_ranges import LARGEST_FLOAT32, FloatRange
from envgraph.env._observation_components import (
    clause_name,
    component_names,
    observe_clauses,
    observed_range,
    path_target_reader,
    path_type,
)
from envgraph.env._observation_spaces import ObservationKind
from envgraph.env._prepared_clauses import NameClasses, ObservationComponent
from envgraph.env._simulator import Simulator
from envgraph.env.scene._scene import Painter, legend
from envgraph.env.scene._text import scene_text
from envgraph.errors import EvaluationError, InvalidArgument, escape_unprintable
from envgraph.graph import Model
from envgraph.metamodel import Attribute, EnumType, Metamodel, Reference, Scalar, Value
from envgraph.pattern import Navigation

MAX_PIXEL = 255
"""Brightness of what is present; observations of trained agents depend on it."""


class ModelView(ABC):
    """The base class of observations that are computed from the whole model.

    Attributes:
        space: the Gymnasium space of the observations.
    """

    space: spaces.Space[Any]

    @abstractmethod
    def observe(self, simulator: Simulator) -> Any:
        """Return the observation of the current state, for the agent that acts next."""

    def present(self, observation: Any) -> Any:
        """Return the form in which users get an observation. The argument is a copy of what `observe` returned."""
        return observation


def model_view(kind: ObservationKind, behaviour: Behaviour, models: Sequence[Model]) -> ModelView:
    """Return the view of a kind of observations of the model, for the models of all members of a family.

    Raises:
        InvalidArgument: an image is wanted, but no grid is drawn, or windows differ in size.
    """
    match kind:
        case "text":
            return TextView(behaviour)
        case "graph":
            return GraphView(behaviour, models[0].metamodel)
        case "image":
            return ImageView(behaviour, models)
        case _:
            return PaddedGraphView(behaviour, models)


def _unseen(simulator: Simulator) -> set[Any]:
    """Return the objects, and the pairs of an object and a feature, that the acting agents do not see.

    A window hides the objects of drawn classes, and the positions of cells. A clause with `if` hides the objects of
    `for` and of `among`, and the feature that it reads. What one clause shows is not hidden by another.
    """
    model, hidden, seen = simulator.engine.model, set[Any](), set[Any]()
    read = feature_reader(model)
    for agent in simulator.agents.prepared_agents if simulator.joint_stepper else [simulator.current_agent]:
        seen.add(agent.node)
        for window, rows in agent.behaviour.windows:
            hidden.update(node for cls in window.classes for node in model.graph.extent(cls))
            hidden.update(product(model.graph.extent(window.grid.cls), (window.grid.column, window.grid.row)))
            seen.update(window.seen(rows()))
        for component in agent.behaviour.components:
            clause, owner = component.observation, component.owner
            if owner is None or clause.visible is None:
                continue
            path, shown = getattr(clause, "path", None), list[Any]()
            if clause.each is not None or isinstance(clause, ObserveObject):
                shown.append(owner[1]())
            if isinstance(path, Navigation):
                shown.append((path_target_reader(path.object, owner, read)(), path.feature))
            hidden.update(model.graph.extent(clause.each.type or "") if clause.each is not None else ())
            (seen if component.read() < component.size - 1 else hidden).update(shown)
    return hidden - seen


def _may_hide_something(behaviour: Behaviour) -> bool:
    """Return True if an `observe` clause hides a part of the model from its agents in some states."""
    return any(isinstance(one, ObserveAround) or one.visible is not None for one in observe_clauses(behaviour))


class ImageView(ModelView):
    """A view of the grid of the `draw` clause as an image, uint8 [height, width, channels], padded with 0.

    Each drawn class (cells or tokens) has a channel: 255 at the positions of its objects. Each `observe` clause has a
    channel: for an attribute, an int, or a pattern `for` an object, `255 * (index + 1) // size` at the position of the
    object; for a float, 0 at the low end of its range to 255 at the high end; for an object, 255 at its position. An
    object outside of the grid fills the channel with the value, a missing object leaves 0, and another `find` fills it
    with `255 * index // (size - 1)`. With agents, one channel is 255 at the agent that acts next.

    Args:
        behaviour: its `draw` and `observe` clauses define the channels.
        models: the models of all members of the family.

    Raises:
        InvalidArgument: the behaviour draws no grid, or windows differ in size.

    Attributes:
        channels: the content of each channel: a class, the text of an `observe` clause, or "agent".
    """

    def __init__(self, behaviour: Behaviour, models: Sequence[Model]) -> None:
        draw = behaviour.draw
        if not isinstance(draw, DrawGrid):
            hint = 'write `draw grid Class at (x, y)`, or use `observation="graph"`'
            raise InvalidArgument(f"environment `{behaviour.name}` has no image, because it draws no grid", hint)
        painters = [Painter(model, draw, behaviour.parameters) for model in models]
        sizes = [painter.grid_places()[:2] for painter in painters]
        width, height = (max(extents, default=0) for extents in zip(*sizes, strict=True))
        metamodel = models[0].metamodel
        drawn = dict.fromkeys(cls for painter in painters for cls in painter.drawn_classes())
        shown = {cls for root in drawn for cls in metamodel.concrete_classes(root)}
        self._classes = [one.name for one in metamodel.class_list if one.name in shown]
        clauses, agent = observe_clauses(behaviour), ["agent"] if behaviour.agents else []
        windows = {(one.height, one.width) for one in clauses if isinstance(one, ObserveAround)}
        clauses = [one for one in clauses if not isinstance(one, ObserveAround)]
        self.channels = (*self._classes, *map(clause_name, clauses), *agent)
        self._channel = {clause: place for place, clause in enumerate(clauses, start=len(self._classes))}
        if len(windows) > 1 or (windows and behaviour.together):
            message = f'"image" needs windows of one size, for one agent at a time, unlike `{behaviour.name}`'
            raise InvalidArgument(message, 'use "flat", "multi", "dict" or "graph"')
        self._has_window = bool(windows)
        ((height, width),) = windows or {(height, width)}
        self.space = spaces.Box(0, MAX_PIXEL, (height, width, len(self.channels)), np.uint8)

    def observe(self, simulator: Simulator) -> NDArray[np.uint8]:
        """Return the image of the current state, for the agent that acts next."""
        shape = self.space.shape
        assert shape is not None
        image = np.zeros(shape, dtype=np.uint8)
        model, seat = simulator.engine.model, simulator.current_agent
        _, _, drawn = simulator.painter().grid_places()
        places: dict[int, Any] = dict.fromkeys(drawn)
        if self._has_window:
            for window, rows in seat.behaviour.windows[:1]:
                places |= window.seen(rows())
        else:
            seen = drawn.keys() - _unseen(simulator)
            places |= {n: (y, x) for n, (x, y) in drawn.items() if n in seen and y < shape[0] and x < shape[1]}
        channel = {cls: number for number, cls in enumerate(self._classes)}
        for node, place in places.items():
            number = channel.get(model.graph.class_of(node))
            if number is not None and place is not None:
                image[(*place, number)] = MAX_PIXEL
        for component in seat.behaviour.components:
            if component.observation in self._channel:
                _write_channel(image[..., self._channel[component.observation]], component, places)
        if seat.node is not None and places.get(seat.node) is not None:
            image[(*places[seat.node], -1)] = MAX_PIXEL
        return image


def _write_channel(channel: NDArray[np.uint8], component: ObservationComponent, places: dict[int, Any]) -> None:
    """Write a component to its channel of the image: at the object's (row, column), or everywhere without a position.

    If the object is missing or not seen, write nothing.
    """
    value, size, clause = component.read(), component.size, component.observation
    if clause.visible is not None and value == size - 1:
        return
    where: Any = ...
    if component.target_object is not None:
        node = component.target_object()
        if not isinstance(node, int) or (where := places.get(node, ...)) is None:
            return
    if isinstance(size, FloatRange):
        low, high, _ = size.limits
        number = float(FlatLayout([size]).encode(np.array([value]))[0])
        channel[where] = round(MAX_PIXEL * (number - low) / (high - low))
    elif component.target_object is None:
        channel[...] = MAX_PIXEL * value // max(size - 1, 1)
    else:
        is_place = isinstance(clause, ObserveObject) and node in places
        channel[where] = MAX_PIXEL if is_place else MAX_PIXEL * (value + 1) // size


class GraphView(ModelView):
    """A view of the model as `gymnasium.spaces.GraphInstance`: its objects in order of creation, and their links.

    `nodes`, float32 [objects, features]: for each class, 1 for its objects; for each single-valued attribute, 1 if it
    has a value, followed by the value: a number, 0 or 1 for a bool, one column for each literal of an enum; no strings.
    Then for each parameter of the environment, 1 for its object, and in `agent`, 1 for the agent that acts next.
    `edges`, int64 [links], the number of the reference; `edge_links`, int64 [links, 2], the numbers of source and
    target; links are sorted by these three numbers.

    Args:
        behaviour: its parameters are features.
        metamodel: its classes, attributes and references are features.

    Attributes:
        features: the meaning of each column of `nodes`: "Tile", "Tile.x?" for whether a value exists, "Tile.x",
            "Tile.kind=road".
        references: the meaning of each number in `edges`.
    """

    def __init__(self, behaviour: Behaviour, metamodel: Metamodel) -> None:
        self._metamodel = metamodel
        self._classes = [one.name for one in metamodel.class_list if not one.abstract]
        self._attributes = [one for one in metamodel.attributes if not one.many and one.type is not Scalar.STRING]
        self._parameters = [parameter.name for parameter in behaviour.parameters]
        self._has_agents = bool(behaviour.agents)
        columns = [name for one in self._attributes for name in _feature_names(one)]
        agent = ["agent"] if behaviour.agents else []
        self.features = (*self._classes, *columns, *self._parameters, *agent)
        self.references = tuple(f"{one.owner}.{one.name}" for one in metamodel.references)
        features = spaces.Box(-np.inf, np.inf, (len(self.features),), np.float32)
        self.space = spaces.Graph(features, spaces.Discrete(max(len(self.references), 1)))

    def observe(self, simulator: Simulator) -> spaces.GraphInstance:
        """Return the graph of the current state, for the agent that acts next."""
        model, seat = simulator.engine.model, simulator.current_agent
        hidden = _unseen(simulator)
        nodes = sorted({node for cls in self._classes for node in model.graph.exact_extent(cls)} - hidden)
        number = {node: place for place, node in enumerate(nodes)}
        marked = [
            *(seat.behaviour.bound_values[name] for name in self._parameters),
            *[seat.node] * self._has_agents,
        ]
        rows = [[*self._node_features(model, node, hidden), *(float(node == one) for one in marked)] for node in nodes]
        edges = [edge for one in self._metamodel.references for edge in self._edges(model, one, number, hidden)]
        table = np.array(edges, dtype=np.int64).reshape(len(edges), 3)
        features = np.array(rows, dtype=np.float32).reshape(len(nodes), len(self.features))
        return spaces.GraphInstance(features, table[:, 0].copy(), table[:, 1:].copy())

    def _node_features(self, model: Model, node: int, hidden: Container[object]) -> Iterator[float]:
        cls = model.graph.class_of(node)
        yield from (float(cls == one) for one in self._classes)
        for attribute in self._attributes:
            known = self._metamodel.is_a(cls, attribute.owner) and (node, attribute.name) not in hidden
            yield from _feature_values(attribute, model.graph.value(node, attribute) if known else None)

    def _edges(self, model: Model, one: Reference, number: dict[int, int], hidden: set[Any]) -> Iterable[Sequence[int]]:
        back = self._metamodel.opposite(one)
        for source in sorted(model.graph.extent(one.owner)):
            for target in sorted(model.graph.targets(source, one)):
                if hidden.isdisjoint([source, target, (source, one.name), (target, back and back.name)]):
                    yield one.index, number[source], number[target]


class PaddedGraphView(GraphView):
    """A view of the graph as a dictionary of arrays of one size, for learners that do not take graphs.

    `nodes`, `edges` and `edge_links` are those of `GraphView`, padded with 0; `node_mask` and `edge_mask`, int8, are 1
    for objects and links. There is space for the objects of the largest member, and for the links that they can have
    by the limits of references at either end. A reference without a limit has space for the links of the member.
    """

    def __init__(self, behaviour: Behaviour, models: Sequence[Model]) -> None:
        super().__init__(behaviour, models[0].metamodel)
        nodes = max(len(model.nodes()) for model in models)
        links = max(sum(_link_limit(model, one) for one in model.metamodel.references) for model in models)
        self._boxes: dict[str, spaces.Box] = {
            "nodes": spaces.Box(-np.inf, np.inf, (nodes, len(self.features)), np.float32),
            "node_mask": spaces.Box(0, 1, (nodes,), np.int8),
            "edges": spaces.Box(0, max(len(self.references) - 1, 0), (links,), np.int64),
            "edge_links": spaces.Box(0, nodes - 1, (links, 2), np.int64),
            "edge_mask": spaces.Box(0, 1, (links,), np.int8),
        }
        self.space = spaces.Dict({**self._boxes})

    def present(self, observation: spaces.GraphInstance) -> dict[str, NDArray[Any]]:
        """Return a graph as arrays; raise EvaluationError if it has more objects or links than there is space for."""
        found = {name: np.zeros(box.shape, box.dtype) for name, box in self._boxes.items()}
        for name, part in observation._asdict().items():
            mask = found["node_mask" if name == "nodes" else "edge_mask"]
            if len(part) > len(mask):
                message = f'a state has {len(part)} {name}, but an observation "padded_graph" has space for {len(mask)}'
                raise EvaluationError(message, None, 'use `observation="graph"`')
            found[name][: len(part)], mask[: len(part)] = part, 1
        return found


def _link_limit(model: Model, reference: Reference) -> int:
    """Return how many links of a reference are possible between the objects of a model, or exist without a limit."""
    sources, targets = model.graph.extent(reference.owner), model.graph.extent(reference.target)
    back = model.metamodel.opposite(reference)
    into = 1 if reference.containment else None if back is None else back.upper
    limits = [upper * len(ends) for upper, ends in ((reference.upper, sources), (into, targets)) if upper is not None]
    return min(limits, default=sum(len(model.graph.targets(node, reference)) for node in sources))


class TextView(ModelView):
    """A view of the state as text: the picture, the observed components by name, and the actions that do something.

    If `observe` clauses may hide something from an agent, there is no picture, and all actions are listed, because a
    picture or a mask could reveal it. Characters that the space lacks are escaped, as in `\\u5317`; it has those of
    European languages, and symbols. Of a longer text, the rest is cut off.
    """

    def __init__(self, behaviour: Behaviour) -> None:
        self._hides = _may_hide_something(behaviour)
        self._letters = frozenset(["\n", *filter(str.isprintable, map(chr, [*range(0x500), *range(0x2000, 0x2800)]))])
        self.space: spaces.Text = spaces.Text(2**16, charset=self._letters)

    def observe(self, simulator: Simulator, number: int | None = None) -> str:
        """Return the text of the current state, for the agent with a number; None: for those that act next."""
        behaviour, keys, agents, lines = simulator.behaviour, simulator.keys, simulator.agents, list[str]()
        if behaviour.draw is not None and not self._hides:
            scene = simulator.painter().draw()
            signs = (f"{entry.glyph.letter} = {entry.kind}" for entry in legend([scene]) if entry.glyph.letter)
            lines += [*scene_text(scene).split("\n"), "; ".join(signs)]
        together = range(len(agents.prepared_agents)) if simulator.joint_stepper else [simulator.turn]
        for each in together if number is None else [number]:
            seat = agents.prepared_agents[each]
            blocks, parts = behaviour.agents[seat.block : seat.block + 1], seat.behaviour.components
            types = {one.name: one.type or "" for one in behaviour.parameters}
            types |= {block.variable: block.cls for block in blocks}
            names = component_names(replace(behaviour, agents=blocks), keys, len(parts))
            values = (_format_value(part, types, simulator) for part in parts)
            lines += [f"agent: {seat.name}"] * len(blocks)
            lines += [f"{name}: {value}" for name, value in zip(names, values, strict=True)]
            mask = zip(agents.action_names, simulator.agent_action_mask(each), strict=True)
            lines.append(f"actions: {', '.join(name for name, can in mask if can or self._hides)}")
        text = "\n".join(map(escape_unprintable, lines))[: self.space.max_length]
        return "".join(c if c in self._letters else ascii(c)[1:-1] for c in text)


def _format_value(part: ObservationComponent, types: NameClasses, simulator: Simulator) -> str:
    """Format the value of a component for people, such as `Tile[3, 3]`, `no` or `none`."""
    clause, value, metamodel = part.observation, part.read(), simulator.engine.model.metamodel
    if isinstance(clause, ObserveAround):
        return part.words[value]
    if clause.visible is not None and value == part.size - 1:
        return "out of sight"
    if isinstance(part.size, FloatRange):
        return f"{FlatLayout([part.size]).encode(np.array([value]))[0]:g}"
    if isinstance(clause, ObserveObject):
        known = simulator.keys.keys_of(clause.among)
        return f"{clause.among}[{', '.join(map(str, known[value]))}]" if value < len(known) else "none"
    if limits := observed_range(clause, types, metamodel):
        return str(int(limits[0]) + value)
    if isinstance(type_ := path_type(clause, types, metamodel), EnumType):
        return str(type_.literals[value])
    return "yes" if value else "no"


def torch_graph(graph: spaces.GraphInstance) -> Any:
    """Convert an observation "graph" to `torch_geometric.data.Data` (`pip install "envgraph[pyg]"`).

    The result has `x`, float32 [objects, features]; `edge_index`, int64 [2, links]; and `edge_type`, int64 [links], the
    number of the reference, as relational layers take it.

    Raises:
        InvalidArgument: PyTorch Geometric is not installed.
    """
    try:
        import torch
        from torch_geometric.data import Data
    except ImportError:
        raise InvalidArgument("PyTorch Geometric is not installed", 'pip install "envgraph[pyg]"') from None
    links = torch.from_numpy(graph.edge_links).T.contiguous()
    return Data(x=torch.from_numpy(graph.nodes), edge_index=links, edge_type=torch.from_numpy(graph.edges))


def _feature_names(attribute: Attribute) -> list[str]:
    name = f"{attribute.owner}.{attribute.name}"
    if isinstance(attribute.type, EnumType):
        return [f"{name}?", *(f"{name}={literal}" for literal in attribute.type.literals)]
    return [f"{name}?", name]


def _feature_values(attribute: Attribute, value: Value | None) -> list[float]:
    there = float(value is not None)
    if isinstance(attribute.type, EnumType):
        return [there, *(float(value == literal) for literal in attribute.type.literals)]
    return [there, 0.0 if value is None else min(max(float(value), -LARGEST_FLOAT32), LARGEST_FLOAT32)]
