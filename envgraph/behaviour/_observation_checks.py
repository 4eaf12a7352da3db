"""Check the observations and drawings of a behaviour."""

from __future__ import annotations

from collections import Counter
from dataclasses import replace

from envgraph.behaviour._behaviour import (
    Behaviour,
    DrawGraph,
    DrawGrid,
    DrawnLink,
    Observation,
    ObserveAround,
    ObserveAttribute,
    ObserveFind,
    ObserveObject,
    ObserveRange,
    Token,
)
from envgraph.behaviour._clause_checks import CheckBase, Scope, type_names, type_with_article
from envgraph.behaviour._drawn_edges import edge_ends
from envgraph.behaviour._helper_patterns import (
    ObservedWindow,
    condition_helper,
    find_helper,
    is_bound_by_match,
    variable_occurrences,
)
from envgraph.code import walk_parts
from envgraph.errors import LARGEST_INT, Severity, Span, did_you_mean, name_hint
from envgraph.metamodel import Attribute, EnumType, Reference, Scalar
from envgraph.pattern import Expression, Navigation, ObjectType, Parameter, StaticType, Variable, type_text

_HINTS = {
    "many-valued": "use a pattern: `observe find p(..)`, or `observe count find p(..) up to n`",
    "stray-hash": "write `_`, or `observe max find p(.., #) in lo..hi` for a value of a pattern",
}
"""Hints of errors in observations, by code."""


