"""Everything that a set of files says, read and checked together."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import field
from typing import TYPE_CHECKING

from envgraph.code import dataclass
from envgraph.errors import Diagnostic, InvalidArgument, LoadError, Severity, did_you_mean, has_errors
from envgraph.graph import Model
from envgraph.lang.family._family import FamilySpec
from envgraph.lang.read._model import ModelText
from envgraph.lang.syntax._files import Bundle, bundle
from envgraph.metamodel import Metamodel
from envgraph.pattern import Derivation, FunctionDeclaration, Pattern, Rule, Unit, UnknownNames
from envgraph.rewrite import Engine, Registration

if TYPE_CHECKING:  # loaded with the first environment
    from envgraph.behaviour import Behaviour


@dataclass(frozen=True, slots=True)
class Workspace:
    """What a set of files says. Nothing in it is missing if `diagnostics` has no errors.

    Attributes:
        metamodel: of all the files; None if there is none, or it has errors.
        models: in the order of reading; `ModelText.model` is None where there are errors.
        families: of the family files among the paths.
        diagnostics: errors and warnings, file by file, each in the order of the text.
        roots: the files that were asked for, in that order; the others were imported.
        sources: the text of every file that was read, by name.
        unknown: names of definitions of which nothing is known, because they could not be read.
        unread: files with errors in them that were found on reading.
        registration: the definitions, checked; None where it is not known what they are about.
    """

    metamodel: Metamodel | None = None
    models: tuple[ModelText, ...] = ()
    patterns: tuple[Pattern, ...] = ()
    rules: tuple[Rule, ...] = ()
    units: tuple[Unit, ...] = ()
    derivations: tuple[Derivation, ...] = ()
    behaviours: tuple[Behaviour, ...] = ()
    families: tuple[FamilySpec, ...] = ()
    diagnostics: tuple[Diagnostic, ...] = ()
    roots: tuple[str, ...] = ()
    sources: Mapping[str, str] = field(default_factory=dict)
    functions: tuple[FunctionDeclaration, ...] = ()
    unknown: UnknownNames = field(default_factory=UnknownNames)
    unread: frozenset[str] = frozenset()
    registration: Registration | None = field(default=None, compare=False, repr=False)

    @property
    def definitions(self) -> tuple[Pattern | Rule | Unit | Derivation | FunctionDeclaration, ...]:
        """What an engine can be given."""
        return (*self.functions, *self.patterns, *self.rules, *self.units, *self.derivations)

    @property
    def errors(self) -> tuple[Diagnostic, ...]:
        """The diagnostics that are errors."""
        return tuple(one for one in self.diagnostics if one.severity is Severity.ERROR)

    def raise_errors(self) -> None:
        """Raises LoadError with all diagnostics if one of them is an error."""
        if has_errors(self.diagnostics):
            raise LoadError(self.diagnostics)

    def model(self, name: str | None = None) -> Model:
        """The model of this name; without a name the only one, or an empty one if there is none.

        Raises:
            LoadError: there are errors.
            InvalidArgument: there is no such model, several to choose from, or no metamodel for an empty one.
        """
        self.raise_errors()
        texts = [text for text in self.models if name is None or text.name == name]
        if len(texts) > 1:
            names = ", ".join(f"`{text.name}` in {text.span.source.name}" for text in texts)
            raise InvalidArgument(f"there are several models: {names}")
        if texts:
            model = texts[0].model
            assert model is not None
            return model
        if name is not None:
            hint = did_you_mean(name, [text.name for text in self.models])
            raise InvalidArgument(f"no model `{name}`", hint)
        if self.metamodel is None:
            raise InvalidArgument("none of the files is a metamodel, or imports one")
        return Model(self.metamodel)

    def engine(self, model: str | None = None, seed: int = 0) -> Engine:
        """An engine on one of the models with all patterns, rules, units and derivations. Raises as `model`."""
        return self.engine_on(self.model(model), seed)

    def engine_on(self, model: Model, seed: int = 0) -> Engine:
        """An engine with everything on a model of the metamodel, which may come from somewhere else."""
        engine = Engine(model, seed=seed)
        assert self.registration is not None, "there is a model"
        engine.registrar.install(self.registration.for_another())
        return engine

    def behaviour(self, name: str | None = None) -> Behaviour:
        """The behaviour of this name, or the only one.

        Raises:
            LoadError: there are errors.
            InvalidArgument: there is none, or several to choose from.
        """
        self.raise_errors()
        found = [one for one in self.behaviours if name is None or one.name == name]
        if len(found) != 1:
            names = ", ".join(f"`{one.name}`" for one in self.behaviours) or "none"
            raise InvalidArgument(
                f"no single environment {name or ''} to choose; there are {names}".replace("  ", " ")
            )
        return found[0]

    def bundle(self) -> Bundle:
        """The texts of all files, to load them again somewhere else."""
        return bundle(self.roots, self.sources)
