"""Check names and types of all definitions of a workspace against its metamodel and against each other."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

from envgraph.errors import MAX_ERRORS, Diagnostic, EvaluationError, Note, Severity, duplicate_diagnostics
from envgraph.graph import Model, Violation, check_conformance
from envgraph.lang.loading._workspace import Workspace
from envgraph.lang.read._model_reader import ModelText
from envgraph.lang.syntax._file_formats import HEAD_BYTES, format_of, namespace_of
from envgraph.metamodel import Reference
from envgraph.pattern import FunctionDeclaration
from envgraph.rewrite import Engine

if TYPE_CHECKING:  # This is loaded with the first environment.
    from envgraph.behaviour import Behaviour


def check_workspace(workspace: Workspace) -> list[Diagnostic]:
    """Return the diagnostics for all patterns, rules, units, derivations and behaviours of a workspace.

    Without a metamodel, report only environments of the same name, and the missing metamodel if a file needs it.
    """
    named = ((one.name, one.span) for one in workspace.behaviours)
    problems = list(duplicate_diagnostics(named, "environment `{}` is defined twice"))
    if workspace.registration is None or workspace.metamodel is None:
        return [*problems, *_missing_metamodel(workspace)]
    problems += workspace.registration.problems
    if workspace.behaviours:
        from envgraph.behaviour import check_behaviour

        engine = Engine(Model(workspace.metamodel))
        engine.registrar.add_sound(workspace.registration)
        for behaviour in workspace.behaviours:
            problems += check_behaviour(behaviour, engine)
    return problems


def conformance_warnings(text: ModelText) -> list[Diagnostic]:
    """Return a warning for each violation of the metamodel by a model; beyond a limit, one warning counts the others.

    These are warnings, not errors, because a model may be edited while it does not conform.
    """
    if text.model is None:
        return []
    alike: dict[object, list[Violation]] = {}
    for one in check_conformance(text.model):  # numbers of a legend or a table occur at many objects
        number = one.message.rpartition(" has ")[2] if one.kind == "outside-range" else one
        alike.setdefault((one.feature, number), []).append(one)
    violations, found = [*alike.values()], []
    for first, *others in violations[:MAX_ERRORS]:
        code = "outside-range" if first.kind == "outside-range" else "conformance"
        message = first.message + (f", and {len(others)} more like it" if others else "")
        hint = _completion_hint(first, text.model, text.span.source.text.lstrip()[:1])
        place = text.spans.get(first.node, text.span)
        found.append(Diagnostic(code, message, place, hint, Severity.WARNING))
    if len(violations) > MAX_ERRORS:
        message = f"{len(violations) - MAX_ERRORS} more warnings of this kind are not shown"
        found.append(replace(found[-1], message=message, hint=None))
    return found


def check_start(behaviour: Behaviour, text: ModelText, notes: tuple[Note, ...] = ()) -> list[Diagnostic]:
    """Return the problems of a model as the start of episodes: objects of one key, and unbound names, with `notes`."""
    from envgraph.behaviour import DuplicateKeyError, KeyIndex, indexed_classes, unbound_names

    assert text.model is not None, "the files have no errors"
    found = [replace(one, notes=(*one.notes, *notes)) for one in unbound_names(behaviour, text.model, text.spans)]
    lacking: dict[object, Diagnostic] = {}
    for cls in indexed_classes(behaviour, text.model.metamodel):
        try:
            KeyIndex.of_model(text.model, [cls])
        except EvaluationError as error:
            first, last = map(text.spans.get, error.nodes) if isinstance(error, DuplicateKeyError) else (None, None)
            hint = "give each of these objects a different key: the environment numbers them by key"
            other = (Note("the other object is here", first),) if first else ()
            span = last or text.span  # objects of a superclass, too, are reported once
            lacking.setdefault(span, Diagnostic("no-key", error.message, span, hint, notes=other))
    return [*found, *lacking.values()]


def _completion_hint(violation: Violation, model: Model, start: str) -> str:
    """Return a hint that mends a violation, in the syntax of the file; `start` is the file's first character."""
    feature = violation.feature
    if violation.kind == "outside-range":
        return f"write a number in this range, or change the `@range` of `{feature}` in the metamodel"
    if violation.kind == "too-many":
        return f"remove some of `{feature.name}`"
    if violation.kind == "too-few" and isinstance(feature, Reference) and model.graph.targets(violation.node, feature):
        return f"add more to its `{feature.name}`"
    many = isinstance(feature, Reference) and feature.many
    if start == "{":
        return f'add `"{feature.name}": {"[..]" if many else ".."}` to its features'
    if start == "<":
        inside = isinstance(feature, Reference) and feature.containment
        return f"add a tag `<{feature.name} ..>` inside" if inside else f'add `{feature.name}="..."`'
    return f"add `{feature.name} = {'[..]' if many else '..'}`"


def _missing_metamodel(workspace: Workspace) -> list[Diagnostic]:
    """Return a diagnostic if a file needs a metamodel, but no file is or imports one; otherwise an empty list.

    The list is also empty if a file could not be read completely, because the metamodel may be imported there.
    """
    formats = [format_of(name, text[:HEAD_BYTES].encode()) for name, text in workspace.sources.items()]
    if workspace.unknown.all or {"metamodel", "ecore"} & set(formats):
        return []
    about = (one for one in workspace.definitions if not isinstance(one, FunctionDeclaration))
    needing = [one.span for one in (*about, *workspace.behaviours) if one.span]
    ours = [one.span for one in workspace.models if one.span.source.text.lstrip()[:1] not in ("<", "{")]
    needing = ours + needing
    hint = 'write `import "name.metamodel"` at the top' + ("" if ours else ", or load this file together with a model")
    if not needing:
        needing = [text.span for text in workspace.models]
        hint = "load its `.ecore` or `.metamodel` file too, for example with `--metamodel`"
    uri = namespace_of(needing[0].source.text) if needing else None
    message = f"no metamodel with the namespace `{uri}` is given" if uri else "no file imports a metamodel"
    return [Diagnostic("no-metamodel", message, span, hint) for span in needing[:1]]
