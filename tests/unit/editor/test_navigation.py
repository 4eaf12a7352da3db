"""Definitions, references, descriptions and numbers of matches of the name at a position."""

from __future__ import annotations

import pytest

from envgraph.errors import InvalidArgument
from tests.editing import MEMORY, Editor

TEXTS = {
    "shop.metamodel": """metamodel shop
enum Size { small, large }
/** A thing that is stored. */
class Box {
    Size size
    refers Box[0..1] above opposite below
    refers Box[0..1] below opposite above
}
class Shelf { contains Box[*] boxes }
""",
    "shop.query": """package shop
import "shop.metamodel"

/** Boxes with another one on top. */
pattern covered(box : Box, on) {
    Box.above(box, on);
}
pattern upper(box : Box) {
    neg find covered(box, _);
    Box.size(box, Size::small);
} or {
    neg find covered(box, other);
    Box.above(other, box);
    Box.size(other, Size::large);
}
""",
    "shop.rules": """package shop
import "shop.query"

rule shrink(box : Box) {
    lhs { box : Box; find upper(box); check box.below.size != ::large; }
    modify { set box.size = ::small; }
}
""",
    "shop.model": """import "shop.metamodel"
model one : shop {
    low : Box { above = high }
    high : Box { size = ::large }
}
""",
    "family.toml": """model = "shop.model"
imports = ["shop.rules"]
[constraints]
require = ["covered"]
[measures.number]
kind = "count"
of = "shop.upper"
[diversity]
of = "number"
range = [0, 4]
[mutation]
rules = ["shrink"]
""",
}


@pytest.fixture(scope="module")
def editor() -> Editor:
    made = Editor(TEXTS)
    made.open_all()
    return made


@pytest.mark.parametrize(
    ("file", "at", "definition"),
    [
        ("shop.query", "find |covered", "shop.query:5: covered"),
        ("shop.query", "(box : |Box, on)", "shop.metamodel:4: Box"),
        ("shop.query", "Box.|above", "shop.metamodel:6: above"),
        ("shop.query", "Size::|small", "shop.metamodel:2: small"),
        ("shop.query", "Box.size(|box, Size::small", "shop.query:8: box"),
        ("shop.query", "Box.size(|other", "shop.query:12: other"),
        ("shop.query", 'import "|shop', "shop.metamodel:1: "),
        ("shop.rules", "box.|below", "shop.metamodel:7: below"),
        ("shop.rules", "below.|size", "shop.metamodel:5: size"),
        ("shop.rules", "!= ::|large", "shop.metamodel:2: large"),
        ("shop.model", "above = |high", "shop.model:4: high"),
        ("shop.model", "size = ::|large", "shop.metamodel:2: large"),
        ("shop.model", "one : |shop", "shop.metamodel:1: shop"),
        ("shop.metamodel", "opposite |below", "shop.metamodel:7: below"),
        ("family.toml", '"|covered"', "shop.query:5: covered"),
        ("family.toml", '"shop.|upper"', "shop.query:8: upper"),
        ("family.toml", '"|shrink"', "shop.rules:4: shrink"),
        ("family.toml", 'of = "|number"', "family.toml:5: number"),
    ],
)
def test_definitions_are_found_across_files(editor: Editor, file: str, at: str, definition: str) -> None:
    assert [editor.text_at(one) for one in editor.ask("definition", MEMORY + file, at)] == [definition]


def test_references_are_found_in_all_files_of_the_folder(editor: Editor) -> None:
    found = editor.ask("references", MEMORY + "shop.query", "pattern |covered")
    places = ["shop.query:5: covered", "shop.query:9: covered", "shop.query:12: covered", "family.toml:4: covered"]
    assert [editor.text_at(one) for one in found] == places
    context = {"includeDeclaration": False}
    found = editor.ask("references", MEMORY + "shop.query", "pattern |covered", context=context)
    assert [editor.text_at(one) for one in found] == places[1:]


def test_variables_of_two_bodies_are_not_the_same(editor: Editor) -> None:
    assert len(editor.ask("documentHighlight", MEMORY + "shop.query", "covered(box, |other")) == 3
    assert len(editor.ask("documentHighlight", MEMORY + "shop.query", "upper(|box")) == 5


