"""The commands `envgraph match` and `envgraph apply`: print matches of patterns, and apply rules to models."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from secrets import randbits
from shlex import quote
from typing import Any

from envgraph.cli._inputs import (
    DEFINITIONS,
    DEFINITIONS_PHRASE,
    MODEL_PHRASE,
    MODELS,
    Inputs,
    check_file_format,
)
from envgraph.cli._output import print_json, print_line, print_lines, print_table
from envgraph.code import dataclass
from envgraph.errors import InvalidArgument, check_known, list_names, name_hint, parse_int, quote_with_article
from envgraph.files import replace_file
from envgraph.graph import Model, Node, model_from_json, value_text
from envgraph.lang import Workspace, bundled_domains
from envgraph.metamodel import Attribute, EnumType, Scalar, Value, parse_value, type_name
from envgraph.pattern import ObjectType, StaticType
from envgraph.rewrite import Application, Engine, Firing, RunResult, Signature, trace_to_text

_EXAMPLE_VALUES = {Scalar.INT: "3", Scalar.FLOAT: "2.5", Scalar.BOOL: "true"}
"""An example value of each type, for messages."""


def print_matches(model: str, queries: str, pattern: str | None, where: Sequence[str], inputs: Inputs) -> None:
    """Print the matches of a pattern in a model; if `pattern` is None, list the patterns that can be matched."""
    engine = open_engine(model, queries, inputs)
    if pattern is None:
        _list_patterns(engine)
        return
    bound = parse_values(engine, _variable_types(engine, pattern), where)
    matches = engine.matches(pattern, bound=bound)
    if print_json(lambda: [{name: _json_value(match[name]) for name in match.names} for match in matches]):
        return
    if not matches:
        print_line(f"no match of {pattern}")
        return
    names = matches[0].names
    count = f"{len(matches)} match{'es' if len(matches) > 1 else ''} of {pattern}"
    print_table(count, names or ("",), [tuple(value_text(match[name]) for name in names) for match in matches])


def _list_patterns(engine: Engine) -> None:
    """Print the names and parameters of the patterns that are not private."""
    patterns = {
        one.qualified_name: [parameter.name for parameter in one.parameters]
        for one in engine.library.patterns
        if not one.private and "#" not in one.qualified_name
    }
    if print_json(lambda: [{"pattern": name, "parameters": found} for name, found in patterns.items()]):
        return
    if not patterns:
        print_line("there are no patterns")
        return
    print_table("patterns", ("pattern", "parameters"), [(name, ", ".join(found)) for name, found in patterns.items()])


def open_engine(model: str, definitions: str, inputs: Inputs, seed: int = 0) -> Engine:
    """Return an engine on a model file (`.model`, `.xmi` or JSON) or a member of a run, with the definitions of a file.

    Search plans use the current sizes of the model.

    Raises:
        InvalidArgument: the file, run or variant does not exist.
        LoadError: the files have errors, or the model does not belong to their metamodel.
    """
    return open_with_workspace(model, definitions, inputs, seed)[0]


def open_with_workspace(model: str, definitions: str, inputs: Inputs, seed: int = 0) -> tuple[Engine, Workspace]:
    """Return the engine of `open_engine` and the workspace of its files."""
    if inputs.variant is None:
        check_file_format(model, (*MODELS, "toml"), MODEL_PHRASE)
        if not Path(model).exists() and "." not in Path(model).name and model not in bundled_domains():
            hint = "for a run or family, add an environment: `--variant E1`"
            raise InvalidArgument(f"`{model}` is not a file", hint)
    if not Path(definitions).exists() and "." not in Path(definitions).name:
        hint = "write the model first, then the file with rules or patterns, then a name in it"
        raise InvalidArgument(f"`{definitions}` is not a file: {hint}")
    check_file_format(definitions, DEFINITIONS, DEFINITIONS_PHRASE)
    if inputs.variant is None:
        workspace = inputs.load(definitions, model, counts_warnings_of=definitions)
        engine = workspace.engine(seed=seed)
    else:
        workspace = inputs.load(definitions, counts_warnings_of=definitions)
        engine = _engine_on_member(model, inputs.variant, workspace, seed)
    engine.analyze()
    return engine, workspace


def _engine_on_member(run: str, variant: str, workspace: Workspace, seed: int) -> Engine:
    """Return an engine on the model of a member of a run or family, with the definitions of a workspace."""
    from envgraph.search import open_family

    family = open_family(run)
    member = family.member(variant)
    assert workspace.metamodel is not None, "definitions without errors have one"
    model = model_from_json(member.model, workspace.metamodel, file=f"{family.name}/{member.name}")
    engine = Engine(model, seed=seed)
    engine.add(*workspace.definitions)
    return engine


def write_model(engine: Engine, output: Path) -> None:
    """Write the model of an engine, and print the path."""
    from envgraph.cli._convert_command import (
        model_text,  # `envgraph match` does not need the writers of files.
    )

    replace_file(output, model_text(engine.model, output))
    print_line(f"wrote {output}")


def apply_rule(
    model: str,
    rules: str,
    rule: str,
    where: Sequence[str],
    *,
    inputs: Inputs,
    times: int,
    seed: int | None,
    output: Path | None,
    trace: Path | None,
    allow_none: bool,
) -> int:
    """Apply a rule or unit up to `times` times and print each application.

    Return 1 if there was no application or a unit failed, and `allow_none` is False; otherwise 0.
    """
    from envgraph.cli._convert_command import check_format
    from envgraph.graph import model_to_json

    if output is not None:
        check_format(output)
    engine = open_engine(model, rules, inputs, randbits(63) if seed is None else seed)
    signature = engine.signature(rule)
    taken = (*signature.parameters, *signature.variables)
    bound = parse_values(engine, {one.name: one.type for one in taken}, where)
    add_unique_arguments(engine, signature, bound)
    named = {node.id: value_text(node) for node in engine.model.nodes()}
    done: list[dict[str, Any]] = []
    lines: list[str] = []
    failed: RunResult | None = None
    with engine.recording() as recorded:
        for number in range(1, times + 1):
            steps, failed = _apply_once(engine, rule, bound, named)
            if steps:
                done.append({"application": number, "steps": [step.data for step in steps]})
                lines += [f"{number}: {step.text}" for step in steps]
            if failed is not None or not steps:
                break
    if trace is not None:
        replace_file(trace, trace_to_text(engine, recorded))
    result = {"rule": rule, "applications": done, "failure": failed.reason if failed is not None else None}
    print_json(lambda: {**result, "model": model_to_json(engine.model)})
    for line in lines:
        print_line(line)
    if failed is not None:
        print_line(f"{rule} failed: {failed.reason}")
        if failed.span is not None:
            print_lines(failed.span.excerpt())
    elif len(done) < times:
        print_line(f"no match of {rule}" + (f" after {len(done)} applications" if done else ""))
    if trace is not None:
        print_line(f"wrote {trace}")
    if output is not None:
        write_model(engine, output)
    return int(not (allow_none or (done and failed is None)))


def add_unique_arguments(engine: Engine, signature: Signature, bound: dict[str, Any]) -> None:
    """Add to `bound` the values of required parameters of a rule or unit where only one object is possible.

    Raises:
        InvalidArgument: a required value is missing and is not unique.
    """
    needed: Iterable[str] = ()
    if signature.kind == "unit":
        needed = [one.name for one in signature.parameters if one.is_required]
    elif signature.kind == "rule":
        needed = engine.prepare(signature.name).inputs
    model, types = engine.model, {one.name: one.type for one in signature.parameters}
    missing: dict[str, str] = {}
    for name in needed:
        if name not in bound:
            type_ = types.get(name)
            objects = model.graph.extent(type_.cls) if isinstance(type_, ObjectType) else ()
            if len(objects) == 1:
                bound[name] = model.node(objects[0])
            else:
                missing[name] = model.graph.display_name(objects[0]) or str(objects[0]) if objects else ".."
    if missing:
        options = " ".join(f"--where {quote(f'{name}={value}')}" for name, value in missing.items())
        raise InvalidArgument(f"`{signature.simple_name}` needs a value for {list_names(missing)}; write `{options}`")


@dataclass(frozen=True, slots=True)
class _AppliedStep:
    """A rule application as text and as JSON-ready data."""

    text: str
    data: dict[str, Any]


def _apply_once(
    engine: Engine, rule: str, bound: dict[str, Any], named: dict[int, str]
) -> tuple[list[_AppliedStep], RunResult | None]:
    """Return the steps of one application (none without a match), and the result of a unit if it failed, or None.

    `named` has the names of the objects before any of them was deleted; the names of created objects are added.
    """
    if engine.signature(rule).kind == "unit":
        result = engine.run(rule, bound=bound)
        return [_trace_step(engine, firing, named) for firing in result.firings], None if result else result
    application = engine.apply(rule, bound=bound)
    if application is not None:
        named.update((node.id, value_text(node)) for node in application.created.values())
    return [] if application is None else [_application_step(engine, application, named)], None


def _trace_step(engine: Engine, firing: Firing, named: Mapping[int, str]) -> _AppliedStep:
    """Return a rule application as a step.

    An object that this or a later application deleted is shown as in `named`, or else by its id.
    """
    shape, model, shown = engine.prepare(firing.rule).shape, engine.model, []
    match: dict[str, Any] = {}
    for position, (name, value) in enumerate(zip(shape.names, firing.values, strict=True)):
        if shape.is_object(position) and isinstance(value, int) and model.graph.alive(value):
            match[name] = _json_value(model.node(value))
            shown.append(f"{name}={value_text(model.node(value))}")
        elif shape.is_object(position) and isinstance(value, int):
            match[name] = {"id": value, "deleted": True}
            shown.append(f"{name}={named.get(value, f'#{value}')} (deleted)")
        else:
            match[name] = value
            shown.append(f"{name}={value_text(value)}")
    return _AppliedStep(f"{firing.rule}({', '.join(shown)})", {"rule": firing.rule, "match": match})


def _application_step(engine: Engine, application: Application, named: Mapping[int, str]) -> _AppliedStep:
    step, nodes = _trace_step(engine, application.firing, named), application.created
    created = "".join(f"; created {value_text(node)}" for node in nodes.values())
    created_data = {name: _json_value(node) for name, node in nodes.items()}
    return _AppliedStep(step.text + created, {**step.data, "created": created_data})


def _variable_types(engine: Engine, name: str) -> Mapping[str, StaticType | None]:
    """Return the types of the variables in a match of a pattern or of a rule's left-hand side."""
    with suppress(InvalidArgument):
        signature = engine.signature(name)
        return {one.name: one.type for one in (*signature.parameters, *signature.variables)}
    return pattern_parameter_types(engine, name)


