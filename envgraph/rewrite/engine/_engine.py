"""The one facade: a model, what is defined over it, and what can be asked of it and done to it."""

from __future__ import annotations

from collections.abc import Callable
from copy import deepcopy
from functools import partial, wraps
from operator import attrgetter
from typing import TYPE_CHECKING, Any, Concatenate, ParamSpec, TypeVar
from weakref import ref

from envgraph.code import short_repr
from envgraph.errors import Diagnostic
from envgraph.graph import Model
from envgraph.match import Matcher, ViewMatcher
from envgraph.pattern import Library
from envgraph.rewrite.engine import _python
from envgraph.rewrite.engine._catalog import Catalog
from envgraph.rewrite.engine._history import EngineHistory
from envgraph.rewrite.engine._notification import Events
from envgraph.rewrite.engine._queries import Queries
from envgraph.rewrite.engine._register import Definition
from envgraph.rewrite.engine._registrar import Registrar
from envgraph.rewrite.engine._rewriting import Rewriting
from envgraph.rewrite.engine._runs import Runs
from envgraph.rewrite.events._agenda import Agenda
from envgraph.rewrite.explore import _explore

if TYPE_CHECKING:
    import numpy

P = ParamSpec("P")
R = TypeVar("R")


def _of(part: str, method: Callable[Concatenate[Any, P], R]) -> Callable[Concatenate[Engine, P], R]:
    """A verb of the engine: a method of one of its parts, with the types and the docstring of that."""
    found = attrgetter(part)

    @wraps(method)
    def verb(engine: Engine, /, *arguments: P.args, **named: P.kwargs) -> R:
        return method(found(engine), *arguments, **named)

    return verb


