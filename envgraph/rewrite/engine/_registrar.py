"""Checks, additions, removals and replacements of definitions, together with the definitions that use them."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Sequence
from copy import copy

from envgraph.errors import Diagnostic, InvalidArgument, ResolutionError, Severity, has_errors
from envgraph.graph import FeatureDefinition, first_object_with_value
from envgraph.match import FREE, ViewMatcher
from envgraph.metamodel import reachable_nodes
from envgraph.pattern import FunctionDeclaration, Library, Pattern
from envgraph.rewrite._signatures import SignatureTable
from envgraph.rewrite.check._field_types import type_error_message
from envgraph.rewrite.engine._catalog import Catalog
from envgraph.rewrite.engine._notification import EngineEvents
from envgraph.rewrite.engine._registration import Definition, Registration
from envgraph.rewrite.run._rule_runner import ExactClassRule, GraphRule, PythonRule
from envgraph.rewrite.run._unit_programs import unit_program


class Registrar:
    """The part of an engine that changes the definitions of its catalog.

    Event rules and listeners in `events` also use definitions, so these cannot be removed.
    """

    def __init__(self, catalog: Catalog, events: EngineEvents) -> None:
        self._catalog = catalog
        self._events = events

    def check(self, *definitions: Definition) -> list[Diagnostic]:
        """Return all errors and warnings that `add` would find. Nothing is added."""
        return self._check_definitions(definitions).problems

    def add(self, *definitions: Definition) -> None:
        """Register patterns, rules, units, derivations and declarations of functions, which may refer to each other.

        Raises:
            ResolutionError: a definition has an error; contains all errors. Nothing is added.
            InvalidArgument: an argument is no definition, or a field of a definition has the wrong type.
        """
        self.install(self._check_definitions(definitions))

    def install(self, registration: Registration) -> None:
        """Register definitions that were checked already. Several engines may install the same registration.

        The derived features that they define become readable. Their patterns are watched, as are patterns with the
        strategy `incremental`.

        Raises:
            ResolutionError: a definition has an error; contains all errors. Nothing is added.
        """
        catalog, sound = self._catalog, self._check_errors(registration)
        model, library, matcher = catalog.model, catalog.library, catalog.matcher
        self._define_features(sound.library)
        library.update_from(sound.library)
        catalog.directory = SignatureTable(sound.directory.signatures.values())
        catalog.clear_caches()
        for plan in sound.plans:
            runner = GraphRule if plan.exact_class is None else ExactClassRule
            catalog.runners[plan.name] = runner(plan, model, library, matcher, catalog.notices.existing_link)
        for definition in sound.definitions:
            if not isinstance(definition, Pattern | FunctionDeclaration):
                catalog.added_definitions[definition.qualified_name] = definition
        catalog.members.update(sound.groups)
        for checked in sound.units:
            signature = catalog.directory.signatures[checked.unit.qualified_name]
            catalog.programs[signature.name] = unit_program(
                checked, signature, catalog.runners, catalog.programs, catalog.group, model, matcher
            )
        self._watch(
            one
            for one in sound.definitions
            if isinstance(one, Pattern)
            and (one.strategy == "incremental" or one.qualified_name in library.definitions.values())
        )

    def add_sound(self, registration: Registration) -> None:
        """Register the definitions without errors. Later references to the other definitions are not reported."""
        while len(sound := registration.valid_definitions) < len(registration.definitions):
            kept = {*map(id, sound)}
            library = copy(self._catalog.library)
            library.unknown = registration.library.unknown | (
                one.qualified_name for one in registration.definitions if id(one) not in kept
            )
            registration = Registration(sound, library, self._catalog.directory)
        self.install(registration)

    def remove(self, *names: str) -> None:
        """Remove patterns, rules, units and derivations. Their runners from `prepare` must not be used any more.

        Raises:
            InvalidArgument: a name is unknown or a single rule of a derivation, or a remaining definition, event rule
                or listener uses a removed one; the message names them. Nothing is removed.
        """
        known = self._catalog.directory_with_patterns()
        gone = dict.fromkeys(known.resolve(name, "pattern, rule, unit or group") for name in names)
        users = [
            user for user, used in self._catalog.used_definitions().items() if user not in gone and used & gone.keys()
        ]
        signatures = self._catalog.directory.signatures
        texts = [f"{signatures[user].kind if user in signatures else 'pattern'} `{user}`" for user in users]
        self._check_unused(gone, [*texts, *self._events.describe_users(gone)])
        self._remove_unused(gone)

    def replace(self, *definitions: Definition) -> None:
        """Replace the definitions that have the names of the given ones.

        Definitions that use a replaced one are also checked and compiled again. Runners from `prepare` for any of
        these must not be used any more. Watched patterns are watched again when no savepoint or version is in use.

        Raises:
            ResolutionError: a definition, or another definition that uses it, has an error; contains all errors.
            InvalidArgument: an argument is no definition, its name does not exist, or it is a single rule of a
                derivation; or a Python rule, event rule or listener uses a replaced definition. In both cases nothing
                is replaced.
        """
        self._check_arguments(definitions)
        new = [one.qualified_name for one in definitions if not isinstance(one, FunctionDeclaration)]
        replaced = dict.fromkeys(new)
        self._check_defined(replaced)
        affected = self._with_users(replaced)
        functions = [
            f"rule `{name}`"
            for name in affected
            if name not in replaced and isinstance(self._catalog.runners.get(name), PythonRule)
        ]
        self._check_unused(replaced, [*functions, *self._events.describe_users(affected)])
        others = [
            one for one in self._catalog.definitions if one.qualified_name in affected and one.qualified_name not in new
        ]
        library = copy(self._catalog.library)
        library.remove(self._patterns_of(affected))
        everything = (*definitions, *others)
        registration = self._check_errors(
            self._check_definitions(everything, library, self._directory_without(affected))
        )
        matcher = self._catalog.matcher
        before = matcher.watched if isinstance(matcher, ViewMatcher) else ()
        watched = [name for name in self._patterns_of(affected) if name in before]
        self._remove_unused(affected)
        self.install(registration)
        known = self._catalog.library
        again = [known.get(name) for name in watched if name in known.names()]
        self._watch(pattern for pattern in again if pattern.strategy != "search")

    # --- adding

    def _check_errors(self, registration: Registration) -> Registration:
        """Return the registration if it has no errors.

        Raises:
            ResolutionError: the registration has errors.
        """
        if has_errors(registration.problems):
            raise ResolutionError([p for p in registration.problems if p.severity is Severity.ERROR])
        return registration

    def _define_features(self, library: Library) -> None:
        """Make the derived features that the patterns of a library define readable through the model.

        Features that other engines define are left as they are.

        Raises:
            ResolutionError: the model has stored values of such a feature.
        """
        model, matcher = self._catalog.model, self._catalog.matcher

        def defined(query: str) -> FeatureDefinition:
            return FeatureDefinition(query, lambda node: [row[1] for row in matcher.rows(query, (node, FREE))], matcher)

        known = {one for one, defined in model.graph.defined_features.items() if defined.matcher is matcher}
        new = {one: query for one, query in library.definitions.items() if one not in known}
        for feature, query in new.items():
            node = first_object_with_value(model.graph, feature)
            if node is not None:
                message = f"query `{query}` defines `{feature}`, but {model.graph.describe(node)} stores a value of it"
                span, hint = library.get(query).span, "clear these values first"
                raise ResolutionError([Diagnostic("stored-values", message, span, hint)])
        model.graph.define_features(model.graph.defined_features | {one: defined(query) for one, query in new.items()})

    def _watch(self, patterns: Iterable[Pattern]) -> None:
        """Watch patterns as soon as no savepoint or version is in use. Do nothing if the matcher cannot watch."""
        if isinstance(self._catalog.matcher, ViewMatcher):
            self._catalog.matcher.watch_later(*(pattern.qualified_name for pattern in patterns))

    def _check_definitions(
        self,
        definitions: Sequence[Definition],
        library: Library | None = None,
        directory: SignatureTable | None = None,
    ) -> Registration:
        """Check definitions against the existing ones, or against another library and directory. Return the result.

        Raises:
            InvalidArgument: an argument is no definition, or a field of it has the wrong type.
        """
        self._check_arguments(definitions)
        return Registration(definitions, library or self._catalog.library, directory or self._catalog.directory)

    def _check_arguments(self, definitions: Sequence[Definition]) -> None:
        """Check that the arguments are definitions.

        Raises:
            InvalidArgument: an argument is no definition, or a field of it has the wrong type.
        """
        strange: list[object] = [one for one in definitions if not isinstance(one, Definition)]
        if strange:
            hint = "; parse definitions with `envgraph.lang.from_text`" if isinstance(strange[0], str) else ""
            raise InvalidArgument(f"expected a pattern, rule, unit or derivation, not {strange[0]!r}{hint}")
        for one in definitions:
            mistake = None if one.span is not None else type_error_message(one)
            if mistake is not None:
                raise InvalidArgument(f"{mistake}; use `envgraph.Rule` and similar classes to pass texts")

    # --- uses of definitions

    def _with_users(self, names: Collection[str]) -> dict[str, None]:
        """Return definitions and all definitions that use them, directly or indirectly."""
        uses = self._catalog.used_definitions()
        return dict.fromkeys(reachable_nodes(names, lambda name: [user for user, used in uses.items() if name in used]))

    def _check_defined(self, names: Collection[str]) -> None:
        """Check that all names exist. The message suggests names of other packages.

        Raises:
            InvalidArgument: a name does not exist.
        """
        known = self._catalog.directory_with_patterns()
        texts = []
        for name in names:
            if name in known.signatures:
                continue
            found = known.candidates(name) or known.candidates(name.rpartition(".")[2])
            packages = [known.signatures[one].package for one in found]
            advice = [f'give it `package="{one}"`' if one else "leave its package out" for one in packages]
            hint = " or ".join(advice) or known.suggest_name(name)
            texts.append(f"`{name}`" + (f" ({hint})" if hint else ""))
        if texts:
            verb = "is" if len(texts) == 1 else "are"
            raise InvalidArgument(f"{', '.join(texts)} {verb} not defined: use `add` for new definitions")

    def _check_unused(self, names: Collection[str], users: Collection[str]) -> None:
        owner = self._catalog.owner_function()
        for name in names:
            if owner(name) != name:
                raise InvalidArgument(f"`{name}` belongs to the group `{owner(name)}`: name the whole group")
        if users:
            what = ", ".join(f"`{name}`" for name in names)
            verb = "is" if len(names) == 1 else "are"
            raise InvalidArgument(f"{what} {verb} used by {', '.join(users)}: remove these first, or together")

    # --- removing

    def _patterns_of(self, names: Collection[str]) -> list[str]:
        """Return the names of all patterns of definitions, including generated patterns."""
        owner = self._catalog.owner_function()
        return [pattern for pattern in self._catalog.library.names() if owner(pattern) in names]

    def _directory_without(self, names: Collection[str]) -> SignatureTable:
        """Return the directory without these definitions."""
        owner, signatures = self._catalog.owner_function(), self._catalog.directory.signatures
        return SignatureTable(signature for name, signature in signatures.items() if owner(name) not in names)

    def _remove_unused(self, names: Collection[str]) -> None:
        """Remove definitions that nothing uses, with their patterns, views and derived features. Clear all caches."""
        catalog, patterns, owner = self._catalog, self._patterns_of(names), self._catalog.owner_function()
        if isinstance(catalog.matcher, ViewMatcher):
            catalog.matcher.unwatch(*patterns)
        catalog.library.remove(patterns)
        catalog.directory = self._directory_without(names)
        for rule in [rule for rule in catalog.runners if owner(rule) in names]:
            del catalog.runners[rule]
        for known in (catalog.programs, catalog.members, catalog.added_definitions):
            for name in names:
                known.pop(name, None)
        catalog.matcher.discard_caches()
        catalog.clear_caches()
        defined, own = catalog.model.graph.defined_features.items(), catalog.matcher
        kept = {one: by for one, by in defined if by.matcher is not own or by.query not in patterns}
        catalog.model.graph.define_features(kept)
