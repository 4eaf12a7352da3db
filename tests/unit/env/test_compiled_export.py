"""A program that is exported steps as the one it was made from, where there is no envgraph."""

from __future__ import annotations

import os
import subprocess
import sys
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from envgraph.env.compiled import CompiledProgram, CompiledVectorEnv, export_package
from envgraph.errors import InvalidArgument
from tests.unit.env.corners.yard import Yard
from tests.unit.env.side_by_side import family_of

STEPPING = """
import sys
sys.modules["envgraph"] = None  # type: ignore[assignment]
if sys.argv[1] == "python":
    sys.modules["numba"] = None
import numpy as np
import halls
from halls import ABOUT, Environments, begin, step
assert halls._load_program().NATIVE == (sys.argv[1] != "python")
found = []
for streams in ("shared", "each"):
    for observation in ("index", "multi"):
        many = Environments(
            7, ["E1", 1, "E3"], max_episode_steps=9, streams=streams, observation=observation
        )
        actions = np.random.default_rng(0)
        seen, infos = many.reset(seed=4)
        found += [seen, infos["agent"].astype("U9")]
        for _ in range(30):
            *results, infos = many.step(actions.integers(len(ABOUT["actions"]), size=7))
            found += [*results, infos["step"], infos["success"], infos["agent"].astype("U9")]
draws = np.random.default_rng(1)
state, seen = begin([0, 1, 2], draws.random(3))
one = Environments(3, [0, 1, 2], max_episode_steps=None)
same, _ = one.reset(seed=1)
assert (seen == same).all()
for _ in range(9):
    before, actions = state.ints.copy(), draws.integers(len(ABOUT["actions"]), size=3)
    uniforms = one._random.bit_generator.state  # what the environments draw next
    copy = np.random.default_rng(); copy.bit_generator.state = uniforms
    after, seen, reward, ended = step(state, actions, copy.random(3))
    assert (state.ints == before).all()
    if one._batch.rows.over.any():
        break
    same, gained, terminated, _, _ = one.step(actions)
    assert (seen == same).all() and (reward == gained).all() and ((ended > 0) == terminated).all()
    state = after
import copy, pickle
copies = [copy.deepcopy(many), pickle.loads(pickle.dumps(many))]
gone_on = [[each.step(np.full(7, number % 3)) for number in range(30)] for each in (*copies, many)]
assert str(gone_on[0]) == str(gone_on[1]) == str(gone_on[2])
for wrong in (lambda: many.step([0]), lambda: Environments(members=["E9"]), lambda: Environments(0)):
    try:
        wrong()
    except ValueError:
        continue
    raise AssertionError("no error")
np.savez("found.npz", *found)
"""


RULES = """
rule go(m : Man, way : Way) { lhs { m -at-> s : Spot; find step(s, way, t); } modify { set m.at = t; } }
rule tire(m : Man) { lhs { check m.hunger > 0; } modify { set m.hunger -= 1; set m.power = m.power * 0.7; } }
"""
TURNS = """
agent m : Man {
    action go(way : Way) = 0.8: go(m, way) reward m.power
    action rest = nothing() reward 0.1
    each step apply 0.4: tire(m)
    observe m.at among Spot or none
    observe m.hunger in 0..3
}
on find hungry(_) terminate failure
"""
MEN = Yard(RULES, TURNS, "pattern hungry(m : Man) { Man.hunger(m, 0); }", head="")


@cache
def program() -> CompiledProgram:
    """Return a program of three members, in which men take turns: numba compiles it in a second."""
    return family_of(MEN).program


def wanted(made: CompiledProgram) -> list[Any]:
    """What the script finds, of the environments of envgraph."""
    found: list[Any] = []
    for streams in ("shared", "each"):
        for observation in ("index", "multi"):
            many = CompiledVectorEnv(
                made,
                7,
                max_episode_steps=9,
                streams=streams,  # type: ignore[arg-type]
                observation=observation,  # type: ignore[arg-type]
            )
            actions = np.random.default_rng(0)
            seen, infos = many.reset(seed=4)
            found += [seen, infos["agent"].astype("U9")]
            for _ in range(30):
                *results, infos = many.step(actions.integers(many.single_action_space.n, size=7))
                found += [*results, infos["step"], infos["success"], infos["agent"].astype("U9")]
    return found


@pytest.mark.parametrize("runs", ["python", "numba"])
def test_exported_package_steps_without_envgraph(tmp_path: Path, runs: str) -> None:
    if runs == "numba":
        pytest.importorskip("numba")
    made = program()
    export_package(made, tmp_path / "halls", name="Men", members=["E1", "E2", "E3"], limit=100)
    ran = subprocess.run(
        [sys.executable, "-c", STEPPING, runs], cwd=tmp_path, capture_output=True, text=True, check=False
    )
    assert (ran.returncode, ran.stderr) == (0, "")
    with np.load(tmp_path / "found.npz", allow_pickle=False) as arrays:
        found = [arrays[name] for name in arrays.files]
    expected = wanted(made)
    assert len(found) == len(expected)
    assert all(np.array_equal(one, other) for one, other in zip(found, expected, strict=True))


@pytest.mark.parametrize(("home", "switched_off", "kept"), [("home", "0", 1), ("file", "0", 0), ("home", "1", 0)])
def test_exported_package_runs_without_a_writable_cache_for_machine_code(
    tmp_path: Path, home: str, switched_off: str, kept: int
) -> None:
    """A package that cannot be written, of a user who has no home, and with numba switched off."""
    pytest.importorskip("numba")
    export_package(program(), tmp_path / "halls", name="W", members=["E1", "E2", "E3"], limit=100)
    (tmp_path / "file").write_text("")
    (tmp_path / "halls").chmod(0o500)
    script = "import halls; halls.Environments(2).reset(seed=0); print(halls._load_program().NATIVE)"
    places = {"HOME": str(tmp_path / home), "PYTHONDONTWRITEBYTECODE": "1", "NUMBA_DISABLE_JIT": switched_off}
    usual = {name: value for name, value in os.environ.items() if name not in ("ENVGRAPH_CACHE", "XDG_CACHE_HOME")}
    for _ in range(1 + kept):
        command = [sys.executable, "-c", script]
        ran = subprocess.run(command, cwd=tmp_path, env=usual | places, capture_output=True, text=True, check=False)
        assert (ran.stdout, ran.stderr) == (f"{switched_off == '0'}\n", "")
    assert len([*tmp_path.glob("home/.cache/envgraph/programs/*")]) == kept


def test_export_refuses_folders_that_cannot_become_a_package(tmp_path: Path) -> None:
    made = program()
    given: dict[str, Any] = {"name": "Men", "members": ["E1", "E2", "E3"], "limit": None}
    with pytest.raises(InvalidArgument, match="`my-halls` cannot be imported"):
        export_package(made, tmp_path / "my-halls", **given)
    export_package(made, tmp_path / "halls", **given)
    with pytest.raises(InvalidArgument, match="exists already"):
        export_package(made, tmp_path / "halls", **given)