@short_repr
class Engine:
    """A model together with what can be asked of it and done to it.

    The work is done by parts; the verbs of all of them are verbs of the engine.

    Names of patterns, rules, units and groups may be qualified (`package.name`), or simple where only one definition
    has that name.

    >>> from envgraph.metamodel import Attribute, Class, Metamodel, Scalar
    >>> from envgraph.pattern import Constant, LeftSide, Modification, Node, Rule, Set, Variable
    >>> model = Model(Metamodel("lamps", [Class("Lamp", features=(Attribute("lit", Scalar.BOOL),))]))
    >>> lamp = model.create("Lamp")
    >>> light = Modification((Set(Variable("lamp"), "lit", "=", Constant(True)),))
    >>> engine = Engine(model)
    >>> engine.add(Rule("light", left=LeftSide((Node("lamp", "Lamp"),)), right=light))
    >>> engine.apply("light").match.names, lamp.lit
    (('lamp',), True)

    Args:
        model: the model; it may also be changed directly.
        seed: of `rng`.
        matcher: makes what finds the matches; another one than `ViewMatcher` can watch nothing.

    Attributes:
        model: the model.
        library: the registered patterns; the left sides of rules are among them under names like `rule#lhs`.
        matcher: finds the matches.
        catalog: what has been defined, by name.
        events: listeners and event rules.
        history: transactions, versions and recordings.
        runs: runs units, and makes the random choices.
        queries: asks the matcher.
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
            self.matcher.kept.user = ref(self)
        self.catalog = Catalog(model, self.library, self.matcher)
        self.events = Events(self.catalog, self)
        self.history = EngineHistory(model, self.events)
        self.runs = Runs(self.catalog, self.events, self.history, seed)
        self._rewriting = Rewriting(self.catalog, self.events, self.history, self.runs)
        self.queries = Queries(self.catalog, self.runs)
        self.registrar = Registrar(self.catalog, self.events)

    matches = _of("queries", Queries.matches)
    first = _of("queries", Queries.first)
    exists = _of("queries", Queries.exists)
    count = _of("queries", Queries.count)
    explain = _of("queries", Queries.explain)
    why_not = _of("queries", Queries.why_not)
    analyze = _of("queries", Queries.analyze)
    watch = _of("queries", Queries.watch)
    unwatch = _of("queries", Queries.unwatch)

    check = _of("registrar", Registrar.check)
    add = _of("registrar", Registrar.add)
    remove = _of("registrar", Registrar.remove)
    replace = _of("registrar", Registrar.replace)
    rule = _python.rule
    unit = _python.unit
    function = _python.function

    definition = _of("catalog", Catalog.definition)
    group = _of("catalog", Catalog.group)
    signature = _of("catalog", Catalog.signature)
    prepare = _of("catalog", Catalog.prepare)

    apply = _of("_rewriting", Rewriting.apply)
    apply_all = _of("_rewriting", Rewriting.apply_all)
    choose = _of("_rewriting", Rewriting.choose)
    choice = _of("_rewriting", Rewriting.choice)
    fire = _of("_rewriting", Rewriting.fire)
    replay = _of("_rewriting", Rewriting.replay)
    run = _of("runs", Runs.run)
    explore = _explore.explore

    transaction = _of("history", EngineHistory.transaction)
    commit = _of("history", EngineHistory.commit)
    checkout = _of("history", EngineHistory.checkout)
    recording = _of("history", EngineHistory.recording)

    on = _of("events", Events.on)
    listen = _of("events", Events.listen)
    unlisten = _of("events", Events.unlisten)
    settle = _of("events", Events.settle)

    @property
    def seed(self) -> int:
        """What `rng` is seeded with."""
        return self.runs.seed

    @property
    def rng(self) -> numpy.random.Generator:
        """The generator behind every random choice: seeded with `seed` when it is first needed, and settable.

        Without NumPy, a `random.Random` of the same seed stands in; its choices are others.
        """
        return self.runs.rng

    @rng.setter
    def rng(self, generator: numpy.random.Generator) -> None:
        self.runs.rng = generator

    @property
    def step_limit(self) -> int:
        """How many calls and rounds one `run` may take, and how often event rules may fire until they rest."""
        return self.runs.step_limit

    @step_limit.setter
    def step_limit(self, most: int) -> None:
        self.runs.step_limit = most

    @property
    def watched(self) -> tuple[str, ...]:
        """Qualified names of the patterns that are kept current."""
        return self.queries.watched

    @property
    def agenda(self) -> Agenda:
        """What event rules are about to do, in that order."""
        return self.events.agenda

    @property
    def notices(self) -> tuple[Diagnostic, ...]:
        """What applications have come upon that may not be meant, each once, in order.

        A link that a rule creates although it is there ("existing-link"). They also go to the logger "envgraph".
        """
        return self.catalog.notices.all

    @property
    def definitions(self) -> tuple[Definition, ...]:
        """The declared functions, patterns, rules, units and derivations as they were added."""
        return self.catalog.definitions

    @property
    def functions(self) -> tuple[str, ...]:
        """Names of the functions that expressions can call, besides those of the language."""
        return tuple(self.library.functions)

    @property
    def patterns(self) -> tuple[str, ...]:
        """Qualified names of the registered patterns, without those that rules are made into."""
        return tuple(name for name in self.library.names() if "#" not in name)

    @property
    def rules(self) -> tuple[str, ...]:
        """Qualified names of all rules, members of groups included, in the order they were added."""
        return tuple(self.catalog.runners)

    @property
    def units(self) -> tuple[str, ...]:
        """Qualified names of the units."""
        return tuple(self.catalog.programs)

    @property
    def groups(self) -> tuple[str, ...]:
        """Qualified names of the derivations."""
        return tuple(self.catalog.members)

    def check_integrity(self) -> None:
        """Assert that model and views hold what a computation from scratch finds: a failure is a bug of envgraph."""
        self.model.check_integrity()
        if isinstance(self.matcher, ViewMatcher):
            self.matcher.check_integrity()

    def copy(self) -> Engine:
        """An independent engine: the same state of the model, the same definitions and watched patterns.

        Its random choices begin anew from `seed`; those of a `deepcopy`, and of a pickled engine, go on as those of
        this one. Versions, listeners, event rules, rules and units made of Python functions, and units that call those,
        stay behind: a function that changes models belongs to the engine that it was registered with.
        """
        make, (model,), (_, *state) = self.__reduce__()
        twin = make(model.copy())
        twin.__setstate__((None, *state))
        return twin

    __copy__ = copy

    def __deepcopy__(self, _: object) -> Engine:
        twin = self.copy()
        twin.rng = deepcopy(self.rng)
        return twin

    def __reduce__(self) -> tuple[Callable[..., Engine], tuple[Model], tuple[Any, ...]]:
        """Return the data to rebuild an engine."""
        functions = [(name, function.code) for name, function in self.library.functions.items()]
        state = self.rng, self.catalog.portable(), functions, self.step_limit, self.watched
        return partial(Engine, seed=self.seed, matcher=self._matching), (self.model,), state

    def __setstate__(self, state: tuple[Any, ...]) -> None:
        """Define and watch what another engine does."""
        self.runs.rng, definitions, functions, self.step_limit, watched = state
        self.add(*definitions)
        for name, code in functions:
            self.library.functions[name].code = code
        if watched:
            self.catalog.views.watch(*(name for name in watched if name in self.library.names()))

    def __repr__(self) -> str:
        return f"<Engine on {self.model!r}: {len(self.rules)} rules>"