def pattern_parameter_types(engine: Engine, pattern: str) -> dict[str, StaticType]:
    """Return the types of the parameters of a pattern; raise InvalidArgument if it is unknown or private."""
    found = engine.library.resolve(pattern)
    if found is None:
        private = [one for one in engine.library.patterns if one.private]
        if any(pattern in {one.name, one.qualified_name} for one in private):
            raise InvalidArgument(f"pattern `{pattern}` is private: it can be used in its own file only")
        simple = [one.name for one in engine.library.patterns if not one.private]
        hint = name_hint(pattern, simple if "." not in pattern else engine.library.names())
        raise InvalidArgument(f"unknown pattern `{pattern}`", hint)
    types = engine.library.parameter_types(found.qualified_name)
    return {parameter.name: type_ for parameter, type_ in zip(found.parameters, types, strict=True)}


def parse_values(engine: Engine, types: Mapping[str, StaticType | None], where: Sequence[str]) -> dict[str, Any]:
    """Parse `NAME=VALUE` arguments into objects and values, according to the types of the variables.

    Raises:
        InvalidArgument: an argument has another form, its name is unknown or repeated, or its value does not fit.
    """
    bound: dict[str, Any] = {}
    for text in where:
        name, equals, value = text.partition("=")
        if not equals:
            raise InvalidArgument(f"`{text}` is not of the form NAME=VALUE; write `--where {name}=..`")
        check_known(name, types, f"unknown variable `{name}`")
        if name in bound:
            raise InvalidArgument(f"`{name}` is given twice")
        bound[name] = _parse_value(engine, name, value, types[name])
    return bound


