"""The check of definitions that are added together, against existing definitions and against each other."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from copy import copy
from dataclasses import replace
from typing import TYPE_CHECKING, TypeVar

from envgraph.errors import Diagnostic, Note, Severity, Span, has_errors, sort_diagnostics
from envgraph.pattern import CheckedPatterns, Derivation, FunctionDeclaration, Library, Pattern, Rule, Unit, static_type
from envgraph.rewrite._rule_plan import RulePlan
from envgraph.rewrite._signatures import CallParameter, Signature, SignatureTable
from envgraph.rewrite.check._annotations import without_generated_names
from envgraph.rewrite.check._endless_units import check_endless
from envgraph.rewrite.check._rule_check import CheckedRule, check_rule
from envgraph.rewrite.check._unit_check import CheckedUnit, check_unit, unit_signature

if TYPE_CHECKING:  # imported only when a derivation is added
    from envgraph.rewrite.derive._derive import DerivedRules

Definition = Pattern | Rule | Unit | Derivation | FunctionDeclaration
Called = TypeVar("Called", Rule, Unit)


class Registration:
    """The result of checking definitions, with everything that is needed to add them to an engine.

    Attributes:
        definitions: the definitions as they were given.
        problems: all errors and warnings, in the order of the text.
        library: a copy of the given library with the patterns without errors. If there are no errors at all, it also
            contains the patterns generated for rules and units.
        plans: plans of the rules, including rules of derivations.
        units: the checked units, in the order of the text.
        groups: names of the members of each derivation.
        directory: signatures of all definitions, including those that existed before.
        checked_patterns: the written patterns, for a later check that need not check equal ones again; None if there
            are none.
    """

    def __init__(
        self, definitions: Sequence[Definition], library: Library, directory: SignatureTable | None = None
    ) -> None:
        directory = directory or SignatureTable()
        library = copy(library)
        undeclared = library.declare(*(d for d in definitions if isinstance(d, FunctionDeclaration)))
        self.definitions = tuple(definitions)
        self._definitions = [
            library.with_functions_resolved(d) for d in definitions if not isinstance(d, Pattern | FunctionDeclaration)
        ]
        self._derivations: dict[int, list[Diagnostic]] = {}
        self._derived = self._derive(library, directory)
        written = [d for d in definitions if isinstance(d, Pattern)]
        made = [pattern for group in self._derived.values() for pattern in group.patterns]
        self._patterns = [*written, *made]
        self._existing = directory
        self.directory = SignatureTable(directory.signatures.values())
        self.units: list[CheckedUnit] = []
        self.groups: dict[str, tuple[str, ...]] = {}
        self._rules: list[CheckedRule] = []
        self.library = library
        self.checked_patterns: CheckedPatterns | None = None
        self._erroneous = frozenset[str]()
        found = [*undeclared, *self._admit_patterns(written), *self._check_duplicates(library, directory)]
        # Warnings about generated patterns would not help the user.
        found += [p for p in self._admit_patterns(made) if p.severity is Severity.ERROR]
        found += self._check(self.library)
        if not has_errors(found):
            found += check_endless(self.units)
            self.library.register_checked(entry for rule in self._rules for entry in rule.entries)
            self.library.register_checked(entry for unit in self.units for entry in unit.entries)
        self.problems = sort_diagnostics(found)

    def for_another(self) -> Registration:
        """Return this registration, or a new one if it declares functions, for installation in another engine.

        Every engine needs its own declarations of functions, because it registers their code there.
        """
        if not any(isinstance(one, FunctionDeclaration) for one in self.definitions):
            return self
        return Registration(self.definitions, Library(self.library.metamodel))

    @property
    def valid_definitions(self) -> list[Definition]:
        """Return the definitions without errors and unknown names; of definitions with the same name only the first."""
        bad = {*self._erroneous}
        bad.update(checked.rule.qualified_name for checked in self._rules if checked.plan is None)
        bad.update(checked.unit.qualified_name for checked in self.units if not checked.is_sound)
        bad.update(name for name, members in self.groups.items() if not bad.isdisjoint(members))
        found: dict[tuple[bool, str], Definition] = {}
        for one in self.definitions:
            if one.qualified_name not in bad and not has_errors(self._derivations.get(id(one), ())):
                found.setdefault((isinstance(one, FunctionDeclaration), one.qualified_name), one)
        return list(found.values())

    @property
    def plans(self) -> list[RulePlan]:
        """Return the plans of the rules without errors."""
        return [checked.plan for checked in self._rules if checked.plan is not None]

    def _derive(self, library: Library, directory: SignatureTable) -> dict[str, DerivedRules]:
        """Check all derivations. Return the generated definitions of those without errors and with unused names."""
        found: dict[str, DerivedRules] = {}
        derivations = [one for one in self._definitions if isinstance(one, Derivation)]
        if not derivations:
            return found
        from envgraph.rewrite.derive._derivation_check import check_derivation
        from envgraph.rewrite.derive._derive import derived

        taken = {*directory.signatures, *library.names()}
        for derivation in derivations:
            name = derivation.qualified_name
            problems = self._derivations[id(derivation)] = check_derivation(derivation, library.metamodel)
            if not (name in taken or name in found or has_errors(problems)):
                found[name] = derived(derivation, library.metamodel)
        return found

    def _admit_patterns(self, patterns: Sequence[Pattern]) -> list[Diagnostic]:
        """Add the patterns without errors to the library and return the diagnostics of all patterns."""
        if not patterns:
            return []
        checked = self.library.analyse(*patterns)
        self.checked_patterns = self.checked_patterns or checked
        self._erroneous |= checked.invalid_names
        self.library = self.library.with_valid_patterns(*patterns)
        return [without_generated_names(one) for one in checked.problems]

    def _check_duplicates(self, library: Library, directory: SignatureTable) -> Iterator[Diagnostic]:
        first: dict[str, Span | None] = {pattern.qualified_name: pattern.span for pattern in self._patterns}
        for definition in self._definitions:
            name = definition.qualified_name
            known = name in directory.signatures or name in library.names()
            if known or name in first:
                notes = (Note("the first definition is here", first[name]),) if first.get(name) else ()
                message = f"`{name}` is defined twice" if name in first else f"`{name}` is defined already"
                hint = "rules, units, derivations and patterns share their names: rename one of them"
                yield Diagnostic("duplicate-definition", message, definition.span, hint, notes=notes)
            first.setdefault(name, definition.span)

    def _with_unused_name(self, definition: Called) -> Called:
        """Return the definition under another name if its name is in use, so that generated patterns do not clash."""
        if definition.qualified_name in self._existing.signatures:
            return replace(definition, name=f"{definition.name}#again")
        return definition

    def _check(self, library: Library) -> list[Diagnostic]:
        problems: list[Diagnostic] = []
        for definition in self._definitions:
            match definition:
                case Rule():
                    problems += self._check_rule(self._with_unused_name(definition), library)
                case Derivation():
                    problems += self._check_derivation(definition, library)
                case Unit():
                    self.directory.add_or_replace(unit_signature(definition, library.metamodel))
        for definition in self._definitions:
            if isinstance(definition, Unit):
                checked = check_unit(self._with_unused_name(definition), self.directory, library)
                self.units.append(checked)
                problems += checked.problems
        return problems

    def _check_rule(self, rule: Rule, library: Library) -> list[Diagnostic]:
        checked = check_rule(rule, library)
        self._rules.append(checked)
        self.directory.add_or_replace(_rule_signature(checked, library))
        return list(checked.problems)

    def _check_derivation(self, derivation: Derivation, library: Library) -> list[Diagnostic]:
        problems = self._derivations[id(derivation)]
        name, weight = derivation.qualified_name, derivation.weight or 1.0
        self.directory.add_or_replace(Signature(name, "group", derivation.package, weight=weight))
        if name in self._derived:
            rules = self._derived.pop(name).rules
            self.groups[name] = tuple(rule.qualified_name for rule in rules)
            for rule in rules:
                # Warnings would be repeated for each generated rule, and generated rules have no source text.
                problems += [p for p in self._check_rule(rule, library) if p.severity is Severity.ERROR]
        return problems


def _rule_signature(checked: CheckedRule, library: Library) -> Signature:
    rule, plan = checked.rule, checked.plan
    types = dict(zip(plan.variables, plan.types, strict=True)) if plan else {}
    return Signature(
        rule.qualified_name,
        "rule",
        rule.package,
        tuple(
            CallParameter(
                parameter.name,
                types.get(parameter.name) or static_type(parameter.type, library.metamodel),
                parameter.direction == "out",
                plan is not None and parameter.name in plan.inputs,
            )
            for parameter in rule.parameters
        ),
        rule.weight,
        rule.priority,
        tuple(CallParameter(name, type_) for name, type_ in types.items()),
    )
