"""Queries and rules as frozen data, independent of any text: their checks, types and lowered form."""

from typing import TYPE_CHECKING

from envgraph.code import later

if TYPE_CHECKING:
    from envgraph.pattern._analysis import (
        Entry as Entry,
        UnknownNames as UnknownNames,
        expression_reads as expression_reads,
    )
    from envgraph.pattern._bodies import (
        Reading as Reading,
        children as children,
        navigations as navigations,
        terms_in as terms_in,
        terms_of as terms_of,
        variables_in as variables_in,
        variables_of_terms as variables_of_terms,
        with_children as with_children,
    )
    from envgraph.pattern._conformance import (
        conformance_patterns as conformance_patterns,
        key_patterns as key_patterns,
    )
    from envgraph.pattern._functions import FunctionDeclaration as FunctionDeclaration
    from envgraph.pattern._library import PATHS as PATHS, VALUES as VALUES, Library as Library
    from envgraph.pattern._lowered import (
        Absence as Absence,
        AggregateAtom as AggregateAtom,
        AttributeAtom as AttributeAtom,
        CallAtom as CallAtom,
        ClosureAtom as ClosureAtom,
        Condition as Condition,
        Conjunction as Conjunction,
        Goal as Goal,
        InstanceAtom as InstanceAtom,
        LinkAtom as LinkAtom,
        ObjectType as ObjectType,
        RelationAtom as RelationAtom,
        StaticType as StaticType,
        UnequalAtom as UnequalAtom,
        Valuation as Valuation,
        arguments as arguments,
        inputs as inputs,
        is_relation as is_relation,
        mentioned as mentioned,
        outputs as outputs,
        renumbered as renumbered,
        renumbered_relation as renumbered_relation,
        variables as variables,
    )
    from envgraph.pattern._queries import (
        Aggregate as Aggregate,
        Body as Body,
        Check as Check,
        Closure as Closure,
        Comparison as Comparison,
        Constraint as Constraint,
        Evaluation as Evaluation,
        Hash as Hash,
        Negation as Negation,
        Parameter as Parameter,
        PathConstraint as PathConstraint,
        Pattern as Pattern,
        PatternCall as PatternCall,
        Relation as Relation,
        Strategy as Strategy,
        Term as Term,
        TypeConstraint as TypeConstraint,
    )
    from envgraph.pattern._rules import (
        Action as Action,
        Alap as Alap,
        Applicable as Applicable,
        Assignment as Assignment,
        Atomic as Atomic,
        Block as Block,
        BlockKind as BlockKind,
        Call as Call,
        Choice as Choice,
        Create as Create,
        DeleteEdge as DeleteEdge,
        DeleteNode as DeleteNode,
        Derivation as Derivation,
        Edge as Edge,
        If as If,
        LeftSide as LeftSide,
        Merge as Merge,
        Modification as Modification,
        Move as Move,
        Node as Node,
        Redirect as Redirect,
        Repeat as Repeat,
        Retype as Retype,
        RightSide as RightSide,
        Rule as Rule,
        Sequence as Sequence,
        Set as Set,
        Step as Step,
        Try as Try,
        Unit as Unit,
    )
    from envgraph.pattern._terms import (
        Binary as Binary,
        Conditional as Conditional,
        Constant as Constant,
        EnumLiteral as EnumLiteral,
        Expression as Expression,
        FunctionCall as FunctionCall,
        Navigation as Navigation,
        Unary as Unary,
        Variable as Variable,
    )
    from envgraph.pattern._types import (
        data_type_hint as data_type_hint,
        may_fit as may_fit,
        static_type as static_type,
        type_hint as type_hint,
        type_text as type_text,
        value_hint as value_hint,
        value_type as value_type,
    )
    from envgraph.pattern.check._usage import mistyped as mistyped, quantified_variable as quantified_variable
    from envgraph.pattern.expressions._compile import compile_expression as compile_expression
    from envgraph.pattern.expressions._evaluate import (
        evaluate as evaluate,
        holds as holds,
        value_of as value_of,
    )
    from envgraph.pattern.expressions._expressions import (
        check_expression as check_expression,
        is_method as is_method,
    )
    from envgraph.pattern.expressions._failure import explained as explained
    from envgraph.pattern.expressions._operations import (
        EXPRESSION_NAMESPACE as EXPRESSION_NAMESPACE,
        Function as Function,
    )
    from envgraph.pattern.lowering._implied import (
        implied_classes as implied_classes,
        is_implied as is_implied,
    )

later(globals())
