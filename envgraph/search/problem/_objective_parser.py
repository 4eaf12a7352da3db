"""Parse objectives of families, which are expressions over calls such as `entropy(complexity)`."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import field, replace
from functools import partial
from typing import TYPE_CHECKING, Final

from envgraph.code import dataclass
from envgraph.errors import Diagnostic, Span, did_you_mean, quote_names
from envgraph.lang import ComponentSpec
from envgraph.metamodel import Scalar
from envgraph.pattern import (
    Binary,
    Expression,
    FunctionCall,
    Variable,
    children,
    value_of,
    variables_in,
    with_children,
)
from envgraph.search.problem._candidate_pool import FamilyMeasure, StatisticMeasure
from envgraph.search.problem._expression_measures import (
    check_number_expression,
    parse_expression,
    span_in_file,
)
from envgraph.search.problem._family_measures import (
    BinCoverage,
    ChainTransfer,
    DistinctMembers,
    LargestBinCount,
    RisingShare,
    SmallestBinCount,
    StepEvenness,
)
from envgraph.search.problem._objective import FamilyCondition, Objective, ObjectiveTerm
from envgraph.search.problem._statistics import BinnedEntropy, Gini, Statistic, Variance

if TYPE_CHECKING:
    from envgraph.search.domain._components import ComponentContext

_COMPARISONS: Final = ("<=", ">=", "==")


@dataclass(frozen=True, slots=True)
class FamilyCall:
    """A call of a family measure in an objective, such as `entropy(complexity, 0, 1)`.

    Attributes:
        name: name of the family measure.
        measures: the arguments that are names of measures of the members.
        numbers: the other arguments, which are numbers.
    """

    name: str
    measures: tuple[str, ...] = ()
    numbers: tuple[float, ...] = ()

    def __str__(self) -> str:
        inside = ", ".join((*self.measures, *(f"{number:g}" for number in self.numbers)))
        return f"{self.name}({inside})" if inside else self.name


class WrongCall(Exception):
    """An invalid call of a family measure; the arguments of the exception are a message and a hint."""


FamilyFactory = Callable[[FamilyCall, "ComponentContext"], FamilyMeasure]
"""Makes the family measure of a call, or raises `WrongCall`."""


def _single_measure_name(call: FamilyCall, most: int = 0) -> str:
    if len(call.measures) == 1 and len(call.numbers) <= most:
        return call.measures[0]
    options = ", low, high, bins" if most else ""
    raise WrongCall(f"`{call.name}` takes exactly one measure", f"write `{call.name}(measure{options})`")


def _statistic_factory(statistic: Statistic) -> FamilyFactory:
    return lambda call, context: StatisticMeasure(statistic, _single_measure_name(call))


def _binned_statistic_factory(make: Callable[[BinnedEntropy], Statistic]) -> FamilyFactory:
    def make_measure(call: FamilyCall, context: ComponentContext) -> FamilyMeasure:
        of = _single_measure_name(call, most=3)
        return StatisticMeasure(make(_bins_of_call(call, of, context)), of)

    return make_measure


def _bins_of_call(call: FamilyCall, of: str, context: ComponentContext) -> BinnedEntropy:
    """Return the bins for a call, from the numbers in the call if it has any.

    A call without numbers uses the bins of the `[diversity]` table if that is of the same measure, else bins over the
    measure's own range. Raises `WrongCall` if the numbers do not give a range, or if the range of the measure is
    unknown.
    """
    known, measure = context.diversity, context.others[of][0] if of in context.others else None
    span, count = getattr(measure, "range", None), context.spec.search.population
    if context.spec.diversity.options.get("of") == of and isinstance(known, BinnedEntropy):
        if not call.numbers:
            return known
        count = known.bins
    low, high = call.numbers[:2] if len(call.numbers) > 1 else span or (0.0, 0.0)
    if len(call.numbers) == 3:
        count = int(call.numbers[2])
    if not low < high or count < 1 or len(call.numbers) == 1:
        if call.numbers or measure is not None:
            message = "the numbers must be the lower and the upper end of a range, and optionally a number of bins"
            message = message if call.numbers else f"the range of `{of}` is unknown"
            raise WrongCall(message, f"write `{call.name}({of}, 0, 64)`")
        low, high = 0.0, 1.0  # only the options are checked; the measure does not exist yet
    return BinnedEntropy(count, low, high, whole=getattr(measure, "whole", False))


def _argumentless_factory(make: Callable[[], FamilyMeasure]) -> FamilyFactory:
    def make_measure(call: FamilyCall, context: ComponentContext) -> FamilyMeasure:
        if call.measures or call.numbers:
            raise WrongCall(f"`{call.name}` takes no arguments", f"write `{call.name}`")
        return make()

    return make_measure


def _make_chain_transfer(call: FamilyCall, context: ComponentContext) -> FamilyMeasure:
    if context.spec.environment is None:
        hint = 'write `environment = "name.environment"` at the top of the family file'
        raise WrongCall(f"`{call.name}` needs an environment, but the family file names none", hint)
    return _argumentless_factory(ChainTransfer)(call, context)


def _make_distance(is_least: bool) -> FamilyMeasure:
    from envgraph.search.problem._member_distances import MemberDistance  # needs NumPy, which checks do without

    return MemberDistance(is_least)


FAMILY_MEASURES: Final[Mapping[str, FamilyFactory]] = {
    "entropy": _binned_statistic_factory(lambda bins: bins),
    "coverage": _binned_statistic_factory(BinCoverage),
    "fewest": _binned_statistic_factory(SmallestBinCount),
    "most": _binned_statistic_factory(LargestBinCount),
    "gini": _statistic_factory(Gini()),
    "variance": _statistic_factory(Variance()),
    "evenness": _statistic_factory(StepEvenness()),
    "rising": _statistic_factory(RisingShare()),
    "mean_distance": _argumentless_factory(partial(_make_distance, is_least=False)),
    "least_distance": _argumentless_factory(partial(_make_distance, is_least=True)),
    "distinct": _argumentless_factory(DistinctMembers),
    "chain_transfer": _make_chain_transfer,
}
"""The built-in family measures: a factory for each name."""


def parse_objective(
    spec: ComponentSpec, context: ComponentContext, factories: Mapping[str, FamilyFactory]
) -> tuple[Objective, list[Diagnostic]]:
    """Parse the objective of a family.

    Args:
        spec: the table of the family file that contains the objective.
        context: the context of the family, for names of measures and the metamodel.
        factories: the available family measures, by name.

    Returns:
        The objective without its invalid parts, and the diagnostics.
    """
    reader = _ObjectiveParser(spec, context, factories)
    terms = [*reader.parse_terms("maximise", 1), *reader.parse_terms("minimise", -1)]
    conditions = reader.parse_conditions("subject_to")
    keys = [key for key in ("maximise", "minimise") if key in spec.options]
    if len(keys) == 2:
        message = "`maximise` and `minimise` cannot both be given: the order of a single list is the precedence"
        hint = 'write terms to minimise with a minus: `maximise = ["entropy(complexity)", "-mean_distance"]`'
        reader.problems.append(Diagnostic("bad-value", message, spec.key_span("minimise"), hint))
    elif any(spec.options[key] == [] for key in keys):
        message, hint = "the list of expressions is empty", 'write `maximise = ["entropy(complexity)"]`'
        reader.problems.append(Diagnostic("missing-key", message, spec.span(keys[0]), hint))
    return Objective(tuple(terms), tuple(conditions)), reader.problems


@dataclass(slots=True)
class _ObjectiveParser:
    spec: ComponentSpec
    context: ComponentContext
    factories: Mapping[str, FamilyFactory]
    problems: list[Diagnostic] = field(default_factory=list)

    def parse_terms(self, key: str, sense: int) -> list[ObjectiveTerm]:
        found = []
        for text, place in self._expression_texts(key):
            expression = self._parse_expression(text, place)
            term = expression and self._parse_term(text, expression, place)
            if term:
                found.append(replace(term, sense=sense))
        return found

    def parse_conditions(self, key: str) -> list[FamilyCondition]:
        found = []
        for text, place in self._expression_texts(key):
            expression = self._parse_expression(text, place)
            match expression:
                case Binary(operator=operator, left=left, right=right) if operator in _COMPARISONS:
                    sides = [self._parse_term(text, side, place) for side in (left, right)]
                    if sides[0] and sides[1]:
                        found.append(FamilyCondition(text, sides[0], operator, sides[1]))
                case None:
                    pass
                case _:
                    hint = "write two numbers and one of `>=`, `<=` and `==`: `entropy(complexity) >= 2.5`"
                    self._report_problem("syntax", "this is not a comparison", place, hint)
        return found

    def _expression_texts(self, key: str) -> list[tuple[str, Span | None]]:
        """Return the expressions given for a key, a string or a list of strings, each with its span. Report others."""
        value = self.spec.options.get(key, [])
        if isinstance(value, str):
            return [(value, self.spec.span(key))]
        if not isinstance(value, list):
            hint = f'write `{key} = ["..."]`'
            self._report_problem("wrong-type", f"`{key}` must be a list of strings", self.spec.span(key), hint)
            return []
        found = []
        for index, one in enumerate(value):
            place = self.spec.span(key, index)
            if isinstance(one, str):
                found.append((one, place))
            else:
                hint = f'write each expression in quotation marks: `{key} = ["..."]`'
                self._report_problem("wrong-type", f"`{key}` must be a list of strings", place, hint)
        return found

    def _parse_expression(self, text: str, place: Span | None) -> Expression | None:
        expression, problems = parse_expression(text, place, "write an expression, such as `entropy(complexity)`")
        self.problems += problems
        return expression

    def _parse_term(self, text: str, expression: Expression, place: Span | None) -> ObjectiveTerm | None:
        """Return the expression, which is all of the text or a side of it, as a term; report its errors."""
        before = len(self.problems)
        measures: dict[str, FamilyMeasure] = {}
        named = self._replace_calls(expression, measures, text, place)
        if len(self.problems) > before:
            return None
        scope = dict.fromkeys(measures, Scalar.FLOAT)
        self.problems += check_number_expression(named, scope, self.context.metamodel, text, place)
        return None if len(self.problems) > before else ObjectiveTerm(text, named, measures)

    def _replace_calls(
        self, node: Expression, measures: dict[str, FamilyMeasure], text: str, place: Span | None
    ) -> Expression:
        """Return a copy of an expression in which calls of family measures are replaced by variables.

        The family measures that are called are added to `measures`, keyed by the names of the variables. Invalid calls
        are reported.
        """
        if isinstance(node, Variable):
            call, where = FamilyCall(node.name), node.span
        elif isinstance(node, FunctionCall) and (node.function in self.factories or self._names_measures(node)):
            call, where = self._parse_call(node), node.function_span or node.span
        else:
            parts = [self._replace_calls(one, measures, text, place) for one in children(node)]
            return with_children(node, parts) if parts else node
        where = span_in_file(where, text, place)
        unknown = [one for one in call.measures if self.context.spec.measure(one) is None]
        if call.name not in self.factories:
            message = f"unknown measure of families `{call.name}`"
            self._report_problem("unknown-measure", message, where, self._unknown_measure_hint(call.name))
        elif "" in unknown:
            hint = f"write `{call.name}(measure)`, or add numbers after the measure"
            message = f"the arguments of `{call.name}` must be names of measures, or numbers"
            self._report_problem("wrong-arguments", message, where, hint)
        elif unknown:
            names = [one.name for one in self.context.spec.measures]
            hint = did_you_mean(unknown[0], names) or f"there are {quote_names(names)}"
            self._report_problem("unknown-measure", f"unknown measure `{unknown[0]}`", where, hint)
        else:
            try:
                measures.setdefault(str(call), self.factories[call.name](call, self.context))
            except WrongCall as error:
                self._report_problem("wrong-arguments", error.args[0], where, error.args[1])
        return Variable(str(call), node.span)

    def _names_measures(self, node: FunctionCall) -> bool:
        """Return True if an argument names a measure of the members, so that the call was meant as a family measure."""
        return any(isinstance(one, Variable) and self.context.spec.measure(one.name) for one in node.arguments)

    @staticmethod
    def _parse_call(node: FunctionCall) -> FamilyCall:
        """Return the call as a `FamilyCall`. An argument that is neither a name nor a number becomes the name ""."""
        measures, numbers = list[str](), list[float]()
        for one in node.arguments:
            if isinstance(one, Variable):
                measures.append(one.name)
            else:
                value = None if any(True for _ in variables_in(one)) else value_of(one, {})
                if isinstance(value, int | float):
                    numbers.append(float(value))
                else:
                    measures.append("")
        return FamilyCall(node.function, tuple(measures), tuple(numbers))

    def _unknown_measure_hint(self, name: str) -> str:
        of = [one for one in ("entropy", "evenness") if one in self.factories]
        if self.context.spec.measure(name) is not None and of:
            return f"write `{of[0]}({name})` or another family measure of it: `{name}` is a measure of one member"
        return did_you_mean(name, self.factories) or f"there are {quote_names(self.factories)}"

    def _report_problem(self, code: str, message: str, span: Span | None, hint: str | None) -> None:
        self.problems.append(Diagnostic(code, message, span, hint))
