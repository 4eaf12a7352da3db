"""Rules that are ready to run: their matches, and what applying them does."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import AbstractContextManager
from inspect import Parameter as Argument, signature
from typing import Any, ClassVar, Final, Protocol, TypeVar, overload

from envgraph.errors import EvaluationError, InvalidArgument, RuleError, did_you_mean, with_article
from envgraph.graph import Model, Node
from envgraph.match import FREE, Matcher
from envgraph.metamodel import Value
from envgraph.pattern import Library
from envgraph.rewrite._branches import Branches
from envgraph.rewrite._match import Application, Firing, Match, Row, Shape
from envgraph.rewrite._plan import RulePlan
from envgraph.rewrite.run._apply import effect_of
from envgraph.rewrite.run._notices import Report

REFUSALS: Final = frozenset(
    {"containment", "dangling", "full", "identification", "lost-link", "missing-link", "multiplicity"}
)
"""Reasons for which a rule is not applicable at a match; any other `RuleError` is a mistake, and is raised."""


class Randomness(Protocol):
    """What random choices need: a `numpy.random.Generator` has it."""

    def random(self) -> float:
        """A number from 0 (included) to 1 (excluded)."""


def draw(rng: Randomness, count: int) -> int:
    """One of `count` numbers from 0, equally likely; without a choice nothing is drawn."""
    if count <= 1:
        return 0
    return rng.choose(count) if isinstance(rng, Branches) else int(rng.random() * count)


def others(rows: Sequence[Row], number: int, pick: Callable[[int], int]) -> Iterator[Row]:
    """The rows but the one of this number, drawn one after the other."""
    left = [*rows[:number], *rows[number + 1 :]]
    while left:
        yield left.pop(pick(len(left)) if len(left) > 1 else 0)


Find = Callable[..., Sequence[Row]]
Found = TypeVar("Found")
NO_ARGUMENTS: Mapping[str, Value] = {}


class RuleRunner(ABC):
    """A rule over the model of one engine.

    Rows are matches as plain tuples, in the order of `shape.names`; objects are ids. Arguments bind any variables of
    the match in advance, by name.

    Attributes:
        shape: name and variables of the rule.
        parameters: names of its parameters, in order.
        weight, priority: for random choices among rules.
        inputs: variables that an argument has to bind, because nothing enumerates them.
        certain: whether a match decides what an application does.
    """

    certain: ClassVar[bool] = True

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
        self._prepared: dict[tuple[str, ...], Find] = {}
        self._all: Find | None = None
        self._live: Find | None = None
        self._holds: Callable[[Row], bool] | None = None

    # --- matches

    def rows(self, arguments: Mapping[str, object] = NO_ARGUMENTS) -> Sequence[Row]:
        """All matches that agree with the arguments.

        Raises:
            InvalidArgument: an unknown variable, or an input without an argument.
            TypeMismatch: an argument of the wrong type.
        """
        return self.matcher.rows(self.pattern, self._arguments(arguments)) if arguments else self.all_rows()

    def all_rows(self) -> Sequence[Row]:
        """All matches; fast."""
        if self._all is None:
            self._all = self.prepare(())
        return self._all()

    def live_rows(self) -> Sequence[Row]:
        """As `all_rows`, but to be read before the model changes, and not to be kept.

        Takes constant time where the rule is watched (`Engine.watch`).
        """
        return (self._live or self.reader())()

    def reader(self) -> Find:
        """`live_rows` as the fastest function that there is."""
        if self._live is None:
            self._require(())
            self._live = self.matcher.lister(self.pattern)
        return self._live

    def rows_known(self, arguments: Mapping[str, Value]) -> Sequence[Row]:
        """As `rows`, unchecked: names and types are right, and the objects are there."""
        if not arguments:
            return self.live_rows()
        return self.prepare(tuple(arguments))(*arguments.values())

    def exists(self, arguments: Mapping[str, object] = NO_ARGUMENTS) -> bool:
        """Return whether there is a match that agrees with the arguments; raises like `rows`."""
        return self.matcher.exists(self.pattern, self._arguments(arguments))

    def is_match(self, row: Row) -> bool:
        """Return whether a row is a match in the present state."""
        return self.matcher.exists(self.pattern, row)

    def still_holds(self, row: Row) -> bool:
        """As `is_match`, for a row that has been one: unchecked, and fast."""
        if self._holds is None:
            self._holds = self.matcher.tester(self.pattern)
        return self._holds(row)

    def prepare(self, names: tuple[str, ...]) -> Find:
        """`rows` for one set of bound variables, as a fast function of their values in the order of `names`.

        The values are not checked: they must have the right type, and objects must exist.

        Raises:
            InvalidArgument: an unknown variable, or an input that is not bound.
        """
        if names not in self._prepared:
            self._prepared[names] = self._bound(names, self.matcher.prepare)
        return self._prepared[names]

    def seek(self, names: tuple[str, ...]) -> Callable[..., Iterator[Row]]:
        """As `prepare`, one by one: each is looked for when it is asked for, and not after the model has changed."""
        return self._bound(names, self.matcher.seeker)

    def seek_known(self, arguments: Mapping[str, Value]) -> Iterator[Row]:
        """As `rows_known`, one by one."""
        return self.seek(tuple(arguments))(*arguments.values()) if self._alive(arguments) else iter(())

    def _alive(self, arguments: Mapping[str, Value]) -> bool:
        """Whether the objects among arguments exist."""
        shape, alive = self.shape, self.model.graph.alive
        return all(
            alive(value)  # type: ignore[arg-type]
            for name, value in arguments.items()
            if shape.is_object(shape.names.index(name))
        )

    def _bound(
        self, names: tuple[str, ...], make: Callable[[str, tuple[int, ...]], Callable[..., Found]]
    ) -> Callable[..., Found]:
        """A function of the values of variables, in their order, made of one in the order of the shape."""
        self._require(names)
        positions = [self.shape.position(name) for name in names]
        order = sorted(range(len(positions)), key=positions.__getitem__)
        find = make(self.pattern, tuple(positions[place] for place in order))
        return find if order == list(range(len(order))) else _reordered(find, order)

    def pick(self, rng: Randomness, arguments: Mapping[str, object] = NO_ARGUMENTS) -> Row | None:
        """One of the matches, equally likely; None if there is none."""
        rows = self.rows(arguments) if arguments else self.live_rows()
        return rows[draw(rng, len(rows))] if rows else None

    def once(self, rng: Randomness) -> Row | None:
        """Apply the rule at one of its matches, equally likely: the fast path of loops, unchecked and unrecorded.

        If it is refused there, at another one. Watch the rule (`Engine.watch`) and this takes the time of the change,
        whatever the number of matches.

        Returns:
            The match; None if there is none.

        Raises:
            RuleError: the rule is refused at each match; the model is as before.
        """
        rows = (self._live or self.reader())()
        if not rows:
            return None
        number = int(rng.random() * len(rows)) if len(rows) > 1 else 0
        row = rows[number]
        try:
            self.fire(row)
        except RuleError as error:
            return self.fire_next(others(rows, number, lambda count: draw(rng, count)), error)[0]
        return row

    def _arguments(self, arguments: Mapping[str, object]) -> tuple[object, ...]:
        self._require(arguments)
        if not arguments:
            return self._free
        values = list(self._free)
        for name, value in arguments.items():
            values[self.shape.position(name)] = value
        return tuple(values)

    def _require(self, bound: Mapping[str, object] | tuple[str, ...]) -> None:
        for name in self.inputs:
            if name not in bound:
                raise InvalidArgument(f"rule `{self.name}` needs a value for `{name}`")

    # --- application

    @abstractmethod
    def fire(self, row: Row) -> Sequence[Any]:
        """Apply the rule at a row that is a match; the result is for `application`.

        Raises:
            RuleError: the rule is refused; the model is as before.
        """

    def fire_next(self, rows: Iterable[Row], error: RuleError) -> tuple[Row, Sequence[Any]]:
        """A row was refused with an error: apply the rule at the first of these rows at which it is applicable.

        Raises:
            RuleError: the last refusal, if there is none; or what is no refusal.
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
        """Why the rule cannot be applied at a match; it is tried, and undone."""
        try:
            with self.model.transaction():
                self.fire(row)
                raise _Tried
        except _Tried:
            return None
        except (RuleError, EvaluationError) as error:
            return error

    def is_applicable(self, row: Row) -> bool:
        """Return whether the rule can be applied at a match.

        Raises:
            RuleError, EvaluationError: something other than a refusal; see `REFUSALS`.
        """
        error = self.refusal_at(row)
        if error is None:
            return True
        if isinstance(error, RuleError) and error.reason in REFUSALS:
            return False
        raise error

    def apply_row(self, row: Row) -> Firing:
        """Apply the rule at a row that is known to be a match: the fast path of searches.

        Returns:
            What a trace needs to do the same again: see `Engine.replay`.

        Raises:
            RuleError: the rule is refused; the model is as before.
        """
        self.fire(row)
        return Firing(self.name, row)

    def apply_checked(self, row: Row) -> Sequence[Any]:
        """Apply the rule at a row that may have ceased to be a match.

        Raises:
            RuleError: it has ("stale-match"), or the rule is refused.
        """
        if not self.is_match(row):
            match = Match(self.model, self.shape, row)
            raise RuleError(f"{match!r} is not a match any more", rule=self.name, reason="stale-match")
        return self.fire(row)

    def application(self, row: Row, result: Sequence[Any]) -> Application:
        """Return what people see of an application."""
        return Application(self.name, Match(self.model, self.shape, row), {}, {})