@pytest.mark.parametrize(
    ("file", "at", "text"),
    [
        (
            "shop.query",
            "find |covered",
            "pattern covered(box : Box, on : Box)\n```\n\nBoxes with another one on top.\n\n1 match",
        ),
        ("shop.query", "(box : |Box, on)", "class Box\n```\n\nA thing that is stored.\n\n`size : Size`"),
        ("shop.query", "Box.|above", "refers Box.above : Box[0..1]\n```\n\nopposite of `Box.below`"),
        ("shop.query", "Size::|small", "Size::small"),
        ("shop.query", "size(|other", "other : Box"),
        ("shop.rules", "rule |shrink", "rule shrink(box : Box)\n```\n\nnot applicable in `one`"),
        ("shop.model", "|low", "low : Box"),
    ],
)
def test_names_are_described(editor: Editor, file: str, at: str, text: str) -> None:
    assert text in editor.ask("hover", MEMORY + file, at)["contents"]["value"]


def test_symbols_are_a_tree(editor: Editor) -> None:
    found = editor.ask("documentSymbol", MEMORY + "shop.metamodel")
    shown = [(one["name"], [each["name"] for each in one["children"]]) for one in found]
    assert shown == [
        ("shop", []), ("Size", ["small", "large"]), ("Box", ["size", "above", "below"]), ("Shelf", ["boxes"]),
    ]  # fmt: skip
    found = editor.service.answer("workspace/symbol", {"query": "cvr"})
    assert [(one["name"], editor.text_at(one["location"])) for one in found] == [("covered", "shop.query:5: covered")]


def test_lenses_count_matches_and_lead_to_reasons(editor: Editor) -> None:
    found = editor.ask("codeLens", MEMORY + "shop.query")
    assert [one["command"]["title"] for one in found] == ["1 match in one", "no match in one: why not?"]
    assert found[1]["command"]["arguments"] == ["upper", MEMORY + "shop.query"]
    text = editor.service.answer("envgraph/whyNot", {"name": "upper", "uri": MEMORY + "shop.query"})["text"]
    assert text.startswith("`shop.upper` has no match") and "shop.query:" in text
    wrong = {"text": TEXTS["shop.model"].replace("size = ::large", "size = ::lrge")}
    editor.change(MEMORY + "shop.model", wrong)
    assert editor.ask("codeLens", MEMORY + "shop.query") == []
    editor.change(MEMORY + "shop.model", {"text": TEXTS["shop.model"]})
    assert len(editor.ask("codeLens", MEMORY + "shop.query")) == 2


def test_a_model_is_drawn(editor: Editor) -> None:
    found = editor.service.answer("envgraph/preview", {"uri": MEMORY + "shop.rules"})
    assert found["title"] == "one" and found["svg"].startswith("<svg") and "low" in found["svg"]
    wrong = Editor(TEXTS | {"shop.model": TEXTS["shop.model"].replace("::large", "::lrge")})
    wrong.open_all()
    with pytest.raises(InvalidArgument, match="the model has errors"):
        wrong.service.answer("envgraph/preview", {"uri": MEMORY + "shop.rules"})
    alone = Editor({"a.metamodel": TEXTS["shop.metamodel"]})
    alone.open(MEMORY + "a.metamodel", TEXTS["shop.metamodel"])
    assert alone.service.answer("envgraph/preview", {"uri": MEMORY + "a.metamodel"})["title"] == "shop"


ECORE = """<?xml version="1.0" encoding="ISO-8859-1"?>
<ecore:EPackage name="shop" nsURI="http://shop" nsPrefix="shop" xmlns:xmi="http://www.omg.org/XMI"
    xmlns:xsi="http://www.w3.org/2001/XMLSchema-instance" xmlns:ecore="http://www.eclipse.org/emf/2002/Ecore">
  <eClassifiers xsi:type="ecore:EClass" name="Box">
    <eStructuralFeatures xsi:type="ecore:EReference" name="above" eType="#//Box"/>
  </eClassifiers>
</ecore:EPackage>
"""


def test_definitions_are_found_in_ecore_files() -> None:
    query = 'import "http://shop"\npattern p(b : Box, c : Box) {\n    Box.above(b, c);\n}\n'
    editor = Editor({"shop.ecore": ECORE, "a.vql": query})
    editor.open_all()
    assert editor.shown == {}
    found = editor.ask("definition", MEMORY + "a.vql", "b : |Box") + editor.ask(
        "definition", MEMORY + "a.vql", ".|above"
    )
    assert [editor.text_at(one).partition(": ")[0] for one in found] == ["shop.ecore:4", "shop.ecore:5"]
    with pytest.raises(InvalidArgument, match="`Box` is not defined in a file of envgraph's languages"):
        editor.ask("rename", MEMORY + "a.vql", "b : |Box", newName="Crate")