class ViewChecks(CheckBase):
    """The checks of observations and drawings."""

    draw: DrawGraph | DrawGrid | None = None
    float_ranges: dict[Span | int, tuple[float, float]]
    """The range of each clause that observes floats, by its span, or by its `id` if it has none."""

    def check_float_places(self, behaviour: Behaviour) -> None:
        """Report the first float that `agent` blocks do not observe at the same place in the same range.

        Later places are not compared if windows or objects of different classes precede them.
        """
        rows = [[*agent.observations, *behaviour.observations] for agent in behaviour.agents]
        rows = [sorted(row, key=lambda one: one.span.start if one.span else 0) for row in rows]
        for column in zip(*rows, strict=False):
            floats = [one for one in column if (one.span or id(one)) in self.float_ranges]
            if len({self.float_ranges.get(one.span or id(one)) for one in column}) > 1:
                message = "each `agent` block must observe this float at the same place and in the same range"
                hint = "observe floats first in each block, in the same order and with equal ranges"
                hint = "write it before the `agent` blocks" if floats[0] in behaviour.observations else hint
                self.report("float-place", message, floats[0].span, hint)
                return
            if len({one.each and one.each.type for one in column}) > 1 or ObserveAround in map(type, column):
                return

    # --- observations

    def check_observation(self, observation: Observation, outer: Scope) -> None:
        """Report errors in an `observe` clause."""
        scope, known = dict(outer), len(self.problems)
        if (each := observation.each) is not None:
            if outer.get(each.name) is not None:
                message = f"`{each.name}` is already a parameter"
                self.report("duplicate-definition", message, each.span, "choose another name after `for`")
            scope[each.name] = self.check_class(each.type or "", each.type_span or each.span, self.metamodel.enums)
        if isinstance(observation, ObserveAround):
            self._check_observe_around(observation, scope)
        if observation.visible is not None:
            question = condition_helper("#check", observation.visible, type_names(scope))
            self.check_helper(question, observation.visible, scope)
        match observation:
            case ObserveFind():
                self._check_observe_find(observation, scope)
            case ObserveObject():
                self._check_observe_object(observation, scope)
            case ObserveRange(path=path, low=low, high=high):
                self._check_range(observation, self.check_path(path, scope), low, high, path.span)
            case ObserveAttribute():
                self._check_observe_attribute(observation, scope)
        is_used = each is None or Variable(each.name) in walk_parts(replace(observation, visible=None))
        if each is not None and not is_used and len(self.problems) == known:
            message = f"`{each.name}` is not used in what is observed"
            self.report("unused-name", message, each.span, "use it there, or leave it out")
        self.problems[known:] = [replace(one, hint=_HINTS.get(one.code, one.hint)) for one in self.problems[known:]]

    def _check_observe_find(self, observation: ObserveFind, scope: Scope) -> None:
        question = find_helper("#check", observation, type_names(scope))
        sound, low, high = self.check_helper(question, observation.call, scope), observation.low, observation.up_to
        entries = self.library.analyse(question.pattern).analysis.entries
        asked = entries[question.pattern.qualified_name] if sound else None
        if high is not None:
            type_ = asked.types[-1] if asked else None
            self._check_range(observation, type_, low, high, observation.call.span)
            if observation.aggregate == "count" and high < 1:
                message = f"the bound of `up to` is {high}, but must be at least 1"
                self.report("empty-range", message, observation.span, "write `up to 1` or more")
            elif type_ is Scalar.FLOAT and isinstance(low, int) and isinstance(high, int):
                message = f"this `{observation.aggregate}` is a `float`, but the bounds of its range are ints"
                self.report("wrong-type", message, observation.span, f"write `in {low}.0..{high}.0`")
        if asked is None or (observation.each and scope[observation.each.name] is None):
            return  # there is an error already
        types = dict(zip(observation.call.arguments, entries[asked.calls[observation.call.pattern]].types, strict=True))
        uses = Counter(one for one in variable_occurrences(observation.call) if is_bound_by_match(one, scope))
        for variable in (one for one, count in uses.items() if count == 1 and one.name not in self.metamodel.classes):
            if did_you_mean(variable.name, [*scope]) is None:  # else there is a warning already
                message = f"`{variable.name}` stands for any value, so that there is one component in all"
                hint = _unbound_hint(variable.name, types.get(variable), observation.each)
                self.report("used-once", message, variable.span, hint, Severity.WARNING)

    def _check_observe_around(self, observation: ObserveAround, scope: Scope) -> None:
        """Check a window, and add the name in its condition that stands for the cell to the scope."""
        name, types, draw = observation.centre.name, type_names(scope), self.draw
        if not {observation.width, observation.height} <= {*range(1, 32, 2)}:
            message = "the width and height of a window must be odd numbers from 1 to 31"
            self.report("wrong-size", message, observation.span, "write `7 x 7`, for example")
        self.check_path(observation.centre, scope)
        if None in scope.values() or name not in types or (draw and draw.cls not in self.metamodel.classes):
            return  # an error elsewhere
        window = ObservedWindow(observation, draw, types, self.metamodel) if isinstance(draw, DrawGrid) else None
        if window is None or window.centre is None:
            lacking = "draws no grid" if window is None else f"does not draw `{name}` in its grid"
            message = f"a window needs the place of `{name}`, but the environment {lacking}"
            hint = f"write `draw grid Class at (x, y) with {name} : {types[name]} at {name}.place`"
            self.report("no-place", message, observation.centre.span, hint)
        elif len(window.cells) > 1:
            message = f"`{window.cells[0]}` stands for the cell, so that `{window.cells[1]}` has no value"
            self.report("unknown-variable", message, observation.span, "write `_` for any other value")
        else:
            scope.update(dict.fromkeys(window.cells, ObjectType(window.classes[0])))

    def _check_observe_object(self, observation: ObserveObject, scope: Scope) -> None:
        among = self.check_class(observation.among, observation.among_span or observation.span)
        type_ = self.check_path(observation.path, scope)
        if type_ is None or among is None:
            return
        if not isinstance(type_, ObjectType):
            message = f"the path leads to {type_with_article(type_)}, not to an object of `{among.cls}`"
            self.report("wrong-type", message, observation.path.span, _data_hint(type_))
        elif not self.metamodel.may_overlap(type_.cls, among.cls):
            message = f"the path leads to {type_with_article(type_)}, which is never {type_with_article(among)}"
            span = observation.among_span or observation.span
            self.report("wrong-type", message, span, f"write `among {type_.cls}`")
        elif observation.or_none:
            return
        elif not self.metamodel.covers(among.cls, type_.cls):
            wider = f"{type_.cls} or none" if self._first_optional(observation.path, scope) else type_.cls
            message = (
                f"this may lead to {type_with_article(type_)} that is not {type_with_article(among)}, "
                "so there is nothing to observe"
            )
            hint = f"write `among {wider}`, or `among {among.cls} or none`"
            self.report("other-class", message, observation.path.span, hint, Severity.WARNING)
        elif loose := self._first_optional(observation.path, scope):
            message = f"`{loose}` may have no target, and then there is nothing to observe"
            hint = f"write `among {among.cls} or none`"
            self.report("maybe-none", message, observation.path.span, hint, Severity.WARNING)

    def _first_optional(self, path: Expression, scope: Scope) -> Reference | None:
        """Return the first reference on a path that may have no target; None if there is none."""
        if not isinstance(path, Navigation):
            return None
        earlier = self._first_optional(path.object, scope)
        feature = self.last_feature(path, scope)
        return earlier or (feature if isinstance(feature, Reference) and feature.lower == 0 else None)

    def _check_range(
        self, observation: Observation, type_: StaticType | None, low: float, high: float, observed: Span | None
    ) -> None:
        """Check the range of an observed number, and that it is a number if its type is known."""
        is_float = type_ is Scalar.FLOAT or not (isinstance(low, int) and isinstance(high, int))
        if type_ is not None and type_ not in (Scalar.INT, Scalar.FLOAT):
            message = f"only an `int` or a `float` can be observed in a range, not {type_with_article(type_)}"
            hint = _data_hint(type_) if type_ is Scalar.STRING else "leave the range out"
            hint = f"write `among {type_.cls}`" if isinstance(type_, ObjectType) else hint
            self.report("wrong-type", message, observed, hint)
        if low > high or (is_float and low == high):
            hint = f"write `{high}..{low}`" if low > high else "write a higher number after `..`"
            self.report("empty-range", f"the range {low}..{high} is empty", observation.span, hint)
        elif not is_float and high - low + 1 + (observation.visible is not None) > LARGEST_INT:
            message = f"the observation has more than {LARGEST_INT} values"
            self.report("too-many-observations", message, observation.span, "observe it in a smaller range")
        if is_float:
            self.float_ranges[observation.span or id(observation)] = low, high

    def _check_observe_attribute(self, observation: ObserveAttribute, scope: Scope) -> None:
        type_ = self.check_path(observation.path, scope)
        if type_ is None or isinstance(type_, EnumType) or type_ is Scalar.BOOL:
            return
        feature = self.last_feature(observation.path, scope)
        if isinstance(feature, Attribute) and feature.range is not None:
            self._check_range(observation, type_, *feature.range[:2], observation.path.span)
            return
        hint = f"write `among {type_.cls}`" if isinstance(type_, ObjectType) else _data_hint(type_)
        message = f"{type_with_article(type_)} cannot be observed, because its values have no range"
        self.report("wrong-type", message, observation.path.span, hint)

    # --- drawing

    def check_drawing(self, draw: DrawGrid | DrawGraph, scope: Scope) -> None:
        """Report errors in a `draw` clause: in its classes and attributes, edges and tokens."""
        cls = self.check_class(draw.cls, draw.cls_span or draw.span)
        if cls is not None and isinstance(draw, DrawGrid):
            for name, span in ((draw.column, draw.column_span), (draw.row, draw.row_span)):
                self._check_drawn_attribute(cls.cls, name, span or draw.span, whole=True)
        if cls is not None and isinstance(draw, DrawGraph) and draw.label is not None:
            self._check_drawn_attribute(cls.cls, draw.label, draw.label_span or draw.span, whole=False)
        for link in draw.links if isinstance(draw, DrawGraph) else ():
            self._check_link(link, cls)
        for token in draw.tokens:
            self._check_token(token, cls, scope)

    def _check_link(self, link: DrawnLink, nodes: ObjectType | None) -> None:
        cls = self.check_class(link.cls, link.cls_span or link.span)
        if cls is None or nodes is None:
            return
        if link.label is not None:
            self._check_drawn_attribute(cls.cls, link.label, link.label_span or link.span, whole=False)
        kinds = [
            kind
            for kind in self.metamodel.concrete_classes(cls.cls)
            if len(edge_ends(self.metamodel, kind, nodes.cls)) < 2
        ]
        if kinds:
            message = f"{type_with_article(ObjectType(kinds[0]))} cannot be drawn as an edge between two nodes"
            hint = f"instead of an edge, which needs two single references to {type_with_article(nodes)}, "
            hint += self._token_hint(cls.cls, nodes.cls) or f"leave `{link.cls}` out"
            self.report("wrong-type", message, link.cls_span or link.span, hint)

    def _token_hint(self, cls: str, nodes: str) -> str | None:
        """Return a hint for drawing the objects of a class as tokens on nodes; None if no reference leads to a node."""
        for one in self.metamodel.features(cls).values():
            if isinstance(one, Reference) and not one.many and self.metamodel.is_a(one.target, nodes):
                name = cls[:1].lower() + cls[1:]
                return f"write `with {name} : {cls} at {name}.{one.name}` to draw it as a token on a node"
        return None

    def _check_drawn_attribute(self, cls: str, name: str, span: Span | None, whole: bool) -> None:
        features = self.metamodel.features(cls)
        feature = features.get(name)
        if not isinstance(feature, Attribute):
            known = [f.name for f in features.values() if isinstance(f, Attribute)]
            hint = name_hint(name, known)
            self.report("unknown-feature", f"`{cls}` has no attribute `{name}`", span, hint)
        elif feature.many:
            message = f"`{feature}` has many values, but only one can be shown"
            self.report("many-valued", message, span, "name an attribute with one value")
        elif whole and feature.type is not Scalar.INT:
            message = f"a position in the grid must be an `int`, but `{feature}` is {type_with_article(feature.type)}"
            ints = [f"`{f.name}`" for f in features.values() if isinstance(f, Attribute) and f.type is Scalar.INT]
            hint = f"use an attribute of that type: {', '.join(ints)}" if ints else None
            self.report("wrong-type", message, span, hint)

    def _check_token(self, token: Token, cell: ObjectType | None, outer: Scope) -> None:
        scope = dict(outer)
        if token.letter is not None and len(token.letter) != 1:
            message = f"the letter of `{token.variable}` must be a single character"
            self.report("bad-glyph", message, token.letter_span, "write one letter")
        if token.cls is not None:
            scope[token.variable] = self.check_class(token.cls, token.cls_span or token.span)
        elif token.variable not in scope:
            message = f"unknown variable `{token.variable}`"
            hint = (
                did_you_mean(token.variable, scope) or f"for all objects of a class: `{token.variable} : Class at ..`"
            )
            span = token.span
            if span is not None:
                span = span.source.span_between(span.start, span.start + len(token.variable))
            self.report("unknown-variable", message, span, hint)
            return
        type_ = self.check_path(token.path, scope)
        if type_ is None or cell is None:
            return
        if not isinstance(type_, ObjectType) or not self.metamodel.may_overlap(type_.cls, cell.cls):
            message = (
                f"`{token.variable}` must be drawn at {type_with_article(cell)}, not at {type_with_article(type_)}"
            )
            hint = f"write a path that leads to {type_with_article(cell)}, or draw a `grid` of another class"
            self.report("wrong-type", message, token.path.span, hint)


def _data_hint(type_: StaticType) -> str:
    if type_ in (Scalar.INT, Scalar.FLOAT):
        return "write `in lo..hi`, or `@range(lo, hi)` before the attribute"
    unseen = "observe a bool, an enum, a number in a range, or an object"
    return unseen if type_ is Scalar.STRING else "leave `among` and the class out"


def _unbound_hint(name: str, type_: StaticType | None, each: Parameter | None) -> str:
    """Return a hint for a name of some type, perhaps unknown, that only a match binds, besides the name `each`."""
    if isinstance(type_, EnumType) and name in type_.literals:
        return f"write `{type_.name}::{name}`"
    if isinstance(type_, Scalar) or (each and isinstance(type_, ObjectType)):
        return "write `_`"
    others = f"{each.name} : {each.type}, " if each else ""
    text, kind = type_text(type_) if type_ else "Class", "literal" if isinstance(type_, EnumType) else "object"
    return f"write `_`, or at the end `for {others}{name} : {text}` for a component for each {kind}"
