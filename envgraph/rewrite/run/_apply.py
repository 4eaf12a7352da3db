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
from envgraph.errors import RAISE_LIMIT, EvaluationError, RuleError, limit
from envgraph.graph import Model
from envgraph.match import Matcher
from envgraph.metamodel import Metamodel, Reference
from envgraph.rewrite._match import Row
from envgraph.rewrite._plan import BlockPlan, ChangeTargets, Link, RulePlan, SetTargets, SetValue
from envgraph.rewrite.check._conflicts import Conflicts, Contradiction, Fresh, told
from envgraph.rewrite.run._effects import check_kept
from envgraph.rewrite.run._notices import Report
from envgraph.rewrite.run._refusal import refusal
from envgraph.rewrite.run._source import FIRST, Writer

Effect = Callable[[Row], Sequence[Any]]
"""A function that applies a rule at a match and returns all slots of the rule, including created objects.

Raises:
    RuleError: the rule is refused; the model is unchanged.
"""

Again = Callable[[Link, int, int], None]

PHASES: Final = ("compute", "unlink", "delete", "strip", "retype", "create", "link", "assign")


def effect_of(plan: RulePlan, model: Model, matcher: Matcher, report: Report) -> Effect:
    """Compile a plan to the function that applies the rule. `report` is called for created links that already exist."""

    def again(link: Link, source: int, target: int) -> None:
        report(plan.name, link, model.graph.describe(source), model.graph.describe(target))

    body = plan.body
    if body.nested or body.coinciding or body.contended:
        return _Staged(plan, model, matcher, again).apply
    return _straight(plan, model, again)


# --- straight rules


def _straight(plan: RulePlan, model: Model, again: Again) -> Effect:
    body = plan.body
    endangered = _endangered([body], model.metamodel)
    writer = Writer(model, _slot, lossy=plan.lossy, sure=True, again=again, endangered=endangered)
    kept = tuple(slot for slot in body.kept if body.classes[slot] in endangered)
    changes = _changes(writer, body, kept)
    computed = writer.compute(body)
    writer.namespace.update(
        store=model.graph.store,
        interrupted=model.graph.store.interrupted,
        refusals=REFUSALS,
        refused=lambda error: refusal(plan, error, model),
        BaseException=BaseException,
    )
    whole: code.Body = (*computed, *changes)
    if kept or _needs_savepoint(body, model.metamodel):
        writer.namespace.update(savepoint=model.graph.history.savepoint, release=model.graph.history.release)
        mark = code.Local("mark")
        protected = code.Try((*changes, code.Do(code.call("release", mark))), (_interrupted(mark),))
        whole = (*computed, code.Assign(mark, code.call("savepoint")), protected)
    elif len(changes) > 1:
        names = [_slot(slot) for slot in (*range(body.variables), *(c.slot for c in body.computed))]
        begin = [code.Assign(total, code.NONE) for total in writer.sums]
        names += writer.sums
        if body.creates:
            begin.append(code.Assign(FIRST, code.Member(code.Name("store"), "next_id")))
            names.append(FIRST)
        writer.namespace["redo"] = _redone(plan, model, endangered, names)
        redo = code.tuple_of(code.Name("redo"), code.tuple_of(*names))
        handlers = code.Handler(code.Name("refusals"), None, (code.Raise(),)), _interrupted(redo)
        whole = (*computed, *begin, code.Try(changes, handlers))
    row, error = code.Local("row"), code.Local("error")
    unpacked = (code.Assign(writer.slots(range(body.variables)), row),) if body.variables else ()
    caught = code.Handler(code.Name("refusals"), error, (code.Raise(code.call("refused", error)),))
    tried = code.Try((*whole, code.Return(writer.slots(range(body.slots)))), (caught,))
    function = code.Function("do_apply", (row,), (*unpacked, tried))
    effect: Effect = code.define((function,), _FILE, writer.namespace)["do_apply"]
    return effect


_FILE: Final = "<rule of envgraph>"


def _slot(number: int) -> code.Local:
    return code.Local(f"e{number}")


def _changes(writer: Writer, body: BlockPlan, kept: tuple[int, ...] = ()) -> code.Body:
    """Emit code for the changes of a straight-line rule, in order, with a check of the slots `kept` after deletions."""
    changes = [*writer.unlink(body), *writer.delete(body)]
    changes += [writer.keep(kept, body)] if kept else []
    return (*changes, *(statement for phase in PHASES[3:] for statement in getattr(writer, phase)(body)))


