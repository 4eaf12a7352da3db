"""Many members at once."""

from __future__ import annotations

import json
import re
import sqlite3
import sys
from collections import Counter
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import envgraph
from envgraph.cli import main
from envgraph.env import EnvgraphVectorEnv
from envgraph.env.compiled import CompiledVectorEnv
from envgraph.errors import InvalidArgument, LoadError
from envgraph.graph import Node, model_to_json
from envgraph.search import (
    Family,
    RunStore,
    generate,
    lineage,
    open_family,
    read_family,
    resume,
    why_low,
    write_family,
)
from envgraph.search.problem._problem import Problem
from tests.unit.search.test_generate import maps, reachable

COVER = "samples.cover={ complexity = 5 }"


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("made") / "run.sqlite"
    generate("burning_forest/paper.toml", path, samples=60, overrides=[COVER])
    return path


@pytest.fixture(scope="module")
def family(run: Path) -> Family:
    return open_family(run)


def test_sampled_members_are_valid_distinct_and_have_the_stored_measures(family: Family) -> None:
    problem = family.domain.problem(family.domain.engine())
    assert len({member.model for member in family.members}) == len(family.members) == 60
    assert [member.initial for member in family.members] == [False] * 59 + [True]
    assert all(reachable(rows) for rows in maps(family))
    for member in family.members[::6]:
        problem = family.domain.problem(family.domain.engine(family.model(member)))
        assert problem.is_valid() and problem.compute_measures() == member.measures


def test_each_bin_of_a_covered_measure_has_the_same_number_of_members(family: Family) -> None:
    counts = Counter(min(int(member.measures["complexity"] * 5), 4) for member in family.members)
    assert counts == dict.fromkeys(range(5), 12)
    values = [member.measures["complexity"] for member in family.members[:-1]]
    assert values == sorted(values)


def test_seed_determines_the_samples(run: Path, family: Family, tmp_path: Path) -> None:
    again = generate("burning_forest/paper.toml", tmp_path / "again.sqlite", samples=60, overrides=[COVER])
    assert again.members == family.members and write_family(again) == write_family(family)
    other = generate("burning_forest/paper.toml", tmp_path / "other.sqlite", samples=60, overrides=[COVER], seed=1)
    assert len({one.model for one in (*other.members, *family.members)}) == 119  # the target is in both
    with RunStore.open(run) as one, RunStore.open(tmp_path / "again.sqlite") as two:
        assert [*one.individuals()] == [*two.individuals()] and one.rejection_counts() == two.rejection_counts()


def test_lineage_of_a_member_reproduces_it_from_the_initial_model(run: Path, family: Family) -> None:
    member = family.members[7]
    with RunStore.open(run) as store:
        assert member.individual is not None
        steps = [*lineage(store, family.domain, member.individual)]
        assert store.individual(member.individual).model is None
    engine = family.domain.engine()
    for step in steps:
        row = tuple(one.id if isinstance(one, Node) else one for one in step.match.values())
        engine.replay([(step.rule, row)])
    assert engine.model.state_hash() == family.model(member).state_hash()


def test_a_family_of_samples_is_written_and_read(family: Family, tmp_path: Path) -> None:
    file = tmp_path / "family.json"
    file.write_text(write_family(family))
    found = read_family(file)
    assert [one.model for one in found.members] == [one.model for one in family.members]


def test_shared_engine_of_members_gives_the_same_program(family: Family, tmp_path: Path) -> None:
    file = tmp_path / "family.json"
    file.write_text(write_family(family))
    alone = read_family(file)  # has an engine for each
    shared, apart = (one.program(one.members[:9]) for one in (family, alone))
    assert family.keys == alone.keys and shared.source == apart.source
    for name in ("tables", "reals", "ints", "floats", "offsets"):
        assert (getattr(shared.arrays, name) == getattr(apart.arrays, name)).all(), name
    twins = [shared.live_counterpart(place) for place in (2, 5)]
    for place, twin in zip((2, 5), twins, strict=True):
        with twin.in_state(shared.arrays.ints[place], shared.arrays.floats[place]) as simulator:
            assert model_to_json(simulator.engine.model) == json.loads(family.members[place].model)


