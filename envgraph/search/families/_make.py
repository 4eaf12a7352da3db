"""Members of families as Gymnasium environments: `envgraph.make`, and the entry points of `gymnasium.make`."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from inspect import signature
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final
from warnings import warn

from envgraph.behaviour import reward_names
from envgraph.env import (
    MODEL_KINDS,
    EnvgraphEnv,
    EnvgraphLiveEnv,
    EnvgraphVectorEnv,
    Environment,
    EnvSpec,
    FrameStackObservation,
    ObservationKind,
    SeparateRewards,
    SingleEnvironment,
    TooManyStates,
    VectorEnvironment,
    VectorVariants,
    check_observation_kind,
    check_render_mode,
    environment_spec,
    make_vec_spec,
    register as register_name,
)
from envgraph.env.registration import MAKE_VECTOR_ENVIRONMENT
from envgraph.env.schedules import Schedule, named_schedule
from envgraph.errors import InvalidArgument, check_known
from envgraph.search.families._lazy_family import (
    ENGINES,
    DomainLocation,
    EngineKind,
    FamilyLocation,
    LazyFamily,
    LazyMembers,
    open_lazy_family,
)
from envgraph.search.families._member_family import Family, Member, find_run_store

if TYPE_CHECKING:
    from envgraph.env.compiled import CompiledEnv, CompiledVectorEnv, StreamMode

GYMNASIUM_OPTIONS: Final = (
    "max_episode_steps", "disable_env_checker", "vectorization_mode", "vector_kwargs", "wrappers"
)  # fmt: skip
"""Options of `gymnasium.make` and `gymnasium.make_vec`."""


def make(
    family: FamilyLocation | None = None,
    variant: int | str | None = None,
    *,
    domain: FamilyLocation | None = None,
    model: FamilyLocation | None = None,
    environment: FamilyLocation | None = None,
    **options: Any,
) -> Environment:
    """Return the Gymnasium environment of a member of a family, with the time limit of the family.

    It works like `gymnasium.make` without a registered name: `env.spec` makes the environment again.

    Args:
        family: a family file (`envgraph export`), a run, its name below `runs`, or its run store.
        variant: name of a member ("E6") or its number from 1; by default the target, which is the last member.
        domain: in place of a family, a family.toml, its directory, or the name of a bundled domain. The environment is
            then that of the domain's own model. A directory with one model and one environment needs no family.toml.
        model, environment: in place of a family, the files of a model and of an environment.
        options: of `gymnasium.make` (`max_episode_steps`, `disable_env_checker`) and of `make_environment`
            (`render_mode`, `observation`, `engine`, `cell`).

    Raises:
        InvalidArgument: the family or member does not exist, or not exactly one of family and domain is given.
        LoadError: the files have errors.
        EvaluationError: there are too many states for `engine="table"`, or the behaviour cannot be compiled for
            `engine="compiled"`.

    >>> make(domain="keydoor").spec.max_episode_steps
    100
    """
    _check_options(options, make_environment)
    return _environment_spec(family, domain, model, environment).make(**_without_none(variant=variant), **options)


def make_vec(
    family: FamilyLocation | Family | None = None,
    num_envs: int = 1,
    variant: int | str | Sequence[int | str] | None = None,
    *,
    domain: FamilyLocation | None = None,
    model: FamilyLocation | None = None,
    environment: FamilyLocation | None = None,
    schedule: Schedule | str | None = None,
    **options: Any,
) -> VectorEnvironment:
    """Return a vector environment, like `gymnasium.make_vec`, with the arguments of `make`.

    Args:
        family, domain, model, environment: as for `make`. A `Family`, such as a part of another one, has no `spec`.
        num_envs: number of environments.
        variant: as for `make`, or a list whose members are repeated in order: `num_envs=60, variant=["E1", "E2"]` makes
            thirty of each.
        schedule: chooses the member of each episode from `variant`, or from all members without it. It is a schedule of
            `envgraph.env.schedules`, or a name in its `SCHEDULES`.
        options: of `gymnasium.make_vec` and of `make_vector_environment`. `vectorization_mode` "sync" or "async" steps
            single environments instead, as `engine="live"` does; `autoreset_mode` works with all of them.
    """
    _check_options(options, make_environment, make_vector_environment)
    given = _without_none(variant=variant, schedule=schedule)
    if isinstance(family, Family) and not (domain or model or environment):
        for name in sorted({*options} - {*signature(make_vector_environment).parameters}):
            raise InvalidArgument(f"`{name}` needs a family in a file", "use `write_family`, or leave out the option")
        options = {"max_episode_steps": family.limit, **given, **options}
        return make_vector_environment(num_envs, family=family, **options)
    return make_vec_spec(_environment_spec(family, domain, model, environment), num_envs, **given, **options)


def make_aec(
    family: FamilyLocation | None = None,
    variant: int | str | None = None,
    *,
    domain: FamilyLocation | None = None,
    model: FamilyLocation | None = None,
    environment: FamilyLocation | None = None,
    max_episode_steps: int | None = -1,
    **options: Any,
) -> Any:
    """Return a member of a family whose agents take turns, as an environment of PettingZoo's AEC interface.

    Args:
        family, variant, domain, model, environment: as for `make`.
        max_episode_steps: turns after which an episode is truncated. -1: the limit of the family; None: no limit.
        options: `render_mode`, `observation`, `cell` and `action_masks`, as for `make`.

    Raises:
        InvalidArgument: as for `make`; or there are no agents, agents act simultaneously, or PettingZoo is not
            installed.
    """
    from envgraph.env.multiagent import TurnEnv  # needs PettingZoo

    return _make_multiagent(TurnEnv, (family, domain, model, environment), variant, max_episode_steps, options)


def make_parallel(
    family: FamilyLocation | None = None,
    variant: int | str | None = None,
    *,
    domain: FamilyLocation | None = None,
    model: FamilyLocation | None = None,
    environment: FamilyLocation | None = None,
    max_episode_steps: int | None = -1,
    **options: Any,
) -> Any:
    """Return a member whose agents act simultaneously, as an environment of PettingZoo's parallel interface.

    The arguments and errors are those of `make_aec`. A family whose agents take turns is refused.
    """
    from envgraph.env.multiagent import TogetherEnv

    return _make_multiagent(TogetherEnv, (family, domain, model, environment), variant, max_episode_steps, options)


def _make_multiagent(
    environment_class: Callable[..., Any],
    location: Sequence[FamilyLocation | None],
    variant: int | str | None,
    limit: int | None,
    options: dict[str, Any],
) -> Any:
    """Return an environment of class `environment_class`, which steps a member with a live engine of its model."""
    given = _locate_family(*location)
    opened = open_lazy_family(**given, variants=() if variant is None else (variant,))
    member = opened.member_place(variant)
    made = environment_class(
        opened.make_simulator(member), limit=opened.family.limit if limit == -1 else limit, **options
    )
    if "family" in given:
        made.set_family(LazyMembers(given["family"], "live", needs_pictures=False), member)
    return made


def register(
    family: FamilyLocation | None = None,
    *,
    domain: FamilyLocation | None = None,
    model: FamilyLocation | None = None,
    environment: FamilyLocation | None = None,
    name: str | None = None,
    **options: Any,
) -> str:
    """Register a family in Gymnasium, so that `gymnasium.make(id, variant="E2")` makes its members.

    `gymnasium.make_vec(id, 8)` works as well. Registering the same family again changes nothing. The id exists only in
    this process; worker processes of Gymnasium must register it as well.

    Args:
        family, domain, model, environment: as for `make`.
        name: name of the environment in the id `envgraph/<name>-v0`: letters, digits, `_`, `.` and `-`. None: the name
            of the family or domain.
        options: options of `make_environment` and `make_vector_environment` for all environments made with this id.

    Returns:
        The id.

    Raises:
        InvalidArgument: as for `make`; or the name is malformed, or the id is registered for something else.
        LoadError: the files have errors.

    >>> import gymnasium
    >>> gymnasium.make(register(domain="keydoor", name="Doors"), observation="multi").spec.id
    'envgraph/Doors-v0'
    """
    given = _locate_family(family, domain, model, environment)
    record = open_lazy_family(**given).record
    return register_name(
        name or record.family,
        vector_entry_point=MAKE_VECTOR_ENVIRONMENT,
        limit=record.limit,
        **given,
        **options,
    )


def _environment_spec(*location: Any) -> EnvSpec:
    """Return the `EnvSpec` of a family or domain for Gymnasium. The arguments are those of `_locate_family`."""
    given = _locate_family(*location)
    record = open_lazy_family(**given).record
    return environment_spec(record.behaviour, limit=record.limit, **given)


def _check_options(options: Mapping[str, object], *functions: Callable[..., object]) -> None:
    """Raise InvalidArgument for an option that is neither an argument of one of the functions nor Gymnasium's."""
    known = [name for function in functions for name in signature(function).parameters]
    for name in options:
        check_known(name, [*known, *GYMNASIUM_OPTIONS], f"unknown option `{name}`")


