"""`envgraph explain` and `envgraph why-not`."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from contextlib import suppress
from typing import Any

from envgraph.cli._inputs import Inputs
from envgraph.cli._output import print_json, print_lines
from envgraph.cli._query import complete, open_both, parse_values, pattern_types
from envgraph.errors import InvalidArgument, Span, did_you_mean, nearest
from envgraph.lang import Workspace
from envgraph.match import WhyNot
from envgraph.metamodel import Value
from envgraph.pattern import StaticType
from envgraph.rewrite import Engine


def print_plan(model: str, definitions: str, name: str, where: Sequence[str], inputs: Inputs) -> None:
    """Print how matches of a pattern or rule are found, or what steps an environment."""
    engine, workspace = open_both(model, definitions, inputs)
    behaviour = next((one for one in workspace.behaviours if one.name == name), None)
    if behaviour is not None:
        from envgraph.env.compiled import explanation  # Gymnasium takes long to import

        text = explanation(engine, behaviour)
    else:
        _check_name(engine, workspace, name)
        text = engine.explain(name, bound=parse_values(engine, _types(engine, name, bool(where)), where))
    print_json(lambda: {"name": name, "explanation": text})
    print_lines(text)


def print_reasons(model: str, definitions: str, name: str, where: Sequence[str], inputs: Inputs) -> None:
    """Print why there is no match, or which there is."""
    engine, workspace = open_both(model, definitions, inputs)
    if name in {one.name for one in workspace.behaviours} and not _means(engine, name):
        hint = "`envgraph explain` says what steps it"
        raise InvalidArgument(f"`{name}` is an environment, which has no matches", hint)
    bound = parse_values(engine, _types(engine, name, bool(where)), where)
    if engine.library.resolve(name) is None:
        signature = None
        with suppress(InvalidArgument):  # the question itself says best that there is no such name
            signature = engine.signature(name)
        if signature is not None:
            complete(engine, signature, bound)
    why = engine.why_not(name, bound=bound)
    if print_json(lambda: _data(why, engine)):
        return
    print_lines(str(why))
    for span in _spans(why):
        print_lines(f"\n{span}\n{span.excerpt()}")


def _check_name(engine: Engine, workspace: Workspace, name: str) -> None:
    """Says of a name that means nothing which environment it nearly is; else the question itself says it best.

    Raises:
        InvalidArgument: it is nearly an environment, or nothing that was read and so perhaps one.
    """
    environments = [one.name for one in workspace.behaviours]
    near = nearest(name, [*environments, *(one.name for one in workspace.definitions)])
    if _means(engine, name) or (near is not None and near not in environments):
        return
    unread = None if environments else "an environment is found in its own file: give the `.environment` file"
    hint = did_you_mean(name, [near] if near else []) or unread
    raise InvalidArgument(f"unknown pattern, rule or environment `{name}`", hint)


def _means(engine: Engine, name: str) -> bool:
    """Return whether a pattern, rule, unit or group has a name."""
    if engine.library.resolve(name) is not None:
        return True
    try:
        engine.signature(name)
    except InvalidArgument:
        return False
    return True


def _types(engine: Engine, name: str, given: bool) -> Mapping[str, StaticType | None]:
    """Return what can be given for a pattern, rule or unit."""
    if engine.library.resolve(name) is not None:
        return pattern_types(engine, name)
    if not given:  # the question itself says best that there is no such name
        return {}
    signature = engine.signature(name)
    return {one.name: one.type for one in (*signature.parameters, *signature.variables)}


def _spans(why: WhyNot) -> Iterable[Span]:
    """Return where the constraints that fail are written, the innermost last; each once."""
    found: dict[tuple[str, int], Span] = {}
    for failure in why.failures:
        spans = [failure.span] if failure.span else []
        for span in (*spans, *(_spans(failure.inner) if failure.inner else ())):
            found.setdefault((span.source.name, span.start), span)
    return found.values()


def _data(why: WhyNot, engine: Engine) -> dict[str, Any]:
    """As JSON-ready data; objects as in messages."""

    def shown(values: Mapping[str, Value], objects: Iterable[str]) -> dict[str, Any]:
        known = set(objects)
        return {
            name: engine.model.graph.describe(int(value)) if name in known else value
            for name, value in values.items()
        }

    return {
        "name": why.pattern,
        "kind": why.kind,
        "given": shown(why.given, why.objects),
        "match": None if why.match is None else shown(why.match, why.objects),
        "refusal": str(why.refusal) if why.refusal else None,
        "failures": [
            {
                "body": failure.body,
                "found": shown(failure.found, failure.objects),
                "constraint": failure.constraint,
                "place": str(failure.span) if failure.span else None,
                "witness": failure.witness
                and {
                    "found": shown(failure.witness.found, failure.witness.objects),
                    "links": [
                        [engine.model.graph.describe(source), link, engine.model.graph.describe(target)]
                        for source, link, target in failure.witness.links
                    ],
                },
                "inner": failure.inner and _data(failure.inner, engine),
            }
            for failure in why.failures
        ],
    }
