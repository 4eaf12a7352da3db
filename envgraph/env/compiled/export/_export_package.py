"""Export a compiled behaviour with a family as a Python package that needs only NumPy, and numba for speed."""

from __future__ import annotations

import inspect
import io
import json
from collections.abc import Sequence
from keyword import iskeyword
from pathlib import Path
from typing import Final

import numpy as np

from envgraph.env import _flat_observations, _float_ranges
from envgraph.env.compiled.batches._batch import CAPACITY_ERRORS
from envgraph.env.compiled.export import _exported
from envgraph.env.compiled.kernels import _python_kernels, step_kernels
from envgraph.env.compiled.kernels.step_kernels import FAILED, REFUSED
from envgraph.env.compiled.layout import _batch_arrays
from envgraph.env.compiled.programs._compiled_program import CompiledProgram
from envgraph.errors import InvalidArgument
from envgraph.files import _cache, check_empty_folder, escape_markdown, replace_file

MOST_NAMED: Final = 20
"""The most actions that a README names."""
_NUMBA: Final = "arrays", "machine_code"
"""Modules that cannot be imported without numba."""
_ERRORS: Final = {
    FAILED: "a value is missing or too large, changes of a rule contradict each other, or a unit may never end",
    REFUSED: "a rule cannot be applied",
    **CAPACITY_ERRORS,
}

_TAIL: Final = """
try:
    from numba import config
except ImportError:
    NATIVE = False
else:
    NATIVE = not config.DISABLE_JIT

if NATIVE:
    from inspect import getsource
    from sys import modules

    from . import arrays, cache_files, machine_code
    from .arrays import *

    text = getsource(arrays) + getsource(modules[__name__])
    machine_code.compile_functions(globals(), ("advance",), text, cache_files)
else:
    from .python_kernels import *

    advance = np.errstate(all="ignore")(advance)
"""

_README: Final = """# {package}

{count} environments of `{name}` as a program over arrays. It needs NumPy; with numba, which compiles it the first time,
it steps millions of times a second.

```python
from {package} import Environments
environments = Environments(num_envs=64)
observations, infos = environments.reset(seed=0)
```

`environments.step(actions)` returns observations, rewards, terminated, truncated and infos, as Gymnasium's vector
environments do. `begin` and `step` of the package are functions of a state. Members: {members}. Actions: {actions}.
"""


def export_package(
    program: CompiledProgram, folder: Path, *, name: str, members: Sequence[str], limit: int | None
) -> list[Path]:
    """Write a program and its data as a package, and return the paths of its files.

    Args:
        program: the compiled behaviour with a family.
        folder: the folder of the package; must be empty or missing.
        name: the name of the environment.
        members: names of the members.
        limit: steps after which an episode is truncated; None for no limit.

    Raises:
        InvalidArgument: the folder is not empty, or its name cannot be the name of a package.
    """
    check_package_name(folder.name)
    check_empty_folder(folder)
    files = program_files(program, folder.name, name=name, members=members, limit=limit)
    for file, content in files.items():
        replace_file(folder / file, content)
    return [folder / file for file in files]


def check_package_name(name: str) -> None:
    """Raise InvalidArgument if a name cannot be the name of a package."""
    if not (name.isascii() and name.isidentifier() and name == name.strip("_")) or iskeyword(name):
        hint = "use a name of letters a to z, digits and `_`, such as `my_environments`"
        raise InvalidArgument(f"`{name}` cannot be imported as a package", hint)


def program_files(
    program: CompiledProgram, package: str, *, name: str, members: Sequence[str], limit: int | None
) -> dict[str, str | bytes]:
    """Return the contents of the package's files by name. The arguments are those of `export_package`."""
    about = {
        "environment": name,
        "members": [*members],
        "actions": program.action_names,
        "agents": [program.agent_names(number) for number in range(len(members))],
        "observation_shape": [getattr(size, "limits", size) for size in program.observation_shape],
        "limit": limit,
        "capacity": program.region_size,
        "levels": program.row_regions,
        "width": program.row_width,
        "errors": _ERRORS,
    }
    text = inspect.getsource(step_kernels)
    flat = inspect.getsource(_flat_observations)
    return {
        "__init__.py": inspect.getsource(_exported)
        .replace(_batch_arrays.__name__, "._batch_arrays")
        .replace(_flat_observations.__name__, "._flat_observations")
        .replace(_float_ranges.__name__, "._float_ranges"),
        "_batch_arrays.py": inspect.getsource(_batch_arrays),
        "_flat_observations.py": flat.replace(_float_ranges.__name__, "._float_ranges"),
        "_float_ranges.py": inspect.getsource(_float_ranges),
        "program.py": f"{text}\n\n{program.source}\n{_TAIL}",
        **{f"{name}.py": (Path(step_kernels.__file__).parent / f"_{name}.py").read_text("utf-8") for name in _NUMBA},
        "cache_files.py": inspect.getsource(_cache),
        "python_kernels.py": inspect.getsource(_python_kernels),
        "about.json": json.dumps(about, indent=1) + "\n",
        "data.npz": _pack_arrays(program),
        "README.md": _README.format(
            package=package,
            count=len(members),
            name=name,
            members=escape_markdown(", ".join(members)),
            actions=_format_action_names(program.action_names),
        ),
    }


def _pack_arrays(program: CompiledProgram) -> bytes:
    stream = io.BytesIO()
    np.savez_compressed(stream, **program.arrays._asdict())
    return stream.getvalue()


def _format_action_names(actions: Sequence[str]) -> str:
    """Format the names of the actions for the README. If there are many, format the first ones and the total number."""
    shown = ", ".join(map(escape_markdown, actions[:MOST_NAMED]))
    return f"{shown}, .. ({len(actions)} in all, in `about.json`)" if len(actions) > MOST_NAMED else shown