def _interrupted(end: code.Expression) -> code.Handler:
    """Emit an exception handler that undoes or completes partly executed changes and raises the exception again.

    `end` is a savepoint for undoing, or a function with its arguments that completes the changes; see `Interrupted`.
    """
    done = [
        code.method(code.Name("interrupted"), "append", end),
        code.method(code.Name("interrupted"), "repair"),
    ]
    return code.Handler(code.Name("BaseException"), None, (*map(code.Do, done), code.Raise()))


def _redone(
    plan: RulePlan, model: Model, endangered: Collection[str], names: Sequence[code.Local]
) -> Callable[..., None]:
    """Return a function that completes the changes of a straight-line rule after an interruption.

    Some changes may be made already. Only the first change may be refused.
    """

    def redo(*values: Any) -> None:
        writer = Writer(model, _slot, lossy=plan.lossy, sure=True, redo=True, endangered=endangered)
        function = code.Function("do_again", tuple(names), _changes(writer, plan.body))
        with suppress(*REFUSALS):
            code.define((function,), _FILE, writer.namespace)["do_again"](*values)

    return redo


def _endangered(blocks: Sequence[BlockPlan], metamodel: Metamodel) -> set[str]:
    """Return classes of variables whose objects may be deleted together with an object that a block deletes."""
    classes = {b.classes[d.node] for b in blocks for d in b.deletes} - {None}
    deleted = (sub for cls in classes for sub in metamodel.concrete(cls or ""))
    return {above for cls in metamodel.all_contents(deleted) for above in metamodel.supertypes(cls)}


def _needs_savepoint(body: BlockPlan, metamodel: Metamodel) -> bool:
    """Return True if a refusable change follows another one, or for moves and merges, which are several changes."""
    if body.moves or body.absorbs:
        return True
    safe = [True] * len(body.unlinks)
    safe += [False] * (len(body.deletes) + len(body.retypes))
    safe += [True] * len(body.creates)
    safe += [_always_fits(link.reference, metamodel) for link in body.links]
    for change in body.sets:
        match change:
            case SetValue():
                safe.append(True)
            case SetTargets():
                safe.append(_always_set(change.reference, metamodel))
            case ChangeTargets():
                safe += [change.operator == "-=" or _always_fits(change.reference, metamodel)] * len(
                    change.values
                )
            case _:
                safe.append(False)
    return not all(safe[1:])


def _always_fits(reference: Reference, metamodel: Metamodel) -> bool:
    """Return True if the model never refuses a link of this reference between ends of the right classes."""
    return reference.upper is None and metamodel.most_sources(reference) is None


def _always_set(reference: Reference, metamodel: Metamodel) -> bool:
    """Return True if a reference is single-valued and the model never refuses to replace its target."""
    contains = metamodel.containment(reference, 0, 1) is not None
    return not (reference.many or contains) and metamodel.most_sources(reference) in (None, 1)


REFUSALS: Final = (RuleError, EvaluationError)


# --- rules with blocks


@dataclass(slots=True)
class Instance:
    """A match of a block: the block, the values of its slots, and the match of the enclosing block."""

    block: _Block
    slots: list[Any]
    parent: Instance | None


class _Block:
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
        self.rows = (
            matcher.prepare(plan.pattern, tuple(range(len(plan.arguments)))) if plan.kind != "rule" else None
        )
        self.nested = [_Block(inner, model, matcher, lossy, doomed, endangered) for inner in plan.nested]
        slots = code.Local("e")
        writer = Writer(
            model,
            lambda n: code.Index(slots, code.Constant(n)),
            lossy=lossy,
            doomed=doomed,
            endangered=endangered,
        )
        phases = {phase: tuple(getattr(writer, phase)(plan)) for phase in PHASES}
        functions = tuple(
            code.Function(f"do_{phase}", (slots,), body) for phase, body in phases.items() if body
        )
        made = code.define(functions, _FILE, writer.namespace)
        self.phases: dict[str, Callable[[list[Any]], None] | None] = {
            phase: made.get(f"do_{phase}") for phase in PHASES
        }

    def collect(
        self,
        slots: list[Any],
        parent: Instance | None,
        found: list[Instance],
        fresh: Iterator[int],
        most: int,
    ) -> None:
        """Add the instance with these slots to `found`, then the instances of nested blocks in the current state.

        `fresh` yields the ids of placeholders for created objects.

        Raises:
            EvaluationError: there would be more than `most` instances.
        """
        slots += [None] * (self.plan.slots - len(slots))
        for new in self.plan.creates:
            slots[new.node] = Fresh(next(fresh))
        instance = Instance(self, slots, parent)
        found.append(instance)
        for block in self.nested:
            assert block.rows is not None
            # Sorted, because ids of new objects depend on this order and the order of the matcher is arbitrary.
            rows = sorted(block.rows(*(slots[number] for number in block.plan.arguments)))
            if block.plan.kind == "optional":
                rows = rows[:1]
            if len(found) + len(rows) > most:
                message = f"the blocks of one application have more than {most:,} matches"
                raise EvaluationError(message, block.plan.span, f"restrict their left sides; {RAISE_LIMIT}")
            for row in rows:
                block.collect([*slots, *row[len(block.plan.arguments) :]], instance, found, fresh, most)


