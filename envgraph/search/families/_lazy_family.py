"""Lazily opened families, from which environments are made, and the engines that step their members."""

from __future__ import annotations

import os
from collections import OrderedDict
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import asdict
from functools import cached_property, lru_cache
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final, Literal, get_args
from warnings import warn

from envgraph.code import dataclass
from envgraph.env import (
    ExploredEnvironment,
    MemberFacts,
    ModelView,
    ObservationKind,
    Simulator,
    TooManyStates,
    model_view,
)
from envgraph.env.compiled import NotCompiled, has_numba
from envgraph.errors import LIMITS, EvaluationError, InvalidArgument, LoadError
from envgraph.files import report_progress
from envgraph.graph import model_to_json
from envgraph.lang import DiskFiles, find_family, read_source
from envgraph.search._run_store import dump_json
from envgraph.search.domain._domain import Domain
from envgraph.search.families._family_file import family_cache, open_family
from envgraph.search.families._member_family import MANY_MEMBERS, Family, Member, member_place
from envgraph.search.families._table_cache import FamilyRecord, TableCache

if TYPE_CHECKING:
    from envgraph.env.compiled import CompiledProgram

FamilyLocation = str | PathLike[str]
DomainLocation = str | Sequence[str]  # a sequence: the files of a model and of an environment

SHARED_FAMILIES, SHARED_PROGRAMS, SHARED_MEMBERS = 8, 16, 16
"""Numbers of families and of programs that later calls of `make` find in memory; and of the members of a program."""

OUTCOMES_FOR_A_TABLE: Final = 50_000
"""Number of outcomes that the live engine visits for tables without `engine="table"`, in 2 to 7 s."""

EngineKind = Literal["table", "compiled", "live"]
ENGINES: Final = get_args(EngineKind)


