"""Members of families as Gymnasium environments: `envgraph.make`, and what `gymnasium.make` calls."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import cached_property
from os import PathLike
from pathlib import Path
from typing import Any, Literal

from envgraph.env import (
    EnvgraphEnv,
    EnvgraphLiveEnv,
    EnvgraphVectorEnv,
    Environment,
    EnvSpec,
    Explored,
    Simulator,
    VectorEnvironment,
    check_render_mode,
    environment_spec,
    make_vec_spec,
)
from envgraph.errors import InvalidArgument
from envgraph.graph import model_to_json
from envgraph.search._domain import Domain
from envgraph.search._family import Family, Member, place_of, run_file
from envgraph.search._family_file import kept, open_family
from envgraph.search._store import dump_json
from envgraph.search._tables import Record, Tables

Location = str | PathLike[str]


def make(
    family: Location | None = None,
    variant: int | str | None = None,
    *,
    domain: Location | None = None,
    **options: Any,
) -> Environment:
    """The Gymnasium environment of one member of a family, with the time limit of the family.

    Like `gymnasium.make`, without a name that would have to be registered: `env.spec` makes the environment again.

    Args:
        family: a family file (`envgraph export`), a run, its name below `runs`, or its run store.
        variant: name of a member ("E6") or its number from 1; the target, which is the last one, by default.
        domain: instead of a family: a family.toml, its directory, or the name of a bundled domain, whose own model is
            the environment.
        options: of `gymnasium.make` (`max_episode_steps`, `disable_env_checker`) and of `make_environment`
            (`render_mode`, `observation`, `live`, `cell`).

    Raises:
        InvalidArgument: no such family or member, or both a family and a domain are given, or neither.
        LoadError: the files have errors.
        EvaluationError: too many states to visit; `live=True` steps without visiting them.

    >>> make(domain="keydoor").spec.max_episode_steps
    100
    """
    return _spec(family, domain).make(**_given(variant=variant), **options)


def make_vec(
    family: Location | None = None,
    num_envs: int = 1,
    variant: int | str | Sequence[int | str] | None = None,
    *,
    domain: Location | None = None,
    **options: Any,
) -> VectorEnvironment:
    """Many environments at once, stepped by array indexing; like `gymnasium.make_vec`, and the arguments of `make`.

    Args:
        family, domain: as for `make`.
        num_envs: how many.
        variant: as for `make`, or a list, whose members take turns: `num_envs=60, variant=["E1", "E2"]` gives thirty
            of each.
        options: of `gymnasium.make_vec`, of `make_vector_environment`, and `live`. `vectorization_mode` "sync" or
            "async" steps single environments instead, as `live=True` does; `autoreset_mode` is for all of them.
    """
    return make_vec_spec(_spec(family, domain), num_envs, **_given(variant=variant), **options)


def _spec(family: Location | None, domain: Location | None) -> EnvSpec:
    """What Gymnasium has to know; places are absolute, so that other processes make the same."""
    if family is not None and domain is not None:
        raise InvalidArgument("give a `family` or a `domain`, not both")
    place = None if domain is None else str(domain)
    if family is not None:
        path = Path(family)
        family = str((path if path.suffix == ".json" else run_file(path)).resolve())
    opened = _opened(place, family)
    record = opened.record
    return environment_spec(record.behaviour, limit=record.limit, **_given(domain=place, family=family))


def _given(**values: object) -> dict[str, Any]:
    return {name: value for name, value in values.items() if value is not None}


def make_environment(
    domain: str | None = None,
    family: Location | None = None,
    variant: int | str | None = None,
    *,
    render_mode: str | None = None,
    observation: Literal["index", "multi"] = "index",
    cell: int = 32,
    live: bool = False,
) -> EnvgraphEnv | EnvgraphLiveEnv:
    """What `gymnasium.make` calls: one member of a family, without a time limit.

    Args:
        domain: where the behaviour and the initial model come from when there is no family: a family file, its
            directory, or the name of a bundled domain.
        family: a family file (`envgraph export`), a run, or its run store.
        variant: name of a member ("E6") or its number from 1; the target, which is the last one, by default.
        render_mode: None, "ansi" or "rgb_array".
        observation: "index" for one number, "multi" for its components.
        cell: side of a cell in pixels.
        live: whether to step on an engine. By default the table of all states is used, which makes steps faster, but
            there must not be too many of them. Episodes are the same.

    Raises:
        InvalidArgument: no such family or member, or neither a domain nor a family is given, or the family is of
            another environment than the domain.
        LoadError: the files have errors.
        EvaluationError: too many states to visit.
    """
    opened = _opened(domain, family, () if variant is None else (variant,))
    check_render_mode(render_mode, drawn=opened.record.drawn)  # before all states are visited
    place = opened.place(variant)
    shown: dict[str, Any] = {"render_mode": render_mode, "observation": observation, "cell": cell}
    environment: EnvgraphEnv | EnvgraphLiveEnv
    if live:
        read = opened.family
        engine = read.domain.engine(read.model(read.members[place]))
        environment = EnvgraphLiveEnv(Simulator(engine, read.behaviour, read.keys), **shown)
    else:
        found = opened.explored(place, pictures=render_mode is not None)
        environment = EnvgraphEnv(found.tabular, pictures=found.pictures, **shown)
    if not opened.record.drawn:
        environment.metadata = {**environment.metadata, "render_modes": []}
    return environment


def make_vector_environment(
    num_envs: int = 1,
    domain: str | None = None,
    family: Location | None = None,
    variant: int | str | Sequence[int | str] | None = None,
    *,
    render_mode: str | None = None,
    observation: Literal["index", "multi"] = "index",
    max_episode_steps: int | None = None,
    autoreset_mode: str | None = None,
) -> EnvgraphVectorEnv:
    """What `gymnasium.make_vec` calls: `num_envs` environments, stepped by array indexing.

    The arguments are those of `make_environment`, but `variant` may be a list: its members take turns, so that
    `num_envs=60, variant=["E1", "E2"]` gives thirty of each. The others are those of `EnvgraphVectorEnv`.
    """
    variants = () if variant is None else (variant,) if isinstance(variant, int | str) else tuple(variant)
    opened = _opened(domain, family, variants)
    check_render_mode(render_mode, ("rgb_array",), drawn=opened.record.drawn)
    places = [opened.place(one) for one in variants or (None,)]
    found = [opened.explored(place, pictures=render_mode is not None) for place in places]
    return EnvgraphVectorEnv(
        [one.tabular for one in found],
        num_envs,
        pictures=[one.pictures for one in found],
        render_mode=render_mode,
        observation=observation,
        max_episode_steps=max_episode_steps,
        **_given(autoreset_mode=autoreset_mode),
    )


class _Opened:
    """A family whose texts are read as soon as a table, or the record of what else it takes, is not kept."""

    def __init__(self, read: Callable[[], Family], kept: Callable[[], tuple[Tables, str]]) -> None:
        self._read = read
        self._kept = kept
        self._tables, self._key = kept()

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

    def place(self, variant: int | str | None) -> int:
        return place_of(variant, [*self.record.tables], self.record.family)

    def explored(self, place: int, *, pictures: bool) -> Explored:
        table = [*self.record.tables.values()][place]
        found = self._tables.read(table, drawn=pictures and self.record.drawn)
        return found or self.family.explored(self.family.members[place], pictures=pictures)


def _opened(domain: str | None, family: Location | None, variants: Sequence[int | str] = ()) -> _Opened:
    """A family; for a domain without one, that of its own model alone."""
    if family is not None:
        path = Path(family)
        opened = _Opened(lambda: open_family(path), lambda: kept(path))
        if domain is not None:
            _check_same(opened.family, str(family), _of_model(domain), domain)
        return opened
    if variants:
        raise InvalidArgument("`variant` names a member of a family: give `family` as well")
    if domain is None:
        raise InvalidArgument("give a `family`, or a `domain`")
    return _Opened(lambda: _of_model(domain), lambda: (Tables(()), ""))


def _of_model(domain: str) -> Family:
    loaded = Domain.load(domain)
    if loaded.behaviour is None:
        raise InvalidArgument(f"`{domain}` has no environment: its family file names none")
    model = dump_json(model_to_json(loaded.initial()))
    return Family(
        loaded.spec.name, loaded.workspace.bundle(), (Member("E1", {}, model, initial=True),), loaded
    )


def _check_same(opened: Family, family: str, own: Family, domain: str) -> None:
    if (opened.behaviour, opened.limit) != (own.behaviour, own.limit):
        raise InvalidArgument(
            f"family `{opened.name}` is not of the environment of `{domain}`; `envgraph.make({family!r})` makes it"
        )
