"""The engine: the facade over a model, its definitions, and all queries and changes."""

from __future__ import annotations

from collections.abc import Callable
from copy import deepcopy
from functools import partial, wraps
from operator import attrgetter
from typing import TYPE_CHECKING, Any, Concatenate, ParamSpec, TypeVar
from weakref import ref

from envgraph.code import shorten_repr
from envgraph.draw import html_picture, html_table
from envgraph.errors import Diagnostic
from envgraph.graph import Model
from envgraph.match import Matcher, ViewMatcher
from envgraph.pattern import Library
from envgraph.rewrite.engine import _decorators
from envgraph.rewrite.engine._catalog import Catalog
from envgraph.rewrite.engine._engine_history import EngineHistory
from envgraph.rewrite.engine._match_queries import Queries
from envgraph.rewrite.engine._notification import EngineEvents
from envgraph.rewrite.engine._registrar import Registrar
from envgraph.rewrite.engine._registration import Definition
from envgraph.rewrite.engine._rewriting import Rewriting
from envgraph.rewrite.engine._unit_runs import EngineRuns
from envgraph.rewrite.events._agenda import Agenda
from envgraph.rewrite.explore import _exploration_search

if TYPE_CHECKING:
    import numpy

P = ParamSpec("P")
R = TypeVar("R")


def _delegate(part: str, method: Callable[Concatenate[Any, P], R]) -> Callable[Concatenate[Engine, P], R]:
    """Return a method of the engine that delegates to a method of a part and has its types and docstring."""
    found = attrgetter(part)

    @wraps(method)
    def verb(engine: Engine, /, *arguments: P.args, **named: P.kwargs) -> R:
        return method(found(engine), *arguments, **named)

    return verb


