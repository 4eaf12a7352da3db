"""How diverse the family of a run is, why it is not more diverse, and what has no value."""

from __future__ import annotations

from math import inf, log2
from pathlib import Path

import pytest

from envgraph.errors import Diagnostic, LoadError
from envgraph.rewrite import Engine
from envgraph.search import Components, Domain, Family, Outcome, RunStore, check_domain, generate, why_low

METAMODEL = """
metamodel beds
class Garden { contains Bed[0..*] beds contains Nest nest }
class Bed { contains Flower[0..*] flowers refers Bed[0..1] next }
class Flower { }
class Nest { refers Bed bed }
"""
MODEL = """
import "beds.metamodel"
model start : beds {
    garden : Garden {
        beds = [
            a : Bed { next = b flowers = [ f : Flower, g : Flower ] },
            b : Bed { next = c },
            c : Bed
        ]
        nest = n : Nest { bed = c }
    }
}
"""
QUERIES = """
import "beds.metamodel"
pattern flower(flower : Flower) { Flower(flower); }
"""
RULES = """
import "beds.metamodel"
rule plant { lhs { bed : Bed; } modify { create bed -flowers-> new : Flower; } }
rule pick { lhs { bed : Bed -flowers-> flower; } modify { delete flower; } }
rule cut { lhs { bed : Bed -next-> other; } modify { delete bed -next-> other; } }
rule idle { lhs { bed : Bed -next-> bed; } modify { delete bed -next-> bed; } }
"""
FAMILY = """
name = "Beds"
model = "beds.model"
imports = ["beds.query", "beds.rules"]
seed = 3

[measures.flowers]
kind = "count"
of = "flower"
"""


@pytest.fixture
def beds(tmp_path: Path) -> Path:
    """A family file without diversity, mutation and search."""
    for kind, text in (("metamodel", METAMODEL), ("model", MODEL), ("query", QUERIES), ("rules", RULES)):
        (tmp_path / f"beds.{kind}").write_text(text)
    return tmp_path / "family.toml"


def evolved(path: Path, text: str, components: Components | None = None) -> tuple[Family, Diagnostic | None]:
    """The family, and why it is not more diverse."""
    path.write_text(FAMILY + text)
    store = path.parent / "run.sqlite"
    family = generate(str(path), store, components=components)
    with RunStore.open(store) as opened:
        return family, why_low(family, opened)


SEARCH = """
[search]
population = 4
generations = 60
"""


def test_a_run_stops_at_the_maximum(beds: Path) -> None:
    text = '[diversity]\nkind = "binned_entropy"\nrange = [0, 8]\n[mutation]\nrules = ["plant", "pick"]\n'
    family, low = evolved(beds, text + SEARCH)
    with RunStore.open(beds.parent / "run.sqlite") as store:
        scores = [row[1] for row in store.generation_statistics()]
    assert low is None and len(scores) < 60
    assert scores[-1] == 2.0 and max(scores[:-1]) < 2.0
    outcome = Outcome.of(family)
    assert (outcome.diversity, outcome.maximum, sorted(outcome.bins)) == (2.0, 2.0, [1, 2, 3, 4])
    assert family.members[-1].initial and outcome.bins[-1] == 2  # the target comes last
    assert str(outcome) == "diversity 2.000 of 2.000 bits, members in bins 1,3,4,2"


def test_samples_have_a_diversity_if_the_file_has_its_table(beds: Path) -> None:
    asked = '[mutation]\nrules = ["plant", "pick"]\n[samples]\ncount = 5\n'
    family, _ = evolved(beds, asked)
    assert family.domain.check_initial() == [] and str(Outcome.of(family)) == ""
    (beds.parent / "run.sqlite").unlink()
    family, _ = evolved(beds, "[diversity]\nrange = [0, 1]\n" + asked)
    assert str(Outcome.of(family)).startswith("diversity ")
    assert [one.code for one in family.domain.check_initial()] == ["outside-range"]