def test_vector_of_many_members_is_stepped_by_a_compiled_program(run: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    with monkeypatch.context() as context:
        context.setattr("envgraph.search.families._lazy_family.MANY_MEMBERS", 3)
        context.setattr("envgraph.search.families._lazy_family.has_numba", lambda: True)
        context.setattr("envgraph.env.compiled.programs._compiled_program.has_numba", lambda: False)  # in Python
        many = envgraph.make_vec(run, num_envs=6, variant=["E1", "E9", "E17", "E60"])
    few = envgraph.make_vec(run, num_envs=6, variant=["E1", "E9", "E17", "E60"])
    assert isinstance(many, CompiledVectorEnv) and isinstance(few, EnvgraphVectorEnv)
    seen = [envs.reset(seed=1)[0] for envs in (many, few)]
    assert (seen[0] == seen[1]).all()
    for number in range(30):
        many_step, few_step = (envs.step(np.full(6, number % 4)) for envs in (many, few))
        for one, other in zip(many_step[:4], few_step[:4], strict=True):
            assert (one == other).all()


def test_samples_with_an_objective_keep_the_best_members_of_each_bin(tmp_path: Path) -> None:
    """The measure that is covered is the one that counts: of each fifth the members at its upper end stay."""
    given = ["samples.maximise=['complexity']", "samples.attempts=600", COVER]
    found = generate("burning_forest/paper.toml", tmp_path / "run.sqlite", samples=10, overrides=given)
    given[0] = "samples.minimise=complexity"
    other = generate("burning_forest/paper.toml", tmp_path / "other.sqlite", samples=10, overrides=given)
    high, low = ([one.measures["complexity"] * 5 for one in each.members[:-1]] for each in (found, other))
    assert [int(value) for value in high if value < 5][:8] == [int(value) for value in low][:8]
    above, below = (sum(value % 1 for value in each if value < 4) for each in (high, low))
    assert above > 6 and below < 2


GARDEN = {
    "garden.metamodel": "metamodel garden\nclass Plot { contains Bed bed }\nclass Bed { int size }\n",
    "garden.model": 'import "garden.metamodel"\nmodel plot : garden { p : Plot { bed = b : Bed { size = 0 } } }\n',
    "garden.rules": 'import "garden.metamodel"\n'
    "rule grow { lhs { b : Bed; check(b.size < 6); } modify { set b.size += 1; } }\n"
    "rule shrink { lhs { b : Bed; check(b.size > 0); } modify { set b.size -= 1; } }\n",
    "garden.query": 'import "garden.metamodel"\n'
    "pattern odd(b : Bed) { Bed.size(b, s); check(s == 3); }\n"
    "pattern size(s : int) { Bed.size(_, s); }\n",
    "family.toml": 'model = "garden.model"\nimports = ["garden.rules", "garden.query"]\n'
    '[constraints]\nforbid = ["odd"]\n[measures.size]\nkind = "value"\nof = "size"\n'
    '[mutation]\nrules = ["grow", "shrink"]\ninitial_applications = [1, 3]\n'
    "[samples]\ncount = 50\n",
}


@pytest.fixture
def garden(tmp_path: Path) -> Path:
    for name, text in GARDEN.items():
        (tmp_path / name).write_text(text)
    return tmp_path


def test_sampling_finds_all_models_of_a_small_space_and_reports_the_shortage(garden: Path) -> None:
    """A bed has seven sizes, of which one is forbidden: a walk goes past it."""
    found = generate(str(garden), garden / "run.sqlite")
    assert sorted(one.measures["size"] for one in found.members) == [0, 1, 2, 4, 5, 6]
    with RunStore.open(garden / "run.sqlite") as store:
        told = why_low(found, store)
        assert (
            sum(store.rejection_counts().values()) + 6 >= 500
            and "the model was found before" in store.rejection_counts()
        )
    assert told is not None and "only 6 of 50 environments" in told.message and "attempts" in str(told.hint)


def test_heavy_tailed_strength_can_be_used_for_samples(garden: Path) -> None:
    given = ["mutation.strength=heavy_tailed", "samples.count=6"]
    found = generate(str(garden), garden / "run.sqlite", overrides=given)
    assert len(found.members) == 6


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ("samples.cover={ size = 3 }", "the range of `size` is unknown"),
        (
            "samples.cover={ size = { bins = 0, range = [0, 6] } }",
            "`bins` is 0, but must be at least 1",
        ),
        ("samples.cover={ size = 'many' }", "`size` must be a number of bins, not a string"),
        ("samples.cover={ sizes = 3 }", "unknown measure `sizes`"),
        ("samples.maximise=width", "unknown measure `width`"),
        ("samples={ maximise = 'size', minimise = 'size' }", "cannot be combined"),
        ("samples.count=1", "but must be at least 2"),
        ("samples.number=9", "unknown key `number` in `[samples]`"),
    ],
)
def test_mistakes_in_sample_options_are_reported_with_their_position(garden: Path, given: str, message: str) -> None:
    diversity = "diversity.kind=variance"
    with pytest.raises(LoadError, match="--set:1:") as caught:
        generate(str(garden), garden / "run.sqlite", overrides=[given, diversity])
    assert message in str(caught.value) and not (garden / "run.sqlite").exists()


