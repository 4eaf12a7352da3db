"""Definitions are removed and replaced: who uses them, and what has to be worked out anew."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterator
from copy import copy

from envgraph.errors import InvalidArgument
from envgraph.match import ViewMatcher
from envgraph.pattern import FunctionDeclaration, Unit
from envgraph.rewrite._names import Directory
from envgraph.rewrite.engine._definitions import Definition, Definitions
from envgraph.rewrite.run._runner import PythonRule


class Replacing(Definitions):
    """A model, and definitions over it that can be taken back."""

    def remove(self, *names: str) -> None:
        """Forget patterns, rules, units and derivations; what `prepare` gave for them is of no more use.

        Raises:
            InvalidArgument: an unknown name, a single rule of a derivation, or something that is used by what stays:
                definitions, event rules and listeners, which are named. Nothing is removed.
        """
        known = self._directory_with_patterns()
        gone = dict.fromkeys(known.resolve(name, "pattern, rule, unit or group") for name in names)
        users = [user for user, used in self._uses().items() if user not in gone and used & gone.keys()]
        texts = [f"{self._kind(user)} `{user}`" for user in users]
        self._check_free(gone, [*texts, *self._holders(gone)])
        self._drop(gone)

    def replace(self, *definitions: Definition) -> None:
        """Register definitions in the place of those that have their names.

        What uses a replaced one is checked and worked out again, too, and what `prepare` gave for any of these is of no
        more use. What was watched is watched again as soon as there is no state to go back to.

        Raises:
            ResolutionError: a definition has an error, or one that uses it has one then; all errors together.
            InvalidArgument: something that is no definition or whose name is not there, or a single rule of a
                derivation; or a Python rule, an event rule or a listener uses what is replaced. Nothing is replaced
                then.
        """
        self._check_given(definitions)
        new = [one.qualified_name for one in definitions if not isinstance(one, FunctionDeclaration)]
        replaced = dict.fromkeys(new)
        self._check_there(replaced)
        affected = self._with_users(replaced)
        functions = [
            f"rule `{name}`"
            for name in affected
            if name not in replaced and isinstance(self._rules.get(name), PythonRule)
        ]
        self._check_free(replaced, [*functions, *self._holders(affected)])
        others = [
            one
            for one in self.definitions
            if one.qualified_name in affected and one.qualified_name not in new
        ]
        library = copy(self.library)
        library.remove(self._patterns_of(affected))
        everything = (*definitions, *others)
        registration = self._sound(self._registration(everything, library, self._directory_without(affected)))
        watched = [name for name in self._patterns_of(affected) if name in self.watched]
        self._drop(affected)
        self._install(registration, everything)
        if isinstance(self.matcher, ViewMatcher):
            there = [name for name in watched if name in self.library.names()]
            self.matcher.watch_later(*(name for name in there if self.library.get(name).strategy != "search"))

    # --- who uses what

    def _kind(self, name: str) -> str:
        return self._directory.signatures[name].kind if name in self._directory.signatures else "pattern"

    def _owners(self) -> Callable[[str], str]:
        """The definition that a pattern or a rule was made for; most are made for themselves."""
        groups = {member: group for group, members in self._groups.items() for member in members}

        def owner(name: str) -> str:
            base = name.partition("#")[0]
            return groups.get(base, base)

        return owner

    def _uses(self) -> dict[str, set[str]]:
        """What each definition uses, without what it was made into."""
        owner = self._owners()
        found: dict[str, set[str]] = {}
        for name in self.library.names():
            found.setdefault(owner(name), set()).update(map(owner, self.library.called(name)))
        for name, rule in self._rules.items():
            if isinstance(rule, PythonRule):
                found.setdefault(name, set()).add(owner(rule.pattern))
        for name, definition in self._definitions.items():
            if isinstance(definition, Unit):
                found.setdefault(name, set()).update(map(owner, self._called(definition)))
        return {name: used - {name} for name, used in found.items()}

    def _with_users(self, names: Collection[str]) -> dict[str, None]:
        """Definitions, and those that use them, directly or not."""
        uses, found = self._uses(), dict.fromkeys(names)
        size = -1
        while size != len(found):
            size = len(found)
            found.update((user, None) for user, used in uses.items() if used & found.keys())
        return found

    def _holders(self, names: Collection[str]) -> Iterator[str]:
        """What else refers to definitions, in words."""
        owner, matcher = self._owners(), self.matcher
        heard = matcher.listened if isinstance(matcher, ViewMatcher) else ()
        yield from (f"a listener of `{name}`" for name in heard if owner(name) in names)

    def _check_there(self, names: Collection[str]) -> None:
        """What has another package is most likely meant with that."""
        known = self._directory_with_patterns()
        texts = []
        for name in names:
            if name in known.signatures:
                continue
            found = known.candidates(name) or known.candidates(name.rpartition(".")[2])
            packages = [known.signatures[one].package for one in found]
            advice = [f'give it `package="{one}"`' if one else "leave its package out" for one in packages]
            hint = " or ".join(advice) or known.hint(name)
            texts.append(f"`{name}`" + (f" ({hint})" if hint else ""))
        if texts:
            verb = "is" if len(texts) == 1 else "are"
            raise InvalidArgument(f"{', '.join(texts)} {verb} not there to be replaced; `add` adds new ones")

    def _check_free(self, names: Collection[str], users: Collection[str]) -> None:
        owner = self._owners()
        for name in names:
            if owner(name) != name:
                raise InvalidArgument(f"`{name}` is a rule of `{owner(name)}`: name the whole group")
        if users:
            what = ", ".join(f"`{name}`" for name in names)
            verb = "is" if len(names) == 1 else "are"
            raise InvalidArgument(
                f"{what} {verb} used by {', '.join(users)}: remove these first, or together"
            )

    # --- taking back

    def _patterns_of(self, names: Collection[str]) -> list[str]:
        """All patterns of definitions, those included that they were made into."""
        owner = self._owners()
        return [pattern for pattern in self.library.names() if owner(pattern) in names]

    def _directory_without(self, names: Collection[str]) -> Directory:
        owner = self._owners()
        return Directory(s for name, s in self._directory.signatures.items() if owner(name) not in names)

    def _drop(self, names: Collection[str]) -> None:
        """Forget definitions that nothing uses."""
        patterns, owner = self._patterns_of(names), self._owners()
        if isinstance(self.matcher, ViewMatcher):
            self.matcher.unwatch(*patterns)
        self.library.remove(patterns)
        self._directory = self._directory_without(names)
        for name in [rule for rule in self._rules if owner(rule) in names]:
            del self._rules[name]
        for name in names:
            self._units.pop(name, None)
            self._groups.pop(name, None)
            self._definitions.pop(name, None)
        self.matcher.forget()
        self._forget()
