"""The last step of lowering: number the variables, drop what is implied, and put a pattern together."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import replace

from envgraph.errors import Span, spelling
from envgraph.metamodel import Metamodel, Value
from envgraph.pattern._bodies import children, with_children
from envgraph.pattern._inference import BodyTypes
from envgraph.pattern._lowered import (
    AggregateAtom,
    Atom,
    AttributeAtom,
    CallAtom,
    CheckAtom,
    ClosureAtom,
    EvaluationAtom,
    InstanceAtom,
    LinkAtom,
    LoweredBody,
    NegationAtom,
    ObjectType,
    RelationAtom,
    StaticType,
    UnequalAtom,
)
from envgraph.pattern._lowering import BodyLowering, Generate
from envgraph.pattern._paths import closure_target, target_type
from envgraph.pattern._queries import Parameter
from envgraph.pattern._slots import Slots, Unsatisfiable
from envgraph.pattern._terms import Expression, Variable

Types = Callable[[str], Sequence[StaticType]]
"""Types of the parameters of a pattern, generated ones included, by qualified name."""


def lower_body(
    parameters: Sequence[Parameter], body_types: BodyTypes, generate: Generate, types_of: Types
) -> LoweredBody | None:
    """The normal form of a checked body; None if it can hold for nothing."""
    try:
        lowering = BodyLowering(parameters, body_types, generate)
        return _Normaliser(lowering.slots, parameters, body_types.metamodel, types_of).body(lowering.atoms)
    except Unsatisfiable:
        return None


class _Normaliser:
    """Turns atoms over slots into atoms over the final numbers."""

    def __init__(
        self, slots: Slots, parameters: Sequence[Parameter], metamodel: Metamodel, types_of: Types
    ) -> None:
        self._slots = slots
        self._parameters = parameters
        self._metamodel = metamodel
        self._types_of = types_of
        self._roots = {slot: slots.root(slot) for slot in range(len(slots))}
        self._root_names = {slot: str(root) for slot, root in self._roots.items()}

    def body(self, raw: Sequence[tuple[Atom, Span | None]]) -> LoweredBody:
        written = [
            *self._declared(),
            *((kept, span) for atom, span in raw for kept in self._resolved(atom)),
        ]
        # As they are spelled: as constants 1 and 1.0 are equal, but 1 / 2 and 1.0 / 2 are not.
        written = list({spelling(atom): (atom, span) for atom, span in written}.values())
        is_implied = self._implied([atom for atom, _ in written])
        written = [(atom, span) for atom, span in written if not is_implied(atom)]
        atoms = [atom for atom, _ in written]
        order = self._order(atoms)
        numbers = {slot: number for number, slot in enumerate(order)}
        names = tuple(self._slots.name(slot) or f"#{number}" for slot, number in numbers.items())
        return LoweredBody(
            names,
            tuple(self._type(slot) for slot in order),
            tuple((numbers[slot], value) for slot in order if (value := self._fixed(slot)) is not None),
            tuple(
                (number, numbers[self._slots.root(number)])
                for number in range(len(self._parameters))
                if self._slots.root(number) != number
            ),
            tuple(renumbered(atom, numbers, names) for atom in atoms),
            tuple(span for _, span in written),
        )

    def _type(self, slot: int) -> StaticType:
        type_ = self._slots.type(slot)
        assert type_ is not None, f"no type for variable {self._slots.name(slot) or slot}"
        return type_

    def _fixed(self, slot: int) -> Value | None:
        return self._slots.value(slot) if self._slots.root(slot) == slot else None

    def _declared(self) -> Iterator[tuple[Atom, Span | None]]:
        for number, parameter in enumerate(self._parameters):
            if parameter.type in self._metamodel.classes:
                assert parameter.type is not None
                yield InstanceAtom(parameter.type, self._slots.root(number)), parameter.span

    def _resolved(self, atom: Atom) -> Iterator[Atom]:
        """The atom over the variables that stand for united ones; an inequality that is decided goes."""
        if isinstance(atom, UnequalAtom):
            left, right = self._roots[atom.left], self._roots[atom.right]
            one, other = self._slots.value(left), self._slots.value(right)
            if left == right or (one is not None and one == other):
                raise Unsatisfiable
            if one is not None and other is not None:
                return
        yield renumbered(atom, self._roots, self._root_names)

    def _order(self, atoms: Iterable[Atom]) -> list[int]:
        """The parameters, then every other variable that an atom mentions, by first mention in the text."""
        count = len(self._parameters)
        mentioned = {slot for atom in atoms for slot in variables_of(atom)}
        return [*range(count), *sorted(slot for slot in mentioned if slot >= count)]

    def _implied(self, atoms: Sequence[Atom]) -> Callable[[Atom], bool]:
        """Whether an atom is a class test that another atom of the body makes, too."""
        implied: dict[int, list[str]] = {}
        for atom in atoms:
            for slot, type_ in self._implications(atom):
                if isinstance(type_, ObjectType):
                    implied.setdefault(slot, []).append(type_.cls)
        tests = [atom for atom in atoms if isinstance(atom, InstanceAtom)]

        def is_implied(atom: Atom) -> bool:
            if not isinstance(atom, InstanceAtom) or atom.exact:
                return False
            classes = implied.get(atom.variable, ())
            return any(self._metamodel.is_a(cls, atom.cls) for cls in classes) or any(
                self._stronger(other, atom) for other in tests
            )

        return is_implied

    def _stronger(self, other: InstanceAtom, atom: InstanceAtom) -> bool:
        return other != atom and other.variable == atom.variable and self._metamodel.is_a(other.cls, atom.cls)

    def _implications(self, atom: Atom) -> Iterator[tuple[int, StaticType | None]]:
        match atom:
            case AttributeAtom():
                yield atom.object, ObjectType(atom.attribute.owner)
            case LinkAtom():
                yield atom.source, ObjectType(atom.reference.owner)
                yield atom.target, target_type(atom.reference)
            case CallAtom():
                yield from zip(atom.arguments, self._types_of(atom.pattern), strict=True)
            case ClosureAtom():
                source, target = self._types_of(atom.step)
                yield atom.source, source
                yield atom.target, closure_target(source, target, atom.closure, self._metamodel)
            case _:
                return


def variables_of(atom: Atom) -> tuple[int, ...]:
    """Every variable that an atom mentions."""
    match atom:
        case InstanceAtom():
            return (atom.variable,)
        case AttributeAtom():
            return (atom.object, atom.value)
        case LinkAtom() | ClosureAtom():
            return (atom.source, atom.target)
        case CallAtom():
            return atom.arguments
        case NegationAtom():
            return variables_of(atom.relation)
        case AggregateAtom():
            return (*variables_of(atom.relation), atom.result)
        case UnequalAtom():
            return (atom.left, atom.right)
        case CheckAtom():
            return atom.variables
        case EvaluationAtom():
            return (*atom.variables, atom.result)


def renumbered(atom: Atom, numbers: Mapping[int, int], names: Sequence[str] | Mapping[int, str]) -> Atom:
    """The same atom over other numbers.

    Args:
        atom: the atom; variables in its expressions are named by their old numbers.
        numbers: old number -> new number.
        names: what expressions call a variable, by its old number (mapping) or its new one (sequence).
    """
    match atom:
        case NegationAtom():
            local = frozenset(numbers[slot] for slot in atom.local)
            return NegationAtom(renumbered_relation(atom.relation, numbers), local)
        case AggregateAtom():
            local = frozenset(numbers[slot] for slot in atom.local)
            column = None if atom.column is None else numbers[atom.column]
            relation = renumbered_relation(atom.relation, numbers)
            return AggregateAtom(atom.function, relation, local, numbers[atom.result], column)
        case UnequalAtom():
            return UnequalAtom(numbers[atom.left], numbers[atom.right])
        case CheckAtom():
            return CheckAtom(_named(atom.expression, numbers, names), _distinct(atom.variables, numbers))
        case EvaluationAtom():
            expression = _named(atom.expression, numbers, names)
            return EvaluationAtom(expression, _distinct(atom.variables, numbers), numbers[atom.result])
        case _:
            return renumbered_relation(atom, numbers)


def _distinct(variables: Iterable[int], numbers: Mapping[int, int]) -> tuple[int, ...]:
    return tuple(dict.fromkeys(numbers[slot] for slot in variables))


def renumbered_relation(atom: RelationAtom, numbers: Mapping[int, int]) -> RelationAtom:
    """The same relation over other numbers: every variable replaced by what `numbers` has for it."""
    match atom:
        case InstanceAtom():
            return replace(atom, variable=numbers[atom.variable])
        case AttributeAtom():
            return replace(atom, object=numbers[atom.object], value=numbers[atom.value])
        case LinkAtom() | ClosureAtom():
            return replace(atom, source=numbers[atom.source], target=numbers[atom.target])
        case CallAtom():
            return replace(atom, arguments=tuple(numbers[slot] for slot in atom.arguments))


def _named(
    expression: Expression, numbers: Mapping[int, int], names: Sequence[str] | Mapping[int, str]
) -> Expression:
    if isinstance(expression, Variable):
        slot = int(expression.name)
        name = names[slot] if isinstance(names, Mapping) else names[numbers[slot]]
        return Variable(name, expression.span)
    return with_children(expression, [_named(child, numbers, names) for child in children(expression)])
