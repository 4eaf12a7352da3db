"""Register environments for `gymnasium.make`.

Gymnasium 1.x runs no plugins: an environment is known once `envgraph.env` has been imported, by the user or by the
prefix of `gymnasium.make("envgraph.env:envgraph/BurningForest-v0")`.

Entry points are registered as text, the name of a function. Gymnasium imports the function when an environment is
made, so that this package does not depend on the layers above, which know files, families and run stores.
"""

from __future__ import annotations

import copyreg
from collections.abc import Callable, Sequence
from functools import partial
from typing import Any, Final, NoReturn

import gymnasium
from gymnasium.envs.registration import EnvSpec, VectorizeMode
from gymnasium.vector import AsyncVectorEnv, SyncVectorEnv, VectorEnv

from envgraph.env._vector_environments import parse_autoreset_mode
from envgraph.errors import InvalidArgument

Environment = gymnasium.Env[Any, Any]
VectorEnvironment = VectorEnv[Any, Any, Any]

NAMESPACE = "envgraph"

MAKE_ENVIRONMENT = "envgraph.search:make_environment"
MAKE_VECTOR_ENVIRONMENT = "envgraph.search:make_vector_environment"

BUNDLED: Final[tuple[tuple[str, str, int, dict[str, str]], ...]] = (
    ("BurningForest", "burning_forest", 200, {}),
    ("JobShop", "jobshop", 100, {}),
    ("KeyDoor", "keydoor", 100, {}),
    ("Lava", "lava", 200, {}),
    ("Routing", "network/diverse.toml", 64, {"engine": "compiled"}),
    ("Sokoban", "sokoban", 120, {}),
    ("Taxi", "taxi", 200, {}),
    ("Triage", "triage", 60, {}),
    ("Warehouse", "warehouse", 300, {"engine": "compiled"}),
)
"""Name, domain or family file, time limit, and options of environments with too many states for a table."""


def environment_spec(
    name: str,
    /,
    *,
    entry_point: str = MAKE_ENVIRONMENT,
    vector_entry_point: str | None = MAKE_VECTOR_ENVIRONMENT,
    limit: int | None = None,
    **kwargs: Any,
) -> EnvSpec:
    """Return the Gymnasium spec of `envgraph/<name>-v0`; the arguments are those of `register`.

    Raises:
        InvalidArgument: the name is malformed.
    """
    try:
        return EnvSpec(
            f"{NAMESPACE}/{name}-v0",
            entry_point=entry_point,
            vector_entry_point=vector_entry_point,
            max_episode_steps=limit,
            order_enforce=entry_point != MAKE_ENVIRONMENT,  # our environments enforce the order themselves
            kwargs=kwargs,
        )
    except gymnasium.error.Error as error:
        raise InvalidArgument(f"`{name}` cannot name an environment: {error}") from None


def make_vec_spec(
    spec: EnvSpec,
    num_envs: int,
    *,
    vectorization_mode: VectorizeMode | str | None = None,
    autoreset_mode: Any = None,
    vector_kwargs: dict[str, Any] | None = None,
    **options: Any,
) -> VectorEnvironment:
    """Make a vector environment as `gymnasium.make_vec` does, from a spec that need not be registered.

    A list as `variant` works in all modes: environment i is of variant i, modulo the number of variants.

    Args:
        spec: the environment to make; its vector entry point does not support the live engine.
        num_envs: the number of environments.
        vectorization_mode: the mode of Gymnasium; by default "sync" for the live engine.
        autoreset_mode: the autoreset mode, in any vectorization mode.
        vector_kwargs: keyword arguments for the vector environment, as in Gymnasium.
        options: passed on to `gymnasium.make_vec`.

    Raises:
        InvalidArgument: `num_envs` is below 1, or a mode is unknown.
    """
    if not hasattr(num_envs, "__index__") or num_envs < 1:
        raise InvalidArgument(f"`num_envs` is {num_envs!r}, but must be an int of at least 1")
    if isinstance(vectorization_mode, VectorizeMode):
        vectorization_mode = vectorization_mode.value
    if vectorization_mode is None and (options.get("live") or options.get("engine") == "live"):
        vectorization_mode = "sync"
    if vectorization_mode in ("sync", "async") and "schedule" in options:
        hint = 'remove `vectorization_mode`, and use `engine="table"` or `"compiled"`'
        raise InvalidArgument('`schedule` cannot be used with `vectorization_mode` "sync" or "async"', hint)
    if autoreset_mode is not None:
        autoreset_mode = parse_autoreset_mode(autoreset_mode)
        if vectorization_mode in ("sync", "async"):
            vector_kwargs = {**(vector_kwargs or {}), "autoreset_mode": autoreset_mode}
        else:
            options["autoreset_mode"] = autoreset_mode
    if vectorization_mode in ("sync", "async") and not isinstance(options.get("variant", ""), int | str):
        make = partial(_make_single, spec, options.pop("wrappers", None) or ())
        variants = [*options.pop("variant")] or [None]
        makers = [partial(make, {**options, "variant": variants[i % len(variants)]}) for i in range(num_envs)]
        together = SyncVectorEnv if vectorization_mode == "sync" else AsyncVectorEnv
        return together(makers, **(vector_kwargs or {}))
    made = gymnasium.make_vec(
        spec, num_envs, vectorization_mode=vectorization_mode, vector_kwargs=vector_kwargs, **options
    )
    if isinstance(made, SyncVectorEnv):
        made.env_fns = ()  # functions of Gymnasium that are no longer needed and cannot be pickled
    return made


def _refuse_copy(_: AsyncVectorEnv) -> NoReturn:
    """Raise an error instead of copying an environment, because the copy would share its processes."""
    raise TypeError('an async vector environment cannot be copied: use `vectorization_mode="sync"`')


copyreg.pickle(AsyncVectorEnv, _refuse_copy)


def _make_single(
    spec: EnvSpec, wrappers: Sequence[Callable[[Environment], Environment]], options: dict[str, Any]
) -> Environment:
    """Return one of the environments of a vector, created and wrapped as Gymnasium does."""
    environment: Environment = spec.make(**options)
    for wrapper in wrappers:
        environment = wrapper(environment)
    return environment


def register(
    name: str,
    /,
    *,
    entry_point: str = MAKE_ENVIRONMENT,
    vector_entry_point: str | None = None,
    limit: int | None = None,
    **kwargs: Any,
) -> str:
    """Register an environment as `envgraph/<name>-v0`; repeating the same registration changes nothing.

    Args:
        name: letters, digits, `_`, `.` and `-`.
        entry_point: "module:function"; the function is called with `kwargs` and the options of `gymnasium.make`.
        vector_entry_point: the same for `gymnasium.make_vec`; without it, Gymnasium steps copies one after the other.
        limit: the number of steps after which Gymnasium truncates an episode.
        **kwargs: JSON-serializable arguments.

    Returns:
        The id.

    Raises:
        InvalidArgument: the id is malformed, or registered for another environment.
    """
    wanted = environment_spec(
        name, entry_point=entry_point, vector_entry_point=vector_entry_point, limit=limit, **kwargs
    )
    known = gymnasium.registry.get(wanted.id)
    if known is None:
        gymnasium.registry[wanted.id] = wanted
    elif known != wanted:
        raise InvalidArgument(f"`{wanted.id}` is already registered for another environment")
    return wanted.id


def register_bundled() -> None:
    """Register the bundled environments; called when `envgraph.env` is imported."""
    for name, domain, limit, options in BUNDLED:
        register(name, limit=limit, vector_entry_point=MAKE_VECTOR_ENVIRONMENT, domain=domain, **options)
