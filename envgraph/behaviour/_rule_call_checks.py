"""Check the branches, rule calls and rewards of a behaviour."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from math import isfinite

from envgraph.behaviour._behaviour import Action, Branch, RuleCall
from envgraph.behaviour._clause_checks import CheckBase, Scope
from envgraph.behaviour._key_index import key_attributes
from envgraph.errors import (
    InvalidArgument,
    Note,
    Severity,
    Span,
    count_with_noun,
    did_you_mean,
    list_names,
    name_hint,
    quote_with_article,
)
from envgraph.metamodel import Attribute, EnumType, Scalar
from envgraph.pattern import (
    Constant,
    Expression,
    ObjectType,
    StaticType,
    Variable,
    check_expression,
    may_be_assignable,
    type_text,
    value_hint,
    variables_in,
)
from envgraph.rewrite import Engine, Signature


class CallChecks(CheckBase):
    """The checks of clauses that apply rules or pay rewards."""

    handles_refusals = False
    """True if an `on refused` clause is about the rules that the checked clauses call."""
    action: Action | None = None
    """The action whose branches are checked."""
    counted: Sequence[str] = ()
    """The classes through whose objects actions and observations count."""

    def check_branches(self, branches: Sequence[Branch], scope: Scope) -> list[Scope]:
        """Check a list of branches; return the output variables of each branch."""
        fixed = [self._check_probability(branch, scope) for branch in branches]
        if all(0.0 <= one <= 1.0 for one in fixed) and sum(fixed) > 1.0 + 1e-9:
            message = f"the probabilities add up to {sum(fixed):.6g}, which is above 1"
            last = next(branch for branch, one in zip(reversed(branches), reversed(fixed), strict=True) if one)
            rest = 1.0 - sum(fixed[:-1])
            hint = f"write at most {rest:.6g} for the last one" if rest > 0.0 and len(fixed) > 1 else None
            self.report("bad-probability", message, last.probability_span or last.span, hint)
        return [self.check_call(branch.call, scope) for branch in branches]

    def _check_probability(self, branch: Branch, scope: Scope) -> float:
        """Check the probability of a branch; return its value if it is a number, and 0.0 if it must be computed."""
        given, span = branch.probability, branch.probability_span or branch.span
        if not isinstance(given, int | float):
            type_, problems = check_expression(given, scope, self.metamodel, expected=Scalar.FLOAT)
            self.problems.extend(problems)
            if type_ is None and isinstance(given, Constant):
                self.report("bad-probability", "`none` is not a probability", span, "write a number from 0 to 1")
            elif not problems:
                self._check_probability_range(given, type_, scope)
            return 0.0
        if not (isfinite(given) and 0.0 <= given <= 1.0):
            self.report(
                "bad-probability",
                f"the probability is {given}, but must be from 0 to 1",
                span,
                "write a number from 0 to 1",
            )
        return given

    def _check_probability_range(self, given: Expression, type_: StaticType | None, scope: Scope) -> None:
        """Warn of a computed probability if its `@range` leaves 0 to 1, or if it is an `int` without a range."""
        attribute = self.last_feature(given, scope)
        declared = attribute.range if isinstance(attribute, Attribute) else None
        if declared is not None and not 0 <= declared[0] < declared[1] <= 1:
            message = f"`{attribute}` is from {declared[0]:g} to {declared[1]:g}, but a probability must be from 0 to 1"
        elif declared is None and type_ is Scalar.INT and not isinstance(given, Constant):
            message = "a probability must be from 0 to 1, but this is an `int`"
        else:
            return
        hint = "divide it, as in `(x.number / 10.0)`, or declare `@range(0, 1)` before the attribute"
        self.report("unlikely-probability", message, given.span, hint, Severity.WARNING)

    def check_rewards(self, action: Action, scope: Scope, outputs: list[Scope]) -> None:
        """Check the rewards of an action, given the output variables of each branch."""
        shared = dict(scope)
        partly: set[str] = set()
        for name in dict.fromkeys(name for scope_ in outputs for name in scope_):
            types = [found[name] for found in outputs if name in found]
            shared[name] = types[0] if all(type_ == types[0] for type_ in types) else None
            if len(types) < len(outputs):
                partly.add(name)
        self._check_output_bound(action.reward, partly, "leave it out: it has a value in some branches only")
        self.check_reward(action.reward, shared)
        self._check_output_bound(
            action.else_reward, set(shared) - set(scope), "leave it out: a rule that is not applied has no outputs"
        )
        self.check_reward(action.else_reward, shared)
        if action.else_reward and [one.probability for one in action.branches if one.call.rule is None] == [1.0]:
            message = "`nothing()` can always be done, so that this reward is never paid"
            hint = "leave it out" if action.reward else "write it without `else`"
            self.report("never-paid", message, action.else_reward.span, hint, Severity.WARNING)

    def _check_output_bound(self, reward: Expression | None, names: set[str], hint: str) -> None:
        """Report the first of the variables `names`, which may have no value, in a reward; the hint is `hint`."""
        found = next((v for v in variables_in(reward) if v.name in names), None) if reward else None
        if found is not None:
            self.report("unbound-output", f"`{found.name}` may have no value here", found.span, hint)

    def check_reward(self, reward: Expression | None, scope: Mapping[str, StaticType | None]) -> None:
        """Report a reward that is not a number; do nothing if there is no reward."""
        if reward is None:
            return
        type_, problems = check_expression(reward, scope, self.metamodel, expected=Scalar.FLOAT)
        self.problems.extend(problems)
        if type_ is None and isinstance(reward, Constant):
            self.report("wrong-type", "a reward must be a number", reward.span, "leave it out for no reward")

    # --- calls of rules

    def check_call(self, call: RuleCall, scope: Scope) -> Scope:
        """Check `rule(arguments)`; return the output variables that the call binds, with their types.

        For an invalid call, the types of the variables are None.
        """
        if call.rule is None:
            if call.arguments:
                self.report("wrong-arity", "`nothing` takes no arguments", call.span, "write `nothing()`")
            return {}
        signature = signature_of(self.engine, call.rule)
        if signature is None:
            self._report_unknown_rule(call)
            return _supposed_outputs(call, scope)
        if signature.kind == "group":
            message = f"`{call.rule}` is a group of rules, but an environment calls single rules or units"
            self.report("no-rule", message, call.rule_span or call.span, "name a rule or a unit")
            return _supposed_outputs(call, scope)
        self._check_refusals(call.rule, call.rule_span or call.span)
        self._check_creations(call.rule, call.rule_span or call.span)
        if len(call.arguments) != len(signature.parameters):
            count = count_with_noun(len(signature.parameters), "argument")
            message = f"{signature.kind} `{call.rule}` takes {count}, not {len(call.arguments)}"
            self.report("wrong-arity", message, call.span, self._arity_hint(call, signature, scope))
            return _supposed_outputs(call, scope)
        return self._check_arguments(call, signature, scope)

    def _arity_hint(self, call: RuleCall, signature: Signature, scope: Scope) -> str:
        """Return a hint with all arguments of a call, and with the parameters that its action needs for them."""
        names = [one.name for one in call.arguments if isinstance(one, Variable) and not one.is_anonymous]
        names += [one.name for one in signature.parameters[len(names) :]]
        text = f"{signature.simple_name}({', '.join(names[: len(signature.parameters)])})"
        lacking = [
            f"{one.name} : {type_text(one.type)}"
            for one in signature.parameters[len(call.arguments) :]
            if one.name not in scope and not one.is_output and isinstance(one.type, ObjectType | EnumType)
        ]
        if self.action is None or len(self.action.branches) > 1 or not lacking:
            return f"write `{text}`"
        own = [f"{name} : {domain.span.text}" for name, domain in self.action.parameters if domain.span]
        return f"write `action {self.action.name}({', '.join([*own, *lacking])}) = {text}`"

    def _check_refusals(self, rule: str, span: Span | None) -> None:
        """Warn once of each rule that the model may refuse, unless an `on refused` clause is about it."""
        found = () if self.handles_refusals else self.engine.catalog.possible_refusals(rule)
        for one in found[:1]:
            links = list_names(map(str, one.features))
            message = f"`{rule}` adds to {links}, but is refused if there is no room"
            hint = "ask in the rule how many there are, or write `on refused ..`"
            if one.deleted is not None:
                message = f"`{rule}` deletes `{one.deleted}`, but is refused if it has other links: {links}"
                hint = "match them in the rule, forbid them in `not`, or write `@semantics(spo)` or `on refused ..`"
            if all(problem.message != message for problem in self.problems):
                notes = tuple(dict.fromkeys(Note("the change is here", each.span) for each in found))
                self.report("may-be-refused", message, span, hint, Severity.WARNING, notes)

    def _check_creations(self, rule: str, span: Span | None) -> None:
        """Warn once of each rule that creates objects which actions and observations may leave out."""
        for made in self.engine.catalog.created_classes(rule):
            found = [cls for cls in self.counted if self.metamodel.is_a(made, cls)]
            keyed = found and key_attributes(self.metamodel, found[0])
            why = "unless a member has its key at the start" if keyed else "because it has no `@key`"
            message = f"`{rule}` creates {quote_with_article(made)}, which actions and observations leave out {why}"
            if found and all(problem.message != message for problem in self.problems):
                hint = "put it into the model, with a `bool` or an enum that says if it is there"
                self.report("new-object", message, span, hint, Severity.WARNING)

    def _report_unknown_rule(self, call: RuleCall) -> None:
        assert call.rule is not None
        span = call.rule_span or call.span
        if call.rule in self.library.unknown:
            return
        if self.library.resolve(call.rule) is not None:
            message = f"`{call.rule}` is a pattern, not a rule"
            self.report("unknown-rule", message, span, "use patterns in `on find` or `observe find`")
            return
        qualified = [*self.engine.rules, *self.engine.units, *self.engine.groups]
        names = list(dict.fromkeys([*qualified, *(self.engine.signature(name).simple_name for name in qualified)]))
        several = [name for name in names if name.endswith(f".{call.rule}")]
        if len(several) > 1:
            message = f"`{call.rule}` may mean several rules"
            self.report("ambiguous-rule", message, span, "write " + " or ".join(f"`{name}`" for name in several))
            return
        simple = ["nothing", *(name for name in names if "." not in name)]
        hint = did_you_mean(call.rule, names) or name_hint(call.rule, simple)
        self.report("unknown-rule", f"unknown rule `{call.rule}`", span, hint)

    def _check_arguments(self, call: RuleCall, signature: Signature, scope: Scope) -> Scope:
        outputs: Scope = {}
        for argument, slot in zip(call.arguments, signature.parameters, strict=True):
            if not slot.is_output:
                self._check_argument(argument, slot.type, scope)
            elif not isinstance(argument, Variable) or scope.get(argument.name) or argument.name in outputs:
                message = f"the output `{slot.name}` of `{call.rule}` must be bound to a new name"
                self.report("bound-output", message, argument.span, f"write `{slot.name}`")
            elif not argument.is_anonymous:
                outputs[argument.name] = slot.type
        return outputs

    def _check_argument(self, argument: Expression, expected: StaticType | None, scope: Scope) -> None:
        if isinstance(argument, Variable) and argument.is_anonymous:
            hint = "bind it: `action a(x : Class) = r(x)`, `on find p(x) apply r(x)`; or remove it from the rule"
            self.report("wrong-type", "`_` has no value, so it cannot be an argument", argument.span, hint)
            return
        wanted = None if isinstance(expected, ObjectType) else expected
        type_, problems = check_expression(argument, scope, self.metamodel, expected=wanted)
        self.problems.extend(problems)
        if problems or type_ is None or not isinstance(expected, ObjectType):
            if not problems and type_ is None and isinstance(argument, Constant):
                hint = f"write the name of {quote_with_article(type_text(expected))}" if expected else "write a value"
                self.report("wrong-type", "an argument needs a value", argument.span, hint)
            return
        if not may_be_assignable(type_, expected, self.metamodel):
            message = f"expected `{type_text(expected)}`, found `{type_text(type_)}`"
            fitting = [
                name for name, known in scope.items() if known and may_be_assignable(known, expected, self.metamodel)
            ]
            hint = f"write {list_names(fitting)}" if fitting else value_hint(expected)
            self.report("wrong-type", message, argument.span, hint)


def _supposed_outputs(call: RuleCall, scope: Scope) -> Scope:
    """Return the variables that an invalid call would probably bind, namely all unbound ones, with the type None."""
    arguments = [argument for argument in call.arguments if isinstance(argument, Variable)]
    return {argument.name: None for argument in arguments if argument.name not in scope}


def signature_of(engine: Engine, name: str) -> Signature | None:
    """Return the signature of a rule, unit or group; None if the name is unknown or ambiguous."""
    try:
        return engine.signature(name)
    except InvalidArgument:
        return None