def test_run_without_a_target_continues_at_the_maximum_diversity(beds: Path) -> None:
    text = '[diversity]\nkind = "binned_entropy"\nrange = [0, 8]\n[mutation]\nrules = ["plant", "pick"]\n'
    evolved(beds, text + SEARCH + "target = false\n")
    with RunStore.open(beds.parent / "run.sqlite") as store:
        assert len(store.generation_statistics()) == 61


def test_bins_without_a_whole_number_do_not_count_in_the_maximum(beds: Path) -> None:
    text = '[diversity]\nkind = "binned_entropy"\nrange = [0, 2]\n[mutation]\nrules = ["plant", "pick"]\n'
    family, low = evolved(beds, text + SEARCH)
    assert low is None and Outcome.of(family).maximum == 1.5 < log2(4)


@pytest.mark.parametrize(
    ("text", "message", "hint"),
    [
        (  # the initial model has two flowers
            'range = [10, 20]\n[mutation]\nrules = ["plant"]\ninitial_applications = 1\nrate = 0.0',
            "`flowers` of 4 of 4 members is outside of the range 10 to 20, and counts in the first or last bin",
            "write `range = [2, 3]` in `[diversity]`: values were from 2 to 3",
        ),
        (
            'range = [0, 40]\n[mutation]\nrules = ["pick"]',
            "no model reached bins 2 to 4 (10 to 40) of `flowers`; ",
            "or write `range = [0, 2]` in `[diversity]`",
        ),
        (
            'range = [0, 4]\n[mutation]\nrules = ["pick", "cut"]\n[constraints]\ncount = { flower = "2..9" }',
            "because `count flower in 2..9` is violated",
            "loosen the constraints",
        ),
    ],
)
def test_reason_for_a_diversity_below_the_maximum_is_reported(beds: Path, text: str, message: str, hint: str) -> None:
    family, low = evolved(beds, f'[diversity]\nkind = "binned_entropy"\n{text}\n{SEARCH}')
    assert low is not None and low.span is not None and low.span.text == '"binned_entropy"'
    assert low.message.startswith("the diversity is below its maximum: ") and message in low.message
    assert hint in (low.hint or "")
    assert Outcome.of(family).diversity < Outcome.of(family).maximum


def test_too_small_family_is_reported_with_the_reason_for_rejections(beds: Path) -> None:
    _, low = evolved(beds, '[diversity]\nkind = "gini"\n[mutation]\nrules = ["idle"]\n' + SEARCH)
    assert low is not None and low.code == "small-family"
    assert "only 1 of 4 environments that satisfy the constraints were found" in low.message
    assert "because no rule could be applied" in low.message


def test_diversity_without_a_maximum_is_never_reported_as_low(beds: Path) -> None:
    family, low = evolved(beds, '[diversity]\nkind = "variance"\n[mutation]\nrules = ["plant"]\n' + SEARCH)
    assert low is None and Outcome.of(family).maximum == inf
    assert str(Outcome.of(family)).startswith("diversity ") and " of " not in str(Outcome.of(family))


# --- no value

WAY = """
[measures.way]
kind = "shortest_path"
from = "Nest"
to = "Nest"
along = ["bed", "next"]
"""
TO_NEST = """
[measures.way]
kind = "shortest_path"
from = "Bed"
to = "Nest"
along = ["next"]
"""
LONG = """
[measures.way]
kind = "shortest_path"
from = "Bed"
to = "Bed"
along = ["next"]
"""
ENTROPY = '[diversity]\nkind = "binned_entropy"\nof = "way"\nrange = [0, 4]\n[mutation]\nrules = ["cut", "plant"]\n'


def measured(beds: Path, measure: str) -> float:
    beds.write_text(FAMILY + measure + ENTROPY)
    domain = Domain.load(str(beds))
    engine = domain.engine()
    return domain.problem(engine).measures["way"].evaluate(engine)


