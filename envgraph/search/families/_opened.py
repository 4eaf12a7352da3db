"""Lazily opened families, from which environments are made, and the engines that step their members."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import suppress
from functools import cached_property
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final, Literal, get_args

from envgraph.code import dataclass
from envgraph.env import About, Explored, ModelView, ObservationKind, Simulator, TooManyStates, model_view
from envgraph.env.compiled import NotCompiled, has_numba
from envgraph.errors import EvaluationError, InvalidArgument
from envgraph.files import telling
from envgraph.graph import model_to_json
from envgraph.search._store import dump_json
from envgraph.search.domain._domain import Domain
from envgraph.search.families._family import Family, Member, place_of
from envgraph.search.families._file import kept, open_family
from envgraph.search.families._tables import Record, Tables

if TYPE_CHECKING:
    from envgraph.env.compiled import Program

Location = str | PathLike[str]

MANY: Final = 100
"""Number of members above which compiling a program is faster than visiting all their states."""

EngineKind = Literal["table", "compiled", "live"]
ENGINES: Final = get_args(EngineKind)


class Opened:
    """A family that is read lazily: its texts are only read if a table, or the record of the family, is not cached.

    `read` reads the family, and `kept` returns the table cache and a hash of the family's data.
    """

    def __init__(self, read: Callable[[], Family], kept: Callable[[], tuple[Tables, str]]) -> None:
        self._read = read
        self._kept = kept
        self._tables, self._key = kept()
        self._refused: NotCompiled | None = None

    @cached_property
    def family(self) -> Family:
        return self._read()

    @cached_property
    def record(self) -> Record:
        found = self._tables.record(self._key)
        if found is None:
            found = self.family.record()
            if self._key == self._kept()[1]:  # no generation was added in the meantime
                self._tables.keep(self._key, found)
        return found

    def paying(self, name: str) -> Opened:
        """Return the family with the rewards of one name alone; see `Family.paying`."""
        return Opened(lambda: self.family.paying(name), lambda: (Tables(()), ""))

    def place(self, variant: int | str | None) -> int:
        return place_of(variant, [*self.record.tables], self.record.family)

    def stepping(
        self, places: Sequence[int], engine: EngineKind | None, *, pictures: bool, of_model: bool = False
    ) -> list[Explored] | Program | None:
        """Return the tables or the program that step the members; None if the live engine has to step them.

        Without an `engine` tables are used, or a program for too many states or many members. If `of_model`,
        observations need models, so that tables are used only if `engine` is "table".

        Raises:
            TooManyStates, EvaluationError: there is no table, or no compiled program, which `engine` demands.
        """
        if engine == "live":
            return None
        many = engine is None and len(places) > MANY and has_numba() and not pictures
        if many:
            with suppress(NotCompiled):
                return self.program(places)
        if engine == "table" or (engine is None and not of_model):
            try:
                shown = [f"environments: {number} of {len(places)}" for number in range(len(places))]
                return [
                    self.explored(place, pictures=pictures, remark=remark if len(places) > 1 else "")
                    for place, remark in zip(places, shown, strict=True)
                ]
            except TooManyStates:
                if engine == "table":
                    raise
        try:
            return self.program(places)
        except NotCompiled as refused:
            self._refused = refused
            if engine == "compiled":
                raise self.refused() from None
            return None

    def program(self, places: Sequence[int]) -> Program:
        """Return the compiled program for the members at `places`. Raise `NotCompiled` if that is impossible."""
        return self.family.program([self.family.members[place] for place in places])

    def simulator(self, place: int) -> Simulator:
        """Return a simulator of a member on a new live engine."""
        read = self.family
        engine = read.domain.engine(read.model(read.members[place]))
        return Simulator(engine, read.behaviour, read.keys)

    def view(self, kind: ObservationKind) -> ModelView:
        """Return the view that turns models of the family into observations."""
        read = self.family
        return model_view(kind, read.behaviour, [read.model(member) for member in read.members])

    def about(self, place: int) -> About:
        """Return the infos about a member: its name and certificates."""
        name = [*self.record.tables][place]
        return {"variant": name, "certificates": dict(self.record.certificates[name])}

    def refused(self) -> EvaluationError:
        """Return the error that the behaviour cannot be compiled, for use after `stepping` has failed to compile it."""
        assert self._refused is not None
        message = (
            f"environment `{self.family.behaviour.name}` cannot be compiled: it has {self._refused.construct}"
        )
        hint = 'use `engine="live"`, or `engine="table"` if there are few states'
        return EvaluationError(message, self._refused.span, hint)

    def explored(self, place: int, *, pictures: bool, remark: str) -> Explored:
        name, table = [*self.record.tables.items()][place]
        table = table or self.family.table_name(self.family.members[place])
        found = self._tables.read(table, drawn=pictures and self.record.drawn)
        if found is not None:
            return found
        with telling() as tell:
            tell(remark and f"{remark}, {name}")
            return self.family.explored(self.family.members[place], pictures=pictures)


@dataclass(frozen=True, eq=False)
class OpenedMembers:
    """The members between which one environment can be switched. Each table or program is read once. See `Members`."""

    domain: str | None
    family: Location | Family
    engine: EngineKind
    pictures: bool
    pays: str | None = None

    @cached_property
    def _entered(self) -> dict[int, Any]:
        return {}

    @cached_property
    def _opened(self) -> Opened:
        opened = open_member_family(self.domain, self.family)
        return opened if self.pays is None else opened.paying(self.pays)

    def place(self, variant: int | str) -> int:
        return self._opened.place(variant)

    def about(self, place: int) -> About:
        return self._opened.about(place)

    def entered(self, place: int) -> Any:
        if place not in self._entered:
            found = self._opened.stepping([place], self.engine, pictures=self.pictures)
            if found is None:
                return self._opened.simulator(
                    place
                )  # not cached: a simulator has a state and belongs to a single environment
            self._entered[place] = found[0] if isinstance(found, list) else found
        return self._entered[place]

    def __deepcopy__(self, _: object) -> OpenedMembers:
        return self


def open_member_family(
    domain: str | None, family: Location | Family | None, variants: Sequence[int | str] = ()
) -> Opened:
    """Return a lazily opened family. For a domain without a family, its only member is the domain's own model.

    Raise `InvalidArgument` if neither is given, if `variants` are given without a family, or if both do not fit.
    """
    if isinstance(family, Family):
        return Opened(lambda: family, lambda: (Tables(()), ""))
    if family is not None:
        path = Path(family)
        opened = Opened(lambda: open_family(path), lambda: kept(path))
        if domain is not None:
            _check_same(opened.family, str(family), of_model(domain), domain)
        return opened
    if variants:
        raise InvalidArgument(
            "`variant` is given without `family`: give the family that contains this member"
        )
    if domain is None:
        raise InvalidArgument("neither `family` nor `domain` is given: give one of them")
    return Opened(lambda: of_model(domain), lambda: (Tables(()), ""))


def of_model(domain: str) -> Family:
    loaded = Domain.load(domain)
    if loaded.behaviour is None:
        raise InvalidArgument(
            f"`{domain}` has no environment", 'write `environment = "name.environment"` in its family file'
        )
    model = dump_json(model_to_json(loaded.initial()))
    return Family(
        loaded.spec.name, loaded.workspace.bundle(), (Member("E1", {}, model, initial=True),), loaded
    )


def _check_same(opened: Family, family: str, own: Family, domain: str) -> None:
    if (opened.behaviour, opened.limit) != (own.behaviour, own.limit):
        raise InvalidArgument(
            f"family `{opened.name}` does not belong to domain `{domain}`; use `envgraph.make({family!r})`"
        )