@shorten_repr
class Engine:
    """A model together with patterns, rules and units, and all operations on them.

    The operations are implemented by parts. Each public operation of a part is also a method of the engine.

    Names of patterns, rules, units and groups may be qualified (`package.name`), or simple if only one definition has
    this simple name.

    >>> from envgraph.metamodel import Attribute, Class, Metamodel, Scalar
    >>> from envgraph.pattern import Constant, LeftSide, Modification, Rule, RuleNode, SetAction, Variable
    >>> model = Model(Metamodel("lamps", [Class("Lamp", features=(Attribute("lit", Scalar.BOOL),))]))
    >>> lamp = model.create("Lamp")
    >>> light = Modification((SetAction(Variable("lamp"), "lit", "=", Constant(True)),))
    >>> engine = Engine(model)
    >>> engine.add(Rule("light", left=LeftSide((RuleNode("lamp", "Lamp"),)), right=light))
    >>> engine.apply("light").match.names, lamp.lit
    (('lamp',), True)

    Args:
        model: the model; it may also be changed directly.
        seed: seed of `rng`.
        matcher: class or function that creates the matcher. Only a `ViewMatcher` can watch patterns.

    Attributes:
        model: the model.
        library: the registered patterns; it also contains the left-hand sides of rules, with names such as `rule#lhs`.
        matcher: finds the matches.
        catalog: the definitions, by name.
        events: listeners and event rules.
        history: transactions, versions and recordings.
        runs: runs units and makes random choices.
        queries: queries the matcher.
        registrar: adds, removes and replaces definitions.
    """

    def __init__(
        self, model: Model, *, seed: int = 0, matcher: Callable[[Model, Library], Matcher] = ViewMatcher
    ) -> None:
        self.model = model
        self.library = Library(model.metamodel)
        self._matching = matcher
        self.matcher = matcher(model, self.library)
        if isinstance(self.matcher, ViewMatcher):
            self.matcher.watched_views.user = ref(self)
        self.catalog = Catalog(model, self.library, self.matcher)
        self.events = EngineEvents(self.catalog, self)
        self.history = EngineHistory(model, self.events)
        self.runs = EngineRuns(self.catalog, self.events, self.history, seed)
        self._rewriting = Rewriting(self.catalog, self.events, self.history, self.runs)
        self.queries = Queries(self.catalog, self.runs)
        self.registrar = Registrar(self.catalog, self.events)

    matches = _delegate("queries", Queries.matches)
    first = _delegate("queries", Queries.first)
    exists = _delegate("queries", Queries.exists)
    count = _delegate("queries", Queries.count)
    explain = _delegate("queries", Queries.explain)
    why_not = _delegate("queries", Queries.why_not)
    analyze = _delegate("queries", Queries.analyze)
    watch = _delegate("queries", Queries.watch)
    unwatch = _delegate("queries", Queries.unwatch)

    check = _delegate("registrar", Registrar.check)
    add = _delegate("registrar", Registrar.add)
    remove = _delegate("registrar", Registrar.remove)
    replace = _delegate("registrar", Registrar.replace)
    rule = _decorators.rule
    unit = _decorators.unit
    function = _decorators.function

    definition = _delegate("catalog", Catalog.definition)
    group = _delegate("catalog", Catalog.group)
    signature = _delegate("catalog", Catalog.signature)
    prepare = _delegate("catalog", Catalog.prepare)

    apply = _delegate("_rewriting", Rewriting.apply)
    apply_all = _delegate("_rewriting", Rewriting.apply_all)
    choose = _delegate("_rewriting", Rewriting.choose)
    choice = _delegate("_rewriting", Rewriting.choice)
    fire = _delegate("_rewriting", Rewriting.fire)
    replay = _delegate("_rewriting", Rewriting.replay)
    run = _delegate("runs", EngineRuns.run)
    explore = _exploration_search.explore

    transaction = _delegate("history", EngineHistory.transaction)
    commit = _delegate("history", EngineHistory.commit)
    checkout = _delegate("history", EngineHistory.checkout)
    recording = _delegate("history", EngineHistory.recording)

    on = _delegate("events", EngineEvents.on)
    listen = _delegate("events", EngineEvents.listen)
    unlisten = _delegate("events", EngineEvents.unlisten)
    settle = _delegate("events", EngineEvents.settle)

    @property
    def seed(self) -> int:
        """Return the seed of `rng`."""
        return self.runs.seed

    @property
    def rng(self) -> numpy.random.Generator:
        """Return the random generator of all random choices, seeded with `seed` when it is first used. It can be set.

        Without NumPy it is a `random.Random` with the same seed, which makes other choices.
        """
        return self.runs.rng

    @rng.setter
    def rng(self, generator: numpy.random.Generator) -> None:
        self.runs.rng = generator

    @property
    def step_limit(self) -> int:
        """Return the maximal number of calls and loop rounds in a `run`, and of event rule firings in a settling."""
        return self.runs.step_limit

    @step_limit.setter
    def step_limit(self, most: int) -> None:
        self.runs.step_limit = most

    @property
    def watched(self) -> tuple[str, ...]:
        """Return the qualified names of the patterns whose matches are updated after every change."""
        return self.queries.watched

    @property
    def agenda(self) -> Agenda:
        """Return the pending activations of event rules, in the order of firing."""
        return self.events.agenda

    @property
    def notices(self) -> tuple[Diagnostic, ...]:
        """Return warnings that applications have reported, each once, in order.

        "existing-link" means that a rule created a link that already existed. Notices also go to the logger "envgraph".
        """
        return self.catalog.notices.all

    @property
    def definitions(self) -> tuple[Definition, ...]:
        """Return the declared functions, patterns, rules, units and derivations as they were added."""
        return self.catalog.definitions

    @property
    def functions(self) -> tuple[str, ...]:
        """Return the names of the functions that expressions can call, without those of the language."""
        return tuple(self.library.functions)

    @property
    def patterns(self) -> tuple[str, ...]:
        """Return the qualified names of the registered patterns, without the patterns generated for rules."""
        return tuple(name for name in self.library.names() if "#" not in name)

    @property
    def rules(self) -> tuple[str, ...]:
        """Return the qualified names of all rules, including members of groups, in the order of their addition."""
        return tuple(self.catalog.runners)

    @property
    def units(self) -> tuple[str, ...]:
        """Return the qualified names of the units."""
        return tuple(self.catalog.programs)

    @property
    def groups(self) -> tuple[str, ...]:
        """Return the qualified names of the derivations."""
        return tuple(self.catalog.members)

    def check_integrity(self) -> None:
        """Assert that model and views equal a computation from scratch. A failure is a bug of envgraph."""
        self.model.check_integrity()
        if isinstance(self.matcher, ViewMatcher):
            self.matcher.check_integrity()

    def copy(self) -> Engine:
        """Return an independent engine with the same state of the model, the same definitions and watched patterns.

        The copy makes its random choices from `seed` again; a `deepcopy` or an unpickled engine continues the random
        sequence. Not copied are versions, listeners, event rules, Python rules and units, and units that call those:
        a function that changes models belongs to the engine with which it was registered.
        """
        make, (model,), (_, *state) = self.__reduce__()
        copied = make(model.copy())
        copied.__setstate__((None, *state))
        return copied

    __copy__ = copy

    def __deepcopy__(self, _: object) -> Engine:
        copied = self.copy()
        copied.rng = deepcopy(self.rng)
        return copied

    def __reduce__(self) -> tuple[Callable[..., Engine], tuple[Model], tuple[Any, ...]]:
        """Return the data from which an engine is rebuilt, for pickling and copying."""
        functions = [(name, function.code) for name, function in self.library.functions.items()]
        state = self.rng, self.catalog.portable_definitions(), functions, self.step_limit, self.watched
        return partial(Engine, seed=self.seed, matcher=self._matching), (self.model,), state

    def __setstate__(self, state: tuple[Any, ...]) -> None:
        """Take over the random generator, definitions, functions, step limit and watched patterns of another engine."""
        self.runs.rng, definitions, functions, self.step_limit, watched = state
        self.add(*definitions)
        for name, code in functions:
            self.library.functions[name].code = code
        if watched:
            self.catalog.view_matcher.watch(*(name for name in watched if name in self.library.names()))

    def _repr_html_(self) -> str:
        names = {"patterns": self.patterns, "rules": self.rules, "units": self.units, "watched": self.watched}
        rows = [(kind, ", ".join(some)) for kind, some in names.items() if some]
        return f"{html_table(rows, caption=repr(self.model))}{html_picture(self.model._repr_svg_)}"

    def __repr__(self) -> str:
        return f"<Engine on {self.model!r}: {len(self.rules)} rules>"
