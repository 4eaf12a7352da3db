"""From lowered bodies to conjunctions: simple called patterns are inlined, implied types are left out."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import field, replace
from typing import Final

from envgraph.code import dataclass
from envgraph.match.plan._calls import CallGraph
from envgraph.match.plan._plan import Absence, Condition, Conjunction, Goal, Valuation, arguments, variables
from envgraph.metamodel import Value
from envgraph.pattern import (
    AggregateAtom,
    Atom,
    AttributeAtom,
    CallAtom,
    CheckAtom,
    Closure,
    ClosureAtom,
    EvaluationAtom,
    InstanceAtom,
    Library,
    LinkAtom,
    LoweredBody,
    NegationAtom,
    ObjectType,
    RelationAtom,
    StaticType,
    UnequalAtom,
    renumbered_relation,
    target_type,
)

MOST_INLINED: Final = 8
"""Goals of a called body that may be inlined, those inside negations included."""
MOST_GOALS: Final = 64
"""Goals of a body beyond which nothing is inlined into it."""
MOST_ALTERNATIVES: Final = 4
"""Bodies of a negated pattern that may be inlined."""
MOST_EXPANDED: Final = 8
"""Bodies that a pattern may have after the bodies of those it calls have been multiplied out."""


class Simplifier:
    """Makes the conjunctions of patterns and remembers them."""

    def __init__(self, library: Library, calls: CallGraph) -> None:
        self._library = library
        self._calls = calls
        self._done: dict[str, tuple[Conjunction, ...]] = {}

    def conjunctions(self, pattern: str) -> tuple[Conjunction, ...]:
        """One conjunction for each body of a pattern."""
        if pattern not in self._done:
            # Bottom up, so that a long chain of calls needs no deep stack.
            for name in self._calls.bottom_up(pattern):
                if name not in self._done:
                    lowered = self._library.lowered(name)
                    bodies = (self._simplify(body, len(lowered.parameters)) for body in lowered.bodies)
                    self._done[name] = tuple(bodies)
        return self._done[pattern]

    def expanded(self, pattern: str) -> tuple[Conjunction, ...]:
        """The same with the bodies of called patterns multiplied out, if that gives only a few.

        It pays where duplicates are sorted out anyway, as in a closure.
        """
        found: list[Conjunction] = []
        pending = list(self.conjunctions(pattern))
        while pending:
            body = pending.pop(0)
            alternatives = self._multiplied(body)
            pending[:0] = alternatives
            if not alternatives:
                found.append(body)
            if len(found) + len(pending) > MOST_EXPANDED:
                return self.conjunctions(pattern)
        return tuple(found)

    def _multiplied(self, conjunction: Conjunction) -> list[Conjunction]:
        """The conjunction with each body of the first pattern that it calls; none if no call can be replaced."""
        for position, goal in enumerate(conjunction.goals):
            bodies = self._inlinable(goal.pattern) if isinstance(goal, CallAtom) else None
            if bodies is not None and isinstance(goal, CallAtom):
                others = [*conjunction.goals[:position], *conjunction.goals[position + 1 :]]
                return [self._with_body(conjunction, others, body, goal.arguments) for body in bodies]
        return []

    def _with_body(
        self, conjunction: Conjunction, others: Sequence[Goal], body: Conjunction, called: tuple[int, ...]
    ) -> Conjunction:
        draft = _Draft(list(conjunction.types), list(conjunction.constants))
        goals = _once([*others, *draft.inlined(body, called)])
        return Conjunction(
            tuple(draft.types), tuple(draft.constants), conjunction.parameters, self._without_implied(goals)
        )

    def _simplify(self, body: LoweredBody, parameters: int) -> Conjunction:
        heads = _heads(body, parameters)
        draft = _Draft(list(body.types), list(body.constants))
        for atom in _without_closures(body.atoms, {*heads, *(number for number, _ in body.constants)}):
            draft.goals.extend(self._goals(atom, body.names, draft))
        goals = _once(draft.goals)
        return Conjunction(tuple(draft.types), tuple(draft.constants), heads, self._without_implied(goals))

    def _goals(self, atom: Atom, names: tuple[str, ...], draft: _Draft) -> Sequence[Goal]:
        goal = _goal(atom, names)
        match atom, goal:
            case NegationAtom(relation), Absence():
                return [replace(goal, alternatives=self._alternatives(relation, draft))]
            case CallAtom(pattern, called), _:
                bodies = self._inlinable(pattern)
                if bodies is not None and len(bodies) == 1 and len(draft.goals) < MOST_GOALS:
                    return draft.inlined(bodies[0], called)
        return [goal]

    def _alternatives(self, relation: RelationAtom, draft: _Draft) -> tuple[tuple[Goal, ...], ...]:
        bodies = self._inlinable(relation.pattern) if isinstance(relation, CallAtom) else None
        if bodies is None or len(bodies) > MOST_ALTERNATIVES:
            return ((relation,),)
        return tuple(tuple(draft.inlined(body, arguments(relation))) for body in bodies)

    def _inlinable(self, pattern: str) -> tuple[Conjunction, ...] | None:
        """The bodies of a pattern if each of them may stand in place of its call."""
        if self._calls.recursive(pattern):
            return None
        bodies = self.conjunctions(pattern)
        return bodies if all(_fits(body) for body in bodies) else None

    # --- types that other goals imply

    def _without_implied(self, goals: tuple[Goal, ...]) -> tuple[Goal, ...]:
        implied = self._implied(goals)
        kept: list[Goal] = []
        for goal in goals:
            if isinstance(goal, Absence):
                goal = replace(goal, alternatives=tuple(self._inside(a, implied) for a in goal.alternatives))
            if not self._is_implied(goal, implied, goals):
                kept.append(goal)
        return tuple(kept)

    def _inside(self, alternative: tuple[Goal, ...], outside: Mapping[int, set[str]]) -> tuple[Goal, ...]:
        implied = self._implied(alternative)
        for variable, classes in outside.items():
            implied.setdefault(variable, set()).update(classes)
        return tuple(goal for goal in alternative if not self._is_implied(goal, implied, alternative))

    def _is_implied(self, goal: Goal, implied: Mapping[int, set[str]], goals: Iterable[Goal]) -> bool:
        if not isinstance(goal, InstanceAtom) or goal.exact:
            return False
        above = self._library.metamodel.supertypes
        if any(goal.cls in above(name) for name in implied.get(goal.variable, ())):
            return True
        return any(
            isinstance(other, InstanceAtom)
            and other.variable == goal.variable
            and other != goal
            and goal.cls in above(other.cls)
            for other in goals
        )

    def _implied(self, goals: Iterable[Goal]) -> dict[int, set[str]]:
        """Classes of variables that follow from facts: features are typed, and so are parameters."""
        found: dict[int, set[str]] = {}
        for goal in goals:
            for variable, type_ in self._facts(goal):
                if isinstance(type_, ObjectType):
                    found.setdefault(variable, set()).add(type_.cls)
        return found

    def _facts(self, goal: Goal) -> Iterable[tuple[int, StaticType]]:
        match goal:
            case AttributeAtom(attribute, owner, _):
                return [(owner, ObjectType(attribute.owner))]
            case LinkAtom(reference, source, target):
                return [(source, ObjectType(reference.owner)), (target, target_type(reference))]
            case CallAtom(pattern, called):
                return zip(called, self._library.lowered(pattern).types, strict=True)
            case ClosureAtom(step, Closure.PLUS, source, target):
                return zip((source, target), self._library.lowered(step).types, strict=True)
            case _:
                return []


def as_written(body: LoweredBody, parameters: int) -> Conjunction:
    """The conjunction with one goal for each atom, in their order: nothing is inlined, and nothing left out."""
    goals = tuple(_goal(atom, body.names) for atom in body.atoms)
    return Conjunction(body.types, body.constants, _heads(body, parameters), goals)


def _heads(body: LoweredBody, parameters: int) -> tuple[int, ...]:
    """The variables that stand for the parameters."""
    aliases = dict(body.aliases)
    return tuple(aliases.get(position, position) for position in range(parameters))


def _goal(atom: Atom, names: tuple[str, ...]) -> Goal:
    match atom:
        case CheckAtom(expression, numbers):
            return Condition(expression, tuple((names[n], n) for n in numbers))
        case EvaluationAtom(expression, numbers, result):
            return Valuation(expression, tuple((names[n], n) for n in numbers), result)
        case NegationAtom(relation, local):
            outer = tuple(dict.fromkeys(v for v in arguments(relation) if v not in local))
            return Absence(((relation,),), outer)
        case _:
            return atom


@dataclass(slots=True)
class _Draft:
    """A conjunction in the making: inlining adds variables and constants to it."""

    types: list[StaticType]
    constants: list[tuple[int, Value]]
    goals: list[Goal] = field(default_factory=list)

    def inlined(self, body: Conjunction, called: tuple[int, ...]) -> list[Goal]:
        """The goals of a called body with this body's variables for its parameters and new ones for the rest."""
        numbers = dict(zip(body.parameters, called, strict=True))
        for number, type_ in enumerate(body.types):
            if number not in numbers:
                numbers[number] = len(self.types)
                self.types.append(type_)
        self.constants.extend((numbers[number], value) for number, value in body.constants)
        return [_renumbered(goal, numbers) for goal in body.goals]


