"""Families: the members that a run created or a file contains, and all data needed to rebuild them."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import field, replace
from functools import cache, cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import numpy as np
from numpy.typing import NDArray

from envgraph.behaviour import action_keys, with_only_reward
from envgraph.code import dataclass
from envgraph.env import Behaviour, ExploredEnvironment, KeyIndex, Scene, scene_of, scene_svg, scene_text
from envgraph.errors import (
    LIMITS,
    EvaluationError,
    InvalidArgument,
    LoadError,
    Note,
    check_known,
    did_you_mean,
    list_names,
    parse_int,
)
from envgraph.files import read_facts, write_facts
from envgraph.graph import Model, model_from_json
from envgraph.lang import Bundle, bundled_domains
from envgraph.rewrite import Engine
from envgraph.search._run_store import Individual, RunStore
from envgraph.search.domain._components import Components
from envgraph.search.domain._domain import Domain
from envgraph.search.families._family_pictures import family_html, member_html
from envgraph.search.families._lazy_models import LazyModel, ReplayedModels
from envgraph.search.families._table_cache import FamilyRecord, TableCache, hash_key, table_file_name
from envgraph.search.families._train_test_split import split_places
from envgraph.search.problem._member_distances import count_differing_objects, number_objects
from envgraph.search.problem._problem import checked_number

if TYPE_CHECKING:
    from envgraph.env.compiled import CompiledProgram, MemberEngines


MANY_MEMBERS: Final = 100
"""Number of members above which compiling a program is faster than visiting all their states. Its arrays are cached."""


@dataclass(frozen=True, slots=True)
class Member:
    """A member of a family: a model, which is the initial state of an environment.

    Attributes:
        name: "E1" for the first member in the order of the curriculum, and so on.
        measures: value of every measure, by name.
        source: the model as JSON text, or an object that makes this text when it is needed.
        individual: id in the run store, or None.
        initial: True if it is the initial model.
        certificates: the verified values by name, within "limit" steps; {} if the member was not verified. Exact are
            "shortest_plan" (None if there is no plan), "random_success" and "optimal_return". If there are too many
            states, what is not known of them is None, and there are "plan_found", "plan_return", and of a random walk
            "sampled_episodes", "sampled_success" and "sampled_return", with the ends of their 95 % intervals:
            "sampled_success_low", "sampled_success_high" and so on.
    """

    name: str
    measures: Mapping[str, float]
    source: str | LazyModel = field(repr=False)
    individual: int | None = None
    initial: bool = False
    certificates: Mapping[str, float | None] = field(default_factory=dict)
    _family: Family | None = field(default=None, compare=False, repr=False)

    @property
    def model(self) -> str:
        """Return the member's model as JSON text."""
        return self.source if isinstance(self.source, str) else self.source.text()

    @property
    def family(self) -> Family | None:
        """Return the family to which the member belongs; None for a member that was made alone."""
        return self._family

    def _repr_html_(self) -> str | None:
        return None if self._family is None else member_html(self._family, self)