class _Staged:
    """An executor, phase by phase, of rules with nested blocks and rules whose changed objects may coincide."""

    def __init__(self, plan: RulePlan, model: Model, matcher: Matcher, again: Again) -> None:
        self.plan = plan
        self.model = model
        self.again = again
        self.most = limit("instances")
        self.doomed: set[int] = set()
        endangered = _endangered(plan.blocks, model.metamodel)
        self.block = _Block(plan.body, model, matcher, plan.lossy, self.doomed, endangered)

    def apply(self, row: Row) -> Sequence[Any]:
        """Apply the rule at a match and return its slots. If it is refused, raise the error and undo all changes."""
        instances: list[Instance] = []
        try:
            self.block.collect(list(row), None, instances, count(-1, -1), self.most)
            self._run(instances, "compute")
            wants = self._check(instances)
            self.doomed.clear()
            self.doomed.update(i.slots[each.node] for i in instances for each in i.block.plan.deletes)
            with self.model.transaction():
                for phase in PHASES[1:]:
                    self._run(instances, phase)
                    if phase == "delete":
                        self._check_kept(instances, wants)
                        self._notify(instances)
        except REFUSALS as error:
            raise refusal(self.plan, error, self.model) from None
        return instances[0].slots

    def _run(self, instances: Sequence[Instance], phase: str) -> None:
        for instance in instances:
            if phase == "create" and instance.parent is not None:
                inherited = instance.block.plan.inherited
                instance.slots[:inherited] = instance.parent.slots[:inherited]
            function = instance.block.phases[phase]
            if function is not None:
                function(instance.slots)

    def _check(self, instances: Sequence[Instance]) -> Conflicts:
        """Check the instances for contradictory changes and return the collected changes.

        Raises:
            RuleError: two changes contradict each other ("ambiguous"), or a deletion is ambiguous ("identification").
        """
        conflicts = Conflicts(self.model.metamodel, self._describe)
        try:
            for instance in instances:
                conflicts.add(instance.block.plan, instance.slots)
            conflicts.finish()
        except Contradiction as error:
            details = [told(want, self._describe) for want in error.wants]
            span = getattr(error.wants[1].operation, "span", None)
            raise RuleError(error.message, reason="ambiguous", details=details, span=span) from None
        return conflicts

    def _describe(self, node: int) -> str:
        return "a new object" if isinstance(node, Fresh) else self.model.graph.describe(node)

    def _check_kept(self, instances: Sequence[Instance], wants: Conflicts) -> None:
        if not wants.deleted:
            return
        for instance in instances:
            plan, slots = instance.block.plan, instance.slots
            kept = tuple(slot for slot in plan.kept if slots[slot] not in wants.deleted)
            check_kept(
                self.model.graph,
                tuple(slots[slot] for slot in kept),
                tuple(plan.names[slot] for slot in kept),
            )
        changed = tuple(node for node in wants.changed if not isinstance(node, Fresh))
        check_kept(self.model.graph, changed, ("",) * len(changed))

    def _notify(self, instances: Sequence[Instance]) -> None:
        """Report links that the rule creates although they already exist."""
        for instance in instances:
            for link in instance.block.plan.links:
                source, target = instance.slots[link.source], instance.slots[link.target]
                if target is None or isinstance(source, Fresh) or isinstance(target, Fresh):
                    continue
                if self.model.graph.has_link(source, link.reference, target):
                    self.again(link, source, target)