class _Tried(Exception):
    """Ends a trial that was successful."""


def _reordered(find: Callable[..., Found], order: Sequence[int]) -> Callable[..., Found]:
    def rows(*values: object) -> Found:
        return find(*(values[place] for place in order))

    return rows


class GraphRule(RuleRunner):
    """A rule with a plan."""

    def __init__(
        self, plan: RulePlan, model: Model, library: Library, matcher: Matcher, report: Report
    ) -> None:
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
        self._effect = effect_of(plan, model, matcher, report)
        # An instance attribute, to save a call in the loop of a search.
        self.fire = self._effect  # type: ignore[method-assign, assignment]

    def fire(self, row: Row) -> Sequence[Any]:
        """Apply the rule at a row that is a match, and return its slots."""
        return self._effect(row)

    def application(self, row: Row, result: Sequence[Any]) -> Application:
        """Return what people see of an application."""
        plan = self.plan
        match = Match(self.model, self.shape, row)
        if not (plan.outputs or plan.body.creates):
            return Application(self.name, match, {}, {})
        created = {plan.body.names[new.node]: self.model.node(result[new.node]) for new in plan.body.creates}
        outputs = {name: self._shown(name, result[slot]) for name, slot in plan.outputs}
        return Application(self.name, match, created, outputs)

    def _shown(self, name: str, value: Any) -> Node | Value:
        is_object = name not in self.shape.names or self.shape.is_object(self.shape.position(name))
        return Node(self.model, value) if is_object else value  # a block may have deleted it