def _locate_family(*location: FamilyLocation | None) -> dict[str, Any]:
    """Return the arguments `family` or `domain` of `make_environment` for a family, a domain, a model, an environment.

    Paths of families, models and environments are made absolute, so that other processes make the same environment.
    """
    family, domain, model, environment = location
    if (model is None) != (environment is None) or sum(one is not None for one in (family, domain, model)) > 1:
        raise InvalidArgument("give one of these: a `family`, a `domain`, or a `model` with its `environment`")
    if model is not None and environment is not None:
        return {"domain": [str(Path(one).resolve()) for one in (model, environment)]}
    if family is None:
        return _without_none(domain=None if domain is None else str(domain))
    try:
        path = Path(family)
    except TypeError:
        message = f"`family` is a {type(family).__name__}, but must be a family file, a run or the name of a run"
        raise InvalidArgument(message, "`make_vec` also takes a Family, `write_family` makes it a file") from None
    return {"family": str((path if path.suffix == ".json" else find_run_store(path)).resolve())}


def _without_none(**values: object) -> dict[str, Any]:
    return {name: value for name, value in values.items() if value is not None}


def make_environment(
    domain: DomainLocation | None = None,
    family: FamilyLocation | Family | None = None,
    variant: int | str | None = None,
    *,
    render_mode: str | None = None,
    observation: ObservationKind | None = None,
    cell: int = 32,
    engine: EngineKind | None = None,
    live: bool = False,
    action_masks: bool = False,
    rewards: bool = False,
    history: int | None = None,
) -> Environment:
    """Return the environment of a member of a family, without a time limit; the entry point for `gymnasium.make`.

    Args:
        domain, family, variant: as for `make`. `domain` may also be a list of two files: a model, an environment.
        render_mode: None, "ansi", "rgb_array" or "human".
        observation: "index" for a single number, "multi" for its components, "flat" for one-hot vectors of them, "dict"
            for components by name, "image" for planes over the grid, "graph" for the model, "padded_graph" for the same
            as arrays of one size, "text" for words. The last four are computed from the model, so that the environment
            is compiled or live ("text": live by default); see `ImageView`, `GraphView`, `PaddedGraphView` and
            `TextView`. None: "flat" if a float is observed, otherwise "index".
        cell: side of a cell in pixels.
        engine: "table" for the transition table, which requires a limited number of states; "compiled" for the compiled
            behaviour; "live" for the engine of the model. None: the first of these that works. Episodes are the same.
        live: True is the same as `engine="live"`.
        action_masks: True adds `action_mask`, int8 [actions], to infos. The method `action_masks` always exists.
        rewards: True adds `rewards`, each reward by name, to the infos of steps; see `SeparateRewards`.
        history: how many last observations form one, as in Gymnasium's `FrameStackObservation`; not for "graph". None:
            only the current one, without a further axis.

    Raises:
        InvalidArgument: the family, member or engine does not exist, neither a domain nor a family is given, or the
            family does not belong to the domain's environment.
        LoadError: the files have errors.
        EvaluationError: as for `make`.
    """
    wanted = _requested_engine(engine, live or (engine is None and observation == "text"))
    _check_observation(observation, wanted, history)
    if not isinstance(variant, int | str | None):
        raise InvalidArgument("`variant` must be a single name or number", "use `envgraph.make_vec` for a list")
    opened = open_lazy_family(domain, family, () if variant is None else (variant,))
    check_render_mode(render_mode, drawn=opened.record.drawn)  # checked before all states are visited
    place = opened.member_place(variant)
    shown = {"render_mode": render_mode, "observation": observation, "cell": cell, "action_masks": action_masks}
    environment, steps_in = _make_member_environment(opened, place, wanted, shown)
    if family is not None:
        environment.set_family(LazyMembers(family, steps_in, render_mode is not None), place)
    environment.action_keys = opened.record.action_keys
    if not opened.record.drawn:
        environment.metadata = {**environment.metadata, "render_modes": []}
    parts: dict[str, SingleEnvironment] = {}
    for name in reward_names(opened.family.behaviour) if rewards else ():
        parts[name], _ = _make_member_environment(opened.paying(name), place, steps_in, {})
        if family is not None:
            parts[name].set_family(LazyMembers(family, steps_in, needs_pictures=False, reward_name=name), place)
    made: Environment = SeparateRewards(environment, parts) if rewards else environment
    return made if history is None else FrameStackObservation(made, history)


