"""The content of a set of files, read and checked together."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import field
from typing import TYPE_CHECKING, Any

from envgraph.code import dataclass
from envgraph.draw import html_table, html_text
from envgraph.errors import Diagnostic, InvalidArgument, LoadError, Severity, did_you_mean, has_errors
from envgraph.graph import Model
from envgraph.lang.family._family_spec import FamilySpec
from envgraph.lang.read._model_reader import ModelText
from envgraph.lang.syntax._source_files import Bundle, make_bundle
from envgraph.metamodel import Metamodel
from envgraph.pattern import Derivation, FunctionDeclaration, Pattern, Rule, Unit, UnknownNames
from envgraph.rewrite import Engine, Registration

if TYPE_CHECKING:  # This is loaded with the first environment.
    from envgraph.behaviour import Behaviour


@dataclass(frozen=True, slots=True)
class Workspace:
    """The content of a set of files. If `diagnostics` contains no errors, the content is complete.

    Attributes:
        metamodel: the metamodel of all files; None if there is none, or it has errors.
        models: the models in the order of reading; `ModelText.model` is None for a model with errors.
        families: the family files among the paths.
        diagnostics: errors and warnings, file by file, each in the order of the text.
        roots: the names of the files that the caller asked for, in that order; all other files were imported.
        sources: the text of every file that was read, by name.
        unknown: names that may be defined in text that could not be read.
        unread: names of files in which errors were found while reading.
        registration: the checked definitions; None if the metamodel is unknown.
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

    def _repr_html_(self) -> str:
        kinds: dict[str, tuple[Any, ...]] = {"models": self.models, "patterns": self.patterns, "rules": self.rules}
        kinds |= {"units": self.units, "environments": self.behaviours, "families": self.families}
        rows = [("files", ", ".join(self.bundle().texts))]
        rows += [(kind, ", ".join(one.name for one in some)) for kind, some in kinds.items() if some]
        problems = html_text("\n\n".join(map(str, self.diagnostics))) if self.diagnostics else ""
        return html_table(rows) + problems

    @property
    def definitions(self) -> tuple[Pattern | Rule | Unit | Derivation | FunctionDeclaration, ...]:
        """Return all functions, patterns, rules, units and derivations, for `Engine.add`."""
        return (*self.functions, *self.patterns, *self.rules, *self.units, *self.derivations)

    @property
    def errors(self) -> tuple[Diagnostic, ...]:
        """Return the diagnostics that are errors."""
        return tuple(one for one in self.diagnostics if one.severity is Severity.ERROR)

    def raise_errors(self) -> None:
        """Raise LoadError with all diagnostics if one of them is an error."""
        if has_errors(self.diagnostics):
            raise LoadError(self.diagnostics)

    def model(self, name: str | None = None) -> Model:
        """Return the model of this name. Without a name, return the only model, or an empty model if there is none.

        Raises:
            LoadError: there are errors.
            InvalidArgument: no model has this name, there are several models, or an empty model lacks a metamodel.
        """
        self.raise_errors()
        texts = [text for text in self.models if name is None or text.name == name]
        if len(texts) > 1:
            names = ", ".join(f"`{text.name}` in {text.span.source.name}" for text in texts)
            raise InvalidArgument(f"choose one of several models: {names}")
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
        """Return an engine on the model that `model` returns, with all patterns, rules, units and derivations."""
        return self.engine_on(self.model(model), seed)

    def engine_on(self, model: Model, seed: int = 0) -> Engine:
        """Return an engine on a given model of the same metamodel, with all patterns, rules, units and derivations."""
        engine = Engine(model, seed=seed)
        assert self.registration is not None, "there is a model"
        engine.registrar.install(self.registration.for_another())
        return engine

    def behaviour(self, name: str | None = None) -> Behaviour:
        """Return the behaviour of this name; without a name, return the only behaviour.

        Raises:
            LoadError: there are errors.
            InvalidArgument: no behaviour has this name, or there are several.
        """
        self.raise_errors()
        found = [one for one in self.behaviours if name is None or one.name == name]
        if len(found) != 1:
            names = ", ".join(f"`{one.name}`" for one in self.behaviours) or "none"
            wanted = "environment" if name is None else f"environment `{name}`"
            raise InvalidArgument(f"the files do not define exactly one {wanted}; their environments are {names}")
        return found[0]

    def bundle(self) -> Bundle:
        """Return the texts of all files as a bundle, which can be loaded again elsewhere."""
        return make_bundle(self.roots, self.sources)