@dataclass(frozen=True)
class Family:
    """A family of environments in the order of the curriculum, with the texts of their domain.

    Attributes:
        name: name of the family.
        bundle: texts of the domain; the first root is the family file.
        members: the members from the easiest to the hardest by the measure that orders the curriculum, then the initial
            model.
        domain: the domain read from the texts, with the overrides.
        overrides: settings that replace those of the family file, such as "seed=5".
        objective: values of the terms of `[objective]`, and `learnt` of `CurriculumProgress`; {} without an objective.
        violated_conditions: violated conditions of the objective, by their text, each with the amount of the violation.
        tables: cache of the members' transition tables.
    """

    name: str
    bundle: Bundle
    members: tuple[Member, ...]
    domain: Domain = field(compare=False, repr=False)
    overrides: tuple[str, ...] = ()
    objective: Mapping[str, float] = field(default_factory=dict)
    violated_conditions: Mapping[str, float] = field(default_factory=dict)
    tables: TableCache = field(default_factory=TableCache.of_user, compare=False, repr=False)
    _explored: dict[tuple[str, bool], ExploredEnvironment] = field(default_factory=dict, compare=False, repr=False)
    _keys: KeyIndex | None = field(default=None, compare=False, repr=False)
    _pays: str | None = field(default=None, repr=False)

    def __post_init__(self) -> None:
        object.__setattr__(self, "members", tuple(replace(one, _family=self) for one in self.members))

    @property
    def value(self) -> float | None:
        """Return the value of the first term of the objective; None without an objective."""
        return next(iter(self.objective.values()), None)

    @cached_property
    def keys(self) -> KeyIndex:
        """Return the numbers of objects by key, the same for all members. A subset keeps those of its whole family."""
        if self._keys is not None:
            return self._keys
        content = self._hash_of(self.members)
        known = read_facts(content, "keys")
        if known is not None:
            return KeyIndex.from_json(known, self.domain.metamodel)
        found = self.domain.keys(self._iterate_models(sorted(self.members, key=_birth)))
        write_facts(content, "keys", found.to_json())
        return found

    def _hash_of(self, members: Sequence[Member], *more: object) -> str:
        """Return a hash of members and of more data; "" if they are few, or may depend on Python functions."""
        behaviour, texts = self.domain.behaviour, sorted(self.domain.workspace.sources.values())
        if len(members) <= MANY_MEMBERS or self.domain.components.function:
            return ""
        models = [one.source if isinstance(one.source, str) else one.source.state_hash for one in members]
        return hash_key(behaviour and behaviour.name, self._pays, texts, models, *more)

    def _iterate_models(self, members: Iterable[Member]) -> Iterator[Model]:
        """Yield the models of members. Each must be read before the next one is requested."""
        for one in members:
            yield self.model(one) if isinstance(one.source, str) else one.source.engine().model

    @property
    def behaviour(self) -> Behaviour:
        """Return the behaviour of the environments.

        Raises:
            InvalidArgument: the family has no environment.
        """
        behaviour = self.domain.behaviour
        if behaviour is None:
            raise InvalidArgument(
                f"family `{self.name}` has no environment",
                'write `environment = "name.environment"` in the family file',
            )
        return behaviour if self._pays is None else with_only_reward(behaviour, self._pays)

    @property
    def limit(self) -> int | None:
        """Return the number of steps after which an episode is truncated, or None."""
        return self.domain.spec.limit or self.behaviour.limit

    def member(self, variant: int | str | None = None) -> Member:
        """Return a member by its name or its number from 1; the target, which is the last member, for None.

        Raises:
            InvalidArgument: the member does not exist.
        """
        return self.members[member_place(variant, self._places, self.name)]

    @cached_property
    def _places(self) -> dict[str, int]:
        return {member.name: place for place, member in enumerate(self.members)}

    def model(self, member: Member) -> Model:
        """Return a new copy of a member's model."""
        return model_from_json(member.model, self.domain.metamodel, file=f"{self.name}/{member.name}")

    def explored(
        self, member: Member, *, pictures: bool = False, outcomes: int = LIMITS["all outcomes"]
    ) -> ExploredEnvironment:
        """Return the transition table of a member. It is computed on the first call, and then cached in `tables`.

        Args:
            member: a member of this family.
            pictures: True if a scene of every state is needed. It is only made if the behaviour has a `draw` clause.
            outcomes: the maximum number of outcomes that the live engine visits, if no compiled program does so faster.

        Raises:
            InvalidArgument: the family has no environment.
            EvaluationError: there are too many states.
        """
        name, kept = member.name, self._explored
        known = kept.get((name, True)) or kept.get((name, pictures))
        if known is None:
            behaviour = self.behaviour  # raises if there is no environment
            known = self._explored[name, pictures] = self.tables.load_or_explore(
                self.domain, behaviour, self.model(member), self.keys, pictures=pictures, outcomes=outcomes
            )
        return known

    def program(self, members: Sequence[Member]) -> CompiledProgram:
        """Return the compiled behaviour for these members, as one program. The arrays of many members are cached.

        Raises:
            InvalidArgument: the family has no environment.
            NotCompiled: the behaviour has a construct that cannot be compiled.
        """
        from envgraph.env.compiled import program_of

        def compile_some(some: Sequence[Member]) -> CompiledProgram:
            return program_of(self.domain.engine(), self.behaviour, self._engines_of(some), self.keys)

        content, cache = self._hash_of(members, self.keys.to_json()), TableCache.of_user()
        known = read_facts(content, "program")
        if known and (arrays := cache.map_arrays(known["arrays"])):
            found = compile_some(members[:: known["step"]])
            if found.source == known["source"]:
                everyone = replace(found.members, engines=self._engines_of(members), strings=known["strings"])
                return replace(found, arrays=type(found.arrays)(*arrays), members=everyone)
        found, step = compile_some(members), len(members)
        if content:
            while compile_some(members[::step]).layout.broken_assumptions != found.layout.broken_assumptions:
                step //= 2  # with the step 1 these are all members
            facts = {"step": step, "source": found.source, "strings": found.members.strings}
            write_facts(content, "program", {**facts, "arrays": cache.write_arrays(found.arrays)})
        return found

    def _engines_of(self, members: Sequence[Member]) -> MemberEngines:
        """Return access to the initial states of members."""
        from envgraph.env.compiled import MemberEngines

        def make(place: int) -> Engine:
            return self.domain.engine(self.model(members[place]))

        made = cache(make)  # environments with the same program may not share an engine that draws their states

        def read(place: int) -> Engine:
            source = members[place].source
            return made(place) if isinstance(source, str) else source.engine()

        return MemberEngines(read, make, sorted(range(len(members)), key=lambda place: _birth(members[place])))

    def table_file_name(self, member: Member) -> str:
        """Return the name of the file in which the transition table of a member is cached, without a directory."""
        return table_file_name(self.domain, self.behaviour, self.model(member), self.keys)

    def record(self) -> FamilyRecord:
        """Return the data that is needed besides tables to make environments. Errors are those of `behaviour`."""
        behaviour = self.behaviour
        tables = {one.name: self.table_file_name(one) if isinstance(one.source, str) else "" for one in self.members}
        certificates = {one.name: one.certificates for one in self.members}
        drawn = behaviour.draw is not None
        keys = None if behaviour.together else action_keys(behaviour, self.keys, self.domain.metamodel)
        return FamilyRecord(self.name, behaviour.name, self.limit, drawn, keys, tables, certificates)

    def scene(self, member: Member) -> Scene | None:
        """Return the picture of a member as a scene; None if the behaviour has no `draw` clause."""
        behaviour = self.domain.behaviour
        if behaviour is None or behaviour.draw is None:
            return None
        return scene_of(self.model(member), behaviour.draw, behaviour.parameters)

    def svg(self, member: Member) -> str:
        """Return the picture of a member as SVG, by the `draw` clause of the behaviour, else as boxes and lines."""
        scene = self.scene(member)
        if scene is not None:
            return scene_svg(scene)
        # Without Graphviz the picture is the same on every machine.
        return self.model(member).picture().to_svg(graphviz=False)

    def text(self, member: Member) -> str:
        """Return the picture of a member as text, by the `draw` clause of the behaviour, else as its objects."""
        scene = self.scene(member)
        return self.model(member).picture().to_text() if scene is None else scene_text(scene)

    def subset(self, members: Iterable[Member | int | str]) -> Family:
        """Return the family of some members, in their order here and with their names.

        Args:
            members: members of this family, or their names or numbers from 1.

        Raises:
            InvalidArgument: a member does not exist, or there are none.
        """
        chosen = {one.name if isinstance(one, Member) else self.member(one).name for one in members}
        return self._family_of_places([place for place, one in enumerate(self.members) if one.name in chosen])

    def between(self, measure: str, low: float, high: float) -> Family:
        """Return the family of the members whose value of a measure is from `low` to `high`.

        Raises:
            InvalidArgument: the measure does not exist, or no member is in the range.
        """
        check_known(measure, self.members[0].measures, f"family `{self.name}` has no measure `{measure}`")
        return self._family_of_places(
            [place for place, one in enumerate(self.members) if low <= one.measures[measure] <= high]
        )

    def spaced(self, count: int) -> Family:
        """Return the family of the target and of other members that are evenly spaced by the measure of the curriculum.

        For each of `count - 1` evenly spaced values, from the least to the greatest, the nearest remaining member is
        chosen.

        Args:
            count: number of members with the target.

        Raises:
            InvalidArgument: `count` is not from 2 to the number of members.
        """
        if not 2 <= count <= len(self.members):
            raise InvalidArgument(
                f"`count` is {count}, but must be from 2 to {len(self.members)}, the number of members of family "
                f"`{self.name}`"
            )
        measure = order_measure(self.domain)
        values = np.array([one.measures[measure] for one in self.members[:-1]])
        chosen = list[int]()
        for wanted in np.linspace(values.min(), values.max(), count - 1):
            distance = np.abs(values - wanted)
            distance[chosen] = np.inf
            chosen.append(int(distance.argmin()))
        return self._family_of_places([*sorted(chosen), len(self.members) - 1])

    def split(
        self, test: float | int | Callable[[Member], bool] = 0.2, *, apart: int = 1, seed: int = 0
    ) -> tuple[Family, Family]:
        """Split the family into a training family and a test family, without common or too similar members.

        Args:
            test: the test members: a share or a number to sample, never the initial model, which is the target; or a
                function that returns True for test members.
            apart: the least number of objects in which a training member differs from each test member. Members that
                are too similar to a test member are in neither family.
            seed: seed of the sampling.

        Raises:
            InvalidArgument: no training member or no test member is left.
        """
        trained, tested = split_places(self.members, self._iterate_models(self.members), test, apart, seed)
        return self._family_of_places(trained), self._family_of_places(tested)

    def distances(self) -> NDArray[np.int64]:
        """Return the number of objects in which each pair of members differs [members, members].

        Objects are compared by id, class, values and links: the members of a run share the objects of the initial
        model. A link belongs to the object whose reference is declared first.
        """
        objects = number_objects(self._iterate_models(self.members))
        return count_differing_objects(objects, objects)

    def columns(self) -> dict[str, NDArray[Any]]:
        """Return the members as columns of a table: `name`, `initial`, and each measure and certificate.

        `pandas.DataFrame(family.columns())` and `polars.DataFrame(family.columns())` make data frames.
        """
        members = self.members
        certain = dict.fromkeys(name for one in members for name in one.certificates)
        known = [
            {name: np.nan if value is None else value for name, value in one.certificates.items()} for one in members
        ]
        return {
            "name": np.array([one.name for one in members]),
            "initial": np.array([one.initial for one in members]),
            **{name: np.array([one.measures[name] for one in members]) for name in members[0].measures},
            **{name: np.array([one.get(name, np.nan) for one in known]) for name in certain},
        }

    def _family_of_places(self, places: Sequence[int]) -> Family:
        if not places:
            raise InvalidArgument(f"no member of family `{self.name}` is selected")
        members = tuple(self.members[place] for place in places)
        return replace(self, members=members, _explored={}, _keys=self.keys)

    def __repr__(self) -> str:
        return f"<Family {self.name}: {len(self.members)} environments>"

    def _repr_html_(self) -> str:
        return family_html(self)

    def paying(self, name: str) -> Family:
        """Return the family whose environments pay only the rewards with one name of `envgraph.behaviour.reward_names`.

        Its transition tables contain this reward alone, and its members have no certificates. Episodes are the same.

        Raises:
            InvalidArgument: no reward has this name, or there is no environment.
        """
        members = tuple(replace(one, certificates={}) for one in self.members)
        found = replace(self, members=members, _explored={}, _keys=self.keys, _pays=name)
        assert found.behaviour, "or it raises"
        return found

    def differing_class_counts(self) -> dict[str, tuple[int, ...]]:
        """Return the number of objects of each class in every member.

        Classes are left out if the numbers are equal in all members, or if a measure has the same values.
        """
        classes = [cls.name for cls in self.domain.metamodel.class_list if not cls.abstract]
        found = [
            [len(model.graph.exact_extent(cls)) for cls in classes] for model in self._iterate_models(self.members)
        ]
        counts = dict(zip(classes, zip(*found, strict=True), strict=True))
        measured = [[member.measures[name] for member in self.members] for name in self.members[0].measures]
        return {cls: numbers for cls, numbers in counts.items() if len(set(numbers)) > 1 and [*numbers] not in measured}

    def diversity(self) -> float:
        """Return the diversity of the members, as the family file defines it."""
        problem = self.domain.problem(self.domain.engine())
        return problem.diversity.score([member.measures[problem.diversity_measure_name] for member in self.members])