def test_more_generations_are_refused_for_a_run_of_samples(run: Path, family: Family) -> None:
    assert resume(run).members == family.members
    with pytest.raises(InvalidArgument, match="has samples and thus no generations"):
        resume(run, generations=5)


def test_resuming_an_interrupted_run_of_samples_starts_it_again(run: Path, family: Family, tmp_path: Path) -> None:
    with RunStore.open(run) as store:
        settings, sources = store.settings(), store.source_texts()
    RunStore.create(tmp_path / "run.sqlite", settings, sources).close()
    assert resume(tmp_path / "run.sqlite").members == family.members


def test_member_whose_model_differs_from_its_stored_hash_is_reported_on_access(run: Path, tmp_path: Path) -> None:
    path = tmp_path / "run.sqlite"
    path.write_bytes(run.read_bytes())
    with sqlite3.connect(path) as db:
        (last,) = db.execute("SELECT max(individual) FROM member").fetchone()
        db.execute("UPDATE individual SET trace = '[]' WHERE id = ?", (last,))
        db.execute("DROP TABLE content")  # as in a store of an older version
    found = open_family(path)
    (wrong,) = (member for member in found.members if member.individual == last)
    with pytest.raises(InvalidArgument, match=f"the model of individual {last} does not have the stored hash"):
        found.model(wrong)


@pytest.mark.parametrize("settings", [["samples.count=24"], ["search.generations=2"]])
def test_worker_processes_compute_the_measures_and_change_nothing(
    settings: list[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    wanted = [*settings, 'measures.chance={ kind = "random_success", otherwise = 0.0 }']
    judged = Counter[str]()
    judge = Problem._compute_measures_or_rejection

    def count(self: Problem, checks: Any) -> Any:
        judged[stage] += 1
        return judge(self, checks)

    monkeypatch.setattr(Problem, "_compute_measures_or_rejection", count)
    found = {}
    for workers in (1, 2):
        stage = f"{workers} workers"
        family = generate(
            "burning_forest/paper.toml", tmp_path / f"{workers}.sqlite", overrides=wanted, workers=workers
        )
        found[stage] = write_family(family)
    assert found["1 workers"] == found["2 workers"]
    assert judged["2 workers"] == 0 < judged["1 workers"]  # the search found all results in its cache


def test_commands_summarise_families_of_many_members(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)

    def call(*arguments: str) -> str:
        monkeypatch.setattr(sys, "argv", ["envgraph", *arguments])
        assert main() == 0
        return capsys.readouterr().out

    printed = call("generate", "burning_forest/paper.toml", "--samples", "101", "--name", "many")
    assert printed.startswith("BurningForest: 101 environments, diversity ")
    assert "three quarters" in printed and "E7" not in printed
    assert "`--variant E1` shows an environment" in call("show", "many")
    assert "E7  complexity" in call("show", "many", "--variant", "E7")
    quickly = ["--steps", "50", "--seeds", "2", "--curricula", "full", "--controls", "none"]
    monkeypatch.setattr(sys, "argv", ["envgraph", "train", "many", *quickly, "--set", "training.learning_rate=0.25"])
    assert main() == 0
    out, err = capsys.readouterr()
    assert "6 of the 101 environments of `many`, evenly spaced by `complexity`" in err
    assert "curriculum" in out and len(re.findall(r"E\d+", out)) > 1
    monkeypatch.setattr(sys, "argv", ["envgraph", "train", "many", "--members", "101"])
    assert main() == 1 and "`--members` is 101, but a curriculum has at most 100" in capsys.readouterr().err
    call("generate", "burning_forest/paper.toml", "--generations", "0", "--name", "few")
    monkeypatch.setattr(sys, "argv", ["envgraph", "train", "few", "--members", "7"])
    assert main() == 1 and capsys.readouterr().err == "error: `--members` is 7, but `few` has 6 environments\n"
    monkeypatch.setattr(sys, "argv", ["envgraph", "train", "many", "--set", "search.population=4"])
    assert main() == 1 and "`--set search.population=4` is no setting of a training" in capsys.readouterr().err
    monkeypatch.setattr(sys, "argv", ["envgraph", "train", "many", "--set", "training.learning_speed=0.2"])
    assert main() == 1 and "did you mean `learning_rate`?" in capsys.readouterr().err
