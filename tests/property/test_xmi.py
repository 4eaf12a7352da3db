"""Random metamodels through `.ecore`, random models through `.xmi`, and slips of the keyboard in both."""

from __future__ import annotations

from pathlib import Path
from time import process_time

from hypothesis import assume, given, settings, strategies as st

from envgraph.errors import InvalidArgument, Source
from envgraph.graph import Model, model_to_xmi
from envgraph.lang import TextFiles, load_workspace
from envgraph.metamodel import Metamodel, metamodel_to_ecore
from tests.property.strategies import metamodels, models
from tests.property.test_bad_input import SECONDS, SLIPS, Slip, assert_placed, slipped
from tests.reading import parse_ecore, parse_xmi

DATA = Path(__file__).parents[1] / "data" / "emf"
TEXTS = {path.name: path.read_text("utf-8") for path in sorted(DATA.iterdir())}


@given(metamodels())
def test_metamodel_is_restored_from_its_ecore_text(metamodel: Metamodel) -> None:
    text = metamodel_to_ecore(metamodel)
    assume("\ud800" not in text)
    again = parse_ecore(Source("m.ecore", text))
    assert (again.name, again.class_list, again.enum_types) == (
        metamodel.name,
        metamodel.class_list,
        metamodel.enum_types,
    )
    assert metamodel_to_ecore(again) == text


@given(models())
def test_model_is_restored_from_its_xmi_text(model: Model) -> None:
    try:
        text = model_to_xmi(model)
    except InvalidArgument:
        return  # a string with a character that XML does not have
    again = parse_xmi(Source("m.xmi", text), model.metamodel)
    again.check_integrity()
    assert again.canonical_hash() == model.canonical_hash()
    assert sorted(filter(None, map(again.graph.object_name, again.graph.store.nodes()))) == sorted(
        filter(None, map(model.graph.object_name, model.graph.store.nodes()))
    )
    # Every order of links, and the places of all objects, are in the text.
    assert model_to_xmi(again) == text


@settings(deadline=None)
@given(st.sampled_from(sorted(TEXTS)), SLIPS)
def test_random_typos_in_ecore_and_xmi_are_reported_quickly_with_positions(name: str, slips: list[Slip]) -> None:
    texts = {**TEXTS, name: slipped(TEXTS[name], slips)}
    started = process_time()
    files = [f"{name.partition('.')[0]}.{ending}" for ending in ("ecore", "xmi", "vql")]
    workspace = load_workspace(files, files=TextFiles(texts))
    assert process_time() - started < SECONDS
    assert_placed(workspace.diagnostics)
