"""The model that the page shows: its matches, applications of rules to it, and their undo."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from itertools import islice, product
from typing import Any

from envgraph.code import dataclass
from envgraph.errors import SHOWN, EnvgraphError, InvalidArgument, did_you_mean, list_names
from envgraph.graph import Model, ModelSnapshot, Node, Version, value_text
from envgraph.metamodel import EnumType, Scalar, Value
from envgraph.page._work import JsonObject
from envgraph.pattern import ObjectType, StaticType
from envgraph.rewrite import Engine, Firing, Match, Signature


@dataclass(frozen=True, slots=True)
class Option:
    """A match of a pattern, or a way to apply a rule or to run a unit.

    Attributes:
        name: the qualified name of the pattern, rule or unit.
        match: the match; None for a unit.
        values: the values with which the unit runs; objects as ids.
        texts: the values by name, for people.
        objects: the ids of the objects among the values.
    """

    name: str
    match: Match | None
    values: Mapping[str, Value]
    texts: Mapping[str, str]
    objects: Sequence[int]

    def __str__(self) -> str:
        return f"{self.name}({', '.join(f'{name}={text}' for name, text in self.texts.items())})"

    @property
    def data(self) -> JsonObject:
        """Return the option for the page."""
        return {"values": dict(self.texts), "objects": list(self.objects)}


def option_of(match: Match) -> Option:
    """Return a match as an option."""
    return _make_option(match.definition, match, {}, match)


def _make_option(
    name: str, match: Match | None, values: Mapping[str, Value], shown: Mapping[str, Node | Value]
) -> Option:
    texts = {one: value_text(value) for one, value in shown.items()}
    objects = dict.fromkeys(value.id for value in shown.values() if isinstance(value, Node))
    return Option(name, match, values, texts, tuple(objects))


@dataclass(frozen=True, slots=True)
class _Step:
    """An applied rule: its description, and the state after it."""

    text: str
    firings: tuple[Firing, ...]
    version: Version


class ShownModel:
    """A model with an engine, and the rules that were applied to it.

    Args:
        engine: an engine of this object's own.
        name: the name of the model.

    Attributes:
        version: a number that changes with every change of the model.
    """

    def __init__(self, engine: Engine, name: str) -> None:
        self.engine, self.name = engine, name
        self.model: Model = engine.model
        self.initial_hash = self.model.state_hash()
        self._initial = self.model.commit()
        self._steps: list[_Step] = []
        self._undone: list[_Step] = []
        self.version = 1

    # --- matches

    def matches(self, pattern: str, bound: Mapping[str, Any]) -> Sequence[Match]:
        """Return the matches of a pattern that agree with values; objects are given as ids or names.

        Raises:
            InvalidArgument: the pattern, a variable or an object is unknown.
            TypeMismatch: a value has the wrong type.
        """
        return self.engine.matches(pattern, bound=self.read_values(bound, _pattern_types(self.engine, pattern)))

    def options(self, name: str, bound: Mapping[str, Any], limit: int) -> tuple[list[Option], bool]:
        """Return the first ways to apply a rule, derived group or unit, and True if there are more.

        A parameter whose value matching cannot find is tried with each possible value, if there are finitely many.
        The options of a unit are values of its parameters; the unit may still fail with them.

        Raises:
            InvalidArgument: the name is unknown, or a parameter without a given value has too many possible ones.
        """
        found = list(islice(self._options(name, bound), limit + 1))
        return found[:limit], len(found) > limit

    def _options(self, name: str, bound: Mapping[str, Any]) -> Iterator[Option]:
        signature = self.engine.signature(name)
        if signature.kind == "group":
            for member in self.engine.group(name):
                yield from self._options(member, bound)
            return
        types = {one.name: one.type for one in (*signature.parameters, *signature.variables)}
        known = self.read_values(bound, types)
        needed = [one for one in self._needed(signature) if one not in known]
        for values in product(*(self._possible_values(signature.simple_name, one, types[one]) for one in needed)):
            given = {**known, **dict(zip(needed, values, strict=True))}
            if signature.kind == "unit":
                shown = {
                    one: self.model.node(value) if isinstance(types[one], ObjectType) and type(value) is int else value
                    for one, value in given.items()
                }
                yield _make_option(signature.name, None, given, shown)
            else:
                found = self.engine.matches(signature.name, applicable=True, bound=given)
                yield from (option_of(match) for match in found)

    def add_only_values(self, name: str, bound: Mapping[str, Any]) -> dict[str, Value]:
        """Return the given values of a pattern, rule or unit. A missing one is added if only one value is possible.

        Raises:
            InvalidArgument: a required value is missing, and there are several possible ones or none.
        """
        found = self.read_values(bound, _pattern_types(self.engine, name))
        if self.engine.library.resolve(name) is not None:
            return found
        signature = self.engine.signature(name)
        types = {one.name: one.type for one in (*signature.parameters, *signature.variables)}
        for needed in self._needed(signature):
            if needed not in found:
                possible = self._possible_values(signature.simple_name, needed, types[needed])
                if len(possible) != 1:
                    raise InvalidArgument(
                        f"`{signature.simple_name}` needs a value for `{needed}`", f"choose a value for `{needed}`"
                    )
                found[needed] = possible[0]
        return found

    def _needed(self, signature: Signature) -> Sequence[str]:
        """Return the parameters of a rule or unit whose values matching cannot find."""
        if signature.kind == "unit":
            return [one.name for one in signature.parameters if one.is_required]
        return self.engine.prepare(signature.name).inputs if signature.kind == "rule" else ()

    def _possible_values(self, rule: str, name: str, type_: StaticType | None) -> Sequence[Value]:
        match type_:
            case ObjectType(cls):
                return self.model.graph.extent(cls)
            case EnumType(literals=literals):
                return literals
            case Scalar.BOOL:
                return (False, True)
        raise InvalidArgument(f"`{rule}` needs a value for `{name}`", f"write a value for `{name}`")

    def read_values(self, given: Mapping[str, Any], types: Mapping[str, StaticType | None]) -> dict[str, Value]:
        """Return values of the page as values for the engine: objects, given as ids, names or texts, become ids.

        Raises:
            InvalidArgument: there is no such variable or object.
        """
        found: dict[str, Value] = {}
        for name, value in given.items():
            if name not in types:
                hint = did_you_mean(name, types) or f"the variables are {list_names(types) or 'none'}"
                raise InvalidArgument(f"there is no variable `{name}`", hint)
            found[name] = self._find_object(name, value) if isinstance(types[name], ObjectType) else value
        return found

    def _find_object(self, name: str, value: Any) -> int:
        graph = self.model.graph
        if type(value) is int and graph.alive(value):
            return value
        node = graph.find_object(value) if isinstance(value, str) else None
        if node is None:
            shown = (one.id for one in self.model.nodes() if value_text(one) == value)
            node = next(shown, None)
        if node is None:
            raise InvalidArgument(f"`{name}`: the model has no object `{value}`")
        return node

    # --- changes

    def apply(self, option: Option) -> list[str]:
        """Apply a rule or run a unit, and return at most 100 of its changes as lines of text.

        Raises:
            RuleError: the rule is refused; the model is unchanged.
            InvalidArgument: the unit fails; the model is unchanged.
        """
        before, engine = ModelSnapshot.of(self.model.graph), self.engine
        with engine.recording() as trace, engine.transaction():
            if option.match is None:
                result = engine.run(option.name, bound=option.values)
                if not result:
                    raise InvalidArgument(
                        f"`{option.name}` failed: {result.reason}", "choose the unit again to see why"
                    )
            else:
                engine.apply(option.name, option.match)
        self._add_step(_Step(str(option), tuple(trace), self.model.commit()))
        self._undone.clear()
        return before.changes(self.model.graph)[: SHOWN.rows]

    def _add_step(self, step: _Step) -> None:
        self._steps.append(step)
        self.version += 1

    def undo(self) -> None:
        """Undo the last applied rule, if there is one."""
        if self._steps:
            self._undone.append(self._steps.pop())
            self._check_out()

    def redo(self) -> None:
        """Apply the rule again that was undone last, if there is one."""
        if self._undone:
            self._steps.append(self._undone.pop())
            self._check_out()

    def reset(self) -> None:
        """Undo all applied rules."""
        while self._steps:
            self._undone.append(self._steps.pop())
        self._check_out()

    def _check_out(self) -> None:
        self.model.checkout(self._steps[-1].version if self._steps else self._initial, discard=True)
        self.version += 1

    def repeat_steps(self, other: ShownModel) -> None:
        """Apply the rules that were applied to another model again, until one does not match any more.

        Nothing is applied if the models were different at the beginning. The definitions may be different.
        """
        self.version = other.version + 1
        if other.initial_hash != self.initial_hash:
            return
        for step in other._steps:
            try:
                self.engine.replay(step.firings)
            except EnvgraphError:
                return
            self._add_step(_Step(step.text, step.firings, self.model.commit()))

    @property
    def history(self) -> JsonObject:
        """Return the applied rules, and whether one can be undone or redone."""
        return {
            "steps": [step.text for step in self._steps],
            "canUndo": bool(self._steps),
            "canRedo": bool(self._undone),
            "version": self.version,
        }


def _pattern_types(engine: Engine, pattern: str) -> Mapping[str, StaticType | None]:
    """Return the types of the parameters of a pattern, or of the variables of a rule; {} if the name is unknown."""
    found = engine.library.resolve(pattern)
    if found is not None:
        types = engine.library.parameter_types(found.qualified_name)
        return {one.name: type_ for one, type_ in zip(found.parameters, types, strict=True)}
    signature = engine.signature(pattern)
    return {one.name: one.type for one in (*signature.parameters, *signature.variables)}
