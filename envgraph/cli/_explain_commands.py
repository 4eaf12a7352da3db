"""The commands `envgraph explain` and `envgraph why-not`: print search plans, and reasons for missing matches."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from contextlib import suppress
from typing import Any

from envgraph.cli._inputs import Inputs
from envgraph.cli._match_and_apply import (
    add_unique_arguments,
    open_with_workspace,
    parse_values,
    pattern_parameter_types,
)
from envgraph.cli._output import print_json, print_lines
from envgraph.editor import why_not_text
from envgraph.errors import InvalidArgument, did_you_mean, most_similar
from envgraph.lang import Workspace
from envgraph.match import WhyNot
from envgraph.metamodel import Value
from envgraph.pattern import StaticType
from envgraph.rewrite import Engine


def print_plan(model: str, definitions: str, name: str, where: Sequence[str], inputs: Inputs) -> None:
    """Print the search plan of a pattern or rule; for an environment, print whether it can be compiled."""
    engine, workspace = open_with_workspace(model, definitions, inputs)
    behaviour = next((one for one in workspace.behaviours if one.name == name), None)
    if behaviour is not None:
        from envgraph.env.compiled import explain_compilation  # Importing Gymnasium is slow.

        text = explain_compilation(engine, behaviour)
    else:
        _check_name(engine, workspace, name)
        bound = parse_values(engine, _variable_types(engine, name, bool(where)), where)
        _add_unique_arguments(engine, name, bound)
        text = engine.explain(name, bound=bound)
    print_json(lambda: {"name": name, "explanation": text})
    print_lines(text)


def print_reasons(model: str, definitions: str, name: str, where: Sequence[str], inputs: Inputs) -> None:
    """Print why a pattern, rule or unit has no match, or print the match if it has one."""
    engine, workspace = open_with_workspace(model, definitions, inputs)
    if name in {one.name for one in workspace.behaviours} and not _is_defined(engine, name):
        hint = "use `envgraph explain` to see how it is run"
        raise InvalidArgument(f"`{name}` is an environment, which has no matches", hint)
    bound = parse_values(engine, _variable_types(engine, name, bool(where)), where)
    _add_unique_arguments(engine, name, bound)
    why = engine.why_not(name, bound=bound)
    if print_json(lambda: _reasons_data(why, engine)):
        return
    print_lines(why_not_text(why))


def _add_unique_arguments(engine: Engine, name: str, bound: dict[str, Any]) -> None:
    """Add values to `bound` as `add_unique_arguments` does, if the name is that of a rule or unit."""
    if engine.library.resolve(name) is None:
        signature = None
        with suppress(InvalidArgument):  # The engine itself reports an unknown name best.
            signature = engine.signature(name)
        if signature is not None:
            add_unique_arguments(engine, signature, bound)


def _check_name(engine: Engine, workspace: Workspace, name: str) -> None:
    """Raise an error with a hint for an unknown name, unless it is similar to the name of a pattern or rule.

    Such a name is left to `engine.explain`, whose error is more exact.

    Raises:
        InvalidArgument: the unknown name is similar to that of an environment, or to nothing.
    """
    environments = [one.name for one in workspace.behaviours]
    near = most_similar(name, [*environments, *(one.name for one in workspace.definitions)])
    if _is_defined(engine, name) or (near is not None and near not in environments):
        return
    unread = None if environments else "for an environment, give its `.environment` file"
    hint = did_you_mean(name, [near] if near else []) or unread
    raise InvalidArgument(f"unknown pattern, rule or environment `{name}`", hint)


def _is_defined(engine: Engine, name: str) -> bool:
    """Return True if a pattern, rule, unit or group has this name."""
    if engine.library.resolve(name) is not None:
        return True
    try:
        engine.signature(name)
    except InvalidArgument:
        return False
    return True


def _variable_types(engine: Engine, name: str, has_values: bool) -> Mapping[str, StaticType | None]:
    """Return the types of the variables to which `--where` can give values, by name; `has_values` tells if it is used.

    For a rule without `--where`, return an empty mapping, without checking the name.
    """
    if engine.library.resolve(name) is not None:
        return pattern_parameter_types(engine, name)
    if not has_values:  # `engine.explain` itself reports an unknown name best.
        return {}
    signature = engine.signature(name)
    return {one.name: one.type for one in (*signature.parameters, *signature.variables)}


def _reasons_data(why: WhyNot, engine: Engine) -> dict[str, Any]:
    """Return the reasons as JSON-ready data; objects are described by texts, as in messages."""

    def shown(values: Mapping[str, Value], objects: Iterable[str]) -> dict[str, Any]:
        known = set(objects)
        return {
            name: engine.model.graph.describe(int(value)) if name in known else value for name, value in values.items()
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
                "inner": failure.inner and _reasons_data(failure.inner, engine),
            }
            for failure in why.failures
        ],
    }
