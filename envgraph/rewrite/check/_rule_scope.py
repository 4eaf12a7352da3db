"""The scope of a right-hand side: matched variables, created objects, and edges of the left-hand side."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import field

from envgraph.code import dataclass
from envgraph.errors import (
    Diagnostic,
    Note,
    Severity,
    Span,
    did_you_mean,
    list_names,
    name_hint,
    quote_with_article,
)
from envgraph.metamodel import Attribute, Feature, Metamodel, Reference
from envgraph.pattern import ObjectType, RuleEdge, StaticType

LinkKey = tuple[int, str, str]
"""A link in canonical direction: index of the reference, source and target."""


@dataclass(frozen=True, slots=True)
class ResolvedEdge:
    """An edge between variables with its resolved reference."""

    source: str
    reference: Reference
    target: str
    span: Span | None = field(default=None, compare=False)


@dataclass(slots=True)
class RuleScope:
    """The names that can be used in a block, including those of the enclosing blocks, and the diagnostics of the rule.

    Attributes:
        names: name of every slot; "" for computed values.
        types: types of variables on the state before the rule, without created objects.
        created: class of every object that the rule creates.
        retyped: new class of every object that is retyped.
        deleted: names of objects that are deleted.
        absorbed: names of deleted objects that a merge absorbs; their links are preserved.
        declared: the classes with which the left-hand sides declare a variable.
        lhs_edges: the edges of the left-hand sides that match single links.
        lhs_path_links: the links that path constraints of the left-hand sides match.
        call_variables: the variables of each pattern call.
        unlinked: the edges whose links are deleted.
        equated: pairs of variables that a left-hand side equates by `==`.
        block_names: names that only nested blocks of the rule define, with the keyword of the block.
        derived_features: derived features, with the names of the queries that define them.
    """

    metamodel: Metamodel
    problems: list[Diagnostic]
    names: list[str] = field(default_factory=list)
    types: dict[str, StaticType | None] = field(default_factory=dict)
    created: dict[str, str] = field(default_factory=dict)
    retyped: dict[str, str] = field(default_factory=dict)
    deleted: dict[str, None] = field(default_factory=dict)
    absorbed: dict[str, None] = field(default_factory=dict)
    declared: dict[str, set[str]] = field(default_factory=dict)
    lhs_edges: list[ResolvedEdge] = field(default_factory=list)
    lhs_path_links: set[LinkKey] = field(default_factory=set)
    call_variables: list[set[str]] = field(default_factory=list)
    unlinked: dict[LinkKey, ResolvedEdge] = field(default_factory=dict)
    equated: set[frozenset[str]] = field(default_factory=set)
    block_names: Mapping[str, str] = field(default_factory=dict)
    derived_features: Mapping[Feature, str] = field(default_factory=dict)
    _reported: set[str] = field(default_factory=set)

    def nested_scope(self, names: Mapping[str, StaticType | None]) -> RuleScope:
        """Return the scope of a nested block: a copy with the variables `names` added and the same list of problems."""
        return RuleScope(
            self.metamodel,
            self.problems,
            [*self.names, *(name for name in names if name not in self.types)],
            {**self.types, **names},
            {name: cls for name, cls in self.created.items() if name not in names},
            dict(self.retyped),
            dict(self.deleted),
            dict(self.absorbed),
            {name: set(classes) for name, classes in self.declared.items()},
            list(self.lhs_edges),
            set(self.lhs_path_links),
            list(self.call_variables),
            dict(self.unlinked),
            set(self.equated),
            self.block_names,
            self.derived_features,
        )

    # --- problems

    def error(self, code: str, message: str, span: Span | None, hint: str | None = None, *notes: Note) -> None:
        """Add an error to the diagnostics of the rule."""
        self.problems.append(Diagnostic(code, message, span, hint, notes=notes))

    def warn(self, code: str, message: str, span: Span | None, hint: str | None = None) -> None:
        """Add a warning to the diagnostics of the rule."""
        self.problems.append(Diagnostic(code, message, span, hint, Severity.WARNING))

    # --- names

    def slot_of(self, name: str) -> int:
        """Return the slot of a name in scope."""
        return self.names.index(name)

    def add_slot(self, name: str) -> int:
        """Add a slot with a name, which is "" for a computed value, and return its number."""
        self.names.append(name)
        return len(self.names) - 1

    def is_in_scope(self, name: str) -> bool:
        """Return True if a name is in scope: a matched variable or a created object."""
        return name in self.types or name in self.created

    def check_in_scope(self, name: str, span: Span | None, *, matched: bool = False) -> bool:
        """Return True if a name is in scope; else report it, once, with a hint to match it (`matched`) or create it."""
        if self.is_in_scope(name):
            return True
        if name not in self._reported:
            self._reported.add(name)
            hint = did_you_mean(name, [*self.types, *self.created])
            if name in self.block_names:
                kind = self.block_names[name]
                advice = "add it to the left side" if kind in ("not", "require") else "move this into the block"
                hint = f"{advice}: `{name}` is known only inside {quote_with_article(kind)} block"
            if name.startswith("_"):
                hint = "choose a name without a leading `_`: such a name stands for any value and cannot be used again"
            typed = f"`{name} : Class`"
            self.error(
                "unknown-variable",
                f"`{name}` is neither matched by the left side nor created",
                span,
                hint or (f"write {typed} in the left side" if matched else f"write {typed} to create it"),
            )
        return False

    def check_object_after(self, name: str, span: Span | None, *, matched: bool = False) -> bool:
        """Return True if a name refers to an object that exists after the rule. Otherwise report the error."""
        if not self.check_in_scope(name, span, matched=matched):
            return False
        if name in self.deleted:
            self.error(
                "deleted-variable",
                f"`{name}` is deleted by this rule",
                span,
                f"remove this use of `{name}`, or remove its deletion",
            )
            return False
        return self.check_is_object(name, span)

    def check_object_before(self, name: str, span: Span | None) -> bool:
        """Return True if a name refers to an object that exists before the rule. Otherwise report the error."""
        if not self.check_in_scope(name, span, matched=True):
            return False
        if name in self.created:
            self.error(
                "no-value-yet",
                f"`{name}` is created by this rule, so it has no links before the rule",
                span,
                "leave this action out",
            )
            return False
        return self.check_is_object(name, span)

    def check_is_object(self, name: str, span: Span | None) -> bool:
        """Return True if a known name refers to an object. Report a data value, but not a name of unknown type."""
        type_ = self.types.get(name)
        if name in self.created or isinstance(type_, ObjectType):
            return True
        if type_ is not None:
            self.error(
                "not-an-object",
                f"`{name}` is a data value, not an object",
                span,
                "use a variable for an object",
            )
        return False

    # --- classes and features

    def class_before(self, name: str) -> str | None:
        """Return the class of a variable before the rule; None if it is unknown or the variable is a data value."""
        type_ = self.types.get(name)
        return type_.cls if isinstance(type_, ObjectType) and type_.cls in self.metamodel.classes else None

    def class_after(self, name: str) -> str | None:
        """Return the class of an object after the rule; None if it is unknown."""
        return self.created.get(name) or self.retyped.get(name) or self.class_before(name)

    def check_instantiable(self, cls: str, span: Span | None) -> bool:
        """Return True if a class exists and is not abstract. Otherwise report the error."""
        found = self.metamodel.classes.get(cls)
        if found is None:
            hint = self.metamodel.suggest_class(cls)
            self.error("unknown-type", f"unknown type `{cls}`", span, hint)
            return False
        if found.abstract:
            concrete = self.metamodel.concrete_classes(cls)
            hint = f"name one of its subclasses: {list_names(concrete)}" if concrete else None
            self.error("abstract-class", f"`{cls}` is abstract: no object is exactly a `{cls}`", span, hint)
            return False
        return True

    def resolve_feature(self, cls: str, name: str, span: Span | None) -> Attribute | Reference | None:
        """Return a feature of a class. Report a feature that is unknown or defined by a query, and return None."""
        feature = self.metamodel.feature(cls, name)
        if feature is None:
            hint = self.metamodel.left_out_reason(cls, name) or self._subclass_hint(cls, name)
            hint = hint or name_hint(name, self.metamodel.features(cls))
            self.error("unknown-feature", f"`{cls}` has no feature `{name}`", span, hint)
        elif feature in self.derived_features:
            message = f"`{feature}` is read-only: query `{self.derived_features[feature]}` defines its values"
            self.error("read-only-feature", message, span, "change the features that the query reads")
            return None
        return feature

    def _subclass_hint(self, cls: str, feature: str) -> str | None:
        for sub in self.metamodel.class_list:
            if any(own.name == feature for own in sub.features) and self.metamodel.is_a(sub.name, cls):
                return f"declare the variable as `{sub.name}`, a subclass that has this feature"
        return None

    def resolve_reference(self, cls: str, name: str, span: Span | None) -> Reference | None:
        """Return a reference of a class. Report an attribute, an unknown or query-defined feature, and return None."""
        feature = self.resolve_feature(cls, name, span)
        if isinstance(feature, Attribute):
            hint = "write `set object.attribute = value;`"
            self.error("not-a-reference", f"`{feature}` is an attribute, not a reference", span, hint)
            return None
        return feature

    def check_target(self, name: str, reference: Reference, span: Span | None) -> bool:
        """Return True if the class of an object after the rule fits the target of a reference. Report a wrong class."""
        cls = self.class_after(name)
        if cls is None or self.metamodel.is_a(cls, reference.target):
            return cls is not None
        message = f"`{reference}` has targets of class `{reference.target}`, but `{name}` is {quote_with_article(cls)}"
        self.error("wrong-type", message, span, f"use an object of class `{reference.target}`")
        return False

    # --- arrows

    def resolve_edge(self, edge: RuleEdge, *, exists_before: bool = False) -> ResolvedEdge | None:
        """Resolve an edge of the right-hand side; return None after errors, which are reported.

        Args:
            edge: the edge in the text.
            exists_before: True if the link exists before the rule, as in `delete a -ref-> b`.
        """
        where = edge.reference_span or edge.span
        if edge.closure:
            message = f"`{edge.reference}{edge.closure}` stands for any number of links, which no rule can rewrite"
            self.error("closure-in-right-side", message, where, f"write `-{edge.reference}->`")
            return None
        ends = {edge.target: edge.target_span or edge.span, edge.source: edge.source_span or edge.span}
        check = self.check_object_before if exists_before else self.check_object_after
        sound = [check(end, span) for end, span in reversed(ends.items())]
        cls = self.class_before(edge.source) if exists_before else self.class_after(edge.source)
        if not all(sound) or cls is None:
            return None
        reference = self.resolve_reference(cls, edge.reference, where)
        if reference is None or (
            not exists_before and not self.check_target(edge.target, reference, ends[edge.target])
        ):
            return None
        return ResolvedEdge(edge.source, reference, edge.target, edge.span)

    def resolve_lhs_edge(self, edge: RuleEdge) -> ResolvedEdge | None:
        """Resolve an edge of a left-hand side. Return None, unreported, if it is no stored link of known variables."""
        cls = self.class_before(edge.source)
        if edge.closure or cls is None or edge.source not in self.types or edge.target not in self.types:
            return None
        feature = self.metamodel.feature(cls, edge.reference)
        if not isinstance(feature, Reference) or feature in self.derived_features:
            return None
        return ResolvedEdge(edge.source, feature, edge.target, edge.span)

    def link_key(self, edge: ResolvedEdge) -> LinkKey:
        """Return a key that is equal for a link and for its opposite, because both are one link."""
        reference, source, target = self.metamodel.canonical_link(edge.reference, edge.source, edge.target)
        return reference.index, source, target
