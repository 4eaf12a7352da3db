"""Family files with an objective: from the text to a run and back."""

from collections.abc import Callable, Sequence
from contextlib import suppress
from importlib.util import find_spec
from pathlib import Path
from shutil import copytree

import numpy as np
import pytest
from numpy.typing import NDArray

from envgraph.env.registration import BUNDLED
from envgraph.errors import LIMITS, InvalidArgument, LoadError, Severity
from envgraph.lang import data_path, load_workspace
from envgraph.report import family_report
from envgraph.search import (
    Components,
    Domain,
    Family,
    Outcome,
    RunStore,
    curricula,
    generate,
    open_family,
    read_family,
    resume,
    write_family,
)
from envgraph.solve import evaluate
from envgraph.solve.learning import TrainingSettings, train_curriculum
from tests.profile import AT_NIGHT

FILE = str(data_path("rules", "burning_forest", "teaching.toml"))
SHORT = ["objective.effort=1_000_000", "objective.steps=300", "objective.lanes=2", "search.population=3"]
needs_numba = pytest.mark.skipif(find_spec("numba") is None, reason="numba, the extra `fast`, is not installed")


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Family]:
    """A run that has ended, and its family."""
    path = tmp_path_factory.mktemp("whole") / "run.sqlite"
    return path, generate(FILE, path, overrides=SHORT)


@needs_numba
def test_run_keeps_members_in_the_order_found_by_the_search(tmp_path: Path) -> None:
    told = []
    overrides = [*SHORT, "search.population=6"]
    family = generate(FILE, tmp_path / "run.sqlite", overrides=overrides, climbing=told.append)
    assert told
    assert [member.name for member in family.members] == ["E1", "E2", "E3", "E4", "E5", "E6"]
    assert [member.initial for member in family.members] == [False] * 5 + [True]
    outcome = Outcome.of(family)
    assert outcome.diversity == pytest.approx(outcome.maximum)
    sentence = "0.0% of new learners solve E6 after 1,800 steps in all, 0.0% after as many steps on E6 alone"
    assert str(outcome).startswith(f"{sentence}, diversity 2.585 of 2.585 bits")
    again = open_family(str(tmp_path))
    assert (again.members, again.value) == (family.members, family.value)
    assert "In the order that the search found; the target E6" in family_report(family).summary
    file = tmp_path / "family.json"
    file.write_text(write_family(family))
    assert [one.model for one in read_family(file).members] == [one.model for one in family.members]


@needs_numba
def test_resuming_an_interrupted_search_starts_it_again(tmp_path: Path, whole: tuple[Path, Family]) -> None:
    def interrupt(progress: curricula.CurriculumProgress) -> None:
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        generate(FILE, tmp_path / "run.sqlite", overrides=SHORT, climbing=interrupt)
    with pytest.raises(InvalidArgument, match="--resume"):
        open_family(tmp_path / "run.sqlite")
    assert resume(tmp_path / "run.sqlite", workers=2).members == whole[1].members


def test_custom_objective_can_be_registered(tmp_path: Path) -> None:
    class Easy:
        """Families whose members are close to complexity 0."""

        drawn, most, effort = False, 0.0, 100

        def scores(self, family: Sequence[curricula.ModelLevel], seeds: range) -> NDArray[np.float64]:
            total = sum(level.measures["complexity"] for level in family[:-1])
            return np.full((1, len(seeds)), -total)

    mine = Components().with_("objective", "mine", lambda options, context: lambda levels, workers: Easy())
    overrides = ['objective={ kind = "mine", effort = 3_000_000 }', "search.population=3"]
    family = generate(FILE, tmp_path / "run.sqlite", overrides=overrides, components=mine)
    assert family.value == pytest.approx(-sum(one.measures["complexity"] for one in family.members[:-1]))


