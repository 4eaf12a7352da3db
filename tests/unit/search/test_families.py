"""Measures of families: what they say, by an independent computation, and families that are searched for by them."""

from __future__ import annotations

import json
from collections.abc import Callable, Sequence
from itertools import combinations, pairwise, permutations
from math import log, log2
from pathlib import Path
from typing import Any, TypeVar, cast

import pytest
from hypothesis import given, strategies as st
from numpy.random import default_rng

from envgraph.errors import EvaluationError, LoadError
from envgraph.graph import Model
from envgraph.metamodel import Attribute, Class, Metamodel, Reference, Scalar
from envgraph.search import (
    BeamSearch,
    Candidate,
    ComponentContext,
    Components,
    Domain,
    ExactSelection,
    FamilyCall,
    FamilyMeasure,
    HillClimbing,
    Outcome,
    Pool,
    RunStore,
    SimulatedAnnealing,
    generate,
    resume,
    why_low,
)
from envgraph.solve import chain_transfer

T = TypeVar("T")
LAMPS = Metamodel(
    "lamps",
    [Class("Lamp", features=(Attribute("on", Scalar.BOOL), Reference("next", "Lamp", 0, 1)))],
)


class Lamps:
    """A candidate: a ring of lamps, some of which are on."""

    def __init__(self, on: Sequence[bool]) -> None:
        self.on, self.state = on, hash(tuple(on))
        self.measures = {"lit": float(sum(on)), "complexity": float(sum(on)), "first": float(on[0])}
        self._kept: dict[object, object] = {}
        self.model = Model(LAMPS)
        nodes = [self.model.create("Lamp") for _ in on]
        for node, after, lit in zip(nodes, [*nodes[1:], nodes[0]], on, strict=True):
            node.on, node.next = lit, after

    def once(self, key: object, make: Callable[[], T]) -> T:
        if key not in self._kept:
            self._kept[key] = make()
        return cast(T, self._kept[key])


def family(*rings: Sequence[bool]) -> list[Candidate]:
    return cast("list[Candidate]", [Lamps(ring) for ring in rings])


rings = st.lists(st.lists(st.booleans(), min_size=4, max_size=4), min_size=2, max_size=6)
FAMILY = "burning_forest/paper.toml"


def measures_of(*texts: str) -> list[Any]:
    """Return measures of families by how a family file writes them."""
    objective = Domain.load(FAMILY, overrides=[f"objective.maximise={json.dumps(texts)}"]).objective()
    assert objective is not None
    return [measure for term in objective.measures for measure in term.measures.values()]


BINS = "complexity, 0, 4, 3"
UNORDERED = measures_of(
    f"entropy({BINS})", "gini(complexity)", "variance(complexity)", f"coverage({BINS})", f"fewest({BINS})",
    f"most({BINS})", "mean_distance", "least_distance", "distinct",
)  # fmt: skip
ORDERED = measures_of("evenness(complexity)", "rising(complexity)")


def named(measure: Any) -> str:
    return type(getattr(measure, "statistic", measure)).__name__


DISTANCES = measures_of("mean_distance", "least_distance")


@given(rings)
def test_mean_and_least_distance_consider_all_pairs_of_members(found: list[list[bool]]) -> None:
    apart = [sum(a != b for a, b in zip(one, other, strict=True)) for one, other in combinations(found, 2)]
    members = family(*found)
    mean, least = DISTANCES
    assert mean.score(members) == pytest.approx(sum(apart) / len(apart))
    assert least.score(members) == min(apart)
    assert least.score(members[:1]) == mean.score([]) == 0.0


DISTINCT = measures_of("distinct")[0]


@given(rings)
def test_isomorphic_members_do_not_count_as_distinct(found: list[list[bool]]) -> None:
    turned = [min(tuple(one[i:] + one[:i]) for i in range(4)) for one in found]  # a ring has no beginning
    assert DISTINCT.score(family(*found)) == len(set(turned)) / len(turned)


HALVES = measures_of(*(f"{name}(complexity, 0, 4, 2)" for name in ("coverage", "fewest", "most")))


@given(st.lists(st.floats(0, 4), min_size=2, max_size=7))
def test_bin_and_order_statistics_equal_their_definitions(values: list[float]) -> None:
    counts = [sum(low <= value < high for value in values) for low, high in ((0, 2), (2, 5))]
    coverage, fewest, most = (one.statistic for one in HALVES)
    evenness, rising = (one.statistic for one in ORDERED)
    assert coverage.score(values) == sum(count > 0 for count in counts) / 2
    assert (fewest.score(values), most.score(values)) == (min(counts), max(counts))
    steps = [abs(b - a) for a, b in pairwise(values)]
    assert rising.score(values) == sum(b >= a for a, b in pairwise(values)) / len(steps)
    shares = [step / sum(steps) for step in steps if sum(steps)]
    even = -sum(share * log(share) for share in shares if share)
    expected = even / log(len(steps)) if len(steps) > 1 else float(sum(steps) > 0)
    assert evenness.score(values) == pytest.approx(expected, abs=1e-9)
    assert evenness.score(values) == pytest.approx(evenness.score(values[::-1]))