class LazyFamily:
    """A family that is read lazily: its texts are only read if a table, or the record of the family, is not cached.

    `read_family` reads the family. `find_cache` returns the table cache, and a hash of the family's data by which its
    record is cached; with the hash "" the record is not cached.
    """

    is_shared = False  # True if later calls of `make` get the same object while the files do not change

    def __init__(self, read_family: Callable[[], Family], find_cache: Callable[[], tuple[TableCache, str]]) -> None:
        self._read = read_family
        self._kept = find_cache
        self._tables, self._key = find_cache()
        self._refused: NotCompiled | None = None
        self._too_large = ""

    @cached_property
    def family(self) -> Family:
        return self._read()

    def is_current(self) -> bool:
        """Return True if the family's files, and the directory of its tables, are the same as when it was opened."""
        with suppress(LoadError):
            texts = {} if self._key else self.family.domain.workspace.sources
            known = all(read_source(DiskFiles(), name).text == text for name, text in texts.items())
            return known and self._kept() == (self._tables, self._key)
        return False

    @cached_property
    def record(self) -> FamilyRecord:
        found = self._tables.read_record(self._key)
        if found is None:
            found = self.family.record()
            if self._key and self._key == self._kept()[1]:  # no generation was added in the meantime
                self._tables.write_json(f"{self._key}.record", asdict(found))
        return found

    def paying(self, name: str) -> LazyFamily:
        """Return the family with the rewards of one name alone; see `Family.paying`."""
        return LazyFamily(lambda: self.family.paying(name), lambda: (TableCache(()), ""))

    def member_place(self, variant: int | str | None) -> int:
        return member_place(variant, self._places, self.record.family)

    @cached_property
    def _names(self) -> list[str]:
        return [*self.record.tables]

    @cached_property
    def _places(self) -> dict[str, int]:
        return {name: place for place, name in enumerate(self._names)}

    def tables_or_program(
        self,
        places: Sequence[int],
        engine: EngineKind | None,
        *,
        needs_pictures: bool,
        needs_models: bool = False,
    ) -> list[ExploredEnvironment] | CompiledProgram | None:
        """Return the tables or the program that step the members; None if the live engine has to step them.

        Without an `engine` tables are used, or a program for many members, for too many states, or if the live engine
        would have to visit too many outcomes. If `needs_models`, observations need models, so that tables are used only
        if `engine` is "table".

        Raises:
            TooManyStates, EvaluationError: there is no table, or no compiled program, which `engine` demands.
        """
        if engine == "live":
            return None
        many = engine is None and len(places) > MANY_MEMBERS and has_numba() and not needs_pictures
        if many:
            with suppress(NotCompiled):
                return self.compiled_program(places)
        self._too_large = ""
        if engine == "table" or (engine is None and not needs_models):
            outcomes = LIMITS["all outcomes"] if engine else OUTCOMES_FOR_A_TABLE // len(places)
            try:
                of_all = f" of {len(places)}" if len(places) > 1 else ""
                return [
                    self.transition_table(place, needs_pictures, outcomes, of_all and f"environments: {number}{of_all}")
                    for number, place in enumerate(places)
                ]
            except TooManyStates as error:
                if engine == "table":
                    raise
                self._too_large = f"{error.message}; "
        try:
            program = self.compiled_program(places)
        except NotCompiled as refused:
            self._refused = refused
            if engine == "compiled":
                raise self.not_compiled_error() from None
            return None
        if self._too_large and not program.native:
            hint = 'numba makes it fast (pip install "envgraph[fast]")'
            warn(f"{self._too_large}a program that Python runs is used instead of a table; {hint}", stacklevel=3)
        return program

    def compiled_program(self, places: Sequence[int]) -> CompiledProgram:
        """Return the compiled program for the members at `places`. Raise `NotCompiled` if that is impossible."""
        if self.is_shared and len(places) <= SHARED_MEMBERS:
            return _shared_program(self, tuple(places), has_numba())
        return self.family.program([self.family.members[place] for place in places])

    def make_simulator(self, place: int) -> Simulator:
        """Return a simulator of a member on a new live engine."""
        read = self.family
        engine = read.domain.engine(read.model(read.members[place]))
        return Simulator(engine, read.behaviour, read.keys)

    def make_model_view(self, kind: ObservationKind) -> ModelView:
        """Return the view that turns models of the family into observations."""
        read = self.family
        return model_view(kind, read.behaviour, [read.model(member) for member in read.members])

    def member_infos(self, place: int) -> MemberFacts:
        """Return the infos about a member: its name and certificates."""
        name = self._names[place]
        return {"variant": name, "certificates": dict(self.record.certificates[name])}

    def not_compiled_error(self) -> EvaluationError:
        """Return the error that the behaviour cannot be compiled, for use after `tables_or_program` has failed to
        compile it.
        """
        assert self._refused is not None
        message = f"{self._too_large}environment `{self.family.behaviour.name}` cannot be compiled: {self._refused}"
        hint = 'use `engine="live"`, or `engine="table"` if there are few states'
        return EvaluationError(message, self._refused.span, hint)

    def transition_table(self, place: int, pictures: bool, outcomes: int, progress_text: str) -> ExploredEnvironment:
        name = self._names[place]
        table = self.record.tables[name] or self.family.table_file_name(self.family.members[place])
        found = self._tables.read_table(table, needs_pictures=pictures and self.record.drawn)
        if found is not None:
            return found
        with report_progress() as tell:
            tell(progress_text and f"{progress_text}, {name}")
            family = self.family.subset([name]) if self.is_shared else self.family  # a subset keeps no table
            return family.explored(family.member(name), pictures=pictures, outcomes=outcomes)


@lru_cache(maxsize=SHARED_PROGRAMS)
def _shared_program(opened: LazyFamily, places: tuple[int, ...], _native: bool) -> CompiledProgram:
    """Return the program of a family that is shared, once for all environments of these members."""
    return opened.family.program([opened.family.members[place] for place in places])


