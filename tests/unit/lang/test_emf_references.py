"""How `.xmi` files name objects: order, other files, keys. Where pyecore reads the same, it is asked too."""

from __future__ import annotations

from pathlib import Path

import pytest

from envgraph.errors import LoadError, Source
from envgraph.graph import Model, model_to_xmi
from envgraph.lang import TextFiles, Workspace, load_workspace
from tests.reading import parse_ecore, parse_xmi

HEAD = 'xmlns:xmi="http://www.omg.org/XMI" xmlns:xsi="http://www.w3.org/2001/XMLSchema-instance"'
_ECORE = 'xmlns:ecore="http://www.eclipse.org/emf/2002/Ecore"'
_STRING = 'eType="ecore:EDataType http://www.eclipse.org/emf/2002/Ecore#//EString"'
PARTS = f"""<ecore:EPackage {HEAD} {_ECORE} name="e" nsURI="http://x/e" nsPrefix="e">
  <eClassifiers xsi:type="ecore:EClass" name="Part">
    <eStructuralFeatures xsi:type="ecore:EAttribute" name="name" {_STRING}/>
    <eStructuralFeatures xsi:type="ecore:EReference" name="parts" upperBound="-1" eType="#//Part" containment="true"
        eOpposite="#//Part/whole"/>
    <eStructuralFeatures xsi:type="ecore:EReference" name="whole" eType="#//Part" eOpposite="#//Part/parts"/>
    <eStructuralFeatures xsi:type="ecore:EReference" name="uses" upperBound="-1"
        eType="#//Part" eOpposite="#//Part/users"/>
    <eStructuralFeatures xsi:type="ecore:EReference" name="users" upperBound="-1"
        eType="#//Part" eOpposite="#//Part/uses"/>
    <eStructuralFeatures xsi:type="ecore:EReference" name="likes" upperBound="-1" eType="#//Part"/>
  </eClassifiers>
</ecore:EPackage>"""


def part(name: str, inside: str = "", attributes: str = "") -> str:
    return f'<e:Part {HEAD} xmlns:e="http://x/e" name="{name}" {attributes}>{inside}</e:Part>'


def workspace(main: str, **others: str) -> Workspace:
    texts = {
        "e.ecore": PARTS,
        "main.xmi": main,
        **{name.replace("__", "/") + ".xmi": text for name, text in others.items()},
    }
    return load_workspace(["e.ecore", "main.xmi"], files=TextFiles(texts))


def names(model: Model, feature: str, of: str = "root") -> list[str]:
    (owner,) = [one for one in model.nodes("Part") if one["name"] == of]
    return [one["name"] for one in getattr(owner, feature)]


def names_in_pyecore(directory: Path, texts: dict[str, str], feature: str) -> list[str]:
    resources = pytest.importorskip("pyecore.resources")
    for name, text in texts.items():
        path = directory / name
        path.parent.mkdir(exist_ok=True)
        path.write_text(text, "utf-8")
    known = resources.ResourceSet()
    package = known.get_resource(resources.URI(str(directory / "e.ecore"))).contents[0]
    known.metamodel_registry[package.nsURI] = package
    root = known.get_resource(resources.URI(str(directory / "main.xmi"))).contents[0]
    return [one.name for one in getattr(root, feature)]


@pytest.mark.parametrize(
    ("inside", "expected"),
    [
        ('<parts name="a"/><parts href="c.xmi#/"/><parts name="b"/>', ["a", "child", "b"]),
        ('<parts href="c.xmi#/"/><parts name="b"/>', ["child", "b"]),
        ('<parts name="a"/><parts href="d/f.xmi#/"/><parts href="c.xmi#/"/>', ["a", "deep", "child"]),
    ],
)
def test_children_from_other_files_keep_their_order_among_children(
    tmp_path: Path, inside: str, expected: list[str]
) -> None:
    main, child, deep = part("root", inside), part("child", '<parts name="grand"/>'), part("deep")
    model = workspace(main, c=child, d__f=deep).model()
    model.check_integrity()
    assert names(model, "parts") == expected
    files = {"e.ecore": PARTS, "main.xmi": main, "c.xmi": child, "d/f.xmi": deep}
    assert names_in_pyecore(tmp_path, files, "parts") == expected


def test_positional_paths_count_children_from_other_files(tmp_path: Path) -> None:
    inside = '<parts name="a"/><parts href="c.xmi#/"/><parts name="b"/>'
    main = part("root", inside, 'likes="//@parts.2 //@parts.1 //@parts.1/@parts.0 //@parts.0"')
    child = part("child", '<parts name="grand"/>')
    model = workspace(main, c=child).model()
    assert names(model, "likes") == ["b", "child", "grand", "a"]
    texts = {"e.ecore": PARTS, "main.xmi": main, "c.xmi": child}
    assert names_in_pyecore(tmp_path, texts, "likes") == ["b", "child", "grand", "a"]
    again = parse_xmi(Source("all.xmi", model_to_xmi(model)), model.metamodel)
    assert names(again, "likes") == ["b", "child", "grand", "a"]