@given(rings)
@pytest.mark.parametrize("measure", [*UNORDERED, *ORDERED], ids=named)
def test_family_measures_respect_bounds_and_declared_order_independence(measure: Any, found: list[list[bool]]) -> None:
    members = family(*found)
    score = measure.score(members)
    assert 0.0 <= score <= getattr(measure, "maximum", lambda size: 1e9)(len(members)) + 1e-9
    if measure in UNORDERED:
        others = [measure.score(list(one)) for one in list(permutations(members))[:24]]
        assert others == pytest.approx([score] * len(others))


@given(rings, rings, st.data())
@pytest.mark.parametrize("measure", [*UNORDERED, *ORDERED], ids=named)
def test_score_change_of_an_exchange_equals_the_difference_of_scores(
    measure: Any, found: list[list[bool]], others: list[list[bool]], data: st.DataObject
) -> None:
    pool = Pool(family(*found, *others), [measure], "lit", lambda one: (one.measures["first"],))
    inside, outside = list(range(len(found))), list(range(len(found), len(pool)))
    swaps = pool.all_swaps(inside)[0]
    for _ in range(3):
        out, into = data.draw(st.sampled_from(inside)), data.draw(st.sampled_from(outside))
        before = measure.score(pool.family_of(inside))
        inside[inside.index(out)], outside[outside.index(into)] = into, out
        after = measure.score(pool.family_of(inside))
        assert swaps.delta(out, into) == pytest.approx(after - before, abs=1e-9)
        swaps.swap(out, into)


# --- families of a file

BOTH = ['objective.maximise=["entropy(complexity)", "mean_distance"]', "search.population=4"]


def made(
    path: Path, *overrides: str, generations: int = 10, components: Components | None = None
) -> tuple[Domain, Outcome, dict[str, float]]:
    found = generate(FAMILY, path / "run.sqlite", overrides=overrides, generations=generations, components=components)
    return found.domain, Outcome.of(found), dict(found.violated_conditions)


def candidates(count: int) -> list[Candidate]:
    rng = default_rng(3)
    return family(*([bool(one < 0.5) for one in rng.random(4)] for _ in range(count)))


def pool_of(overrides: Sequence[str], members: Sequence[Candidate]) -> Pool:
    """Candidates whose measure `complexity` is a share of their lamps."""
    for one in members:
        cast(Lamps, one).measures["complexity"] = one.measures["lit"] / 4
    objective = Domain.load(FAMILY, overrides=overrides).objective()
    assert objective is not None
    return Pool(members, objective.measures, "complexity", lambda one: (one.measures["complexity"],))


OBJECTIVES = [
    BOTH,
    ['objective.maximise=["mean_distance"]', 'objective.subject_to=["entropy(complexity, 0, 1, 4) >= 1.5"]'],
    ['objective.maximise=["2 * evenness(complexity) - gini(complexity)", "least_distance"]'],
    [
        'objective.minimise=["variance(complexity)"]',
        'objective.subject_to=["distinct == 1", "rising(complexity) >= 1"]',
    ],
]  # fmt: skip


@pytest.mark.parametrize("overrides", OBJECTIVES, ids=str)
def test_exact_selection_equals_brute_force_and_bounds_other_selections(overrides: list[str]) -> None:
    pool = pool_of(overrides, candidates(9))
    best = max(pool.ranking_key(one) for one in combinations(range(9), 4) if 0 in one)
    found = ExactSelection().select(pool, 4, [0], [0, 1, 2, 3], default_rng(0))
    assert pool.ranking_key(found) == best
    for selection in (SimulatedAnnealing(), HillClimbing(), BeamSearch()):
        other = selection.select(pool, 4, [0], [0, 1, 2, 3], default_rng(1))
        assert pool.ranking_key([0, 1, 2, 3]) <= pool.ranking_key(other) <= best


def test_selection_maximises_objectives_in_their_order() -> None:
    """By hand: of all families with the most entropy, the one with the greatest mean distance."""
    pool = pool_of(BOTH, candidates(10))
    families = [*combinations(range(10), 4)]

    def entropy(members: Sequence[int]) -> float:
        values = [pool.candidates[one].measures["complexity"] for one in members]
        shares = [sum(min(int(v * 4), 3) == one for v in values) / 4 for one in range(4)]
        return round(-sum(share * log2(share) for share in shares if share), 9)

    def apart(members: Sequence[int]) -> int:
        lamps = [cast(Lamps, pool.candidates[one]).on for one in members]
        return sum(int(a != b) for one, other in combinations(lamps, 2) for a, b in zip(one, other, strict=True))

    found = ExactSelection().select(pool, 4, [], [0, 1, 2, 3], default_rng(0))
    assert (entropy(found), apart(found)) == max((entropy(one), apart(one)) for one in families)


