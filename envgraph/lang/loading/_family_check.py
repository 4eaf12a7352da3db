"""Check the names in a family file: patterns, rules, classes, references and components."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from types import MappingProxyType

from envgraph.errors import Diagnostic, Span, did_you_mean, list_names, name_hint, quote_names
from envgraph.lang.family._family_spec import EXPRESSION_KIND, FamilySpec
from envgraph.lang.family._table_reader import ComponentSpec, LocatedName
from envgraph.lang.loading._workspace import Workspace
from envgraph.metamodel import Metamodel, Reference, Scalar
from envgraph.pattern import Derivation, Library, Rule, Unit

NEED_ENVIRONMENT = ("shortest_plan", "random_success", "optimal_return")
"""The kinds of measures that need an environment, not only a model."""

# The options of each kind of measure, with the sort of definition that the option's value names ("" for none).
MEASURE_OPTIONS: Mapping[str, Mapping[str, str]] = {
    "path_complexity": {"transform": "", "from": "class", "to": "class", "along": "path", "avoid": "class"},
    "shortest_path": {"from": "class", "to": "class", "along": "path", "avoid": "class"},
    "shortest_plan": {"guide": "pattern"},
    "random_success": {},
    "optimal_return": {},
    "distance": {},
    "expression": {"of": ""},
    "count": {"of": "pattern"},
    "value": {"of": "pattern", "parameter": ""},
}


COMPONENTS: Mapping[str, Collection[str]] = MappingProxyType(
    {
        "measure": tuple(MEASURE_OPTIONS),
        "diversity": ("binned_entropy", "gini", "variance"),
        "objective": ("learning", "chain_transfer"),
        "parents": ("random", "tournament", "elitist"),
        "survivors": ("simulated_annealing", "hill_climbing", "beam", "exact"),
        "strategy": ("simulated_annealing", "hill_climbing", "beam", "tree_search"),
    }
)
"""The kinds of components that envgraph provides, by role."""


def numeric_parameters(library: Library, pattern: str) -> dict[str, tuple[int, Scalar]] | None:
    """Return index and type of each numeric parameter of a pattern, by name; None if no pattern has this name."""
    found = library.resolve(pattern) or (library.get(pattern) if pattern in library.names() else None)
    if found is None:
        return None
    types = library.parameter_types(found.qualified_name)
    return {
        parameter.name: (place, type_)
        for place, (parameter, type_) in enumerate(zip(found.parameters, types, strict=True))
        if type_ is Scalar.INT or type_ is Scalar.FLOAT
    }


def check_family(
    spec: FamilySpec, workspace: Workspace, components: Mapping[str, Collection[str]] = COMPONENTS
) -> list[Diagnostic]:
    """Return diagnostics for unknown or ambiguous names in a family file, and for names of definitions that do not fit.

    Args:
        spec: the family.
        workspace: the files that the family names.
        components: the known kinds of components, by role ("measure", "diversity", "objective", "parents", "survivors",
            "strategy").
    """
    return list(_FamilyChecker(spec, workspace, components).check())


class _FamilyChecker:
    def __init__(self, spec: FamilySpec, workspace: Workspace, components: Mapping[str, Collection[str]]) -> None:
        self._spec = spec
        self._workspace = workspace
        self._components = components
        self._patterns = _count_definitions((one.name, one.qualified_name) for one in workspace.patterns)
        rules: list[Rule | Unit | Derivation] = [*workspace.rules, *workspace.units, *workspace.derivations]
        groups = workspace.registration.groups if workspace.registration else {}
        derived = [
            (qualified.removeprefix(f"{one.package}.") if one.package else qualified, qualified)
            for one in workspace.derivations
            for qualified in groups.get(one.qualified_name, ())
        ]
        self._rules = _count_definitions([*((one.name, one.qualified_name) for one in rules), *derived])

    def check(self) -> Iterator[Diagnostic]:
        spec = self._spec
        constraints = spec.constraints
        for name in (*constraints.require, *constraints.forbid, *(name for name, _ in constraints.count)):
            yield from self._check_name(name.text, name.span, self._patterns, "pattern")
        for name in spec.mutation.rules:
            yield from self._check_rule(name)
        for measure in spec.measures:
            yield from self._check_component(measure, "measure")
            yield from self._check_measure(measure)
        yield from self._check_component(spec.diversity, "diversity")
        if spec.objective is not None and spec.objective.kind != EXPRESSION_KIND:
            yield from self._check_component(spec.objective, "objective")
        yield from self._check_component(spec.search.parents, "parents")
        yield from self._check_component(spec.search.survivors, "survivors")
        if spec.optimise is not None:
            yield from self._check_component(spec.optimise.strategy, "strategy")
        for name in spec.ga4cl:
            yield from self._check_class(name.text, name.span)
        yield from self._check_environment_named()
        models = [one.span for one in self._workspace.models]
        yield from self._check_single_definition(spec.model, models, "model")
        behaviours = [one.span for one in self._workspace.behaviours]
        if spec.environment is not None:
            yield from self._check_single_definition(spec.environment, behaviours, "environment")

    def _check_single_definition(
        self, file: LocatedName, spans: Iterable[Span | None], what: str
    ) -> Iterator[Diagnostic]:
        """Yield a diagnostic if the file named as `what` (model or environment) does not define exactly one.

        Yield none if the file was not loaded or has errors.
        """
        count = sum(1 for span in spans if span and span.source.name == file.text)
        workspace = self._workspace
        if count != 1 and file.text in workspace.sources and file.text not in workspace.unread:
            message = f"the file defines {'no' if not count else 'more than one'} {what}"
            hint = f"name a `.{what}` file with one {what}"
            yield Diagnostic(f"no-single-{what}", message, file.span, hint)

    def _check_environment_named(self) -> Iterator[Diagnostic]:
        if self._spec.environment is not None:
            return
        plans = [measure.span() for measure in self._spec.measures if measure.kind in NEED_ENVIRONMENT]
        outcomes = [outcome.span for outcome in self._spec.constraints.reachable]
        objective = [self._spec.objective.span()] if self._spec.objective and self._spec.searches_whole_families else []
        for span in (*plans, *outcomes, *objective):
            hint = 'write `environment = "name.environment"` at the top'
            yield Diagnostic("missing-key", "this needs an environment, but the family file names none", span, hint)

    def _check_rule(self, name: LocatedName) -> Iterator[Diagnostic]:
        group = name.text.partition(".")[0]
        if group != name.text and group in self._rules and not any(one.startswith(f"{group}.") for one in self._rules):
            return  # The group has errors, so its rules are unknown.
        if name.text not in self._rules and name.text in self._patterns:
            hint = "name a rule: a pattern changes nothing"
            yield Diagnostic("unknown-rule", f"`{name}` is a pattern, not a rule", name.span, hint)
            return
        yield from self._check_name(name.text, name.span, self._rules, "rule")
        yield from self._check_no_arguments(name)

    def _check_no_arguments(self, name: LocatedName) -> Iterator[Diagnostic]:
        """Yield a diagnostic if a mutation rule has required parameters, because a search passes no arguments."""
        registration = self._workspace.registration
        if registration is None:
            return
        for found in registration.directory.candidates(name.text):
            signature = registration.directory.signatures[found]
            missing = [parameter.name for parameter in signature.parameters if parameter.is_required]
            if missing:
                message = f"{signature.kind} `{name}` needs a value for {list_names(missing)}, but a search passes none"
                hint = (
                    f"name a unit without parameters that calls `{name}`: `unit any {{ {signature.simple_name}(..); }}`"
                )
                yield Diagnostic("needs-arguments", message, name.span, hint)

    def _check_name(self, name: str, span: Span | None, known: Mapping[str, int], what: str) -> Iterator[Diagnostic]:
        count = known.get(name, 0)
        if count == 1 or (not count and name in self._workspace.unknown):
            return
        if count > 1:
            full = quote_names(one for one in known if one.endswith(f".{name}"))
            message = f"`{name}` may mean several {what}s"
            yield Diagnostic(f"ambiguous-{what}", message, span, f"write one of {full}")
            return
        hint = self._other_kind_hint(name, what) or did_you_mean(name, known)
        hint = hint or name_hint(name, [one for one in known if "." not in one])
        hint = hint or f'add the file that defines the {what} to `imports = [".."]`: no file has a {what}'
        yield Diagnostic(f"unknown-{what}", f"unknown {what} `{name}`", span, hint)

    def _other_kind_hint(self, name: str, what: str) -> str | None:
        if what == "pattern" and name in self._rules:
            return f"name a pattern: `{name}` is a rule"
        return None

    # --- components ---

    def _check_component(self, component: ComponentSpec, role: str) -> Iterator[Diagnostic]:
        known = self._components.get(role, ())
        if component.kind not in known:
            word = "name" if role in {"parents", "survivors", "strategy"} else "kind"
            computed = "; `value` is for a number that a pattern computes, such as a sum"
            others = f"use one of {quote_names(known)}{computed if role == 'measure' else ''}"
            hint = did_you_mean(component.kind, known) or others
            message = f"unknown {word} of {role} `{component.kind}`"
            yield Diagnostic("unknown-component", message, component.span(), hint)

    def _check_measure(self, measure: ComponentSpec) -> Iterator[Diagnostic]:
        expected = MEASURE_OPTIONS.get(measure.kind)
        if expected is None:
            return
        for option, value in measure.options.items():
            span = measure.key_span(option)
            if option == "otherwise":
                continue
            if option not in expected:
                known = quote_names((*expected, "otherwise"))
                hint = did_you_mean(option, (*expected, "otherwise")) or f"the keys of `{measure.kind}` are {known}"
                yield Diagnostic("unknown-key", f"unknown key `{option}` in `{measure.name}`", span, hint)
            elif expected[option]:
                yield from self._check_option(measure, option, value, expected[option])
        if measure.kind == "path_complexity":
            yield from self._check_steps_reachable(measure)
        if measure.kind == "value":
            yield from self._check_numeric_parameter(measure)

    def _check_numeric_parameter(self, measure: ComponentSpec) -> Iterator[Diagnostic]:
        """Yield a diagnostic if the options of a `value` measure do not select one numeric parameter of its pattern."""
        name, wanted = measure.options.get("of"), measure.options.get("parameter")
        registration = self._workspace.registration
        if not isinstance(name, str) or registration is None:
            return
        numbers = numeric_parameters(registration.library, name)
        if numbers is None:
            return
        if not numbers:
            message = f"pattern `{name}` has no numeric parameter"
            hint = f"use `count` to count matches; for a value write `pattern {name.rpartition('.')[2]}(.., n : int)`"
            yield Diagnostic("wrong-type", message, measure.span("of"), hint)
        elif wanted is None and len(numbers) > 1:
            message = f"pattern `{name}` has several numeric parameters: {list_names(numbers)}"
            hint = f'write `parameter = "{next(iter(numbers))}"`'
            yield Diagnostic("ambiguous-parameter", message, measure.span("of"), hint)
        elif isinstance(wanted, str) and wanted not in numbers:
            message = f"pattern `{name}` has no numeric parameter `{wanted}`"
            yield Diagnostic("unknown-parameter", message, measure.span("parameter"), name_hint(wanted, numbers))

    def _check_option(self, measure: ComponentSpec, option: str, value: object, what: str) -> Iterator[Diagnostic]:
        span = measure.span(option)
        names = value if isinstance(value, list) else [value]
        if not names or not all(isinstance(name, str) for name in names) or (what != "path" and value is names):
            wanted = "a list of names of references" if what == "path" else f"the name of a {what}"
            hint = f'write `{option} = ["..."]`' if what == "path" else f'write `{option} = "..."`'
            yield Diagnostic("wrong-type", f"`{option}` must be {wanted}", span, hint)
            return
        for index, name in enumerate(names):
            span = measure.span(option, index)
            match what:
                case "class":
                    yield from self._check_class(str(name), span)
                case "pattern":
                    yield from self._check_name(str(name), span, self._patterns, "pattern")
                case _:
                    yield from self._check_path(str(name), span, measure.kind)

    def _check_class(self, name: str, span: Span | None) -> Iterator[Diagnostic]:
        metamodel = self._workspace.metamodel
        if metamodel is not None and name not in metamodel.classes:
            yield Diagnostic("unknown-class", f"unknown class `{name}`", span, name_hint(name, metamodel.classes))

    def _check_path(self, name: str, span: Span | None, kind: str) -> Iterator[Diagnostic]:
        """Yield a diagnostic for a step that is neither a reference (`right`, `Tile.right`) nor a binary pattern.

        Patterns are reported too if the measure's `kind` is `path_complexity`, which follows only references.
        """
        metamodel = self._workspace.metamodel
        if metamodel is None:
            return
        references = [one for one in metamodel.references if name in {one.name, str(one)}]
        if name in self._patterns and not references and kind == "path_complexity":
            message = f"`{name}` is a pattern, but `{kind}` follows only references"
            yield Diagnostic("wrong-type", message, span, "use `shortest_path`, which also follows patterns")
            return
        if references or name in self._patterns:
            yield from self._check_binary(name, span, references)
            return
        if name in self._workspace.unknown:
            return
        patterns = () if kind == "path_complexity" else self._patterns
        known = [*(one.name for one in metamodel.references), *patterns]
        message = f"no reference {'or pattern ' if patterns else ''}is called `{name}`"
        yield Diagnostic("unknown-reference", message, span, name_hint(name, known))

    def _check_binary(self, name: str, span: Span | None, references: list[Reference]) -> Iterator[Diagnostic]:
        if references:
            return
        found = next(one for one in self._workspace.patterns if name in {one.name, one.qualified_name})
        if len(found.parameters) != 2:
            message = f"pattern `{name}` must have 2 parameters to be a step of a path, not {len(found.parameters)}"
            hint = "name a pattern of 2 parameters: a step goes from the object of the first to that of the second"
            yield Diagnostic("wrong-arity", message, span, hint)

    def _check_steps_reachable(self, measure: ComponentSpec) -> Iterator[Diagnostic]:
        """Yield diagnostics for steps and classes that no path of a `path_complexity` measure can reach.

        Paths are judged by the classes that references connect, not by objects.
        """
        metamodel, given = self._workspace.metamodel, measure.options
        along = given.get("along")
        names = along if isinstance(along, list) else [along]
        classes = [given.get(option) for option in ("from", "to", "avoid")]
        if metamodel is None or not all(isinstance(one, str) and one in metamodel.classes for one in classes):
            return
        found = [[r for r in metamodel.references if name in {r.name, str(r)}] for name in names]
        start, goal, avoid = map(str, classes)
        reached = _reachable_classes(metamodel, start, [one for references in found for one in references])
        for index, (name, references) in enumerate(zip(names, found, strict=True)):
            span = measure.span("along", index)
            if references and reached.isdisjoint(c for r in references for c in metamodel.concrete_classes(r.owner)):
                owners = list_names(r.owner for r in references)
                hint = f"name a reference of `{start}` or of a class that it leads to: `{name}` belongs to {owners}"
                message = f"no path from a `{start}` leads to an object with the reference `{name}`"
                yield Diagnostic("unreachable-step", message, span, hint)
        if not all(found):
            return
        for option, cls in (("to", goal), ("avoid", avoid)):
            if reached.isdisjoint(metamodel.concrete_classes(cls)):
                message = f"no path along these references leads from a `{start}` to a `{cls}`"
                hint = (
                    f"choose a class that paths lead to: {list_names(reached)}"
                    if reached
                    else f"choose another class: `{start}` can have no objects"
                )
                yield Diagnostic("unreachable-step", message, measure.span(option), hint)


def _reachable_classes(metamodel: Metamodel, start: str, references: Sequence[Reference]) -> set[str]:
    """Return the concrete classes of the objects that paths along the references can reach from the class `start`."""
    reached = set(metamodel.concrete_classes(start))
    before = -1
    while before < len(reached):
        before = len(reached)
        for reference in references:
            if not reached.isdisjoint(metamodel.concrete_classes(reference.owner)):
                reached.update(metamodel.concrete_classes(reference.target))
    return reached


def _count_definitions(names: Iterable[tuple[str, str]]) -> dict[str, int]:
    """Map each simple name to the number of definitions that it may mean, and each qualified name to 1."""
    counts: dict[str, int] = {}
    distinct = dict.fromkeys(names)  # A duplicate definition is reported where it is defined.
    for simple, _ in distinct:
        counts[simple] = counts.get(simple, 0) + 1
    return counts | {qualified: 1 for _, qualified in distinct}