def test_a_file_of_a_bundled_domain_has_a_short_name(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    assert Domain.load("burning_forest/teaching.toml").spec.name == "BurningForestDiverseTeaching"
    assert Domain.load("burning_forest/budgets.toml").spec.name == "BurningForestBudgets"
    assert Domain.load("burning_forest/paper.toml").spec.name == "BurningForest"
    assert Domain.load("keydoor/diverse.toml").spec.name == "KeyDoor"
    assert not load_workspace(["burning_forest/teaching.toml"]).diagnostics
    with pytest.raises(LoadError, match=r"did you mean `teaching[.]toml`"):
        Domain.load("burning_forest/teachin.toml")
    (tmp_path / "burning_forest").mkdir()
    with pytest.raises(LoadError, match="no such file"):
        Domain.load("burning_forest/teaching.toml")


@pytest.mark.parametrize("name", [file.partition("/")[0] for _, file, _, _ in BUNDLED])
def test_teaching_file_of_each_bundled_domain_has_a_learning_objective(name: str) -> None:
    teaching = Domain.load(name)
    diverse = Domain.load(f"{name}/{'paper' if name == 'burning_forest' else 'diverse'}.toml")
    assert teaching.spec.objective is not None and str(teaching.spec.objective.kind) == "learning"
    assert diverse.spec.objective is None
    assert teaching.spec.name != diverse.spec.name


@pytest.mark.parametrize(
    ("override", "code", "hint"),
    [
        ('objective.kind="learnin"', "unknown-component", "did you mean `learning`?"),
        ("objective.stepz=3", "unknown-key", "did you mean `steps`?"),
        ("objective.steps=0", "wrong-type", "write `steps = [2000]`"),
        ('objective.steps=[1, "a"]', "wrong-type", "write `steps = [2000]`"),
        ('objective.begin="walk"', "unknown-choice", "use one of `auto`, `easing`, `episode`"),
        ('objective.diversity="most"', "wrong-type", 'write `diversity = "maximum"`'),
        ("objective.lanes=0", "bad-range", "write `lanes = 1` or more"),
        ("objective.effort=0", "bad-range", "write another number"),
        (
            "search.population=1",
            "bad-objective",
            "write `population = 2` or more, and remove `keep_initial` and `initial`",
        ),
        ("search.keep_initial=false", "bad-objective", "write `population = 2` or more"),
        ('curriculum.initial="ordered"', "bad-objective", "remove `keep_initial` and `initial`"),
        ("objective.steps=[2000, 100_000_001]", "bad-range", "ENVGRAPH_LIMITS=10"),
        ("objective.enough=true", "wrong-type", "write `enough = 0.5`"),
    ],
)
def test_mistakes_in_an_objective_are_reported_with_a_hint(override: str, code: str, hint: str) -> None:
    with pytest.raises(LoadError) as failure:
        Domain.load(FILE, overrides=[override])
    (problem,) = (one for one in failure.value.diagnostics if one.severity is Severity.ERROR)
    assert problem.code == code
    assert problem.hint is not None and hint in problem.hint


def test_an_objective_needs_an_environment(tmp_path: Path) -> None:
    folder = tmp_path / "domain"
    copytree(data_path("rules", "burning_forest"), folder)
    file = folder / "teaching.toml"
    named, other = 'environment = "burning_forest.environment"', 'imports = ["burning_forest.rules"]'
    file.write_text(file.read_text().replace(named, other))
    with pytest.raises(LoadError) as failure:
        Domain.load(str(file))
    assert "needs an environment" in failure.value.diagnostics[0].message
    assert failure.value.diagnostics[0].span is not None


@needs_numba
def test_resuming_a_finished_run_does_not_search_again(whole: tuple[Path, Family]) -> None:
    path, family = whole
    told: list[object] = []
    assert resume(path, climbing=told.append).members == family.members
    assert not told


@AT_NIGHT
@needs_numba
def test_family_is_generated_for_a_target_with_too_many_states_for_a_table(tmp_path: Path) -> None:
    overrides = ['objective={ kind = "learning", steps = 100, effort = 4_000_000 }', "search.population=3"]
    family = generate("network/diverse.toml", tmp_path / "run.sqlite", overrides=overrides, workers=2)
    assert family.value is not None and 0.0 < family.value < 1.0
    again = generate("network/diverse.toml", tmp_path / "again.sqlite", overrides=overrides)
    assert (again.members, again.value) == (family.members, family.value)


@AT_NIGHT
@needs_numba
def test_family_of_network_models_teaches_more_than_the_target_alone(tmp_path: Path) -> None:
    family = generate("network/family.toml", tmp_path / "run.sqlite", overrides=["objective.effort=150_000_000"])
    tables = [family.explored(member).tabular for member in family.members]
    settings = TrainingSettings.from_spec(family.domain.spec.training, limit=family.limit)
    solved = [
        [
            evaluate(
                train_curriculum(some, settings, rng, steps=[3_000 // len(some)] * len(some)).q,
                tables[-1],
                1,
                settings.limit,
                rng,
            ).success_rate
            for rng in map(np.random.default_rng, range(20))
        ]
        for some in (tables, tables[-1:])
    ]
    assert np.mean(solved[0]) > 0.8 and np.mean(solved[1]) == 0.0


@needs_numba
@pytest.mark.parametrize(
    ("kind", "step", "message", "hint"),
    [
        ("chain_transfer", "", "more than 50 states", 'write `kind = "learning"`'),
        (
            "learning",
            " | 0.01: again()",
            "the unit `again`, which calls itself",
            "a table has at most 50 states",
        ),
    ],
)
def test_unusable_target_is_reported_before_the_run_is_created(
    kind: str, step: str, message: str, hint: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(LIMITS, "searched states", 50)
    folder = tmp_path / "domain"
    copytree(data_path("rules", "network"), folder)
    behaviour = folder / "network.environment"
    behaviour.write_text(behaviour.read_text().replace(": recover()", f": recover(){step}"))
    with (folder / "network.rules").open("a") as rules:
        rules.write("unit again { try { recover; again; } }\n")
    with pytest.raises(LoadError) as failure:
        generate(
            str(folder / "diverse.toml"),
            tmp_path / "run.sqlite",
            overrides=[f'objective={{ kind = "{kind}" }}'],
        )
    (problem,) = failure.value.diagnostics
    assert message in problem.message
    assert problem.hint is not None and hint in problem.hint
    assert problem.span is not None and problem.span.text == f'"{kind}"'
    assert not (tmp_path / "run.sqlite").exists()


@needs_numba
def test_target_with_too_many_observations_for_learners_is_reported_before_the_run(tmp_path: Path) -> None:
    folder = tmp_path / "domain"
    copytree(data_path("rules", "burning_forest"), folder)
    behaviour = folder / "burning_forest.environment"
    window = "    observe around truck 31 x 31\n    observe "
    behaviour.write_text(behaviour.read_text().replace("    observe ", window, 1))
    with pytest.raises(LoadError, match="observations, but a table can have at most") as failure:
        generate(str(folder / "teaching.toml"), tmp_path / "run.sqlite")
    (problem,) = failure.value.diagnostics
    assert problem.hint is not None and "observe less" in problem.hint
    assert problem.span is not None and problem.span.text == '"learning"'


@pytest.mark.parametrize(
    ("overrides", "message", "hint"),
    [
        (
            ["objective.diversity=2.6"],
            "the diversity of 6 members is at most 2.58496",
            'write `diversity = "maximum"`',
        ),
        (
            ['diversity={ kind = "variance", of = "complexity" }'],
            "the largest possible diversity by `variance` is unknown",
            "write a number",
        ),
    ],
)
def test_demanded_diversity_that_no_family_can_have_is_refused(
    tmp_path: Path, overrides: list[str], message: str, hint: str
) -> None:
    with pytest.raises(LoadError) as failure:
        generate(FILE, tmp_path / "run.sqlite", overrides=overrides)
    (problem,) = failure.value.diagnostics
    assert message in problem.message
    assert problem.span is not None
    assert problem.hint is not None and hint in problem.hint
    assert not (tmp_path / "run.sqlite").exists()


@needs_numba
def test_family_is_stored_completely_or_not_at_all(
    tmp_path: Path, whole: tuple[Path, Family], monkeypatch: pytest.MonkeyPatch
) -> None:
    """A run that ends at any commit of its store is gone on with, and comes to the same."""
    kept: dict[str, Callable[..., None]] = {
        "set_setting": RunStore.set_setting,
        "write_generation": RunStore.write_generation,
    }
    calls = 0

    def dying(name: str, at: int) -> Callable[..., None]:
        def write(store: RunStore, *arguments: object) -> None:
            nonlocal calls
            kept[name](store, *arguments)
            calls += 1
            if calls == at:
                raise KeyboardInterrupt

        return write

    for at in (1, 2):
        path, calls = tmp_path / f"{at}.sqlite", 0
        with monkeypatch.context() as patched:
            for name in kept:
                patched.setattr(RunStore, name, dying(name, at))
            with suppress(KeyboardInterrupt):
                generate(FILE, path, overrides=SHORT)
        found = resume(path)
        assert (found.members, found.value) == (whole[1].members, whole[1].value)


@needs_numba
def test_more_generations_are_refused_for_a_family_with_an_objective(whole: tuple[Path, Family]) -> None:
    path, _ = whole
    with pytest.raises(InvalidArgument, match="has an objective and thus no generations"):
        resume(path, generations=7)
    with RunStore.open(path) as store:
        assert not any("generations" in one for one in store.overrides)
