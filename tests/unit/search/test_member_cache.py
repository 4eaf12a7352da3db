"""The keys and arrays of many members are cached, and mapped into memory."""

from __future__ import annotations

import os
from collections.abc import Iterator
from dataclasses import replace
from hashlib import sha256
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from envgraph.env.compiled import CompiledProgram, CompiledVectorEnv, MemberEngines
from envgraph.env.compiled.layout._program_layout import ProgramLayout
from envgraph.env.compiled.layout._symbols import MemberNumbers
from envgraph.graph import model_to_json
from envgraph.rewrite import Engine
from envgraph.search import Components, Domain, Family, Member, generate, open_family
from envgraph.search._run_store import dump_json
from envgraph.search.families import _member_family, _table_cache
from tests.unit.env.side_by_side import family_of
from tests.unit.env.test_compiled_corners import CORNERS

STREET = {
    "street.metamodel": """
metamodel street
class Town { contains Lamp[*] lamps contains Guard[*] guards }
@key(x) class Lamp { int x
string label = "old"
bool on = false }
class Guard { int tired = 0 }
""",
    "street.query": 'package street\nimport "street.metamodel"\npattern dark(lamp : Lamp) { Lamp.on(lamp, false); }\n'
    "pattern alike(a : Lamp, b : Lamp) { Lamp.label(a, l); Lamp.label(b, l); a != b; }",
    "street.rules": """
package street
import "street.query"
rule light(lamp : Lamp) { lhs { find dark(lamp); } modify { set lamp.on = true; set lamp.label = "lit"; } }
rule tire { lhs { guard : Guard; } modify { set guard.tired = 1; } }
""",
    "street.environment": """
import "street.rules"
environment Street() {
    action light(lamp : Lamp) = light(lamp)
    action tire = tire()
    each step apply tire()
    on neg find dark(_) reward 1.0 terminate success
    on find alike(_, _) reward 0.25
    observe lamp.on for lamp : Lamp
    limit 6 steps
}
""",
}


@pytest.fixture(autouse=True)
def cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setenv("ENVGRAPH_CACHE", str(tmp_path / "cache"))
    monkeypatch.setattr(_member_family, "MANY_MEMBERS", 5)
    monkeypatch.setattr("envgraph.env.compiled.programs._compiled_program.has_numba", lambda: False)  # in Python
    return tmp_path / "cache"


@pytest.fixture
def street(tmp_path: Path) -> Family:
    """Members of several sizes and texts: one of them, not the first, has two guards, which programs do not expect."""
    for name, text in STREET.items():
        (tmp_path / name).write_text(text, encoding="utf-8")
    members = []
    for number in range(9):
        labels = [f"{number}{x % 2}" if number > 3 else "old" for x in range(1 + number % 4)]
        lamps = ", ".join(f'Lamp {{ x = {x + number} label = "{label}" }}' for x, label in enumerate(labels))
        guards = ", ".join(["Guard { }"] * (1 + (number == 6)))
        model = f'import "street.metamodel"\nmodel m : street {{ Town {{ lamps = [{lamps}] guards = [{guards}] }} }}'
        (tmp_path / "street.model").write_text(model, encoding="utf-8")
        domain = Domain.of_environment(str(tmp_path / "street.model"), str(tmp_path / "street.environment"))
        members.append(Member(f"E{number}", {}, dump_json(model_to_json(domain.initial())), initial=number == 8))
    return Family("Street", domain.workspace.bundle(), tuple(members), domain)


def reopened(family: Family) -> Family:
    return Family(family.name, family.bundle, family.members, family.domain)


@pytest.fixture
def reads(monkeypatch: pytest.MonkeyPatch) -> Iterator[list[int]]:
    """The numbers of the members whose models are read."""
    found: list[int] = []
    engines_of = Family._engines_of

    def counted(family: Family, members: Any) -> MemberEngines:
        engines = engines_of(family, members)

        def read(number: int) -> Engine:
            found.append(number)
            return engines.read(number)

        return engines._replace(read=read)

    monkeypatch.setattr(Family, "_engines_of", counted)
    yield found


def assert_equal(one: CompiledProgram, other: CompiledProgram) -> None:
    assert one.source == other.source and one.members.strings == other.members.strings
    assert len(one.members) == len(other.members) and one.layout.columns() == other.layout.columns()
    pairs: Any = zip(one.arrays, other.arrays, strict=True)
    for mine, theirs in pairs:
        assert mine.dtype == theirs.dtype and np.array_equal(mine, theirs, equal_nan=True)


def played(program: CompiledProgram) -> list[Any]:
    envs, rng = CompiledVectorEnv(program, max_episode_steps=6), np.random.default_rng(4)
    found: list[Any] = [envs.reset(seed=3)[0].tolist()]
    for _ in range(40):
        step = envs.step(rng.integers(len(program.action_names), size=envs.num_envs))
        found += [part.tolist() for part in step[:4]]
    return found


def is_mapped(array: Any) -> bool:
    return isinstance(array.base, np.memmap) and not array.flags.writeable


