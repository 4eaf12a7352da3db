"""Whether the engine and the oracle do the same with a rule."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from envgraph.errors import EvaluationError, RuleError
from envgraph.graph import Model
from envgraph.pattern import Pattern, Rule
from envgraph.rewrite import Engine, Match
from tests.oracle.rewriting import Outcome, Refused, Unclear, outcomes
from tests.oracle.rewriting_search import Env, Matching, Search, State, Thing
from tests.oracle.rewriting_worlds import state_of
from tests.oracle.worlds import Dice, domain, type_of


def given_values(dice: Dice, rule: Rule, state: State) -> Env:
    """Arguments for the parameters that hold values: nothing in the model enumerates them."""
    found: Env = {}
    for parameter in rule.parameters:
        if parameter.type not in state.metamodel.classes:
            found[parameter.name] = dice.one(domain(type_of(parameter.type)))  # type: ignore[arg-type]
    return found


def env_of(match: Match, things: set[str]) -> Env:
    """A match of the engine, as the oracle writes it."""
    return {n: Thing(v) if n in things else v for n, v in zip(match.names, match.row, strict=True)}


def key(env: Env) -> tuple[tuple[str, object], ...]:
    return tuple(sorted(env.items()))


def disagreement(engine: Engine, patterns: Sequence[Pattern], rule: Rule, given: Env, most: int = 8) -> str | None:
    """How engine and oracle differ, in the matches or in what the rule does at one of them; None if they do not.

    The rule is applied at some matches, each time from the state at the beginning.
    """
    model = engine.model
    state = state_of(model)
    known = {pattern.name: pattern for pattern in patterns}
    expected = Matching(state, rule, Search(state, known)).matches(given)
    found = engine.matches(rule.name, **given)
    things = {n for env in expected for n, v in env.items() if isinstance(v, Thing)}
    if {key(env) for env in expected} != {key(env_of(match, things)) for match in found} or len(expected) != len(found):
        ours = sorted(map(str, (key(env) for env in expected)))
        theirs = sorted(map(str, (key(env_of(match, things)) for match in found)))
        return f"matches: oracle {ours} engine {theirs}"
    for match in found[:most]:
        wrong = application_disagrees(model, state, rule, known, match, env_of(match, things), engine)
        if wrong is not None:
            return f"at {match.row}: {wrong}"
    return None


def application_disagrees(
    model: Model,
    state: State,
    rule: Rule,
    patterns: dict[str, Pattern],
    match: Match,
    env: Env,
    engine: Engine,
) -> str | None:
    """How they differ at a match."""
    expected = outcomes(state, rule, patterns, env)
    savepoint = model.graph.history.savepoint()
    try:
        said, found = applied(engine, rule, match, model)
        model.check_integrity()
    finally:
        model.graph.history.rollback(savepoint)
    if not expected or any(isinstance(one, Unclear) for one in expected):
        return None
    if any(agrees(one, said, found, state) for one in expected):
        return None
    return f"oracle {[described(one) for one in expected]}, engine {said}" + (f" {described(found)}" if found else "")


def applied(engine: Engine, rule: Rule, match: Match, model: Model) -> tuple[str, State | None]:
    """What the engine says, and the state that it leads to."""
    before = state_of(model)
    try:
        engine.apply(rule.name, match)
    except RuleError as error:
        assert state_of(model) == before
        return error.reason, None
    except EvaluationError:
        assert state_of(model) == before
        return "error", None
    return "done", state_of(model)


def agrees(expected: Outcome, said: str, found: State | None, before: State) -> bool:
    if isinstance(expected, Refused):
        return said in expected.reasons
    assert isinstance(expected, State)
    return found is not None and same(expected, found, set(before.classes))


def described(outcome: Outcome | None) -> str:
    if isinstance(outcome, Refused):
        return f"refused: {sorted(outcome.reasons)}"
    if isinstance(outcome, State):
        return f"{outcome.classes} {outcome.values} {sorted(outcome.links)}"
    return str(outcome)


# --- the same but for the ids of new objects

MOST_NEW = 12
"""With more new objects it has to do that they look alike."""


def same(one: State, other: State, old: set[Thing]) -> bool:
    """Whether two graphs are the same, once the new objects of one stand for those of the other."""
    new = [thing for thing in one.classes if thing not in old]
    also = [thing for thing in other.classes if thing not in old]
    if len(one.classes) != len(other.classes) or len(new) != len(also):
        return False
    colours, theirs = coloured(one, old), coloured(other, old)
    if len(new) > MOST_NEW:
        return sorted(colours.values()) == sorted(theirs.values())
    return any(renamed(one, names) == other for names in renamings(new, also, colours, theirs))


def renamings(
    new: Sequence[Thing], also: Sequence[Thing], colours: dict[Thing, str], theirs: dict[Thing, str]
) -> Iterator[dict[Thing, Thing]]:
    """The ways to pair the new objects that look the same."""
    if not new:
        yield {}
        return
    for thing in also:
        if colours[new[0]] == theirs[thing]:
            for rest in renamings(new[1:], [o for o in also if o != thing], colours, theirs):
                yield {new[0]: thing, **rest}


def coloured(state: State, old: set[Thing], rounds: int = 3) -> dict[Thing, str]:
    """What new objects look like, from some links away."""
    colours = {t: f"={int(t)}" if t in old else cls for t, cls in state.classes.items()}
    for _ in range(rounds):
        colours = {t: c if t in old else look(state, t, colours) for t, c in colours.items()}
    return colours


def look(state: State, thing: Thing, colours: dict[Thing, str]) -> str:
    values = sorted((name, str(v)) for (t, name), v in state.values.items() if t == thing)
    out = sorted((r, colours[t]) for r, s, t in state.links if s == thing)
    into = sorted((r, colours[s]) for r, s, t in state.links if t == thing)
    return str(hash((state.classes[thing], tuple(values), tuple(out), tuple(into))))


def renamed(state: State, names: dict[Thing, Thing]) -> State:
    return State(
        state.metamodel,
        {names.get(t, t): cls for t, cls in state.classes.items()},
        {(names.get(t, t), name): value for (t, name), value in state.values.items()},
        {(r, names.get(s, s), names.get(t, t)) for r, s, t in state.links},
    )