def _birth(member: Member) -> int:
    """Return a sort key of members: models of consecutive individuals of a run differ by the fewest rule applications,
    so that this is the fastest order in which to visit them.
    """
    return member.individual or 0


def member_place(variant: int | str | None, places: Mapping[str, int], family: str) -> int:
    """Return the place of a member in a family, from 0, by its name or its number from 1; the last place for None.

    Args:
        variant: the name or number.
        places: the place of each member, by name.
        family: name of the family, for messages.

    Raises:
        InvalidArgument: the member does not exist.
    """
    if variant is None:
        return len(places) - 1
    text = str(variant)
    if text not in places and (number := parse_int(text)) is not None and 1 <= number <= len(places):
        return number - 1
    check_known(text, places, f"family `{family}` has no environment `{variant}`")
    return places[text]


def order_members(domain: Domain, member_data: Sequence[tuple[Any, ...]]) -> tuple[Member, ...]:
    """Return members in the order of the curriculum, from tuples of the values of `Member` after its name.

    The initial model is last, as the target, or last among equals if the family file says `order_members`. Equal values
    keep the given order. The members of a curriculum search also keep it, unless the file names a measure for the
    order.
    """
    curriculum = domain.spec.curriculum
    if domain.spec.searches_whole_families and curriculum.order is None:
        return tuple(Member(f"E{place}", *one) for place, one in enumerate(member_data, start=1))
    measure = order_measure(domain)
    last = curriculum.initial == "last"
    ranked = sorted(member_data, key=lambda one: (last and one[3], one[0][measure], one[3]))
    return tuple(Member(f"E{place}", *one) for place, one in enumerate(ranked, start=1))


