"""The paper's experiment: a family of Burning Forest environments."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from collections import deque
from math import log2
from pathlib import Path

import pytest

from envgraph.errors import EvaluationError, InvalidArgument, LoadError
from envgraph.lang import data_path
from envgraph.rewrite import Engine
from envgraph.search import (
    Components,
    Domain,
    Family,
    Generation,
    LineageBranch,
    RunStore,
    Variance,
    export_ga4cl,
    generate,
    lineage,
    lineage_tree,
    open_family,
    read_family,
    resume,
    write_family,
)
from tests.profile import NIGHTLY

SMALL = {"generations": 25, "population": 4}


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Family]:
    """A small run that nothing has interrupted, and its family."""
    path = tmp_path_factory.mktemp("whole") / "run.sqlite"
    return path, generate("burning_forest/paper.toml", path, **SMALL)


def maps(family: Family) -> list[list[str]]:
    return [entry["desc"] for entry in json.loads(export_ga4cl(family))["environments"]]


def reachable(rows: list[str]) -> bool:
    """Whether the goal can be reached from the start without fire; written without the engine."""
    seen, queue = {(0, 0)}, deque([(0, 0)])
    while queue:
        x, y = queue.popleft()
        if rows[y][x] == "G":
            return True
        for u, v in ((x + 1, y), (x - 1, y), (x, y + 1), (x, y - 1)):
            if 0 <= u < len(rows[0]) and 0 <= v < len(rows) and rows[v][u] != "B" and (u, v) not in seen:
                seen.add((u, v))
                queue.append((u, v))
    return False


def test_generated_maps_are_valid_and_contain_the_target(family: Family, published: Path) -> None:
    found = maps(family)
    target = json.loads(published.read_text())["environments"][-1]["desc"]
    assert len(found) == 6
    for rows in found:
        assert [len(row) for row in rows] == [8] * 8
        letters = "".join(rows)
        assert rows[0][0] == "S" and rows[7][7] == "G" and rows[5][3] == "W"
        assert (letters.count("S"), letters.count("G"), letters.count("W")) == (1, 1, 1)
        assert set(letters) <= set("SGWRVB")
        assert reachable(rows)
    assert target in found


def test_generated_family_has_one_complexity_in_each_of_six_bins(family: Family) -> None:
    values = [member.measures["complexity"] for member in family.members]
    assert values == sorted(values)
    assert {int(value * 6) for value in values} == set(range(6))
    assert family.diversity() == pytest.approx(log2(6), abs=1e-12)


@pytest.mark.parametrize("transform", ["linear", "sqrt"])
def test_either_transform_reaches_the_maximum_from_the_bundled_target(tmp_path: Path, transform: str) -> None:
    seeds = 20 if NIGHTLY else 1
    for seed in range(1, 1 + seeds):
        overrides = [f"measures.complexity.transform={transform}"]
        family = generate("burning_forest/paper.toml", tmp_path / f"{seed}.sqlite", seed=seed, overrides=overrides)
        assert family.diversity() == pytest.approx(log2(6), abs=1e-12), seed


def test_members_are_named_in_the_order_of_the_curriculum(family: Family) -> None:
    assert [member.name for member in family.members] == ["E1", "E2", "E3", "E4", "E5", "E6"]
    assert [member.initial for member in family.members].count(True) == 1
    assert family.member("E3") is family.member(3) is family.members[2]
    assert family.member() is family.members[-1]
    with pytest.raises(InvalidArgument, match="no environment `E9`"):
        family.member("E9")


@pytest.mark.parametrize("initial", ["last", "ordered"])
def test_target_is_the_initial_model_unless_the_file_lets_the_order_decide(tmp_path: Path, initial: str) -> None:
    path = copied(tmp_path, toml=('sequences = "suffixes"', f'initial = "{initial}"'))
    path.write_text(path.read_text() + '\n[measures.fires]\nkind = "count"\nof = "burningTile"\n')
    path.write_text(path.read_text().replace('order = "complexity"', 'order = "fires"'))
    path.write_text(path.read_text().replace('of = "complexity"', 'of = "fires"\nrange = [0, 40]'))
    family = generate(str(path), tmp_path / "run.sqlite", seed=1, generations=30)
    fires = [member.measures["fires"] for member in family.members]
    places = [member.initial for member in family.members]
    assert places.count(True) == 1 and max(fires) > 20
    if initial == "last":
        assert places[-1] and fires[-1] == 20 and fires[:-1] == sorted(fires[:-1])
    else:
        assert not places[-1] and fires == sorted(fires)
    assert [member.name for member in family.members] == ["E1", "E2", "E3", "E4", "E5", "E6"]


def test_equal_seeds_give_equal_families_and_other_seeds_give_others(tmp_path: Path) -> None:
    exports = [
        export_ga4cl(generate("burning_forest/paper.toml", tmp_path / str(turn) / "run.sqlite", seed=seed, **SMALL))
        for turn, seed in enumerate((5, 5, 6))
    ]
    assert exports[0] == exports[1] != exports[2]


class Interrupted(Exception):
    """Stands for a kill: nothing is cleaned up by the search itself."""


@pytest.mark.parametrize("last", [0, 1, 13, 24])
def test_an_interrupted_run_resumes_to_the_same_store(tmp_path: Path, whole: tuple[Path, Family], last: int) -> None:
    def interrupt(generation: Generation) -> None:
        if generation.number > last:
            raise Interrupted

    path = tmp_path / "cut" / "run.sqlite"
    with pytest.raises(Interrupted):
        generate("burning_forest/paper.toml", path, progress=interrupt, **SMALL)
    asked = SMALL["generations"] if last == 13 else None
    assert export_ga4cl(resume(path, generations=asked)) == export_ga4cl(whole[1])
    with RunStore.open(path) as cut, RunStore.open(whole[0]) as uncut:
        assert list(cut.individuals()) == list(uncut.individuals())
        assert cut.generation_statistics() == uncut.generation_statistics()
        assert cut.settings() == uncut.settings()


def test_resumed_run_continues_counting_stagnation(tmp_path: Path) -> None:
    def interrupt(generation: Generation) -> None:
        if generation.number == last // 2:
            raise Interrupted

    family = str(copied(tmp_path, toml=("generations = 1000", "generations = 1000\nstagnation = 60")))
    generate(family, tmp_path / "whole.sqlite")
    with RunStore.open(tmp_path / "whole.sqlite") as store:
        last = len(store.generation_statistics()) - 1
    with pytest.raises(Interrupted):
        generate(family, tmp_path / "cut.sqlite", progress=interrupt)
    resume(tmp_path / "cut.sqlite")
    with RunStore.open(tmp_path / "cut.sqlite") as store:
        assert len(store.generation_statistics()) - 1 == last < 1000


def test_resuming_a_finished_run_changes_nothing(whole: tuple[Path, Family]) -> None:
    path, first = whole
    assert export_ga4cl(resume(path)) == export_ga4cl(first)


def test_extended_run_equals_one_long_run(tmp_path: Path) -> None:
    short, whole = tmp_path / "short.sqlite", tmp_path / "whole.sqlite"
    generate("burning_forest/paper.toml", short, seed=4, generations=4, population=4)
    with pytest.raises(InvalidArgument, match="has 4 generations already"):
        resume(short, generations=4)
    longer = resume(short, generations=9)
    assert export_ga4cl(longer) == export_ga4cl(
        generate("burning_forest/paper.toml", whole, seed=4, generations=9, population=4)
    )
    with RunStore.open(short) as one, RunStore.open(whole) as other:
        assert one.generation_statistics() == other.generation_statistics() and len(one.generation_statistics()) == 10
        assert [(a.trace, a.measures) for a in one.individuals()] == [
            (a.trace, a.measures) for a in other.individuals()
        ]
    assert open_family(short).domain.spec == open_family(whole).domain.spec


def test_any_key_of_the_family_file_can_be_overridden(tmp_path: Path) -> None:
    path = tmp_path / "run.sqlite"
    overrides = [
        "name=Woods",
        "search.survivors={ name = 'beam', width = 3 }",
        "measures.complexity.transform=linear",
        "measures.fires={ kind = 'count', of = 'burningTile' }",
        "search.population=5",
    ]
    family = generate("burning_forest/paper.toml", path, generations=2, population=3, overrides=overrides)
    spec = family.domain.spec
    assert (spec.name, spec.search.population, spec.search.generations) == ("Woods", 5, 2)
    assert spec.search.survivors.kind == "beam" and spec.search.survivors.options == {"width": 3}
    assert family.members[-1].measures["fires"] == 20 and family.members[-1].measures["complexity"] > 0.99
    again = open_family(path)
    assert again == family
    assert (again.domain.spec.search, again.domain.spec.measures) == (spec.search, spec.measures)
    (tmp_path / "family.json").write_text(write_family(family))
    assert read_family(tmp_path / "family.json").domain.spec == again.domain.spec


@pytest.mark.parametrize(
    ("override", "message"),
    [
        ("search.populaton=4", "--set:1:8: unknown key `populaton` in `[search]`"),
        ("search.population=many", "--set:1:19: `population` must be a whole number, not a string"),
        ("search.population=0.5", "--set:1:19: `population` must be a whole number, not a decimal number"),
        ("search.survivors.rounds=-1", "--set:1:25: `rounds` is -1, but must be at least 0"),
        ("diversity.range=[8, 2]", "hint: write `range = [2, 8]`"),
        ("diversity.of=fires", "--set:1:14: unknown measure `fires`"),
        ("mutation.rules=[grow]", "--set:1:17: invalid value"),
        ("model=nowhere.model", "nowhere.model`: there is no such file"),
        ("seed", "--set:1:1: a setting must be `key=value`"),
        ("seed.x=3", "--set:1:1: `seed` is not a table"),
        ("seed=1\nname='x'", "a setting must be `key=value`"),
        ("", "a setting must be `key=value`"),
        ("=3", "--set:1:1: "),
    ],
)  # fmt: skip
def test_mistake_in_an_override_is_reported(override: str, message: str) -> None:
    with pytest.raises(LoadError) as caught:
        Domain.load("burning_forest/paper.toml", overrides=[override])
    assert message in str(caught.value).replace("\n", " ")
    assert all(one.span and one.span.source.name == "--set" for one in caught.value.diagnostics)


def test_every_stored_individual_is_valid_and_reproduced_by_its_trace(whole: tuple[Path, Family]) -> None:
    path, _ = whole
    domain = Domain.load("burning_forest/paper.toml")
    with RunStore.open(path) as store:
        individuals = list(store.individuals())
        assert len(individuals) > 50
        for individual in individuals[::7]:
            engine = domain.engine()
            for ancestor in store.lineage(individual.id):
                engine.replay(ancestor.trace)
            assert f"{engine.model.state_hash():016x}" == individual.state_hash
            assert domain.problem(engine).is_valid()
            assert domain.problem(engine).compute_measures() == individual.measures


def fail(*_: object) -> None:
    raise KeyboardInterrupt


def test_family_of_an_unfinished_run_is_its_last_generation(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "run.sqlite"
    monkeypatch.setattr(RunStore, "write_models", fail)  # which is what comes last
    with pytest.raises(KeyboardInterrupt):
        generate("burning_forest/paper.toml", path, generations=3, population=4)
    monkeypatch.undo()
    assert export_ga4cl(open_family(path)) == export_ga4cl(
        generate("burning_forest/paper.toml", tmp_path / "b.sqlite", generations=3, population=4)
    )


def test_a_family_file_holds_the_whole_family(family: Family, tmp_path: Path) -> None:
    path = tmp_path / "family.json"
    path.write_text(write_family(family))
    again = read_family(path)
    assert export_ga4cl(again) == export_ga4cl(family)
    assert write_family(again) == write_family(family)
    assert again.keys == family.keys


@pytest.mark.parametrize(
    "text",
    [
        "",
        "[]",
        "{}",
        '{"format": "other"}',
        '{"format": "envgraph-family-1", "name": 3}',
        "\x00",
        "[[[[",
        "nul",
    ],
)
def test_files_that_are_no_family_are_refused_with_a_position(tmp_path: Path, text: str) -> None:
    path = tmp_path / "bad.json"
    path.write_text(text)
    with pytest.raises(LoadError) as caught:
        read_family(path)
    (problem,) = caught.value.diagnostics
    assert problem.span is not None


def test_a_missing_family_file_is_a_diagnostic(tmp_path: Path) -> None:
    with pytest.raises(LoadError, match="there is no such file"):
        read_family(tmp_path / "missing.json")


def copied(tmp_path: Path, **changes: tuple[str, str]) -> Path:
    """The bundled domain in a directory of its own, with texts replaced."""
    from envgraph.lang import bundled_domain

    for file in bundled_domain("burning_forest").glob("*.*"):
        text = file.read_text()
        changed = file.suffix != ".toml" or file.name == "paper.toml"
        before, after = changes.get(file.suffix.removeprefix("."), ("", "")) if changed else ("", "")
        assert before in text
        (tmp_path / file.name).write_text(text.replace(before, after) if before else text)
    return tmp_path / "paper.toml"


def test_initial_model_that_violates_a_constraint_is_refused_before_the_run(tmp_path: Path) -> None:
    path = copied(tmp_path, toml=("forbid = []", 'forbid = ["burningTile"]'))
    with pytest.raises(LoadError) as caught:
        generate(str(path), tmp_path / "run.sqlite")
    (problem,) = caught.value.diagnostics
    assert "violates `forbid burningTile`" in problem.message
    assert problem.span is not None and problem.span.text == '"burningTile"'
    assert not (tmp_path / "run.sqlite").exists()


def test_all_wrong_options_of_components_are_reported_with_positions(tmp_path: Path) -> None:
    path = copied(
        tmp_path,
        toml=(
            "rounds = 500, initial_temperature = 0.1, cooling_rate = 0.95",
            'rounds = "many", cooling_rte = 0.9',
        ),
    )
    with pytest.raises(LoadError) as caught:
        Domain.load(str(path))
    messages = [problem.message for problem in caught.value.diagnostics]
    assert messages == [
        "`rounds` must be a whole number, not a string",
        "unknown key `cooling_rte` in `[search.survivors]`",
    ]
    assert all(problem.span for problem in caught.value.diagnostics)
    assert "cooling_rate" in str(caught.value)


def test_too_many_bins_are_refused(tmp_path: Path) -> None:
    path = copied(tmp_path, toml=('kind = "binned_entropy"', 'kind = "binned_entropy"\nbins = 1000000000'))
    with pytest.raises(LoadError) as caught:
        Domain.load(str(path))
    (problem,) = caught.value.diagnostics
    assert problem.message == "`bins` is 1000000000, but must be at most 100,000"
    assert problem.span and problem.span.text == "1000000000" and "ENVGRAPH_LIMITS" in str(problem.hint)


HUGE = str(10**18)


@pytest.mark.parametrize(
    ("domain", "settings"),
    [
        (
            "burning_forest/paper.toml",
            "limit={} mutation.initial_applications={} mutation.max_attempts={} search.population={} "
            "search.generations={} search.stagnation={} samples.count={} samples.attempts={} "
            "training.steps_per_environment={} training.evaluation_episodes={} training.seeds={} training.n_step={}",
        ),
        (
            "burning_forest/paper.toml",
            "search.parents={name='tournament',rounds={}} search.survivors.rounds={}",
        ),
        ("burning_forest/paper.toml", "search.survivors={name='beam',width={}}"),
        ("burning_forest/paper.toml", "search.survivors={name='exact',limit={}}"),
        ("assignment", "optimise.steps={} optimise.strategy={name='simulated_annealing',runs={}}"),
        ("assignment", "optimise.strategy={name='hill_climbing',patience={}}"),
        ("assignment", "optimise.strategy={name='beam',width={},branching={}}"),
        ("assignment", "optimise.strategy={name='tree_search',length={}}"),
    ],
)
def test_every_number_of_a_family_file_has_a_limit(domain: str, settings: str) -> None:
    with pytest.raises(LoadError) as caught:
        Domain.load(domain, overrides=settings.replace("{}", HUGE).split())
    problems = [one for one in caught.value.diagnostics if one.code == "bad-range"]
    assert [one.span.text for one in problems if one.span] == [HUGE] * settings.count("{}")
    assert all(HUGE in one.message and "ENVGRAPH_LIMITS" in str(one.hint) for one in problems)


def test_search_stops_at_its_target_or_by_stagnation(tmp_path: Path) -> None:
    (tmp_path / "a").mkdir()
    target = copied(tmp_path / "a", toml=("generations = 1000", "generations = 1000\ntarget = 1.0"))
    family = generate(str(target), tmp_path / "a.sqlite")
    with RunStore.open(tmp_path / "a.sqlite") as store:
        history = store.generation_statistics()
    assert history[-1][1] >= 1.0 > history[-2][1] and family.diversity() >= 1.0
    (tmp_path / "b").mkdir()
    stagnation = copied(tmp_path / "b", toml=("generations = 1000", "generations = 1000\nstagnation = 7"))
    generate(str(stagnation), tmp_path / "b.sqlite")
    with RunStore.open(tmp_path / "b.sqlite") as store:
        scores = [row[1] for row in store.generation_statistics()]
    assert len(scores) < 1000 and len(set(scores[-8:])) == 1


class Fires:
    """A measure that only a program knows."""

    def evaluate(self, engine: Engine) -> float:
        return engine.count("burningTile") / 64


def test_custom_measure_is_used_by_generation_and_by_opening_the_family(tmp_path: Path) -> None:
    path = copied(tmp_path, toml=('[diversity]\nkind = "binned_entropy"', '[diversity]\nkind = "mine"'))
    components = Components().with_("measure", "fires", lambda options, context: Fires())
    components = components.with_("diversity", "mine", lambda options, context: Variance())
    path.write_text(
        path.read_text().replace('of = "complexity"', 'of = "fires"') + '\n[measures.fires]\nkind = "fires"\n'
    )
    family = generate(str(path), tmp_path / "run.sqlite", components=components, **SMALL)
    again = open_family(tmp_path / "run.sqlite", components=components)
    assert again == family and all("fires" in member.measures for member in again.members)
    with pytest.raises(LoadError, match="unknown kind of measure `fires`"):
        open_family(tmp_path / "run.sqlite")


def test_overrides_of_a_run_are_stored_in_its_family(tmp_path: Path) -> None:
    generate("burning_forest/paper.toml", tmp_path / "run.sqlite", seed=5, **SMALL)
    family = open_family(tmp_path / "run.sqlite")
    spec = family.domain.spec
    assert (spec.seed, spec.search.generations, spec.search.population) == (5, 25, 4)
    (tmp_path / "family.json").write_text(write_family(family))
    assert read_family(tmp_path / "family.json").domain.spec == spec
    with RunStore.open(tmp_path / "run.sqlite") as store:
        assert family.diversity() == store.generation_statistics()[-1][1]


def test_a_store_is_overwritten_only_on_request(tmp_path: Path) -> None:
    path = tmp_path / "run.sqlite"
    first = generate("burning_forest/paper.toml", path, generations=1)
    with pytest.raises(InvalidArgument, match=r"exists already[^`]*`overwrite=True`[^`]*`resume`"):
        generate("burning_forest/paper.toml", path, generations=1, population=3, seed=2)
    assert len(first.members) == 6 and open_family(path).members == first.members
    generate("burning_forest/paper.toml", path, generations=1, population=3, seed=2, overwrite=True)
    assert len(open_family(path).members) == 3
    with RunStore.open(path) as store:
        assert "seed=2" in store.overrides


GENERATE = """
import sys
from pathlib import Path
from envgraph.search import export_ga4cl, generate
family = generate("burning_forest/paper.toml", Path(sys.argv[1]), generations=8, population=4)
sys.stdout.write(export_ga4cl(family))
"""


def test_the_result_does_not_depend_on_the_hash_seed_of_the_process(tmp_path: Path) -> None:
    """Strings hash differently in every process: no set or dict of them may decide anything."""
    paths = [tmp_path / "1.sqlite", tmp_path / "2.sqlite"]
    exports = [
        subprocess.run(
            [sys.executable, "-c", GENERATE, str(path)],
            env={**os.environ, "PYTHONHASHSEED": path.stem},
            check=True,
            capture_output=True,
        ).stdout
        for path in paths
    ]
    assert exports[0] == exports[1]
    assert len(json.loads(exports[0])["environments"]) == 4
    with RunStore.open(paths[0]) as one, RunStore.open(paths[1]) as other:
        assert list(one.individuals()) == list(other.individuals())
        assert one.generation_statistics() == other.generation_statistics()


def test_options_of_components_are_checked_despite_other_mistakes(tmp_path: Path) -> None:
    path = copied(tmp_path, toml=("forbid = []", 'forbid = ["nothing"]'))
    text = path.read_text()
    for before, after in (("rounds = 500", "rounds = -1"), ('transform = "sqrt"', 'transform = "cube"')):
        assert before in text
        text = text.replace(before, after)
    path.write_text(text)
    with pytest.raises(LoadError) as caught:
        Domain.load(str(path))
    told = {problem.message: problem.hint or "" for problem in caught.value.diagnostics}
    assert told.pop("unknown pattern `nothing`").startswith("there are `")
    assert set(told.items()) == {
        ("`transform` cannot be `cube`", "use one of `sqrt`, `linear`"),
        ("`rounds` is -1, but must be at least 0", "write `rounds = 0` or more, or leave it out"),
    }


def test_a_path_may_name_a_reference_with_its_class(tmp_path: Path) -> None:
    plain = Domain.load(str(copied(tmp_path)))
    (tmp_path / "b").mkdir()
    qualified = ('along = ["right", "down"]', 'along = ["Tile.right", "Tile.down"]')
    other = Domain.load(str(copied(tmp_path / "b", toml=qualified)))
    values = [
        domain.problem(domain.engine()).measures["complexity"].evaluate(domain.engine()) for domain in (plain, other)
    ]
    assert values[0] == values[1] < 1.0


def test_declared_functions_are_components(tmp_path: Path) -> None:
    source = data_path("rules", "keydoor")
    for file in source.glob("*.*"):
        text = file.read_text(encoding="utf-8")
        if file.name == "keydoor.query":
            text += "\nfunction far(x : int) : bool;\n"
            text += "pattern farRight(hero : Hero) { Hero.at(hero, p); check(far(p.x)); }\n"
        (tmp_path / file.name).write_text(text, encoding="utf-8")
    mine = Components().with_("function", "far", lambda x: x >= 0)
    engine = Domain.load(str(tmp_path), mine).engine()
    assert engine.count("farRight") == 1


HERD = {
    "herd.metamodel": """
        metamodel herd
        class Farm { contains Cow[*] cows }
        @key(number) class Cow { int number  bool milked }
    """,
    "herd.model": """
        import "herd.metamodel"
        model herd : herd { farm : Farm { cows = [Cow { number = 1 }, Cow { number = 2 }] } }
    """,
    "herd.query": """
        import "herd.metamodel"
        pattern cow(cow : Cow) { Cow(cow); }
        pattern thirsty(cow : Cow) { Cow.milked(cow, false); }
    """,
    "herd.rules": """
        import "herd.query"
        rule milk(cow : Cow) { lhs { find thirsty(cow); } modify { set cow.milked = true; } }
        rule calve { lhs { farm : Farm; } modify { create farm -cows-> calf : Cow; } }
    """,
    "herd.environment": """
        import "herd.rules"
        environment Herd(farm : Farm) {
            action milk(cow : Cow) = milk(cow)
            on neg find thirsty(_) terminate success
            observe cow.milked for cow : Cow
        }
    """,
    "family.toml": """
        model = "herd.model"
        environment = "herd.environment"
        constraints.reachable = ["success"]
        measures.cows = { kind = "count", of = "cow" }
        diversity = { kind = "binned_entropy", range = [2, 5] }
        mutation.rules = ["calve"]
        search = { population = 3, generations = 5 }
    """,
}


def herd(folder: Path, *changes: tuple[str, str]) -> str:
    """The farm in a directory, with words of its files replaced."""
    for name, text in HERD.items():
        for before, after in changes:
            text = text.replace(before, after)
        (folder / name).write_text(text, encoding="utf-8")
    return str(folder)


def herd_with_value_measure(folder: Path, bodies: str, options: str = "") -> str:
    """The farm, measured by what a pattern computes."""
    measure = f'measures.sum = {{ kind = "value", of = "total"{options} }}\n        measures.cows ='
    path = herd(folder, ("measures.cows =", measure), ('{ kind = "binned', '{ of = "cows", kind = "binned'))
    with (folder / "herd.query").open("a", encoding="utf-8") as file:
        file.write(f"\npattern total(cow : Cow, n : int, share : float) {bodies}\n")
    return path


def test_value_measure_reads_the_number_computed_by_a_pattern(tmp_path: Path) -> None:
    folder = herd_with_value_measure(
        tmp_path,
        "{ Cow.number(cow, 1); n == count Cow(_); share == eval(n / 4.0); }",
        ', parameter = "share"',
    )
    domain = Domain.load(folder)
    engine = domain.engine()
    assert domain.problem(engine).compute_measures() == {"sum": 0.5, "cows": 2.0}
    engine.apply("calve")
    assert domain.problem(engine).compute_measures()["sum"] == 0.75


@pytest.mark.parametrize("body", ["Cow.number(cow, 9);", "Cow(cow);"], ids=["no match", "several"])
def test_value_measure_without_exactly_one_match_has_no_value(tmp_path: Path, body: str) -> None:
    bodies = f"{{ {body} n == count Cow(_); share == 0.5; }}"
    domain = Domain.load(herd_with_value_measure(tmp_path, bodies, ', parameter = "n", otherwise = 7'))
    assert domain.problem(domain.engine()).compute_measures()["sum"] == 7
    domain = Domain.load(herd_with_value_measure(tmp_path, bodies, ', parameter = "n"'))
    with pytest.raises(EvaluationError, match="the model has no value of `sum`"):
        domain.problem(domain.engine()).compute_measures()


def test_models_with_duplicate_keys_are_rejected_as_members(tmp_path: Path) -> None:
    family = generate(herd(tmp_path), tmp_path / "run.sqlite", seed=1)
    assert {member.measures["cows"] for member in family.members} == {
        2,
        3,
    }  # one calf: a second is a 0 as well
    assert family.keys.size("Cow") == 3


def test_duplicate_keys_are_refused_in_the_initial_model(tmp_path: Path) -> None:
    where = herd(tmp_path, ("number = 2", "number = 1"))
    with pytest.raises(LoadError, match="`Cow#1` and `Cow#2` have the same key, number = 1") as caught:
        generate(where, tmp_path / "run.sqlite")
    assert caught.value.diagnostics[0].hint
    where = herd(tmp_path, ("[Cow { number = 1 }, Cow {", "[one : Cow { number = 2 }, two : Cow {"))
    with pytest.raises(LoadError, match="`one` and `two` have the same key, number = 2") as caught:
        generate(where, tmp_path / "run.sqlite")
    (found,) = caught.value.diagnostics
    places = [found.span, found.notes[0].span]
    assert [place and (place.source.name.endswith("herd.model"), place.text) for place in places] == [
        (True, "two"),
        (True, "one"),
    ]


def test_parameter_without_its_object_in_the_initial_model_is_refused(tmp_path: Path) -> None:
    where = herd(tmp_path, ("farm : Farm)", "farm : Farm, leader : Cow)"), ('["success"]', "[]"))
    with pytest.raises(LoadError, match="cannot bind parameter `leader`: the model has 2 objects") as caught:
        generate(where, tmp_path / "run.sqlite")
    (problem,) = caught.value.diagnostics
    assert problem.span is not None and problem.span.source.name.endswith("herd.environment")
    texts = [note.span.text for note in problem.notes if note.span is not None]
    assert texts == ["Cow", "Cow", '"herd.model"']


def test_model_without_the_object_of_a_parameter_is_rejected_as_a_member(tmp_path: Path) -> None:
    one_cow = (
        (", Cow { number = 2 }", ""),
        ("farm : Farm)", "farm : Farm, leader : Cow)"),
        ('["success"]', "[]"),
    )
    family = generate(herd(tmp_path, *one_cow), tmp_path / "run.sqlite")
    assert [member.measures["cows"] for member in family.members] == [1]
    with RunStore.open(tmp_path / "run.sqlite") as store:
        assert "`each parameter of the environment has its object` is violated" in store.rejection_counts()


@pytest.mark.parametrize(
    ("names", "changes", "called"),
    [
        (("Emma", "Lisa"), (), "Emma"),
        (("Cow1", "Lisa"), (), "Lisa"),
        (("Cow1", "Cow2"), (), None),
        (("Emma", "Lisa"), (("derive", "@weight(delete = 0) derive"),), None),
    ],
)
def test_operators_that_create_objects_with_other_keys_give_a_warning(
    tmp_path: Path, names: tuple[str, str], changes: tuple[tuple[str, str], ...], called: str | None
) -> None:
    """Only where they create and delete, and where the environment counts through the objects."""
    one, other = names
    calve = "rule calve { lhs { farm : Farm; } modify { create farm -cows-> calf : Cow; } }"
    string = (
        ("int number ", "string number "),
        ("number = 1", f'number = "{one}"'),
        ("number = 2", f'number = "{other}"'),
        (calve, "derive cows = operators for Cow;"),
        ('"calve"', '"cows"'),
    )
    found = Domain.load(herd(tmp_path, *string, *changes)).check_initial()
    assert [problem.code for problem in found] == ["other-names"] * (called is not None)
    for problem in found:
        assert problem.span is not None and f"may delete `{called}`" in problem.message
        assert problem.span.source.name.endswith("herd.model") and problem.hint and "`Cow1`" in problem.hint


def test_search_applies_only_the_named_rule_of_a_group(tmp_path: Path) -> None:
    calve = "rule calve { lhs { farm : Farm; } modify { create farm -cows-> calf : Cow; } }"
    changes = ((calve, "derive cows = operators for Cow;"), ('"calve"', '"cows.create.Cow.cows"'))
    family = generate(herd(tmp_path, *changes), tmp_path / "run.sqlite")
    cows = [member.measures["cows"] for member in family.members]
    assert min(cows) == 2 and max(cows) > 2


@pytest.mark.parametrize(("together", "cows"), [("agents together", [2]), ("", [2, 3])])
def test_members_may_differ_in_their_agents_only_if_agents_take_turns(
    tmp_path: Path, together: str, cows: list[int]
) -> None:
    acting = f"{together} agent cow : Cow {{ action milk = milk(cow) }}"
    changes = ("action milk(cow : Cow) = milk(cow)", acting), ("cow.milked for cow", "other.milked for other")
    family = generate(herd(tmp_path, *changes), tmp_path / "run.sqlite")
    assert sorted({member.measures["cows"] for member in family.members}) == cows
    with RunStore.open(tmp_path / "run.sqlite") as store:
        reason = "`agents that act together are those of the initial model` is violated"
        assert (reason in store.rejection_counts()) == bool(together)


def test_the_tree_of_changes_has_the_lineage_of_each_member(whole: tuple[Path, Family]) -> None:
    path, family = whole
    with RunStore.open(path) as store:
        root = lineage_tree(store, family)
        rules = {
            one.name: [step.rule for step in lineage(store, family.domain, one.individual or 0)]
            for one in family.members
        }
    found: dict[str, list[str]] = {}

    def walk(branch: LineageBranch, before: list[str]) -> None:
        changes = [*before, *branch.changes]
        found.update(dict.fromkeys(branch.members, changes))
        assert branch.members or len(branch.branches) != 1
        for one in branch.branches:
            walk(one, changes)

    walk(root, [])
    assert {name: [text.partition(":")[0] for text in texts] for name, texts in found.items()} == {
        name: [rule.partition(".")[2] for rule in texts] for name, texts in rules.items()
    }
