"""Find the tests after a loop over the ends of a link that restrict the objects of the loop."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import takewhile

from envgraph import code
from envgraph.match.generate._bindings import VariableBindings
from envgraph.match.generate._relation_code import RelationCode
from envgraph.match.generate._source_builder import SourceBuilder
from envgraph.match.generate._symbols import Builtin
from envgraph.match.plan._search_plan import PlanStep, StepKind
from envgraph.metamodel import Reference
from envgraph.pattern import LinkAtom


def link_tests(loop: PlanStep, following: Sequence[PlanStep], bindings: VariableBindings) -> list[PlanStep]:
    """Return the link tests, before the next loop, between the end that a loop over links binds and a known object."""
    if not (isinstance(loop.goal, LinkAtom) and isinstance(loop.goal.reference, Reference)):
        return []
    (end,) = loop.binds
    found: list[PlanStep] = []
    for each in takewhile(lambda step: step.kind is not StepKind.LOOP, following):
        match each:
            case PlanStep(kind=StepKind.TEST, goal=LinkAtom(Reference(), one, other)) if end in (one, other):
                if one != other and bindings.has_value(other if one == end else one):
                    found.append(each)
    return found


def emit_common_ends(
    module: SourceBuilder, relations: RelationCode, loop: LinkAtom, tests: Sequence[PlanStep]
) -> code.Expression:
    """Return code for the ends of a loop; if they are many, for those of them that link tests require, too."""
    others = [relations.emit_ends(test.goal) for test in tests if isinstance(test.goal, LinkAtom)]
    ends = code.Local(module.fresh_name("e"))
    kind = code.AttributeAccess(code.AssignmentExpression(ends, relations.emit_ends(loop)), "__class__")
    short = code.Operation("is", (kind, code.Name("tuple")))  # otherwise a crowded `IndexedSet`
    common = code.emit_call(module.name_of(Builtin("common")), ends, *others)
    return code.ConditionalExpression(short, ends, common)
