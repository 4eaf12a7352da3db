"""Bind the names of a behaviour to objects of a model, and evaluate paths."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping

from envgraph.behaviour._behaviour import Agent, Behaviour
from envgraph.errors import (
    SHOWN,
    Diagnostic,
    EvaluationError,
    InvalidArgument,
    Note,
    ResolutionError,
    Severity,
    Span,
    did_you_mean,
)
from envgraph.graph import Model
from envgraph.metamodel import Attribute, Metamodel, Reference, Value
from envgraph.pattern import Expression, Navigation, Parameter, Variable

FeatureReader = Callable[[int, str], Value | int | None]
"""A function that reads a single-valued feature of an object: the value, the id of the target, or None."""


def feature_reader(model: Model) -> FeatureReader:
    """Return a function that reads features of a model's objects by name.

    The function raises EvaluationError if the object is deleted, or if its class has no such feature any more.
    """
    mm = model.metamodel
    known: dict[tuple[str, str], Attribute | Reference] = {}

    def read(node: int, feature: str) -> Value | int | None:
        try:
            place = model.graph.class_of(node), feature
            found = known.get(place)
            if found is None:
                found = known[place] = _feature(mm, *place)
        except InvalidArgument as error:
            raise EvaluationError(str(error)) from None
        return model.graph.value(node, found) if isinstance(found, Attribute) else model.graph.target(node, found)

    return read


def _feature(metamodel: Metamodel, cls: str, name: str) -> Attribute | Reference:
    found = metamodel.feature(cls, name)
    if found is None:
        raise InvalidArgument(f"`{cls}` has no feature `{name}`")
    return found


def follow_path(path: Expression, values: Mapping[str, Value | int | None], read: FeatureReader) -> Value | int | None:
    """Return the value or object id at the end of a path; None if a feature on the path has no value."""
    if isinstance(path, Variable):
        return values[path.name]
    if not isinstance(path, Navigation):
        raise InvalidArgument(f"a path was expected, not {path}")
    owner = follow_path(path.object, values, read)
    return read(owner, path.feature) if type(owner) is int else None


def bind_parameters(
    model: Model, parameters: Iterable[Parameter], spans: Mapping[int, Span] | None = None
) -> dict[str, int]:
    """Return the object id for each parameter, by name.

    If several objects match, notes of the error show their places in `spans` (by object id).

    Raises:
        ResolutionError: a parameter matches no object or several; lists all such parameters.
    """
    bound: dict[str, int] = {}
    problems: list[Diagnostic] = []
    for parameter in parameters:
        try:
            bound[parameter.name] = bind_parameter(model, parameter, spans)
        except ResolutionError as error:
            problems.extend(error.diagnostics)
    if problems:
        raise ResolutionError(problems)
    return bound


def bind_parameter(model: Model, parameter: Parameter, spans: Mapping[int, Span] | None = None) -> int:
    """Return the object with the parameter's name and type, or else the only instance of the type.

    Raises:
        ResolutionError: no object has this name and type, and the type has no instance or several.
    """
    mm = model.metamodel
    named = model.graph.find_object(parameter.name)
    if named is not None and (parameter.type is None or mm.is_a(model.graph.class_of(named), parameter.type)):
        return named
    if parameter.type is None:
        message = f"the model has no object `{parameter.name}`"
        names = (model.graph.object_name(node) for cls in mm.class_list for node in model.graph.exact_extent(cls.name))
        hint = did_you_mean(parameter.name, (name for name in names if name))
        raise ResolutionError([Diagnostic("unbound-parameter", message, parameter.span, hint)])
    instances = list(model.graph.extent(parameter.type))
    if len(instances) == 1:
        return instances[0]
    count = f"{len(instances)} objects of class `{parameter.type}`" if instances else f"no `{parameter.type}`"
    message = f"cannot bind parameter `{parameter.name}`: the model has {count}"
    hint = (
        f"name one of them `{parameter.name}`"
        if instances
        else f"add one to the model, with the name `{parameter.name}`"
    )
    places = [spans[node] for node in instances if node in spans] if spans else []
    notes = tuple(Note(f"object {number} is here", span) for number, span in enumerate(places[: SHOWN.objects], 1))
    raise ResolutionError([Diagnostic("unbound-parameter", message, parameter.span, hint, notes=notes)])


def unbound_names(behaviour: Behaviour, model: Model, spans: Mapping[int, Span] | None = None) -> list[Diagnostic]:
    """Return diagnostics for parameters and `agent` blocks without an object in the model.

    A parameter without an object is an error. So is an `agent` block if no block has an object; otherwise it is a
    warning. If several objects match a parameter, notes show their places in `spans`.
    """
    problems: list[Diagnostic] = []
    try:
        bind_parameters(model, behaviour.parameters, spans)
    except ResolutionError as error:
        problems.extend(error.diagnostics)
    absent = [agent for agent in behaviour.agents if not model.graph.extent(agent.cls)]
    return problems + [_missing_agent(agent, alone=len(absent) == len(behaviour.agents)) for agent in absent]


def _missing_agent(agent: Agent, alone: bool) -> Diagnostic:
    return Diagnostic(
        "unbound-agent",
        f"there is no agent{'' if alone else f' `{agent.variable}`'}: the model has no `{agent.cls}`",
        agent.cls_span or agent.span,
        "add one to the model",
        Severity.ERROR if alone else Severity.WARNING,
    )