def order_measure(domain: Domain) -> str:
    """Return the measure that orders the curriculum: the one named in the family file, else that of the diversity."""
    return str(domain.spec.curriculum.order or domain.spec.diversity.options["of"])


def find_run_store(location: str | Path, directory: Path = Path("runs")) -> Path:
    """Return the path of a run store. `location` is the file, its directory, or the name of a run below `directory`.

    Raises:
        InvalidArgument: the run does not exist.
    """
    path = Path(location)
    for candidate in (path, path / "run.sqlite", directory / path / "run.sqlite"):
        if candidate.is_file():
            return candidate
    known = sorted(file.parent.name for file in directory.glob("*/run.sqlite") if file.is_file())
    there_are = f"there are {', '.join(known)}" if known else "run `envgraph generate` to make one"
    hint = did_you_mean(str(location), known) or there_are
    if str(location) in bundled_domains() or any(path.glob("*.environment")):
        hint = f"it is a domain: use `envgraph.make(domain={str(location)!r})`, or `envgraph generate {location}`"
    raise InvalidArgument(f"there is no run `{location}` in {directory}", hint)


def load_stored_domain(
    bundle: Bundle, overrides: Sequence[str], file: str, components: Components | None = None
) -> Domain:
    """Return the domain of the texts in a run or family file. Errors get a note that the text is in `file`.

    Raises:
        LoadError: the texts have errors; it contains all of them.
    """
    try:
        return Domain.from_bundle(bundle, components, overrides)
    except LoadError as error:
        note = Note(f"the text is in {file}")
        raise LoadError([replace(one, notes=(*one.notes, note)) for one in error.diagnostics]) from error