def test_a_path_in_an_href_can_pass_through_another_href() -> None:
    main = part("root", '<parts href="b.xmi#//@parts.1/@parts.0"/><parts name="z"/>', 'likes="//@parts.0"')
    others = {
        "b": part("b", '<parts name="y"/><parts href="c.xmi#/"/>'),
        "c": part("c", '<parts href="d.xmi#/"/>'),
        "d": part("d"),
    }
    assert [one.code for one in workspace(main, **others).errors] == [
        "two-containers"
    ]  # `d` is inside `c` and inside `root`
    main = part("root", "", 'likes="b.xmi#//@parts.1/@parts.0 b.xmi#//@parts.0"')
    found = workspace(main, **others)
    assert names(found.model(), "likes") == ["d", "y"]


def test_cyclic_hrefs_are_an_error() -> None:
    main = part("root", '<parts href="b.xmi#//@parts.0"/>')
    found = workspace(main, b=part("b", '<parts href="main.xmi#//@parts.0"/>'))
    assert {one.code for one in found.errors} == {"unknown-object"}
    chain = "".join(f'<parts href="#//@parts.{place + 1}"/>' for place in range(5_000))
    assert "unknown-object" in {one.code for one in workspace(part("root", chain + '<parts name="z"/>')).errors}


def test_attributes_and_hrefs_of_one_reference_keep_their_order() -> None:
    inside = '<parts name="a" users="//@parts.1"/><parts name="b"/><parts name="c"/>'
    hrefs = '<uses href="other%20files/a%20b.xmi#/"/><uses href="#//@parts.0"/>'
    main = part("root", inside + hrefs, 'uses="//@parts.2 //@parts.1"')
    other = part("other")
    files = TextFiles({"e.ecore": PARTS, "main.xmi": main, "other files/a b.xmi": other})
    found = load_workspace(["e.ecore", "main.xmi"], files=files)
    assert names(found.model(), "uses") == ["c", "b", "other", "a"]
    assert names(found.model(), "users", "a") == ["b", "root"]


# --- keys ---

PRODUCTS = f"""<ecore:EPackage {HEAD} {_ECORE} name="p" nsURI="http://x/p" nsPrefix="p">
  <eClassifiers xsi:type="ecore:EClass" name="Library">
    <eStructuralFeatures xsi:type="ecore:EReference" name="products" upperBound="-1" eType="#//Product"
        containment="true" eKeys="#//Product/ID #//Product/version"/>
  </eClassifiers>
  <eClassifiers xsi:type="ecore:EClass" name="Product">
    <eStructuralFeatures xsi:type="ecore:EAttribute" name="ID" {_STRING}/>
    <eStructuralFeatures xsi:type="ecore:EAttribute" name="version"
        eType="ecore:EDataType http://www.eclipse.org/emf/2002/Ecore#//EInt"/>
    <eStructuralFeatures xsi:type="ecore:EAttribute" name="tags" upperBound="-1" {_STRING}/>
    <eStructuralFeatures xsi:type="ecore:EReference" name="needs" upperBound="-1" eType="#//Product"/>
    <eStructuralFeatures xsi:type="ecore:EReference" name="parts" upperBound="-1"
        eType="#//Product" containment="true"/>
  </eClassifiers>
</ecore:EPackage>"""
SHELF = """<products ID="C40"><parts ID="x"/></products><products ID="C40" version="2"/>
  <products ID="a'b/c ]=,&quot;d"><tags>red</tags><tags>deep blue</tags></products><products/>"""


def needs(*fragments: str) -> Model:
    words = " ".join(fragments).replace('"', "&quot;")
    text = f'<p:Library {HEAD} xmlns:p="http://x/p">{SHELF}<products ID="last" needs="{words}"/></p:Library>'
    return parse_xmi(Source("a.xmi", text), parse_ecore(Source("p.ecore", PRODUCTS)))


@pytest.mark.parametrize(
    ("fragment", "place"),
    [
        ("//@products[ID='C40']", 0),
        ("//@products[ID='C40',version='2']", 1),
        ('//@products[version="2",ID="C40"]', 1),
        ("//@products[ID='a%27b%2Fc%20%5D=,%22d']", 2),
        ("//@products[tags=['red','deep%20blue']]", 2),
        ("//@products[ID=null]", 3),
        ("/0/@products[version='0']", 0),
    ],
)
def test_objects_are_found_by_their_keys(fragment: str, place: int) -> None:
    model = needs(fragment)
    products = model.nodes("Library")[0].products
    assert list(products[4].needs) == [products[place]]


def test_a_path_may_continue_after_keys() -> None:
    model = needs("//@products[ID='C40']/@parts[ID='x']", "//@products[ID='C40']/@parts.0")
    (part,) = model.nodes("Library")[0].products[0].parts
    assert list(model.nodes("Library")[0].products[4].needs) == [part]


@pytest.mark.parametrize(
    "fragment",
    [
        "//@products[ID='C41']",
        "//@products[ID='C41']/@parts.0",
        "//@products[name='C40']",
        "//@products[ID=C40]",
        "//@products[]",
        "//@products[needs='']",
    ],
)
def test_keys_without_an_object_are_an_error_with_a_hint(fragment: str) -> None:
    with pytest.raises(LoadError) as caught:
        needs(fragment)
    (found,) = caught.value.diagnostics
    assert found.code == "unknown-object" and "these values" in str(found.hint)
