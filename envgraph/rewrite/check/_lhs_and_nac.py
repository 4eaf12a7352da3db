"""Lowering of left-hand sides to ordinary patterns.

The left-hand side (LHS) of a rule becomes a pattern over the variables of its match. A `not` or `require` block becomes
a separate pattern, over the enclosing variables that it uses, and the enclosing pattern calls this pattern. A `forall`
or `optional` block also becomes a pattern; its matches are found when the rule is applied. Generated patterns have
names such as `rule#lhs` and `rule#not1`, which no source text can contain. Injectivity becomes `!=` constraints.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from itertools import count

from envgraph.code import dataclass
from envgraph.errors import Diagnostic, Span, quote_with_article
from envgraph.metamodel import Attribute
from envgraph.pattern import (
    Binary,
    Body,
    Check,
    Closure,
    Comparison,
    Constant,
    Constraint,
    LeftSide,
    Library,
    Negation,
    ObjectType,
    Parameter,
    PathConstraint,
    Pattern,
    PatternCall,
    Rule,
    RuleBlock,
    RuleEdge,
    RuleNode,
    StaticType,
    TypeConstraint,
    Variable,
    constraint_terms,
    static_type,
)
from envgraph.rewrite.check._annotations import without_generated_names
from envgraph.rewrite.check._lhs_variables import (
    all_names,
    equated_pairs,
    may_be_same,
    own_variables,
    parameter_for,
)

_CONDITIONS = ("not", "require")

VariableTypes = dict[str, StaticType | None]
"""Type of each variable, in the order of the match; None if unknown."""


@dataclass(frozen=True, slots=True)
class LoweredBlock:
    """A lowered rule, or a lowered `forall` or `optional` block of it.

    Attributes:
        block: the block of the rule; None for the rule itself.
        pattern: the generated pattern; its parameters are `inherited_variables`, then `own_variables`.
        inherited_variables: enclosing variables that the pattern takes as arguments.
        own_variables: variables that the block adds.
        types: types of all variables in scope, as far as the left-hand sides define them.
        nested: the nested `forall` and `optional` blocks.
    """

    block: RuleBlock | None
    left: LeftSide
    pattern: Pattern
    inherited_variables: tuple[str, ...]
    own_variables: tuple[str, ...]
    types: Mapping[str, StaticType | None]
    nested: tuple[LoweredBlock, ...]


class LhsLowering:
    """A lowering of all left-hand sides of one rule.

    Attributes:
        patterns: all generated patterns, callees before callers.
        problems: diagnostics of edges and blocks; the library reports all others when it checks the patterns.
        untyped: names of variables without a known type, for which `problems` contains a diagnostic.
    """

    def __init__(self, rule: Rule, library: Library, unknown: Iterable[str]) -> None:
        self.rule = rule
        self.library = library
        self.metamodel = library.metamodel
        self.patterns: list[Pattern] = []
        self.problems: list[Diagnostic] = []
        self.untyped: set[str] = set()
        self._unknown_variables = frozenset(unknown)
        self._numbers = count(1)

    def lower(self, created: set[str]) -> LoweredBlock:
        """Lower the whole rule and return it as a block. Parameters in `created` are not part of the match."""
        rule = self.rule
        parameters = [p for p in rule.parameters if p.name not in created]
        outside = {p.name: static_type(p.type, self.metamodel) for p in parameters}
        types = self._variable_types(rule.left, rule.blocks, outside)
        constraints, nested = self._lower_body(rule.left, rule.blocks, types, ())
        names = tuple(types)
        declared = [self._lower_parameter(p, rule.left, types[p.name]) for p in parameters]
        constraints += self._mention_parameters(parameters, constraints, types)
        declared += [Parameter(name, span=self.rule.span) for name in names[len(declared) :]]
        pattern = self._add_pattern("lhs", declared, constraints, rule.left)
        return LoweredBlock(None, rule.left, pattern, (), names, types, nested)

    # --- parameters

    def _lower_parameter(
        self,
        parameter: Parameter,
        left: LeftSide,
        type_: StaticType | None,
    ) -> Parameter:
        """Return a pattern parameter for a rule parameter: `in` if it is data that no positive constraint mentions."""
        if type_ is None or isinstance(type_, ObjectType):
            return replace(parameter, direction=None)
        positive = {
            term.name
            for constraint in left.constraints
            if not isinstance(constraint, Negation | Check)
            for term in constraint_terms(constraint)
            if isinstance(term, Variable)
        }
        return replace(parameter, direction=None if parameter.name in positive else "in")

    def _mention_parameters(
        self, parameters: Sequence[Parameter], constraints: Sequence[Constraint], types: VariableTypes
    ) -> list[Constraint]:
        """Return constraints for parameters that the LHS does not mention. Report such parameters without a type."""
        mentioned = all_names(LeftSide(constraints=tuple(constraints)))
        found: list[Constraint] = []
        for parameter in parameters:
            variable = Variable(parameter.name, parameter.span)
            if parameter.name in mentioned:
                continue
            if parameter.type is None:
                self._report_untyped(parameter.name, parameter.span)
                continue
            if isinstance(types[parameter.name], ObjectType):
                found.append(TypeConstraint(parameter.type, variable, span=_declaration_span(parameter)))
            else:
                found.append(Check(Binary("==", variable, variable)))
        return found

    # --- types

    def _variable_types(self, left: LeftSide, blocks: Sequence[RuleBlock], outside: VariableTypes) -> VariableTypes:
        """Return the types that the LHS alone implies for all variables in scope, `outside` first.

        If a type is unknown and there are nested blocks, paths from untyped variables are reported.
        """
        constraints = (*self._type_constraints(left), *map(_edge_path, left.edges), *left.constraints)
        declared = [parameter_for(name, type_) for name, type_ in outside.items()]
        pattern = Pattern(f"{self.rule.name}#types", tuple(declared), (Body(constraints),), package=self.rule.package)
        found = self.library.variable_types(pattern)
        types: VariableTypes = {name: found.get(name) for name in (*outside, *own_variables(left, outside))}
        if blocks and None in types.values():
            # A block cannot supply the class: injectivity, which needs the class, is part of this pattern.
            problems = self.library.analyse(pattern).problems
            self.problems += [without_generated_names(one) for one in problems if one.code == "untyped-source"]
        return types

    # --- bodies

    def _lower_body(
        self, left: LeftSide, blocks: Sequence[RuleBlock], types: VariableTypes, enclosing: Sequence[str]
    ) -> tuple[list[Constraint], tuple[LoweredBlock, ...]]:
        self._check_isolated_nodes(left, enclosing)
        constraints = [*self._type_constraints(left), *self._edge_constraints(left, types), *left.constraints]
        own = [name for name in types if name not in enclosing]
        constraints += self._injectivity_constraints(own, enclosing, types, left)
        nested: list[LoweredBlock] = []
        for block in blocks:
            if block.kind in _CONDITIONS:
                constraints.append(self._lower_condition(block, types))
            else:
                lowered = self._lower_block(block, types, own_variables(block.left, types))
                nested.append(lowered)
                if block.kind == "forall+":
                    constraints.append(_block_call(lowered, span_of=block))
        return constraints, tuple(nested)

    def _check_isolated_nodes(self, left: LeftSide, enclosing: Sequence[str]) -> None:
        """Report nodes without edges and constraints that have no class, or that are data values without a binding."""
        explained = {end for edge in left.edges for end in (edge.source, edge.target)}
        explained |= all_names(LeftSide(constraints=left.constraints))
        explained |= {parameter.name for parameter in self.rule.parameters}
        for node in left.nodes:
            if node.name in explained or node.name in enclosing:
                continue
            if node.type is None:
                self._report_untyped(node.name, node.span)
            elif not isinstance(static_type(node.type, self.metamodel) or ObjectType(""), ObjectType):
                hint = f"bind it, as in `Class.feature(object, {node.name});`, or make it a parameter"
                message = f"`{node.name}`, {quote_with_article(node.type)}, gets no value"
                self._report_error("unbound-value", message, node.span, hint)
                self.untyped.add(node.name)

    def _report_untyped(self, name: str, span: Span | None) -> None:
        self.untyped.add(name)
        message = f"the class of `{name}` is unknown"
        hint = f"write `{name} : Class`"
        self.problems.append(Diagnostic("untyped-variable", message, span, hint, subject=(name,)))

    def _report_error(self, code: str, message: str, span: Span | None, hint: str) -> None:
        self.problems.append(Diagnostic(code, message, span, hint))

    def _type_constraints(self, left: LeftSide) -> Iterator[Constraint]:
        for node in left.nodes:
            if node.type:
                yield TypeConstraint(
                    node.type,
                    Variable(node.name, node.span),
                    span=_declaration_span(node),
                    type_span=node.type_span,
                )

    def _edge_constraints(self, left: LeftSide, types: VariableTypes) -> Iterator[Constraint]:
        for edge in left.edges:
            source = types.get(edge.source)
            if isinstance(source, ObjectType) and source.cls in self.metamodel.classes:
                feature = self.metamodel.feature(source.cls, edge.reference)
                if isinstance(feature, Attribute):
                    hint = f"write `{feature.owner}.{feature.name}({edge.source}, {edge.target});`"
                    message = f"`{feature}` is an attribute, but an edge needs a reference"
                    self._report_error("not-a-reference", message, edge.reference_span or edge.span, hint)
            yield _edge_path(edge)

    def _injectivity_constraints(
        self, own: Sequence[str], enclosing: Sequence[str], types: VariableTypes, left: LeftSide
    ) -> Iterator[Constraint]:
        if not self.rule.injective:
            return
        groups, same = self.rule.homomorphic, equated_pairs(self.rule.left, left)
        for position, one in enumerate(own):
            for other in (*own[position + 1 :], *enclosing):
                if self._may_overlap(types[one], types[other]) and not may_be_same(one, other, groups, same):
                    yield Comparison("!=", Variable(one), Variable(other))

    def _may_overlap(self, left: StaticType | None, right: StaticType | None) -> bool:
        """Return True if an object may be an instance of both types."""
        if not (isinstance(left, ObjectType) and isinstance(right, ObjectType)):
            return False
        known = self.metamodel.classes
        return left.cls in known and right.cls in known and self.metamodel.may_overlap(left.cls, right.cls)

    # --- blocks

    def _lower_condition(self, block: RuleBlock, outside: VariableTypes) -> Constraint:
        """Lower a `not` or `require` block to a call of its pattern, negated for `not`.

        Report and leave out its right-hand side and its nested `forall` and `optional` blocks, which are not allowed.
        """
        if block.right is not None:
            message = f"a `{block.kind}` block is a condition, so it cannot have a right side"
            hint = "move the right side to the rule, or use `forall`"
            self._report_error("misplaced-right-side", message, block.right.span or block.span, hint)
        for inner in block.blocks:
            if inner.kind not in _CONDITIONS:
                message = f"`{inner.kind}` is not allowed in a `{block.kind}` block, which is a condition"
                self._report_error("misplaced-block", message, inner.span, "move it to the rule")
        conditions = tuple(inner for inner in block.blocks if inner.kind in _CONDITIONS)
        misplaced = len(conditions) < len(block.blocks)
        lowered = self._lower_block(replace(block, blocks=conditions), outside, (), quiet=misplaced)
        call = _block_call(lowered, span_of=block)
        return Negation(call, block.span) if block.kind == "not" else call

    def _lower_block(
        self, block: RuleBlock, outside: VariableTypes, exported: Sequence[str], *, quiet: bool = False
    ) -> LoweredBlock:
        """Lower a block to a pattern over the enclosing variables that it uses and its own `exported` variables.

        If `quiet`, an empty block is not reported.
        """
        types = self._variable_types(block.left, block.blocks, outside)
        enclosing = list(outside)
        number = next(self._numbers)
        constraints, nested = self._lower_body(block.left, block.blocks, types, enclosing)
        if not constraints and not quiet:
            message = f"this `{block.kind}` block has no constraints"
            self._report_error("empty-block", message, block.span, "remove it, or write a constraint in it")
        used = all_names(LeftSide(constraints=tuple(constraints)))
        # Nested blocks may use more variables: they are matched later, with the whole enclosing match as arguments.
        inherited = tuple(name for name in enclosing if name in used)
        declared = [parameter_for(name, outside[name]) for name in inherited]
        declared += [Parameter(name) for name in exported]
        unknown = [name for name in inherited if outside[name] is None]  # the enclosing block reports these
        suffix = f"{block.kind.rstrip('+')}{number}"
        pattern = self._add_pattern(suffix, declared, constraints, block.left, unknown)
        return LoweredBlock(block, block.left, pattern, inherited, tuple(exported), types, nested)

    def _add_pattern(
        self,
        suffix: str,
        parameters: Sequence[Parameter],
        constraints: Sequence[Constraint],
        left: LeftSide,
        unknown: Iterable[str] = (),
    ) -> Pattern:
        span = left.span or self.rule.span
        body = Body(tuple(constraints) or (Check(Constant(True), span),), span=span)
        home = self.rule.left.span or self.rule.span
        if span is not None and home is not None and span.source.name != home.source.name:
            span = home  # a block may be a separate source, but private patterns are visible only inside one source
        pattern = Pattern(
            f"{self.rule.name}#{suffix}",
            tuple(parameters),
            (body,),
            package=self.rule.package,
            private=True,
            span=span,
            unknown=self._unknown_variables.union(unknown),
        )
        self.patterns.append(pattern)
        return pattern


def _edge_path(edge: RuleEdge) -> PathConstraint:
    """Return an edge of a left-hand side as a path constraint."""
    return PathConstraint(
        "",
        (edge.reference,),
        Variable(edge.source, edge.source_span or edge.span),
        Variable(edge.target, edge.target_span or edge.span),
        Closure(edge.closure),
        edge.span,
        feature_spans=(edge.reference_span,) if edge.reference_span else (),
    )


def _block_call(lowered: LoweredBlock, span_of: RuleBlock) -> PatternCall:
    """Return a call of a block's pattern: the arguments are the enclosing variables, and `_` for its own variables."""
    arguments = (*lowered.inherited_variables, *("_" for _ in lowered.own_variables))
    return PatternCall(lowered.pattern.qualified_name, tuple(Variable(name) for name in arguments), span=span_of.span)


def _declaration_span(declared: RuleNode | Parameter) -> Span | None:
    """Return the span of a declaration `x : Class`, from the name to the class, or None if it has no span."""
    span, type_span = declared.span, declared.type_span
    return span.joined_with(type_span) if span and type_span else span
