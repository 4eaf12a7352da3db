"""Check the initial model of a domain, from which a family is generated."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from math import inf
from re import fullmatch
from typing import TYPE_CHECKING

from envgraph.behaviour import key_reader, ranged_classes
from envgraph.errors import Diagnostic, LoadError, Note, Severity, has_errors, sort_diagnostics
from envgraph.graph import Model
from envgraph.lang import check_start
from envgraph.pattern import Derivation
from envgraph.rewrite import Engine
from envgraph.search.domain._constraints import OutcomeReachable
from envgraph.search.problem._individual_measures import ShortestPlan
from envgraph.search.problem._problem import Constraint, Forbid, MatchCountWithin, MissingValueError, Problem, Require
from envgraph.search.problem._statistics import BinnedEntropy

if TYPE_CHECKING:
    from envgraph.search.domain._domain import Domain


def check_initial(domain: Domain, problem: Problem, search: bool) -> list[Diagnostic]:
    """Check the initial model as `Domain.check_initial` does: return warnings, or raise `LoadError`."""
    note = Note("the initial model is here", domain.spec.model.span)
    found = _check_demanded_diversity(domain, problem)
    found += [one for one in domain.workspace.diagnostics if one.code == "outside-range"]
    if domain.behaviour is not None:
        found += check_start(domain.behaviour, domain.model_text, (note,))
    found += _check_constraints(domain, problem, note, of_states=False)
    if not has_errors(found):
        found += _check_object_names(domain, problem.engine)
        # States are searched last, because that takes long and assumes a model that is otherwise valid.
        found += _check_by_search(domain, problem, note) if search else ()
    if has_errors(found):
        raise LoadError(sort_diagnostics(found))
    return found


def _check_by_search(domain: Domain, problem: Problem, note: Note) -> list[Diagnostic]:
    """Return an error if the model violates a constraint on states or lacks a value of a measure, else warnings."""
    if broken := _check_constraints(domain, problem, note, of_states=True):
        return broken
    try:
        return _check_diversity_range(domain, problem, problem.compute_measures())
    except MissingValueError as error:
        measure = next(one for one in domain.spec.measures if one.name == error.measure)
        message = f"the initial model has no value of `{error.measure}`"
        hint = "write `otherwise = 0`, or another number to use for models without a value"
        if isinstance(plan := problem.measures[error.measure], ShortestPlan):
            evidence, missed = plan.why_no_plan(problem.engine)
            message, hint = f"{message}: {evidence}", "; ".join(filter(None, (missed, hint)))
        return [Diagnostic("no-value", message, measure.span(), hint, notes=(note,))]


def _check_constraints(domain: Domain, problem: Problem, note: Note, of_states: bool) -> list[Diagnostic]:
    """Return an error for each violated constraint: those on states, or those of `[constraints]` on the model alone."""
    spec = domain.spec
    named = {
        **{f"require {name}": name.span for name in spec.constraints.require},
        **{f"forbid {name}": name.span for name in spec.constraints.forbid},
        **{str(MatchCountWithin(str(name), *bounds)): name.span for name, bounds in spec.constraints.count},
        **{f"reachable {name}": name.span for name in spec.constraints.reachable},
    }
    tried = [one for one in problem.constraints if of_states != isinstance(one, Require | Forbid | MatchCountWithin)]
    violated = {str(one): _violation_evidence(problem.engine, one) for one in tried if not one.holds(problem.engine)}
    return [
        Diagnostic(
            "initial-model-invalid",
            f"the initial model violates `{constraint}`{evidence}",
            named.get(constraint, spec.model.span),
            hint or "change the model or the constraint: a family begins with a model that satisfies all constraints",
            notes=(note,) if constraint in named else (),
        )
        for constraint, (evidence, hint) in sorted(violated.items())
    ]


def _check_demanded_diversity(domain: Domain, problem: Problem) -> list[Diagnostic]:
    """Return an error if an objective demands more diversity than a family can have, or an unknown maximum; else []."""
    objective, size = domain.spec.objective, domain.spec.search.population
    demanded = None if objective is None else objective.options.get("diversity")
    most = problem.largest_diversity(size)
    if (
        objective is None
        or not domain.spec.searches_whole_families
        or demanded is None
        or (demanded == "maximum" and most < inf)
    ):
        return []
    message, hint = f"the diversity of {size} members is at most {most:g}", 'write `diversity = "maximum"`'
    if demanded == "maximum":
        message = f"the largest possible diversity by `{domain.spec.diversity.kind}` is unknown"
        hint = "write a number, such as `diversity = 1.5`: the least diversity of a family"
    elif isinstance(demanded, int | float) and demanded <= most:
        return []
    return [Diagnostic("bad-range", message, objective.span("diversity"), hint)]


def _check_diversity_range(domain: Domain, problem: Problem, measures: Mapping[str, float]) -> list[Diagnostic]:
    """Return a warning if the diversity's measure of the initial model is outside of the range of the bins; else []."""
    diversity, value = problem.diversity, measures[problem.diversity_measure_name]
    if not domain.spec.uses_diversity:
        return []
    if not isinstance(diversity, BinnedEntropy) or diversity.low <= value <= diversity.high:
        return []
    end = "first" if value < diversity.low else "last"
    message = (
        f"`{problem.diversity_measure_name}` of the initial model is {value:g}, outside of the range "
        f"{diversity.low:g} to {diversity.high:g}, so that it counts in the {end} bin"
    )
    low, high = min(0.0, 2 * value), max(0.0, 2 * value)
    span = domain.spec.diversity.span("range" if "range" in domain.spec.diversity.options else "kind")
    hint = f"write the range of all possible values, such as `range = [{low:g}, {high:g}]`, in `[diversity]`"
    return [Diagnostic("outside-range", message, span, hint, Severity.WARNING)]