def _parse_value(engine: Engine, name: str, text: str, type_: StaticType | None) -> Node | Value:
    if isinstance(type_, ObjectType):
        found = engine.model.graph.find_object(text)
        if found is None:
            called = _object_names(engine.model, type_.cls)
            found = next((node for node, names in called.items() if text in names), None)
        if found is None and (number := parse_int(text)) is not None and engine.model.graph.alive(number):
            found = number
        if found is None:
            raise InvalidArgument(
                f"`{name}`: the model has no object `{text}`; {_objects_hint(engine, text, type_.cls)}"
            )
        cls = engine.model.graph.class_of(found)
        if not engine.model.metamodel.is_a(cls, type_.cls):
            raise InvalidArgument(
                f"`{name}` must be {quote_with_article(type_.cls)}, but `{text}` is {quote_with_article(cls)}; "
                f"{_objects_hint(engine, '', type_.cls)}"
            )
        return engine.model.node(found)
    if isinstance(type_, EnumType):
        text = text.removeprefix(type_.name).removeprefix("::")  # The languages also allow the prefix.
        check_known(text, type_.literals, f"`{name}`: `{type_.name}` has no literal `{text}`")
        return text
    value = parse_value(text, type_) if type_ else text
    if value is None:
        raise InvalidArgument(
            f"`{name}` must be {quote_with_article(type_name(type_)) if type_ else 'a value'}, not `{text}`"
            + (f"; write `--where {name}={_EXAMPLE_VALUES[type_]}`" if type_ in _EXAMPLE_VALUES else "")
        )
    return value


