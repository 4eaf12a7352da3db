"""Queries and rules as frozen data, independent of any text: their checks, types and lowered form."""

from typing import TYPE_CHECKING

from envgraph.code import export_lazily

if TYPE_CHECKING:
    from envgraph.pattern._analysis import (
        LibraryEntry as LibraryEntry,
        UnknownNames as UnknownNames,
        derived_reads_in as derived_reads_in,
    )
    from envgraph.pattern._conformance_patterns import (
        conformance_patterns as conformance_patterns,
        key_patterns as key_patterns,
    )
    from envgraph.pattern._declared_functions import FunctionDeclaration as FunctionDeclaration
    from envgraph.pattern._expression_data import (
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
    from envgraph.pattern._goals import (
        AbsenceAtom as AbsenceAtom,
        AggregateAtom as AggregateAtom,
        AttributeAtom as AttributeAtom,
        CallAtom as CallAtom,
        ClosureAtom as ClosureAtom,
        ConditionAtom as ConditionAtom,
        Conjunction as Conjunction,
        Goal as Goal,
        InstanceAtom as InstanceAtom,
        LinkAtom as LinkAtom,
        ObjectType as ObjectType,
        RelationAtom as RelationAtom,
        StaticType as StaticType,
        UnequalAtom as UnequalAtom,
        ValuationAtom as ValuationAtom,
        all_variables as all_variables,
        is_relation as is_relation,
        relation_variables as relation_variables,
        renumber_goal as renumber_goal,
        renumber_relation as renumber_relation,
        required_variables as required_variables,
        visible_variables as visible_variables,
    )
    from envgraph.pattern._library import (
        PATHS as PATHS,
        VALUES as VALUES,
        CheckedPatterns as CheckedPatterns,
        Library as Library,
    )
    from envgraph.pattern._occurrences import (
        BodyVariables as BodyVariables,
        base_of as base_of,
        children as children,
        constraint_terms as constraint_terms,
        required_paths as required_paths,
        rewrite_expressions as rewrite_expressions,
        terms_of as terms_of,
        variables_in as variables_in,
        variables_of_terms as variables_of_terms,
        with_children as with_children,
    )
    from envgraph.pattern._query_data import (
        Aggregate as Aggregate,
        AggregateFunction as AggregateFunction,
        Body as Body,
        Check as Check,
        Closure as Closure,
        ColumnMark as ColumnMark,
        Comparison as Comparison,
        Constraint as Constraint,
        Evaluation as Evaluation,
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
    from envgraph.pattern._rule_data import (
        Action as Action,
        Alap as Alap,
        Applicable as Applicable,
        Assignment as Assignment,
        AtomicStep as AtomicStep,
        BlockKind as BlockKind,
        CreateAction as CreateAction,
        DeleteEdge as DeleteEdge,
        DeleteNode as DeleteNode,
        Derivation as Derivation,
        IfStep as IfStep,
        LeftSide as LeftSide,
        MergeAction as MergeAction,
        Modification as Modification,
        MoveAction as MoveAction,
        RedirectAction as RedirectAction,
        Repeat as Repeat,
        RetypeAction as RetypeAction,
        RightSide as RightSide,
        Rule as Rule,
        RuleBlock as RuleBlock,
        RuleEdge as RuleEdge,
        RuleNode as RuleNode,
        SetAction as SetAction,
        Step as Step,
        StepSequence as StepSequence,
        TryStep as TryStep,
        Unit as Unit,
        UnitCall as UnitCall,
        UnitChoice as UnitChoice,
    )
    from envgraph.pattern._types import (
        data_type_hint as data_type_hint,
        may_be_assignable as may_be_assignable,
        static_type as static_type,
        type_hint as type_hint,
        type_text as type_text,
        value_hint as value_hint,
        value_type as value_type,
    )
    from envgraph.pattern.check._variable_usage import (
        class_warning as class_warning,
        misspelling_warnings as misspelling_warnings,
        quantified_variable_warning as quantified_variable_warning,
    )
    from envgraph.pattern.expressions._builtin_functions import (
        EXPRESSION_NAMESPACE as EXPRESSION_NAMESPACE,
        FUNCTIONS as FUNCTIONS,
        BuiltinFunction as BuiltinFunction,
    )
    from envgraph.pattern.expressions._evaluate import (
        check_holds as check_holds,
        evaluate as evaluate,
        value_of as value_of,
    )
    from envgraph.pattern.expressions._expression_code import compile_expression as compile_expression
    from envgraph.pattern.expressions._expression_types import (
        check_expression as check_expression,
        is_method as is_method,
    )
    from envgraph.pattern.expressions._missing_values import explain_error as explain_error
    from envgraph.pattern.lowering._implied_classes import (
        implied_classes as implied_classes,
        is_implied as is_implied,
    )

export_lazily(globals())