def test_family_stores_its_objective_values_and_is_determined_by_the_seed(tmp_path: Path) -> None:
    overrides = [*BOTH, 'objective.subject_to=["distinct >= 1"]']
    _, outcome, lacking = made(tmp_path / "a", *overrides)
    again = made(tmp_path / "b", *overrides)[1]
    assert (outcome.objective, outcome.bins) == (again.objective, again.bins)
    with RunStore.open(tmp_path / "a" / "run.sqlite") as store:
        found = resume(store.path, generations=11)
        assert why_low(found, store) is None or not lacking
    distances = found.distances()
    mean = sum(int(distances[a, b]) for a, b in combinations(range(4), 2)) / 6
    assert found.objective["mean_distance"] == pytest.approx(mean)
    assert list(found.objective) == ["entropy(complexity)", "mean_distance"] and not lacking
    assert str(Outcome.of(found)).startswith("entropy(complexity) ")


def test_unsatisfied_condition_of_an_objective_is_reported(tmp_path: Path) -> None:
    overrides = ['objective.maximise=["mean_distance"]', 'objective.subject_to=["mean_distance >= 1000"]']
    found = generate(FAMILY, tmp_path / "run.sqlite", overrides=overrides, generations=2)
    with RunStore.open(tmp_path / "run.sqlite") as store:
        warning = why_low(found, store)
    assert found.violated_conditions == {
        "mean_distance >= 1000": pytest.approx(1000 - found.objective["mean_distance"])
    }
    assert warning is not None and warning.code == "unsatisfied"


def test_chain_transfer_of_a_family_is_computed_from_its_tables(tmp_path: Path) -> None:
    overrides = ['objective.maximise=["chain_transfer"]', "search.population=3"]
    found = generate(FAMILY, tmp_path / "run.sqlite", overrides=overrides, generations=2)
    tables = [found.explored(one).tabular for one in found.members]
    assert found.objective["chain_transfer"] == pytest.approx(chain_transfer(tables))
    assert measures_of("chain_transfer")[0].maximum(3) == 0.0


class Lit:
    """A measure of one's own: fires in neighbours, by the models; it counts how it is asked."""

    def __init__(self, changing: bool) -> None:
        self.changed = 0
        if changing:
            self.change = self._change

    def score(self, members: Sequence[Candidate]) -> float:
        fires = [len(one.model.graph.extent("BurningTile")) for one in members]
        return float(sum(abs(a - b) for a, b in pairwise(fires)))

    def _change(self, members: Sequence[Candidate], leaving: int, entering: Candidate) -> float:
        self.changed += 1
        family = [entering if place == leaving else one for place, one in enumerate(members)]
        family.sort(key=lambda one: (one is members[-1], one.measures["complexity"]))
        return self.score(family) - self.score(members)


@pytest.mark.parametrize("changing", [False, True])
def test_custom_family_measure_receives_the_models_in_order(tmp_path: Path, changing: bool) -> None:
    mine, calls = Lit(changing), list[FamilyCall]()

    def factory(call: FamilyCall, context: ComponentContext) -> FamilyMeasure:
        calls.append(call)
        return mine

    components = Components().with_("family", "lit", factory)
    overrides = ['objective.maximise=["lit(complexity, 3) + 1"]', "search.population=4"]
    _, outcome, _ = made(tmp_path, *overrides, generations=5, components=components)
    assert str(calls[0]) == "lit(complexity, 3)" and outcome.objective["lit(complexity, 3) + 1"] > 1
    assert bool(mine.changed) == changing


def test_custom_family_measure_that_returns_no_number_is_reported(tmp_path: Path) -> None:
    class Wrong:
        def score(self, members: Sequence[Candidate]) -> float:
            return float("nan")

    components = Components().with_("family", "wrong", lambda call, context: Wrong())
    with pytest.raises(EvaluationError, match="measure of families `wrong` must return a number"):
        made(tmp_path, 'objective.maximise=["-wrong"]', generations=1, components=components)


CLIMBING = [
    'objective={ search = "climb", effort = 6e6, lanes = 2, maximise = ["entropy(complexity)", "mean_distance"] }',
    'objective.begin="easing"',
    "search.population=4",
]