def _object_names(model: Model, cls: str) -> dict[int, tuple[str, ...]]:
    """Return the names by which the command line may refer to each object of a class, the preferred name first.

    These are the name in the file, the cell in a grid, the values of the key, and the printed form: `Box {label = a}`.
    """
    found: dict[int, tuple[str, ...]] = {}
    for node in model.graph.extent(cls):
        key = model.metamodel.key(model.graph.class_of(node))
        name = model.graph.display_name(node)
        title = [name] if name else []
        values = [", ".join(str(model.node(node)[each]) for each in key)] if key else []
        found[node] = (*title, *values, model.graph.describe(node).strip("`"))
    return found


def _objects_hint(engine: Engine, text: str, cls: str) -> str:
    """Return a hint with objects of a class whose names are similar to `text`, or with all of them if `text` is ""."""
    names = [called[0] for called in _object_names(engine.model, cls).values()]
    return name_hint(text, names) or "" if names else f"the model has no `{cls}`"


def _json_value(value: Node | Value) -> Any:
    """Return an object as JSON-ready data (class, id, name and attributes); return any other value unchanged."""
    if not isinstance(value, Node):
        return value
    features = value.model.metamodel.features(value.cls).values()
    attributes = {
        one.name: list(value[one.name]) if one.many else value[one.name]
        for one in features
        if isinstance(one, Attribute)
    }
    return {
        "class": value.cls,
        "id": value.id,
        "name": value.model.graph.object_name(value.id),
        "attributes": attributes,
    }