def _once(goals: Sequence[Goal]) -> tuple[Goal, ...]:
    """Relations that inlining has repeated go; expressions stay, for `1 / 2` and `1.0 / 2` compare equal."""
    kept: list[Goal] = []
    seen: set[RelationAtom] = set()
    for goal in goals:
        if isinstance(goal, InstanceAtom | AttributeAtom | LinkAtom | CallAtom | ClosureAtom):
            if goal in seen:
                continue
            seen.add(goal)
        kept.append(goal)
    return tuple(kept)


def _fits(body: Conjunction) -> bool:
    """Whether a body is small, and its parameters are variables of their own."""
    return (
        sum(map(_size, body.goals)) <= MOST_INLINED
        and len(set(body.parameters)) == len(body.parameters)
        and not any(number in body.parameters for number, _ in body.constants)
    )


def _size(goal: Goal) -> int:
    """Goals in a goal, itself included: what negations have inlined would double with each level."""
    if isinstance(goal, Absence):
        return 1 + sum(_size(each) for alternative in goal.alternatives for each in alternative)
    return 1


def _without_closures(atoms: Sequence[Atom], fixed: set[int]) -> Sequence[Atom]:
    """`find p+(a, _)` asks no more than `find p(a, _)`, wherever the other end stands nowhere else."""
    uses = Counter(variable for atom in atoms for variable in _mentioned(atom))

    def simple(atom: Atom) -> Atom:
        if isinstance(atom, ClosureAtom) and atom.closure is Closure.PLUS:
            for end in (atom.source, atom.target):
                if uses[end] == 1 and end not in fixed:
                    return CallAtom(atom.step, (atom.source, atom.target))
        if isinstance(atom, NegationAtom):
            relation = simple(atom.relation)
            return replace(atom, relation=relation) if isinstance(relation, CallAtom) else atom
        return atom

    return [simple(atom) for atom in atoms]