def test_arrays_of_many_members_are_computed_once_and_then_mapped(street: Family, reads: list[int]) -> None:
    known = street.program(street.members)
    assert len(reads) > 2 * len(street.members) and not any(map(is_mapped, known.arrays))
    reads.clear()
    found = reopened(street).program(street.members)
    assert all(map(is_mapped, found.arrays)) and len(reads) < 2 * len(street.members)
    assert_equal(found, known)
    assert played(found) == played(known) and len({*map(str, played(known))}) > 20
    for number in (0, 6, 8):
        state = found.arrays.ints[number], found.arrays.floats[number]
        with found.live_counterpart(number).in_state(*state) as simulator:
            assert model_to_json(simulator.engine.model) == model_to_json(street.model(street.members[number]))


def test_parts_of_a_family_have_arrays_of_their_own(street: Family, reads: list[int]) -> None:
    part = street.subset([one.name for one in street.members[1:8]])
    for members in (part.members, part.members[::-1], street.members):
        known = part.program(members)
        assert_equal(reopened(street).subset(part.members).program(members), known)
    alone = replace(part, _keys=None)  # fewer lamps have an index, so that there are fewer actions
    assert len(alone.program(alone.members).action_names) < len(part.program(part.members).action_names)
    few = street.program(street.members[:5])
    assert not any(map(is_mapped, street.program(street.members[:5]).arrays)) and len(few.members) == 5


def test_keys_are_cached_without_their_models(street: Family, monkeypatch: pytest.MonkeyPatch) -> None:
    known = street.keys
    monkeypatch.setattr(Family, "_iterate_models", None)
    assert reopened(street).keys == known and known.size("Lamp") == 11


def test_members_of_a_run_are_cached_by_their_hashes(tmp_path: Path, reads: list[int]) -> None:
    run = tmp_path / "many.sqlite"
    family = generate("burning_forest/paper.toml", run, samples=12)
    known = family.program(family.members)
    reads.clear()
    found = open_family(run)
    assert_equal(found.program(found.members), known)
    assert len(reads) < 6 and is_mapped(found.program(found.members).arrays.tables)


@pytest.mark.parametrize("ending", ["npy", "program", "keys"])
@pytest.mark.parametrize("damage", ["shorter", "other", "empty", "missing"])
def test_damaged_files_are_computed_again(street: Family, cache: Path, ending: str, damage: str) -> None:
    known = street.program(street.members)
    files = sorted(cache.glob(f"*.{ending}"))
    assert files
    for file in files:
        content = file.read_bytes()
        changed = {
            "shorter": content[:-7],
            "other": content[:-3] + bytes([content[-3] ^ 1]) + content[-2:],
            "empty": b"",
        }
        file.write_bytes(changed.get(damage, b""))
        if damage == "missing":
            file.unlink()
    for _ in range(2):
        assert_equal(reopened(street).program(street.members), known)
    assert is_mapped(reopened(street).program(street.members).arrays.tables)


def test_files_that_another_process_removes_are_computed_again(
    street: Family, cache: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def removed() -> Path:
        for file in cache.glob("*.npy"):
            file.unlink()
        return cache

    known = street.program(street.members)
    monkeypatch.setattr(_table_cache, "cache_directory", removed)  # asked for after the file was seen
    assert_equal(reopened(street).program(street.members), known)


@pytest.mark.skipif(os.name != "posix", reason="permissions of POSIX")
def test_files_that_others_can_write_are_not_mapped(street: Family, cache: Path) -> None:
    known = street.program(street.members)
    for file in cache.glob("*.npy"):
        file.chmod(0o666)
    found = street.program(street.members)
    assert not any(map(is_mapped, found.arrays))
    assert_equal(found, known)


def test_nothing_is_cached_without_a_cache_or_with_python_functions(
    street: Family, cache: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def more(n: int) -> int:
        return n + 1

    mine = replace(street.domain, components=Components().with_("function", "more", more))
    replace(street, domain=mine).program(street.members)
    assert not [*cache.glob("*.npy"), *cache.glob("*.keys")]
    for place in ("off", str(Path(__file__))):  # a file, in which nothing can be written
        monkeypatch.setenv("ENVGRAPH_CACHE", place)
        street.program(street.members)
    assert not [*cache.glob("*.npy"), *cache.glob("*.keys")]


FILLED = {
    "network": "91018552",
    "wildfire": "5cf7021d",
    "containers that go with what they contain": "29735810",
    "several that may have one index": "272a2382",
    "operations on strings": "762e05d9",
}
"""Checksums of arrays, whose tables and columns are sorted by their numbers: programs may change their order."""


def test_arrays_are_those_of_the_format_of_the_cache() -> None:
    """Where the numbers of a table or column have changed: increase `CACHE_FORMAT`, and change both here."""
    found = {}
    for corner in FILLED:
        program = family_of(CORNERS[corner], 2).program
        stride = int(program.arrays.offsets[0])
        used = [one for one in program.layout._numbers if isinstance(one, MemberNumbers)]
        rows = {one: str([[*one.fill(member, stride)] for _, member in program.members.read_all()]) for one in used}
        layout = ProgramLayout()
        for symbol in sorted(used, key=lambda one: (type(one).__name__, rows[one])):
            layout.offset(symbol)
        content = sha256()
        for array in layout.fill_arrays(program.members, stride):
            content.update(f"{array.dtype} {array.shape}".encode() + array.tobytes())
        found[corner] = content.hexdigest()[:8]
    assert (found, _table_cache.CACHE_FORMAT) == (FILLED, 6)
