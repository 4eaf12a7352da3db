"""Jobs of event rules: Python functions, or rules and units by name."""

from __future__ import annotations

from collections.abc import Callable
from inspect import iscoroutinefunction, isgeneratorfunction
from typing import TYPE_CHECKING, Literal

from envgraph.errors import InvalidArgument
from envgraph.graph import Node
from envgraph.rewrite._matches import Match, Shape
from envgraph.rewrite.run._rule_runner import wanted_arguments

if TYPE_CHECKING:
    from envgraph.rewrite.engine._engine import Engine

Event = Literal["appear", "disappear", "update"]

Job = Callable[..., object] | str
"""A function that takes variables of the match by name, or the name of a rule, group or unit."""

BoundJob = Callable[[Match, "Match | None"], object]
"""A function that executes a job; its arguments are the match and, for an update, the match before, else None."""


def bind_job(engine: Engine, shape: Shape, event: Event, job: Job) -> BoundJob:
    """Return a function that executes a job at a match of the given shape.

    Raises:
        InvalidArgument: a name is unknown, or the job needs a value that the match does not have.
    """
    if isinstance(job, str):
        return _bind_named(engine, shape, job)
    if callable(job):
        return _bind_function(engine, shape, event, job)
    raise InvalidArgument(f"`{event}` must be a function or the name of a rule or unit, not {job!r}")


def _bind_function(engine: Engine, shape: Shape, event: Event, function: Callable[..., object]) -> BoundJob:
    others = ("engine", "match", "old") if event == "update" else ("engine", "match")
    check_not_deferred(function)
    names, taken = wanted_arguments(function, shape, others)
    places = [(name, shape.position(name)) for name in names]

    def do(match: Match, old: Match | None) -> object:
        arguments: dict[str, object] = {}
        for name, place in places:
            value = match.row[place]
            # A node even for a deleted object, because a `disappear` job may use its id.
            arguments[name] = Node(engine.model, int(value)) if shape.is_object(place) else value
        for name, other in (("engine", engine), ("match", match), ("old", old)):
            if name in taken:
                arguments[name] = other
        return function(**arguments)

    return do


def _bind_named(engine: Engine, shape: Shape, name: str) -> BoundJob:
    signature = engine.signature(name)
    qualified = signature.name
    required = [parameter.name for parameter in signature.parameters if parameter.is_required]
    if signature.kind == "rule":
        runner = engine.prepare(qualified)
        known = runner.shape.names
        required = [*required, *runner.inputs]
    else:
        known = tuple(parameter.name for parameter in signature.parameters if not parameter.is_output)
    missing = [f"`{parameter}`" for parameter in dict.fromkeys(required) if parameter not in shape.names]
    if missing:
        raise InvalidArgument(
            f"{signature.kind} `{name}` needs {', '.join(missing)}, which is no variable of `{shape.definition}`"
        )
    places = [(variable, shape.position(variable)) for variable in known if variable in shape.names]

    def do(match: Match, _: Match | None) -> object:
        objects = [match.row[place] for _, place in places if shape.is_object(place)]
        if not all(engine.model.graph.alive(int(node)) for node in objects):
            return None
        arguments = {variable: match.row[place] for variable, place in places}
        result = engine.run(qualified, bound=arguments)
        if result.refusal is not None:  # raised here because the result of a job is not used
            raise result.refusal
        return result

    return do


def job_name(job: Job) -> str:
    """Return the name of a job: the job itself if it is a name, or else the name of the function or of its class."""
    return job if isinstance(job, str) else getattr(job, "__name__", type(job).__name__)


def check_not_deferred(function: Callable[..., object]) -> None:
    """Refuse coroutine and generator functions, because calling them does not execute their body.

    Raises:
        InvalidArgument: the function is a coroutine or a generator.
    """
    for kind, found in (("a coroutine", iscoroutinefunction), ("a generator", isgeneratorfunction)):
        if found(function):
            name = getattr(function, "__name__", type(function).__name__)
            raise InvalidArgument(f"`{name}` is {kind}, whose body a call does not execute; use an ordinary function")