def _mentioned(atom: Atom) -> tuple[int, ...]:
    match atom:
        case NegationAtom(relation):
            return arguments(relation)
        case CheckAtom(_, numbers):
            return numbers
        case EvaluationAtom(_, numbers, result):
            return (*numbers, result)
        case AggregateAtom():
            return (*arguments(atom.relation), atom.result)
        case _:
            return variables(atom)


def _renumbered(goal: Goal, numbers: Mapping[int, int]) -> Goal:
    def reads(pairs: tuple[tuple[str, int], ...]) -> tuple[tuple[str, int], ...]:
        return tuple((name, numbers[number]) for name, number in pairs)

    match goal:
        case Condition():
            return replace(goal, reads=reads(goal.reads))
        case Valuation():
            return replace(goal, reads=reads(goal.reads), result=numbers[goal.result])
        case UnequalAtom(left, right):
            return UnequalAtom(numbers[left], numbers[right])
        case Absence(alternatives, outer):
            return Absence(
                tuple(tuple(_renumbered(g, numbers) for g in alternative) for alternative in alternatives),
                tuple(dict.fromkeys(numbers[number] for number in outer)),
            )
        case AggregateAtom():
            return replace(
                goal,
                relation=renumbered_relation(goal.relation, numbers),
                local=frozenset(numbers[number] for number in goal.local),
                result=numbers[goal.result],
                column=None if goal.column is None else numbers[goal.column],
            )
        case _:
            return renumbered_relation(goal, numbers)