def load_stored_family(store: RunStore, domain: Domain) -> Family:
    """Return the family of the last generation of a run, given the domain read from the run's texts.

    Raises:
        InvalidArgument: the run has no generation yet, or is damaged.
    """
    last = store.last_generation()
    if last is None:
        raise InvalidArgument(f"{store.path} has no generation yet: run `envgraph generate --resume`")
    imported, sampled = store.imported is not None, domain.spec.samples is not None
    individuals = {one.id: one for one in store.individuals()} if sampled else _with_ancestors(store, last.members)
    replay = ReplayedModels(domain, individuals, str(store.path))
    found, certificates = [], store.certificates
    for id_ in last.members:
        if id_ not in individuals:
            raise store.damage_error(f"individual {id_} is missing")
        individual = individuals[id_]
        lacking = missing_measures(domain, individual.measures)
        if lacking:
            raise store.damage_error(f"individual {id_} has no measure {list_names(lacking)}")
        derived = LazyModel(individual.state_hash, id_, replay)
        source: str | LazyModel = derived
        if individual.model is not None:
            model = model_from_json(individual.model, domain.metamodel, file=f"{store.path}: individual {id_}")
            if f"{model.state_hash():016x}" != individual.state_hash:
                raise store.damage_error(f"the model of individual {id_} does not have the stored hash")
            source = individual.model
        elif not sampled:
            source = derived.text()  # made now, so that errors are reported now
        is_initial = individual.parent is None and not imported
        found.append((individual.measures, source, id_, is_initial, certificates.get(id_, {})))
    members, (values, failing) = order_members(domain, found), _objective_values(store, domain)
    tables = TableCache.of_run(store.path)
    return Family(store.name, store.bundle(), members, domain, domain.overrides, values, failing, tables)