def _make_member_environment(
    opened: LazyFamily, place: int, engine: EngineKind | None, view_options: dict[str, Any]
) -> tuple[EnvgraphEnv | EnvgraphLiveEnv | CompiledEnv, EngineKind]:
    """Return the environment of a member with the view options `view_options`, and the name of the engine that steps
    it.

    Without a `engine` engine, warn if the live engine is used because tables and compiled programs are impossible.
    """
    kind: ObservationKind | None = view_options.get("observation")
    of_model, pictures = kind in MODEL_KINDS, view_options.get("render_mode") is not None
    found = opened.tables_or_program([place], engine, needs_pictures=pictures, needs_models=of_model)
    if kind is not None and of_model:
        view_options = {**view_options, "observation": opened.make_model_view(kind)}
    if isinstance(found, list):
        return EnvgraphEnv(found[0].tabular, pictures=found[0].pictures, **view_options), "table"
    if found is not None:
        from envgraph.env.compiled import CompiledEnv

        return CompiledEnv(found, **view_options), "compiled"
    if engine is None:
        warn(f"{opened.not_compiled_error().message}; the live engine is used instead", stacklevel=3)
    return EnvgraphLiveEnv(opened.make_simulator(place), **view_options), "live"


def make_vector_environment(
    num_envs: int = 1,
    domain: DomainLocation | None = None,
    family: FamilyLocation | Family | None = None,
    variant: int | str | Sequence[int | str] | None = None,
    *,
    render_mode: str | None = None,
    observation: ObservationKind | None = None,
    max_episode_steps: int | None = None,
    autoreset_mode: str | None = None,
    engine: EngineKind | None = None,
    streams: StreamMode | None = None,
    threads: int | None = None,
    schedule: Schedule | str | None = None,
    action_masks: bool = False,
    rewards: bool = False,
    history: int | None = None,
) -> EnvgraphVectorEnv | CompiledVectorEnv:
    """Return a vector environment of `num_envs` environments; the entry point for `gymnasium.make_vec`.

    The arguments are those of `make_environment`. `variant` may be a list whose members are repeated in order, so that
    `num_envs=60, variant=["E1", "E2"]` makes thirty of each; a `schedule` chooses the member of each episode instead.
    `family` may be a `Family`. The other arguments are those of `CompiledVectorEnv`. With `streams` or `threads` the
    environments are compiled even if there are tables.

    Raises:
        InvalidArgument, LoadError, EvaluationError: as for `make_environment`. `engine="live"` and `rewards` are
            refused, because they need single environments: use `make_vec`.
    """
    if rewards:
        raise InvalidArgument("`rewards=True` needs single environments", 'use `vectorization_mode="sync"`')
    wanted = _requested_engine(engine, live=False)
    _check_observation(observation, wanted, history)
    own = _without_none(streams=streams, threads=threads)
    if own:
        if wanted not in (None, "compiled"):
            raise InvalidArgument(f'`{next(iter(own))}` needs `engine="compiled"`, but `engine="{wanted}"` is given')
        wanted = "compiled"
    if wanted == "live":
        raise InvalidArgument('`engine="live"` needs single environments', 'use `vectorization_mode="sync"`')
    variants = () if variant is None else (variant,) if isinstance(variant, int | str | Member) else tuple(variant)
    opened = open_lazy_family(domain, family, variants)
    check_render_mode(render_mode, ("rgb_array",), drawn=opened.record.drawn)
    if schedule is not None and not variants:
        variants = tuple(opened.record.tables)
    places = [opened.member_place(one) for one in variants or (None,)]
    if isinstance(schedule, str):
        schedule = named_schedule(schedule, len(places))
    options: dict[str, Any] = {
        "render_mode": render_mode,
        "observation": observation,
        "max_episode_steps": max_episode_steps,
        "action_masks": action_masks,
        **_without_none(autoreset_mode=autoreset_mode, schedule=schedule),
    }
    found = opened.tables_or_program(
        places, wanted, needs_pictures=render_mode is not None, needs_models=observation in MODEL_KINDS
    )
    if found is None and observation not in MODEL_KINDS:
        with suppress(TooManyStates):  # single environments would be live: only tables are left for a vector
            found = opened.tables_or_program(places, "table", needs_pictures=render_mode is not None)
    if found is None:
        raise opened.not_compiled_error()
    if observation is not None and observation in MODEL_KINDS:
        options["observation"] = opened.make_model_view(observation)
    environment: EnvgraphVectorEnv | CompiledVectorEnv
    if isinstance(found, list):
        pictures = [one.pictures for one in found]
        environment = EnvgraphVectorEnv([one.tabular for one in found], num_envs, pictures=pictures, **options)
    else:
        from envgraph.env.compiled import CompiledVectorEnv

        environment = CompiledVectorEnv(found, num_envs, **options, **own)
    if family is not None:
        environment.set_variants(VectorVariants(LazyMembers(family, "table", needs_pictures=False), places))
    if history is not None:
        environment.set_history(history)
    return environment


def _requested_engine(engine: EngineKind | None, live: bool) -> EngineKind | None:
    """Return the requested engine, or None. Raise `InvalidArgument` if it is unknown or contradicts `live`."""
    if engine is not None:
        check_known(engine, ENGINES, f"unknown engine {engine!r}")
    if live and engine not in (None, "live"):
        raise InvalidArgument(f"`live=True` contradicts `engine={engine!r}`: give one of them")
    return "live" if live else engine


def _check_observation(kind: ObservationKind | None, engine: EngineKind | None, history: int | None) -> None:
    """Raise `InvalidArgument` if the kind of observation is unknown, or if the engine cannot make it."""
    check_observation_kind(kind)
    if history is not None and (not isinstance(history, int) or history < 1):
        raise InvalidArgument(f"`history` is {history!r}, but must be an int of at least 1")
    if history is not None and kind in ("graph", "text"):
        raise InvalidArgument("`history` needs observations of one size", 'use `observation="padded_graph"`')
    if kind in MODEL_KINDS and engine == "table":
        hint = 'leave `engine` out, or give "compiled" or "live"'
        raise InvalidArgument(f'observation "{kind}" needs a model, which `engine="table"` does not have', hint)
