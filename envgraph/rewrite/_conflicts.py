"""What the matches of one application must agree on."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from typing import Any

from envgraph.errors import RuleError
from envgraph.graph import Model
from envgraph.metamodel import Attribute, Reference
from envgraph.rewrite._plan import BlockPlan, ChangeTargets, Increase, SetTargets, SetValue, Unlink

Link = tuple[Reference, int, int]


class Conflicts:
    """Collects what every match of an application wants, and refuses it where two do not go together.

    Deleting the same thing twice, creating the same link twice and giving one value twice is agreement.
    """

    def __init__(self, model: Model) -> None:
        self.model = model
        self._deleted: dict[int, str] = {}
        self._touched: dict[int, str] = {}
        self._classes: dict[int, tuple[str, str]] = {}
        self._values: dict[tuple[int, Attribute | Reference], tuple[object, str]] = {}
        self._removed: dict[Link, str] = {}
        self._added: dict[Link, str] = {}

    def add(self, plan: BlockPlan, slots: Sequence[Any]) -> None:
        """Take in one match of a block.

        Raises:
            RuleError: it deletes something that its own left side keeps ("identification"), or it does not go
                together with an earlier one ("ambiguous").
        """
        self._identification(plan, slots)
        where = self._name(plan, slots)
        for delete in plan.deletes:
            self._delete(slots[delete.node], where)
        for absorb in plan.absorbs:
            self._touch(slots[absorb.kept], where)
            self._delete(slots[absorb.absorbed], where)
        for retype in plan.retypes:
            self._retype(slots[retype.node], retype.cls, where)
        for unlink in plan.unlinks:
            self._unlink(self._link(unlink, slots), where)
        self._links(plan, slots, where)
        for change in plan.sets:
            self._set(change, slots, where)

    @property
    def deleted(self) -> Collection[int]:
        """The objects that a match deletes."""
        return self._deleted.keys()

    def _identification(self, plan: BlockPlan, slots: Sequence[Any]) -> None:
        for gone, other in plan.identified:
            if slots[gone] == slots[other]:
                names = f"`{plan.names[gone]}` and `{plan.names[other]}`"
                message = f"{names} are one object, and `{plan.names[gone]}` is deleted"
                raise RuleError(message, reason="identification", details=[self._object(slots[gone])])
        for gone_link, other_link in plan.identified_links:
            if self._link(gone_link, slots) == self._link(other_link, slots):
                message = f"two arrows `{gone_link.reference.name}` are one link, and one of them is deleted"
                details = [self._object(slots[gone_link.source]), self._object(slots[gone_link.target])]
                raise RuleError(message, reason="identification", details=details)

    def _delete(self, node: int, where: str) -> None:
        if node in self._touched:
            self._refuse(f"{self._object(node)} is deleted and changed", where, self._touched[node])
        self._deleted.setdefault(node, where)

    def _touch(self, node: int | None, where: str) -> None:
        if node is None:
            return
        if node in self._deleted:
            self._refuse(f"{self._object(node)} is deleted and changed", where, self._deleted[node])
        self._touched.setdefault(node, where)

    def _retype(self, node: int, cls: str, where: str) -> None:
        self._touch(node, where)
        other, earlier = self._classes.setdefault(node, (cls, where))
        if other != cls:
            self._refuse(f"{self._object(node)} becomes `{other}` and `{cls}`", where, earlier)

    def _unlink(self, link: Link, where: str) -> None:
        if link in self._added:
            self._refuse(f"{self._text(link)} is removed and added", where, self._added[link])
        self._removed.setdefault(link, where)

    def _links(self, plan: BlockPlan, slots: Sequence[Any], where: str) -> None:
        own = {self._link(unlink, slots) for unlink in plan.unlinks}
        for move in plan.moves:
            self._touch(slots[move.node], where)
            self._touch(slots[move.container], where)
            self._agree(slots[move.node], move.reference, slots[move.container], where)
        for link in plan.links:
            source, target = slots[link.source], slots[link.target]
            if source is None or target is None:
                continue  # created by this application, or no target
            self._touch(source, where)
            self._touch(target, where)
            found = self._canonical(link.reference, source, target)
            if found in self._removed and found not in own:
                self._refuse(f"{self._text(found)} is removed and added", where, self._removed[found])
            self._added.setdefault(found, where)

    def _set(self, change: object, slots: Sequence[Any], where: str) -> None:
        match change:
            case SetValue(node, attribute, value):
                self._touch(slots[node], where)
                self._agree(slots[node], attribute, None if value is None else slots[value], where)
            case Increase(node, attribute):
                self._touch(slots[node], where)
                self._agree(slots[node], attribute, "more or less", where)
            case SetTargets(node, reference, values):
                targets = tuple(slots[value] for value in values)
                for end in (slots[node], *targets):
                    self._touch(end, where)
                self._agree(slots[node], reference, targets, where)
            case ChangeTargets(node, reference):
                self._touch(slots[node], where)
                self._agree(slots[node], reference, "some", where)
            case _:
                raise AssertionError(change)

    def _agree(self, node: int | None, feature: Attribute | Reference, value: object, where: str) -> None:
        if node is None:
            return
        other, earlier = self._values.setdefault((node, feature), (value, where))
        if other != value:
            self._refuse(
                f"{self._object(node)} gets two values of `{feature}`: {other} and {value}", where, earlier
            )

    # --- what it is about

    def _link(self, op: Unlink, slots: Sequence[Any]) -> Link:
        return self._canonical(op.reference, slots[op.source], slots[op.target])

    def _canonical(self, reference: Reference, source: int, target: int) -> Link:
        opposite = self.model.metamodel.opposite(reference)
        if opposite is not None and (opposite.index, target, source) < (reference.index, source, target):
            return opposite, target, source
        return reference, source, target

    def _refuse(self, message: str, one: str, other: str) -> None:
        raise RuleError(message, reason="ambiguous", details=[other, one])

    def _name(self, plan: BlockPlan, slots: Sequence[Any]) -> str:
        shown = list(zip(plan.names, slots, strict=False))[: plan.inherited + plan.variables]
        inside = ", ".join(f"{name}={value}" for name, value in shown if name and value is not None)
        return f"{plan.kind}({inside})"

    def _object(self, node: int) -> str:
        return repr(self.model.node(node))

    def _text(self, link: Link) -> str:
        reference, source, target = link
        return f"{self._object(source)} -{reference.name}-> {self._object(target)}"
