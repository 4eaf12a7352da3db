"""Compilation of rule plans to functions that change a model.

A rule without nested blocks whose variables are all different objects becomes a single straight-line function. Any
other rule is executed phase by phase over the matches of all its blocks, after a check for contradictions between them.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterator, Sequence
from contextlib import suppress
from itertools import count
from typing import Any, Final

from envgraph import code
from envgraph.code import dataclass
from envgraph.errors import RAISE_LIMIT_HINT, EvaluationError, RuleError, scaled_limit
from envgraph.graph import Model
from envgraph.match import Matcher
from envgraph.metamodel import Metamodel
from envgraph.rewrite._matches import Row
from envgraph.rewrite._rule_plan import (
    AddLink,
    AdjustAttribute,
    BlockPlan,
    ChangeTargets,
    CreateObject,
    Operation,
    RulePlan,
    SetAttributeValues,
)
from envgraph.rewrite.check._claims import claims_of, endangered_classes, may_refuse
from envgraph.rewrite.check._contradictions import ConflictCheck, Contradiction, FreshObject, format_change
from envgraph.rewrite.run._notices import ReportLink
from envgraph.rewrite.run._refusal import explain_refusal
from envgraph.rewrite.run._rule_code import FIRST_NEW_ID, RuleCodeEmitter
from envgraph.rewrite.run._rule_runtime import check_kept

ApplyRule = Callable[[Row], Sequence[Any]]
"""A function that applies a rule at a match and returns all slots of the rule, including created objects.

Raises:
    RuleError: the rule is refused; the model is unchanged.
