"""Runners: compiled rules that find their matches and apply themselves."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import AbstractContextManager
from inspect import Parameter as Argument, signature
from typing import Any, ClassVar, Final, Protocol, TypeVar, overload

from envgraph.errors import EvaluationError, InvalidArgument, RuleError, did_you_mean, quote_with_article
from envgraph.graph import Model, Node
from envgraph.match import FREE, Matcher
from envgraph.metamodel import Value
from envgraph.pattern import Library
from envgraph.rewrite._choice_enumeration import Branches
from envgraph.rewrite._matches import Application, Firing, Match, Row, Shape
from envgraph.rewrite._rule_plan import RulePlan
from envgraph.rewrite.run._compile_rule import compile_rule
from envgraph.rewrite.run._notices import ReportLink

REFUSALS: Final = frozenset(
    {"containment", "dangling", "full", "identification", "lost-link", "missing-link", "multiplicity"}
)
"""Reasons that count as a refusal at a match; a `RuleError` with another reason is a mistake and is raised."""


class Randomness(Protocol):
    """A source of random floats, such as a `numpy.random.Generator`."""

    def random(self) -> float:
        """Return a number from 0 (included) to 1 (excluded)."""


def draw_index(rng: Randomness, count: int) -> int:
    """Return a random number from 0 to `count` - 1. If `count` is 1 or less, return 0 without drawing."""
    if count <= 1:
        return 0
    return rng.choose(count) if isinstance(rng, Branches) else int(rng.random() * count)


def drawn_others(rows: Sequence[Row], number: int, pick: Callable[[int], int]) -> Iterator[Row]:
    """Yield all rows except the one at the index `number`, in random order."""
    left = [*rows[:number], *rows[number + 1 :]]
    while left:
        yield left.pop(pick(len(left)) if len(left) > 1 else 0)


FindRows = Callable[..., Sequence[Row]]
Found = TypeVar("Found")
NO_ARGUMENTS: Mapping[str, Value] = {}


class RuleRunner(ABC):
    """A compiled rule over the model of an engine.

    Rows are matches as tuples, in the order of `shape.names`, with ids in place of objects. Arguments bind
    variables of the match in advance, by name.

    Attributes:
        shape: name and variables of the rule.
        parameters: names of its parameters, in order.
        weight, priority: used in random choices among rules.
        inputs: variables that must be bound by an argument, because matching cannot enumerate their values.
        is_deterministic: True if a match determines the result of an application.
    """

    is_deterministic: ClassVar[bool] = True

    def __init__(
        self,
        shape: Shape,
        pattern: str,
        model: Model,
        library: Library,
        matcher: Matcher,
        *,
        parameters: Sequence[str],
        weight: float,
        priority: int,
    ) -> None:
        self.shape = shape
        self.name = shape.definition
        self.pattern = pattern
        self.model = model
        self.matcher = matcher
        self.parameters = tuple(parameters)
        self.weight = weight
        self.priority = priority
        self.inputs = tuple(shape.names[position] for position in library.inputs(pattern))
        self._free: tuple[object, ...] = (FREE,) * len(shape.names)
        self._prepared: dict[tuple[str, ...], FindRows] = {}
        self._find_all: FindRows | None = None
        self._find_live: FindRows | None = None
        self._still_holds: Callable[[Row], bool] | None = None

    # --- matches

    def rows(self, arguments: Mapping[str, object] = NO_ARGUMENTS) -> Sequence[Row]:
        """Return all matches that agree with the arguments.

        Raises:
            InvalidArgument: a variable is unknown, or an input has no argument.
            TypeMismatch: an argument has the wrong type.
        """
        return self.matcher.rows(self.pattern, self._arguments(arguments)) if arguments else self.all_rows()

    def all_rows(self) -> Sequence[Row]:
        """Return all matches, as `rows` does without arguments, by a function that is prepared once."""
        if self._find_all is None:
            self._find_all = self.prepare(())
        return self._find_all()

    def live_rows(self) -> Sequence[Row]:
        """Return all matches as a sequence that may be used only until the model changes.

        This takes constant time if the rule is watched (`Engine.watch`).
        """
        return (self._find_live or self.rows_reader())()

    def rows_reader(self) -> FindRows:
        """Return the function that `live_rows` calls, which is created at first use."""
        if self._find_live is None:
            self._check_inputs(())
            self._find_live = self.matcher.prepare_listing(self.pattern)
        return self._find_live

    def rows_unchecked(self, arguments: Mapping[str, Value]) -> Sequence[Row]:
        """Return the matches for arguments, unchecked: names and types must be right, and objects must exist.

        Without arguments, the matches may be used only until the model changes.
        """
        if not arguments:
            return self.live_rows()
        return self.prepare(tuple(arguments))(*arguments.values())

    def exists(self, arguments: Mapping[str, object] = NO_ARGUMENTS) -> bool:
        """Return True if a match agrees with the arguments. Exceptions are raised as in `rows`."""
        return self.matcher.exists(self.pattern, self._arguments(arguments))

    def is_match(self, row: Row) -> bool:
        """Return True if a row is a match in the current state."""
        return self.matcher.exists(self.pattern, row)

    def still_holds(self, row: Row) -> bool:
        """Return True if a row that was a match is still one. This is fast, and the row is not checked."""
        if self._still_holds is None:
            self._still_holds = self.matcher.prepare_test(self.pattern)
        return self._still_holds(row)

    def prepare(self, names: tuple[str, ...]) -> FindRows:
        """Return a fast function that finds matches for values of the variables `names`, in this order.

        The values are not checked: they must have the right types, and objects must exist.

        Raises:
            InvalidArgument: a variable is unknown, or an input is not bound.
        """
        if names not in self._prepared:
            self._prepared[names] = self._bind_variables(names, self.matcher.prepare)
        return self._prepared[names]

    def prepare_lazy(self, names: tuple[str, ...]) -> Callable[..., Iterator[Row]]:
        """Return a function that yields matches lazily, for unchecked values of the variables `names`, in this order.

        The matches may be used only until the model changes.
        """
        return self._bind_variables(names, self.matcher.prepare_iterator)

    def lazy_rows_unchecked(self, arguments: Mapping[str, Value]) -> Iterator[Row]:
        """Yield the matches for arguments lazily; none if an object among the arguments does not exist."""
        return self.prepare_lazy(tuple(arguments))(*arguments.values()) if self._are_alive(arguments) else iter(())

    def _are_alive(self, arguments: Mapping[str, Value]) -> bool:
        """Return True if the objects among the arguments exist."""
        shape, alive = self.shape, self.model.graph.alive
        return all(
            alive(value)  # type: ignore[arg-type]
            for name, value in arguments.items()
            if shape.is_object(shape.names.index(name))
        )

    def _bind_variables(
        self, names: tuple[str, ...], make: Callable[[str, tuple[int, ...]], Callable[..., Found]]
    ) -> Callable[..., Found]:
        """Return the function that `make` makes for these variables, with its arguments in the order of `names`."""
        self._check_inputs(names)
        positions = [self.shape.position(name) for name in names]
        order = sorted(range(len(positions)), key=positions.__getitem__)
        find = make(self.pattern, tuple(positions[place] for place in order))
        return find if order == list(range(len(order))) else _with_reordered_arguments(find, order)

    def pick(self, rng: Randomness, arguments: Mapping[str, object] = NO_ARGUMENTS) -> Row | None:
        """Return one of the matches, drawn uniformly; None if there are no matches."""
        rows = self.rows(arguments) if arguments else self.live_rows()
        return rows[draw_index(rng, len(rows))] if rows else None

    def once(self, rng: Randomness) -> Row | None:
        """Apply the rule at one of its matches, drawn uniformly: the fast, unchecked and unrecorded way for loops.

        If the rule is refused, other matches are tried. If the rule is watched (`Engine.watch`), the time depends
        only on the change, not on the number of matches.

        Returns:
            The match; None if there are no matches.

        Raises:
            RuleError: the rule is refused at each match; the model is unchanged.
        """
        rows = (self._find_live or self.rows_reader())()
        if not rows:
            return None
        number = int(rng.random() * len(rows)) if len(rows) > 1 else 0
        row = rows[number]
        try:
            self.fire(row)
        except RuleError as error:
            return self.fire_next(drawn_others(rows, number, lambda count: draw_index(rng, count)), error)[0]
        return row

    def _arguments(self, arguments: Mapping[str, object]) -> tuple[object, ...]:
        self._check_inputs(arguments)
        if not arguments:
            return self._free
        values = list(self._free)
        for name, value in arguments.items():
            values[self.shape.position(name)] = value
        return tuple(values)

    def _check_inputs(self, bound: Mapping[str, object] | tuple[str, ...]) -> None:
        for name in self.inputs:
            if name not in bound:
                raise InvalidArgument(f"rule `{self.name}` needs a value for `{name}`")

    # --- application

    @abstractmethod
    def fire(self, row: Row) -> Sequence[Any]:
        """Apply the rule at a row that is a match, and return the values of its slots, for `application`.

        Raises:
            RuleError: the rule is refused; the model is unchanged.
        """

    def fire_next(self, rows: Iterable[Row], error: RuleError) -> tuple[Row, Sequence[Any]]:
        """Apply the rule, which was refused with `error`, at the first of these rows at which it is not refused.

        Raises:
            RuleError: the rule is refused at all rows (the last refusal), or an error is no refusal.
        """
        if error.reason not in REFUSALS:
            raise error
        for row in rows:
            try:
                return row, self.fire(row)
            except RuleError as other:
                if other.reason not in REFUSALS:
                    raise
                error = other
        raise error

    def refusal_at(self, row: Row) -> RuleError | EvaluationError | None:
        """Return the error that an application at a match raises, or None. The application is undone."""
        try:
            with self.model.transaction():
                self.fire(row)
                raise _TrialSucceeded
        except _TrialSucceeded:
            return None
        except (RuleError, EvaluationError) as error:
            return error

    def is_applicable(self, row: Row) -> bool:
        """Return True if the rule can be applied at a match.

        Raises:
            RuleError, EvaluationError: the application fails for another reason than a refusal; see `REFUSALS`.
        """
        error = self.refusal_at(row)
        if error is None:
            return True
        if isinstance(error, RuleError) and error.reason in REFUSALS:
            return False
        raise error

    def apply_row(self, row: Row) -> Firing:
        """Apply the rule at a row that is known to be a match: the fast way for searches.

        Returns:
            The firing, for `Engine.replay`.

        Raises:
            RuleError: the rule is refused; the model is unchanged.
        """
        self.fire(row)
        return Firing(self.name, row)

    def apply_checked(self, row: Row) -> Sequence[Any]:
        """Apply the rule at a row that may not be a match any more.

        Raises:
            RuleError: the row is no match ("stale-match"), or the rule is refused.
        """
        if not self.is_match(row):
            match = Match(self.model, self.shape, row)
            raise RuleError(f"{match!r} is not a match any more", rule=self.name, reason="stale-match")
        return self.fire(row)

    def application(self, row: Row, result: Sequence[Any]) -> Application:
        """Return an `Application` for a match and the result of `fire`."""
        return Application(self.name, Match(self.model, self.shape, row), {}, {})


class _TrialSucceeded(Exception):
    """An exception that rolls back a successful trial application."""


def _with_reordered_arguments(find: Callable[..., Found], order: Sequence[int]) -> Callable[..., Found]:
    def rows(*values: object) -> Found:
        return find(*(values[place] for place in order))

    return rows


class GraphRule(RuleRunner):
    """The runner of a rule with a plan."""

    def __init__(self, plan: RulePlan, model: Model, library: Library, matcher: Matcher, report: ReportLink) -> None:
        super().__init__(
            Shape(plan.name, plan.variables, plan.types),
            plan.body.pattern,
            model,
            library,
            matcher,
            parameters=plan.parameters,
            weight=plan.weight,
            priority=plan.priority,
        )
        self.plan = plan
        self._effect = compile_rule(plan, model, matcher, report)
        # Set on the instance, to save a call in the loops of searches.
        self.fire = self._effect  # type: ignore[method-assign, assignment]

    def fire(self, row: Row) -> Sequence[Any]:
        """Apply the rule at a row that is a match, and return its slots."""
        return self._effect(row)

    def application(self, row: Row, result: Sequence[Any]) -> Application:
        """Return an `Application` with the created objects and the values of the `out` parameters."""
        plan = self.plan
        match = Match(self.model, self.shape, row)
        if not (plan.outputs or plan.body.creates):
            return Application(self.name, match, {}, {})
        created = {plan.body.names[new.node]: self.model.node(result[new.node]) for new in plan.body.creates}
        outputs = {name: self._shown(name, result[slot]) for name, slot in plan.outputs}
        return Application(self.name, match, created, outputs)

    def _shown(self, name: str, value: Any) -> Node | Value:
        is_object = name not in self.shape.names or self.shape.is_object(self.shape.position(name))
        return Node(self.model, value) if is_object else value  # the object may have been deleted by a block


class ExactClassRule(GraphRule):
    """The runner of a rule whose LHS is one object of exactly one class: its matches are the objects of this class."""

    def all_rows(self) -> Sequence[Row]:
        """Return all matches."""
        return list(self.live_rows())

    def rows_reader(self) -> FindRows:
        """Return a function that returns all matches in constant time."""
        assert self.plan.exact_class is not None
        rows = ExtentRows(self.model.graph.exact_extent(self.plan.exact_class))
        self._find_live = lambda: rows
        return self._find_live

    def exists(self, arguments: Mapping[str, object] = NO_ARGUMENTS) -> bool:
        """Return True if a match agrees with the arguments."""
        return super().exists(arguments) if arguments else bool(self.live_rows())


class ExtentRows(Sequence[Row]):
    """The objects of a class as a sequence of rows, each of which is created when it is read."""

    __slots__ = ("_nodes",)

    def __init__(self, nodes: Sequence[int]) -> None:
        self._nodes = nodes

    def __len__(self) -> int:
        return len(self._nodes)

    @overload
    def __getitem__(self, index: int) -> Row: ...
    @overload
    def __getitem__(self, index: slice) -> list[Row]: ...
    def __getitem__(self, index: int | slice) -> Row | list[Row]:
        found = self._nodes[index]
        return (found,) if isinstance(found, int) else [(node,) for node in found]


class PythonRule(RuleRunner):
    """The runner of a rule whose LHS is a pattern and whose RHS is a Python function.

    The function takes variables of the match by name, as nodes or values, and the engine if it has a parameter
    `engine`.
    """

    is_deterministic = False  # the function may make random choices

    def __init__(
        self,
        function: Callable[..., object],
        shape: Shape,
        pattern: str,
        model: Model,
        library: Library,
        matcher: Matcher,
        *,
        engine: object,
        aside: Callable[[], AbstractContextManager[None]],
        weight: float,
        priority: int,
    ) -> None:
        super().__init__(
            shape, pattern, model, library, matcher, parameters=shape.names, weight=weight, priority=priority
        )
        self.function = function
        self._names, taken = wanted_arguments(function, shape, ("engine",))
        self._takes_engine = "engine" in taken
        self._engine = engine
        self._aside = aside

    def fire(self, row: Row) -> Sequence[Any]:
        """Call the function at a match and return the row. If it raises an exception, its changes are undone.

        Raises:
            InvalidArgument: the function returns something other than None.
        """
        match = Match(self.model, self.shape, row)
        arguments: dict[str, object] = {name: match[name] for name in self._names}
        if self._takes_engine:
            arguments["engine"] = self._engine
        with self._aside(), self.model.transaction():
            result = self.function(**arguments)
            if result is not None:
                found = quote_with_article(type(result).__name__)
                raise InvalidArgument(
                    f"rule `{self.name}` returned {found}, but the function of a rule must return None"
                )
        return row


def wanted_arguments(
    function: Callable[..., object], shape: Shape, others: Sequence[str]
) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """Return the match variables that a function takes, and its parameters in `others`. Variables take precedence.

    A function with `**` takes all variables.

    Raises:
        InvalidArgument: the function has another parameter without a default.
    """
    names: list[str] = []
    taken: list[str] = []
    for argument in signature(function).parameters.values():
        if argument.kind is Argument.VAR_KEYWORD:
            return shape.names, tuple(taken)
        if argument.name in shape.names and argument.kind is not Argument.POSITIONAL_ONLY:
            names.append(argument.name)
        elif argument.name in others and argument.kind is not Argument.POSITIONAL_ONLY:
            taken.append(argument.name)
        elif argument.default is Argument.empty:
            hint = did_you_mean(argument.name, shape.names)
            known = ", ".join(f"`{name}`" for name in shape.names) or "none"
            raise InvalidArgument(
                f"parameter `{argument.name}` is not a variable of `{shape.definition}`: "
                + (hint or f"its variables are {known}")
            )
    return tuple(names), tuple(taken)