def _check_object_names(domain: Domain, engine: Engine) -> list[Diagnostic]:
    """Return warnings for objects of the initial model that mutations may delete, but whose names are not reused.

    Each class gets at most one warning. The environment indexes objects by name, so that each new name makes actions or
    observations larger.
    """
    metamodel, behaviour, found = domain.metamodel, domain.behaviour, list[Diagnostic]()
    spread = ranged_classes(behaviour, metamodel) if behaviour else ()
    counted = dict.fromkeys(cls for top in spread for cls in metamodel.concrete_classes(top))
    for group in _deleting_and_creating_groups(domain, engine):
        for cls in metamodel.concrete_classes(group.classes[0]):
            node, name = next(_unusual_names(engine.model, cls), (None, ""))
            if cls in counted and node is not None:
                message = (
                    f"`{group.name}` may delete `{name}`, and names the objects that it creates `{cls}1`, `{cls}2` "
                    "and so on"
                )
                hint = f"rename it to `{cls}1`, so that actions and observations of the family have no unused entries"
                place = domain.model_text.spans.get(node) or group.span
                found.append(Diagnostic("other-names", message, place, hint, Severity.WARNING))
    return found


def _deleting_and_creating_groups(domain: Domain, engine: Engine) -> Iterator[Derivation]:
    """Yield the derived operator groups among the mutations that both create and delete objects."""
    mutations = set(map(str, domain.spec.mutation.rules))
    for group in domain.workspace.derivations:
        name = group.qualified_name
        if group.kind == "operators" and mutations & {group.name, name}:
            kinds = {one.removeprefix(f"{name}.").split(".")[0] for one in engine.group(name)}
            if {"create", "delete"} <= kinds:
                yield group


def _unusual_names(model: Model, cls: str) -> Iterator[tuple[int, str]]:
    """Yield objects of exactly this class whose string key is unlike those of created objects ("Tile3"), with the key.

    Nothing is yielded if the keys of the class are not single strings.
    """
    read = key_reader(model, cls)
    for node in model.graph.extent(cls):
        name, *more = read(node)
        if not isinstance(name, str) or more:
            return  # numeric keys are continued, whatever keys exist
        if model.graph.class_of(node) == cls and not fullmatch(rf"{cls}[0-9]+", name):
            yield node, name


def _violation_evidence(engine: Engine, constraint: Constraint) -> tuple[str, str | None]:
    """Return a text that shows how the model violates a constraint, such as a match, or ""; and a hint or None."""
    if isinstance(constraint, Forbid):
        return f": it matches {engine.first(constraint.pattern)}", None
    if isinstance(constraint, MatchCountWithin):
        return f": the number of matches is {engine.count(constraint.pattern)}", None
    if isinstance(constraint, OutcomeReachable):
        evidence, hint = constraint.plan.why_no_plan(engine, constraint.outcome_number)
        return f": {evidence}", hint
    return "", None