"""

ReportExistingLink = Callable[[AddLink, int, int], None]

PHASES: Final = ("compute", "unlink", "delete", "strip", "retype", "create", "link", "assign")


def compile_rule(plan: RulePlan, model: Model, matcher: Matcher, report: ReportLink) -> ApplyRule:
    """Compile a plan to the function that applies the rule. `report` is called for created links that already exist."""

    def report_existing_link(link: AddLink, source: int, target: int) -> None:
        report(plan.name, link, model.graph.describe(source), model.graph.describe(target))

    body = plan.body
    if body.may_contradict:
        return _PhasedRule(plan, model, matcher, report_existing_link).apply
    return _compile_straight_line(plan, model, report_existing_link)


# --- straight rules


def _compile_straight_line(plan: RulePlan, model: Model, again: ReportExistingLink) -> ApplyRule:
    body = plan.body
    endangered = endangered_classes([body], model.metamodel)
    writer = RuleCodeEmitter(model, _slot_local, lossy=plan.is_spo, sure=True, again=again, endangered=endangered)
    kept = tuple(slot for slot in body.preserved_slots if body.classes[slot] in endangered)
    changes = _emit_changes(writer, body, kept)
    computed = writer.compute(body)
    writer.namespace.update(
        store=model.graph.store,
        interrupted=model.graph.store.interrupted_writes,
        refusals=REFUSALS,
        refused=lambda error: explain_refusal(plan, error, model),
        BaseException=BaseException,
    )
    whole: code.Body = (*computed, *changes)
    if kept or _needs_savepoint(plan, model.metamodel):
        writer.namespace.update(savepoint=model.graph.history.savepoint, release=model.graph.history.release)
        mark = code.Local("mark")
        protected = code.Try(
            (*changes, code.emit_call_statement("release", mark)),
            (_emit_interruption_handler(mark),),
        )
        whole = (*computed, code.Assign(mark, code.emit_call("savepoint")), protected)
    elif len(changes) > 1:
        names = [_slot_local(slot) for slot in (*range(body.variable_count), *(c.slot for c in body.computed))]
        begin = [code.Assign(total, code.NONE) for total in writer.sums]
        names += writer.sums
        if body.creates:
            begin.append(code.Assign(FIRST_NEW_ID, code.AttributeAccess(code.Name("store"), "next_id")))
            names.append(FIRST_NEW_ID)
        writer.namespace["redo"] = _redo_function(plan, model, endangered, names)
        redo = code.emit_tuple(code.Name("redo"), code.emit_tuple(*names))
        handlers = (
            code.ExceptClause(code.Name("refusals"), None, (code.Raise(),)),
            _emit_interruption_handler(redo),
        )
        whole = (*computed, *begin, code.Try(changes, handlers))
    row, error = code.Local("row"), code.Local("error")
    unpacked = (code.Assign(writer.slot_tuple(range(body.variable_count)), row),) if body.variable_count else ()
    caught = code.ExceptClause(code.Name("refusals"), error, (code.Raise(code.emit_call("refused", error)),))
    tried = code.Try((*whole, code.Return(writer.slot_tuple(range(body.slot_count)))), (caught,))
    function = code.Function("do_apply", (row,), (*unpacked, tried))
    effect: ApplyRule = code.define_functions((function,), _FILE_NAME, writer.namespace)["do_apply"]
    return effect


_FILE_NAME: Final = "<rule of envgraph>"


def _slot_local(number: int) -> code.Local:
    return code.Local(f"e{number}")


def _emit_changes(writer: RuleCodeEmitter, body: BlockPlan, kept: tuple[int, ...] = ()) -> code.Body:
    """Emit code for the changes of a straight-line rule, in order, with a check of the slots `kept` after deletions."""
    changes = [*writer.unlink(body), *writer.delete(body)]
    changes += [writer.emit_preserved_check(kept, body)] if kept else []
    return (*changes, *(statement for phase in PHASES[3:] for statement in getattr(writer, phase)(body)))


def _emit_interruption_handler(end: code.Expression) -> code.ExceptClause:
    """Emit an exception handler that undoes or completes partly executed changes and raises the exception again.

    `end` is a savepoint for undoing, or a function with its arguments that completes the changes; see `Interrupted`.
    """
    done = [
        code.emit_method_call(code.Name("interrupted"), "append", end),
        code.emit_method_call(code.Name("interrupted"), "repair"),
    ]
    return code.ExceptClause(code.Name("BaseException"), None, (*map(code.ExpressionStatement, done), code.Raise()))


def _redo_function(
    plan: RulePlan, model: Model, endangered: Collection[str], names: Sequence[code.Local]
) -> Callable[..., None]:
    """Return a function that completes the changes of a straight-line rule after an interruption.

    Some changes may be made already. Only the first change may be refused.
    """

    def redo(*values: Any) -> None:
        writer = RuleCodeEmitter(model, _slot_local, lossy=plan.is_spo, sure=True, redo=True, endangered=endangered)
        function = code.Function("do_again", tuple(names), _emit_changes(writer, plan.body))
        with suppress(*REFUSALS):
            code.define_functions((function,), _FILE_NAME, writer.namespace)["do_again"](*values)

    return redo


def _needs_savepoint(plan: RulePlan, metamodel: Metamodel) -> bool:
    """Return True if a rule without blocks may be refused, or a value be out of range, after it has changed the model.

    This is so if a change that can be refused follows another change, or if the rule has a move or merge, which takes
    several changes.
    """
    body, steps = plan.body, list[Operation | CreateObject]()
    for operation in body.operations:
        steps += [operation] * (len(operation.values) if isinstance(operation, ChangeTargets) else 1)
    return bool(body.moves or body.absorbs) or any(
        isinstance(step, AdjustAttribute | SetAttributeValues) or may_refuse(step, body, metamodel, lossy=plan.is_spo)
        for step in steps[1:]
    )


REFUSALS: Final = (RuleError, EvaluationError)


# --- rules with blocks


@dataclass(slots=True)
class BlockMatch:
    """A match of a block: the block, the values of its slots, and the match of the enclosing block."""

    block: _CompiledBlock
    slots: list[Any]
    parent: BlockMatch | None


class _CompiledBlock:
    """A block of a rule with one compiled function for each phase."""

    def __init__(
        self,
        plan: BlockPlan,
        model: Model,
        matcher: Matcher,
        lossy: bool,
        doomed: Collection[int],
        endangered: Collection[str],
    ) -> None:
        self.plan = plan
        self.claims = tuple(claims_of(plan, model.metamodel))
        self.rows = matcher.prepare(plan.pattern, tuple(range(len(plan.arguments)))) if plan.kind != "rule" else None
        self.nested = [_CompiledBlock(inner, model, matcher, lossy, doomed, endangered) for inner in plan.nested]
        slots = code.Local("e")
        writer = RuleCodeEmitter(
            model,
            lambda n: code.Subscript(slots, code.Constant(n)),
            lossy=lossy,
            doomed=doomed,
            endangered=endangered,
        )
        phases = {phase: tuple(getattr(writer, phase)(plan)) for phase in PHASES}
        functions = tuple(code.Function(f"do_{phase}", (slots,), body) for phase, body in phases.items() if body)
        made = code.define_functions(functions, _FILE_NAME, writer.namespace)
        self.phases: dict[str, Callable[[list[Any]], None] | None] = {
            phase: made.get(f"do_{phase}") for phase in PHASES
        }

    def collect(
        self,
        slots: list[Any],
        parent: BlockMatch | None,
        found: list[BlockMatch],
        fresh: Iterator[int],
        most: int,
    ) -> None:
        """Add the instance with these slots to `found`, then the instances of nested blocks in the current state.

        `fresh` yields the ids of placeholders for created objects.

        Raises:
            EvaluationError: there would be more than `most` instances.
        """
        slots += [None] * (self.plan.slot_count - len(slots))
        for new in self.plan.creates:
            slots[new.node] = FreshObject(next(fresh))
        instance = BlockMatch(self, slots, parent)
        found.append(instance)
        for block in self.nested:
            assert block.rows is not None
            # Sorted, because ids of new objects depend on this order and the order of the matcher is arbitrary.
            rows = sorted(block.rows(*(slots[number] for number in block.plan.arguments)))
            if block.plan.kind == "optional":
                rows = rows[:1]
            if len(found) + len(rows) > most:
                message = f"the blocks of one application have more than {most:,} matches"
                raise EvaluationError(message, block.plan.span, f"restrict their left sides; {RAISE_LIMIT_HINT}")
            for row in rows:
                block.collect([*slots, *row[len(block.plan.arguments) :]], instance, found, fresh, most)


class _PhasedRule:
    """An executor, phase by phase, of rules with nested blocks and rules whose changed objects may coincide."""

    def __init__(self, plan: RulePlan, model: Model, matcher: Matcher, again: ReportExistingLink) -> None:
        self.plan = plan
        self.model = model
        self.report_existing = again
        self.most = scaled_limit("instances")
        self.doomed: set[int] = set()
        endangered = endangered_classes(plan.blocks, model.metamodel)
        self.block = _CompiledBlock(plan.body, model, matcher, plan.is_spo, self.doomed, endangered)

    def apply(self, row: Row) -> Sequence[Any]:
        """Apply the rule at a match and return its slots. If it is refused, raise the error and undo all changes."""
        instances: list[BlockMatch] = []
        try:
            self.block.collect(list(row), None, instances, count(-1, -1), self.most)
            self._run_phase(instances, "compute")
            wants = self._check_conflicts(instances)
            self.doomed.clear()
            self.doomed.update(i.slots[each.node] for i in instances for each in i.block.plan.deletes)
            with self.model.transaction():
                for phase in PHASES[1:]:
                    self._run_phase(instances, phase)
                    if phase == "delete":
                        self._check_kept(instances, wants)
                        self._report_existing_links(instances)
        except REFUSALS as error:
            raise explain_refusal(self.plan, error, self.model) from None
        return instances[0].slots

    def _run_phase(self, instances: Sequence[BlockMatch], phase: str) -> None:
        for instance in instances:
            if phase == "create" and instance.parent is not None:
                inherited = instance.block.plan.inherited_count
                instance.slots[:inherited] = instance.parent.slots[:inherited]
            function = instance.block.phases[phase]
            if function is not None:
                function(instance.slots)

    def _check_conflicts(self, instances: Sequence[BlockMatch]) -> ConflictCheck:
        """Check the instances for contradictory changes and return the collected changes.

        Raises:
            RuleError: two changes contradict each other ("ambiguous"), or a deletion is ambiguous ("identification").
        """
        conflicts = ConflictCheck(self.model.metamodel, self._describe)
        try:
            for instance in instances:
                conflicts.add_match(instance.block.plan, instance.block.claims, instance.slots)
            conflicts.check_all()
        except Contradiction as error:
            details = [format_change(want, self._describe) for want in error.changes]
            span = getattr(error.changes[1].operation, "span", None)
            raise RuleError(error.message, reason="ambiguous", details=details, span=span) from None
        return conflicts

    def _describe(self, node: int) -> str:
        return "a new object" if isinstance(node, FreshObject) else self.model.graph.describe(node)

    def _check_kept(self, instances: Sequence[BlockMatch], wants: ConflictCheck) -> None:
        if not wants.deleted:
            return
        for instance in instances:
            plan, slots = instance.block.plan, instance.slots
            kept = tuple(slot for slot in plan.preserved_slots if slots[slot] not in wants.deleted)
            check_kept(
                self.model.graph,
                tuple(slots[slot] for slot in kept),
                tuple(plan.names[slot] for slot in kept),
            )
        changed = tuple(node for node in wants.changed if not isinstance(node, FreshObject))
        check_kept(self.model.graph, changed, ("",) * len(changed))

    def _report_existing_links(self, instances: Sequence[BlockMatch]) -> None:
        """Report links that the rule creates although they already exist."""
        for instance in instances:
            for link in instance.block.plan.links:
                source, target = instance.slots[link.source], instance.slots[link.target]
                if target is None or isinstance(source, FreshObject) or isinstance(target, FreshObject):
                    continue
                if self.model.graph.has_link(source, link.reference, target):
                    self.report_existing(link, source, target)