def _objective_values(store: RunStore, domain: Domain) -> tuple[dict[str, float], dict[str, float]]:
    """Return the stored values of the objective (with results of learning), and the violations of its conditions."""
    found, spec = store.objective, domain.spec.objective
    try:
        known = {spec.kind: found["value"]} if spec and "value" in found else found.get("values", {})
        return _checked_numbers(known) | _checked_numbers(found.get("learnt", {})), _checked_numbers(
            found.get("lacking", {})
        )
    except (EvaluationError, TypeError, ValueError) as error:
        raise store.damage_error("setting `objective` is not a table of numbers") from error


def _checked_numbers(found: Any) -> dict[str, float]:
    return {str(name): checked_number(value, f"`{name}`") for name, value in dict(found).items()}


def missing_measures(domain: Domain, measures: Mapping[str, float]) -> list[str]:
    """Return the names of the measures in the family file of which a member has no value."""
    return [one.name for one in domain.spec.measures if one.name not in measures]


def _with_ancestors(store: RunStore, members: Sequence[int]) -> dict[int, Individual]:
    """Return the given individuals by id, together with the ancestors of each individual whose model is not stored."""
    found: dict[int, Individual] = {}
    for id_ in members:
        individual = store.individual(id_)
        line = [individual] if individual.model is not None else store.lineage(id_)
        found |= {one.id: one for one in line}
    return found