class ExactClassRule(GraphRule):
    """A rule whose left side is an object of exactly one class: its matches are an extent."""

    def __init__(
        self, plan: RulePlan, model: Model, library: Library, matcher: Matcher, report: Report
    ) -> None:
        super().__init__(plan, model, library, matcher, report)
        assert plan.exact is not None
        self._rows = ExtentRows(model.graph.exact_extent(plan.exact))

    def all_rows(self) -> Sequence[Row]:
        """All matches."""
        return list(self._rows)

    def reader(self) -> Find:
        """`live_rows`."""
        self._live = lambda: self._rows
        return self._live

    def exists(self, arguments: Mapping[str, object] = NO_ARGUMENTS) -> bool:
        """Return whether there is a match."""
        return super().exists(arguments) if arguments else bool(self._rows)


class ExtentRows(Sequence[Row]):
    """The objects of a class as rows, which are made when they are read."""

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


def graph_rule(plan: RulePlan, model: Model, library: Library, matcher: Matcher, report: Report) -> GraphRule:
    """The runner for a plan."""
    kind = GraphRule if plan.exact is None else ExactClassRule
    return kind(plan, model, library, matcher, report)


class PythonRule(RuleRunner):
    """A rule whose left side is a pattern and whose right side is a function.

    The function takes variables of the match by name, as handles or values, and `engine` if it has such a parameter.
    """

    certain = False  # it may draw

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
        """Call the function; an exception undoes what it did."""
        match = Match(self.model, self.shape, row)
        arguments: dict[str, object] = {name: match[name] for name in self._names}
        if self._takes_engine:
            arguments["engine"] = self._engine
        with self._aside(), self.model.transaction():
            result = self.function(**arguments)
            if result is not None:
                found = with_article(type(result).__name__)
                raise InvalidArgument(
                    f"rule `{self.name}` returned {found}: the function of a rule returns nothing"
                )
        return row


def wanted_arguments(
    function: Callable[..., object], shape: Shape, others: Sequence[str]
) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """The variables that a function takes, and what else of `others`; a variable of such a name comes first.

    Raises:
        InvalidArgument: it takes something else.
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
                f"`{shape.definition}` takes `{argument.name}`, which is no variable of its pattern: "
                + (hint or f"they are {known}")
            )
    return tuple(names), tuple(taken)