def test_search_for_whole_families_uses_the_same_measures(tmp_path: Path) -> None:
    found = generate(FAMILY, tmp_path / "a.sqlite", overrides=CLIMBING)
    other = generate(FAMILY, tmp_path / "b.sqlite", overrides=CLIMBING, workers=2)
    assert (found.objective, found.members) == (other.objective, other.members)
    assert found.objective["entropy(complexity)"] == pytest.approx(found.diversity())
    assert found.diversity() > 1.4 and found.members[-1].initial
    assert found.objective["mean_distance"] == pytest.approx(found.distances().sum() / 12)


def test_conditions_take_precedence_over_the_objective(tmp_path: Path) -> None:
    wanted = 'objective={ kind = "chain_transfer", effort = 4_000_000, subject_to = ["least_distance >= 3"] }'
    found = generate(FAMILY, tmp_path / "a.sqlite", overrides=[wanted, "search.population=3"])
    assert list(found.objective) == ["chain_transfer"] and not found.violated_conditions
    distances = found.distances()
    assert min(int(distances[a, b]) for a, b in combinations(range(3), 2)) >= 3


@pytest.mark.parametrize(
    ("override", "message", "place"),
    [
        ('maximise=["entropi(complexity)"]', "unknown measure of families `entropi`", "entropi"),
        ('maximise=["entropy(komplexity)"]', "unknown measure `komplexity`", "entropy"),
        ('maximise=["1 + complexity"]', "unknown measure of families `complexity`", "complexity"),
        ('maximise=["entropy(complexity, 5)"]', "the numbers must be the lower and the upper end", "entropy"),
        ('maximise=["entropy(complexity + 1)"]', "the arguments of `entropy` must be names of measures", "entropy"),
        ('maximise=["gini"]', "`gini` takes exactly one measure", "gini"),
        ('maximise=["mean_distance(complexity)"]', "`mean_distance` takes no arguments", "mean_distance"),
        ('maximise=["mean_distance +"]', "unexpected", None),
        ('maximise=["distinct > 0"]', "expected `float`, found `bool`", None),
        ("maximise=[3]", "`maximise` must be a list of strings", None),
        ("maximise=3", "`maximise` must be a list of strings", None),
        ("maximise=[]", "the list of expressions is empty", None),
    ],
)  # fmt: skip
def test_mistakes_in_an_objective_are_reported_with_their_position(
    override: str, message: str, place: str | None
) -> None:
    with pytest.raises(LoadError) as error:
        Domain.load(FAMILY, overrides=[f"objective.{override}"])
    found = [one for one in error.value.diagnostics if message in one.message]
    assert found and found[0].hint, [str(one) for one in error.value.diagnostics]
    if place is not None:
        assert found[0].span is not None and found[0].span.text == place


@pytest.mark.parametrize(
    ("overrides", "message"),
    [
        (['objective.subject_to=["distinct >= 1"]'], "no `maximise`"),
        (['objective.maximise=["distinct"]', 'objective.minimise=["most(complexity)"]'], "cannot both be given"),
        (['objective.maximise=["distinct"]', 'objective.kind="learning"'], "cannot have both a kind and expressions"),
        (['objective.maximise=["distinct"]', 'objective.subject_to=["distinct"]'], "this is not a comparison"),
        (['objective.maximise=["distinct"]', 'objective.subjectto=["distinct >= 1"]'], "unknown key `subjectto`"),
        (['objective.maximize=["distinct"]'], "unknown key `maximize`"),
        (['objective={ maximise = ["distinct"], search = "climbing" }'], "`search` cannot be"),
        (['objective.maximise=["distinct"]', "objective.lanes=2"], "unknown key `lanes`"),
        (['objective.maximise=["distinct"]', "search.stagnation=3"], "`stagnation` refers to the diversity"),
    ],
)  # fmt: skip
def test_incompatible_keys_of_an_objective_are_reported(overrides: list[str], message: str) -> None:
    with pytest.raises(LoadError) as error:
        Domain.load(FAMILY, overrides=overrides)
    assert any(message in one.message and one.hint for one in error.value.diagnostics), str(error.value)


def test_all_mistakes_of_an_objective_are_reported_together() -> None:
    with pytest.raises(LoadError) as error:
        Domain.load(FAMILY, overrides=['objective.maximise=["foo", "bar", "distinct"]'])
    assert len(error.value.diagnostics) == 2


def test_mistake_in_a_condition_of_a_learning_objective_is_reported_once(tmp_path: Path) -> None:
    with pytest.raises(LoadError) as error:
        wanted = 'objective={ kind = "learning", subject_to = ["foo >= 2"] }'
        generate(FAMILY, tmp_path / "a.sqlite", overrides=[wanted])
    assert [one.message for one in error.value.diagnostics] == ["unknown measure of families `foo`"]
