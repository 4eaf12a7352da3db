"""Lazily opened families, from which environments are made, and the engines that step their members."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import suppress
from functools import cached_property
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final, Literal, get_args

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
from envgraph.errors import EvaluationError, InvalidArgument
from envgraph.files import report_progress
from envgraph.graph import model_to_json
from envgraph.search._run_store import dump_json
from envgraph.search.domain._domain import Domain
from envgraph.search.families._family_file import family_cache, open_family
from envgraph.search.families._member_family import Family, Member, member_place
from envgraph.search.families._table_cache import FamilyRecord, TableCache

if TYPE_CHECKING:
    from envgraph.env.compiled import CompiledProgram

FamilyLocation = str | PathLike[str]

MEMBERS_TO_COMPILE: Final = 100
"""Number of members above which compiling a program is faster than visiting all their states."""

EngineKind = Literal["table", "compiled", "live"]
ENGINES: Final = get_args(EngineKind)


class LazyFamily:
    """A family that is read lazily: its texts are only read if a table, or the record of the family, is not cached.

    `read` reads the family, and `kept` returns the table cache and a hash of the family's data.
    """

    def __init__(self, read_family: Callable[[], Family], find_cache: Callable[[], tuple[TableCache, str]]) -> None:
        self._read = read_family
        self._kept = find_cache
        self._tables, self._key = find_cache()
        self._refused: NotCompiled | None = None

    @cached_property
    def family(self) -> Family:
        return self._read()

    @cached_property
    def record(self) -> FamilyRecord:
        found = self._tables.read_record(self._key)
        if found is None:
            found = self.family.record()
            if self._key == self._kept()[1]:  # no generation was added in the meantime
                self._tables.write_record(self._key, found)
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

        Without an `engine` tables are used, or a program for too many states or many members. If `needs_models`,
        observations need models, so that tables are used only if `engine` is "table".

        Raises:
            TooManyStates, EvaluationError: there is no table, or no compiled program, which `engine` demands.
        """
        if engine == "live":
            return None
        many = engine is None and len(places) > MEMBERS_TO_COMPILE and has_numba() and not needs_pictures
        if many:
            with suppress(NotCompiled):
                return self.compiled_program(places)
        if engine == "table" or (engine is None and not needs_models):
            try:
                shown = [f"environments: {number} of {len(places)}" for number in range(len(places))]
                return [
                    self.transition_table(
                        place, pictures=needs_pictures, progress_text=remark if len(places) > 1 else ""
                    )
                    for place, remark in zip(places, shown, strict=True)
                ]
            except TooManyStates:
                if engine == "table":
                    raise
        try:
            return self.compiled_program(places)
        except NotCompiled as refused:
            self._refused = refused
            if engine == "compiled":
                raise self.not_compiled_error() from None
            return None

    def compiled_program(self, places: Sequence[int]) -> CompiledProgram:
        """Return the compiled program for the members at `places`. Raise `NotCompiled` if that is impossible."""
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
        message = f"environment `{self.family.behaviour.name}` cannot be compiled: {self._refused}"
        hint = 'use `engine="live"`, or `engine="table"` if there are few states'
        return EvaluationError(message, self._refused.span, hint)

    def transition_table(self, place: int, *, pictures: bool, progress_text: str) -> ExploredEnvironment:
        name = self._names[place]
        table = self.record.tables[name] or self.family.table_file_name(self.family.members[place])
        found = self._tables.read_table(table, needs_pictures=pictures and self.record.drawn)
        if found is not None:
            return found
        with report_progress() as tell:
            tell(progress_text and f"{progress_text}, {name}")
            return self.family.explored(self.family.members[place], pictures=pictures)


@dataclass(frozen=True, eq=False)
class LazyMembers:
    """The members between which one environment can be switched. Each table or program is read once. See `Members`."""

    domain: str | None
    family: FamilyLocation | Family
    engine: EngineKind
    needs_pictures: bool
    reward_name: str | None = None

    @cached_property
    def _entered_members(self) -> dict[int, Any]:
        return {}

    @cached_property
    def _lazy_family(self) -> LazyFamily:
        opened = open_lazy_family(self.domain, self.family)
        return opened if self.reward_name is None else opened.paying(self.reward_name)

    def place(self, variant: int | str) -> int:
        return self._lazy_family.member_place(variant)

    def about(self, place: int) -> MemberFacts:
        return self._lazy_family.member_infos(place)

    def entered(self, place: int) -> Any:
        if place not in self._entered_members:
            found = self._lazy_family.tables_or_program([place], self.engine, needs_pictures=self.needs_pictures)
            if found is None:
                return self._lazy_family.make_simulator(
                    place
                )  # not cached: a simulator has a state and belongs to a single environment
            self._entered_members[place] = found[0] if isinstance(found, list) else found
        return self._entered_members[place]

    def __deepcopy__(self, _: object) -> LazyMembers:
        return self


def open_lazy_family(
    domain: str | None, family: FamilyLocation | Family | None, variants: Sequence[int | str] = ()
) -> LazyFamily:
    """Return a lazily opened family. For a domain without a family, its only member is the domain's own model.

    Raise `InvalidArgument` if neither is given, if `variants` are given without a family, or if both do not fit.
    """
    if isinstance(family, Family):
        return LazyFamily(lambda: family, lambda: (TableCache(()), ""))
    if family is not None:
        path = Path(family)
        opened = LazyFamily(lambda: open_family(path), lambda: family_cache(path))
        if domain is not None:
            _check_same_environment(opened.family, str(family), domain_family(domain), domain)
        return opened
    if variants:
        raise InvalidArgument("`variant` is given without `family`: give the family that contains this member")
    if domain is None:
        raise InvalidArgument("neither `family` nor `domain` is given: give one of them")
    return LazyFamily(lambda: domain_family(domain), lambda: (TableCache(()), ""))


def domain_family(domain: str) -> Family:
    loaded = Domain.load(domain)
    if loaded.behaviour is None:
        raise InvalidArgument(
            f"`{domain}` has no environment", 'write `environment = "name.environment"` in its family file'
        )
    model = dump_json(model_to_json(loaded.initial()))
    return Family(loaded.spec.name, loaded.workspace.bundle(), (Member("E1", {}, model, initial=True),), loaded)


def _check_same_environment(opened: Family, family: str, own: Family, domain: str) -> None:
    if (opened.behaviour, opened.limit) != (own.behaviour, own.limit):
        raise InvalidArgument(
            f"family `{opened.name}` does not belong to domain `{domain}`; use `envgraph.make({family!r})`"
        )