def test_shortest_path_to_an_unreachable_object_is_infinite(beds: Path) -> None:
    assert measured(beds, TO_NEST) == inf
    assert measured(beds, LONG) == 2.0
    assert measured(beds, WAY) == 0.0  # it is both the start and the goal


def test_initial_model_without_a_value_of_a_measure_is_refused(beds: Path) -> None:
    beds.write_text(FAMILY + TO_NEST + ENTROPY)
    with pytest.raises(LoadError) as caught:
        generate(str(beds), beds.parent / "run.sqlite")
    (problem,) = caught.value.diagnostics
    assert problem.message == "the initial model has no value of `way`"
    assert problem.span is not None and problem.span.text == '"shortest_path"'
    assert problem.hint is not None and "otherwise = 0" in problem.hint
    assert not (beds.parent / "run.sqlite").exists()
    domain = Domain.load(str(beds))
    assert [*map(str, check_domain(domain.spec, domain.workspace))] == [str(problem)]


def test_otherwise_is_the_value_of_models_without_a_value(beds: Path) -> None:
    beds.write_text(FAMILY + TO_NEST + "otherwise = 4.5\n" + ENTROPY + SEARCH)
    family = generate(str(beds), beds.parent / "run.sqlite")
    assert {member.measures["way"] for member in family.members} == {4.5}


@pytest.mark.parametrize("value", ["inf", "nan", '"far"', "true", "[1]"])
def test_otherwise_value_that_is_not_a_finite_number_is_refused(beds: Path, value: str) -> None:
    beds.write_text(FAMILY + TO_NEST + f"otherwise = {value}\n" + ENTROPY)
    with pytest.raises(LoadError, match=r"`otherwise` (must be a number|is .*, but must be from)"):
        Domain.load(str(beds))


class Even:
    """A measure that models with an odd number of flowers have no value of."""

    def evaluate(self, engine: Engine) -> float:
        count = engine.count("flower")
        return inf if count % 2 else count


def test_model_without_a_value_is_rejected_and_the_reason_is_stored(beds: Path) -> None:
    components = Components().with_("measure", "even", lambda options, context: Even())
    text = '[diversity]\nkind = "binned_entropy"\nof = "even"\nrange = [0, 8]\n[mutation]\nrules = ["plant"]\n'
    family, _ = evolved(beds, '[measures.even]\nkind = "even"\n' + text + SEARCH, components)
    assert {member.measures["even"] % 2 for member in family.members} == {0.0}
    with RunStore.open(beds.parent / "run.sqlite") as store:
        assert store.rejection_counts()["the model has no value of `even`"] > 0
        assert all(one.measures["even"] % 2 == 0 for one in store.individuals())


def test_initial_value_outside_the_range_is_reported_at_the_start(beds: Path) -> None:
    beds.write_text(FAMILY + '[diversity]\nkind = "binned_entropy"\n[mutation]\nrules = ["plant"]\n' + SEARCH)
    told: list[Diagnostic] = []
    generate(str(beds), beds.parent / "run.sqlite", warn=told.extend)
    domain = Domain.load(str(beds))
    (problem,) = told
    assert [*map(str, check_domain(domain.spec, domain.workspace))] == [str(problem)]
    assert problem.severity == "warning"
    assert problem.message.startswith("`flowers` of the initial model is 2, outside of the range 0 to 1")
    assert problem.hint is not None and "`range = [0, 4]`" in problem.hint


def test_entropy_uses_the_range_that_a_measure_declares(beds: Path) -> None:
    class Mine(Even):
        range = (2.0, 10.0)

    components = Components().with_("measure", "even", lambda options, context: Mine())
    text = '[measures.even]\nkind = "even"\n[diversity]\nof = "even"\n[mutation]\nrules = ["plant"]\n'
    beds.write_text(FAMILY + text)
    diversity = Domain.load(str(beds), components).problem(Domain.load(str(beds), components).engine()).diversity
    assert (diversity.low, diversity.high) == (2.0, 10.0)  # type: ignore[attr-defined]