@dataclass(frozen=True, eq=False)
class LazyMembers:
    """The members between which one environment can be switched. Each table or program is read once. See `Members`."""

    family: FamilyLocation | Family
    engine: EngineKind
    needs_pictures: bool
    reward_name: str | None = None

    @cached_property
    def _entered_members(self) -> dict[int, Any]:
        return {}

    @cached_property
    def _lazy_family(self) -> LazyFamily:
        opened = open_lazy_family(family=self.family)
        return opened if self.reward_name is None else opened.paying(self.reward_name)

    def place(self, variant: int | str) -> int:
        return self._lazy_family.member_place(variant)

    def about(self, place: int) -> MemberFacts:
        return self._lazy_family.member_infos(place)

    def entered(self, place: int) -> Any:
        if place not in self._entered_members:
            found = self._lazy_family.tables_or_program([place], self.engine, needs_pictures=self.needs_pictures)
            if found is None:
                # Not cached: a simulator has a state and belongs to a single environment.
                return self._lazy_family.make_simulator(place)
            self._entered_members[place] = found[0] if isinstance(found, list) else found
        return self._entered_members[place]

    def __deepcopy__(self, _: object) -> LazyMembers:
        return self


def open_lazy_family(
    domain: DomainLocation | None = None,
    family: FamilyLocation | Family | None = None,
    variants: Sequence[int | str] = (),
) -> LazyFamily:
    """Return a lazily opened family. For a domain without a family, its only member is the domain's own model.

    Raise `InvalidArgument` if neither is given, if `variants` are given without a family, or if both do not fit.
    """
    if isinstance(family, Family):
        return LazyFamily(lambda: family, lambda: (TableCache(()), ""))
    if family is not None:
        path = Path(family)
        opened = _open_shared(str(path), lambda: open_family(path), lambda: family_cache(path))
        if domain is not None:
            mine, own = opened.family, open_lazy_family(domain).family
            if (mine.behaviour, mine.limit) != (own.behaviour, own.limit):
                message = f"family `{mine.name}` does not belong to domain `{domain}`"
                raise InvalidArgument(f"{message}; use `envgraph.make({str(family)!r})`")
        return opened
    if variants:
        raise InvalidArgument("`variant` is given without `family`: give the family that contains this member")
    if domain is None:
        raise InvalidArgument("neither `family` nor `domain` is given: give one of them")
    files = _domain_files(domain)
    return _open_shared("\0".join(files), lambda: _domain_family(*files), lambda: (TableCache.of_user(), ""))


_shared_families: Final[OrderedDict[tuple[str, str], LazyFamily]] = OrderedDict()  # by working directory and name


def _open_shared(
    name: str, read_family: Callable[[], Family], find_cache: Callable[[], tuple[TableCache, str]]
) -> LazyFamily:
    """Return a lazily opened family, the same as before if its files have not changed."""
    place = os.getcwd(), name
    opened = _shared_families.pop(place, None)
    if opened is None or not opened.is_current():
        opened = LazyFamily(read_family, find_cache)
        opened.is_shared = True
    _shared_families[place] = opened
    if len(_shared_families) > SHARED_FAMILIES:
        _shared_families.popitem(last=False)
    return opened


def _domain_files(domain: DomainLocation) -> tuple[str, ...]:
    """Return the family file of a domain, or the only model and environment of a directory without a family file."""
    if not isinstance(domain, str):
        return tuple(domain)
    try:
        return (find_family(domain),)
    except LoadError as error:
        files = DiskFiles().entries(domain)
        models, environments = ([one for one in files if one.endswith(end)] for end in (".model", ".environment"))
        if error.diagnostics[0].code != "missing-file" or not environments:
            raise
        if len(models) == len(environments) == 1:
            return (*models, *environments)
        message = f"`{domain}` has no family file, but {len(models)} models and {len(environments)} environments"
        raise InvalidArgument(message, "name one of each: `model=..` and `environment=..`") from None


def _domain_family(*files: str) -> Family:
    loaded = Domain.load(*files) if len(files) == 1 else Domain.of_environment(*files)
    if loaded.behaviour is None:
        raise InvalidArgument(
            f"`{files[0]}` has no environment", 'write `environment = "name.environment"` in this family file'
        )
    model = dump_json(model_to_json(loaded.initial()))
    return Family(loaded.spec.name, loaded.workspace.bundle(), (Member("E1", {}, model, initial=True),), loaded)
