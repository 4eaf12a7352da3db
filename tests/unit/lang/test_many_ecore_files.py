"""Several `.ecore` files, which become one metamodel, and packages that have classes of one name."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

import envgraph
from envgraph.errors import LoadError, ResolutionError, Source, TypeMismatch
from envgraph.graph import model_to_json, model_to_xmi
from envgraph.lang import TextFiles, Workspace, from_text, load_workspace, parse_model, spelled_out, to_text
from envgraph.metamodel import EnumType, Metamodel, metamodel_to_ecore
from envgraph.rewrite import Engine, derived
from tests.reading import parse_ecore, parse_xmi

HEAD = (
    'xmi:version="2.0" xmlns:xmi="http://www.omg.org/XMI" xmlns:xsi="http://www.w3.org/2001/XMLSchema-instance" '
    'xmlns:ecore="http://www.eclipse.org/emf/2002/Ecore"'
)


LAMPS = 'upperBound="-1" containment="true" eOpposite="../power/power.ecore#//Lamp/street"'
STREET = 'eOpposite="../city/city.ecore#//Street/lamps"'


def package(name: str, inside: str) -> str:
    named = f'name="{name}" nsURI="http://example.org/{name}" nsPrefix="{name}"'
    return f"<ecore:EPackage {HEAD} {named}>\n{inside}\n</ecore:EPackage>\n"


def cls(name: str, *features: str, above: str = "") -> str:
    extends = f' eSuperTypes="{above}"' if above else ""
    return f'<eClassifiers xsi:type="ecore:EClass" name="{name}"{extends}>{"".join(features)}</eClassifiers>'


def reference(name: str, target: str, rest: str = 'upperBound="-1"') -> str:
    return f'<eStructuralFeatures xsi:type="ecore:EReference" name="{name}" eType="{target}" {rest}/>'


def attribute(name: str, type_: str) -> str:
    return f'<eStructuralFeatures xsi:type="ecore:EAttribute" name="{name}" eType="{type_}"/>'


def enum(name: str, *literals: str) -> str:
    inside = "".join(f'<eLiterals name="{one}" value="{at}"/>' for at, one in enumerate(literals))
    return f'<eClassifiers xsi:type="ecore:EEnum" name="{name}">{inside}</eClassifiers>'


CITY = package(
    "city",
    cls(
        "Street",
        reference("lamps", "ecore:EClass ../power/power.ecore#//Lamp", LAMPS),
        attribute("state", "#//State"),
    )
    + cls("Node", reference("streets", "#//Street"))
    + enum("State", "open", "closed"),
)
POWER = package(
    "power",
    cls(
        "Lamp",
        reference("street", "ecore:EClass ../city/city.ecore#//Street", STREET),
        attribute("state", "#//State"),
    )
    + cls("Node", reference("lamps", "#//Lamp"), above="../city/city.ecore#//Node")
    + enum("State", "dark", "lit"),
)
FILES = {"city/city.ecore": CITY, "power/power.ecore": POWER}
TOWN = """<?xml version="1.0" encoding="UTF-8"?>
<xmi:XMI xmi:version="2.0" xmlns:xmi="http://www.omg.org/XMI" xmlns:xsi="http://www.w3.org/2001/XMLSchema-instance"
    xmlns:city="http://example.org/city" xmlns:power="http://example.org/power">
  <city:Street state="closed"><lamps state="lit"/><lamps/></city:Street>
  <city:Node streets="/0"/>
  <power:Node streets="/0" lamps="/0/@lamps.1"/>
</xmi:XMI>
"""


def loaded(*roots: str, **texts: str) -> Workspace:
    named = {name.replace("__", "/").replace("_", "."): text for name, text in texts.items()}
    return load_workspace(roots, files=TextFiles(FILES | named))


def messages_of(workspace: Workspace) -> list[str]:
    return [f"{one.span}: {one.message}" for one in workspace.diagnostics]


def town_metamodel() -> Metamodel:
    metamodel = loaded("city/city.ecore").metamodel
    assert metamodel is not None
    return metamodel


def test_ecore_files_that_refer_to_each_other_are_combined_into_one_metamodel() -> None:
    metamodel = town_metamodel()
    assert [one.name for one in metamodel.class_list] == ["Street", "city::Node", "Lamp", "power::Node"]
    assert [(one.path, one.uri) for one in metamodel.packages] == [
        ("", "http://example.org/city"),
        ("power", "http://example.org/power"),
    ]
    assert metamodel.classes["power::Node"].supertypes == ("city::Node",)
    lamps = metamodel.feature("Street", "lamps")
    assert lamps in metamodel.references and metamodel.opposite(lamps) is metamodel.feature("Lamp", "street")


def test_unrelated_ecore_files_are_combined_into_one_metamodel() -> None:
    alone = package("plain", cls("Stone"))
    metamodel = loaded("plain.ecore", "city/city.ecore", plain_ecore=alone).metamodel
    assert metamodel is not None
    assert (metamodel.name, metamodel.uri) == ("plain", "http://example.org/plain")
    assert [one.path for one in metamodel.packages] == ["", "city", "power"]


@pytest.mark.parametrize(
    "word",
    [
        "http://example.org/power",
        "platform:/resource/power/power.ecore",
        "platform:/plugin/org.example.elsewhere/power.ecore",
        "../somewhere/else/power.ecore",
    ],
)
def test_other_ecore_files_are_found_by_uri_eclipse_path_or_name(word: str) -> None:
    city = CITY.replace("../power/power.ecore", word)
    found = load_workspace(
        ["city/city.ecore", "power/power.ecore"], files=TextFiles({**FILES, "city/city.ecore": city})
    )
    assert found.metamodel is not None and found.metamodel.feature("Street", "lamps") is not None


def test_an_eclipse_project_is_searched_in_parent_directories() -> None:
    city = CITY.replace("../power/power.ecore", "platform:/resource/power/model/power.ecore")
    power = POWER.replace("../city/", "../../city/")
    files = TextFiles({"all/city/city.ecore": city, "all/power/model/power.ecore": power})
    found = load_workspace(["all/city/city.ecore"], files=files)
    assert messages_of(found) == [] and list(found.sources) == [
        "all/city/city.ecore",
        "all/power/model/power.ecore",
    ]


def test_a_missing_file_is_reported_once_with_a_hint() -> None:
    found = load_workspace(["city/city.ecore"], files=TextFiles({"city/city.ecore": CITY}))
    (problem,) = found.diagnostics
    assert problem.message == "`../power/power.ecore`: there is no such file"
    assert str(problem.hint).startswith(
        "give `power.ecore`, which contains `Lamp`, too, for example with `--metamodel`"
    )
    assert problem.span is not None and problem.span.text == "../power/power.ecore#//Lamp"


def test_a_missing_package_is_reported_by_its_uri() -> None:
    city = CITY.replace("../power/power.ecore", "http://example.org/powr")
    found = load_workspace(["power/power.ecore"], files=TextFiles({**FILES, "city/city.ecore": city}))
    (problem, *_) = found.errors
    assert problem.message == "none of the files has the package `http://example.org/powr`"
    assert problem.hint == "did you mean `http://example.org/power`?"


def test_errors_are_reported_in_the_file_that_contains_them() -> None:
    power = POWER.replace("#//Node", "#//Nodes")
    found = load_workspace(["city/city.ecore"], files=TextFiles({**FILES, "power/power.ecore": power}))
    (problem,) = found.diagnostics
    assert problem.message == "unknown class or data type `Nodes` in city.ecore"
    assert problem.span is not None and problem.span.source.name == "power/power.ecore"
    assert problem.hint == "did you mean `Node`?"


def test_equal_copies_of_a_package_are_merged_and_different_ones_refused() -> None:
    again = metamodel_to_ecore(town_metamodel())
    assert loaded("city/city.ecore", "copy.ecore", copy_ecore=CITY.replace("../", "")).errors == ()
    found = loaded("city/city.ecore", "other.ecore", other_ecore=again.replace("Lamp", "Lantern"))
    (problem,) = found.errors
    assert problem.code == "two-metamodels" and problem.hint == "load only one of the two files"
    inner = again.replace('nsURI="http://example.org/city"', 'nsURI="http://example.org/outer"')
    (problem, *_) = loaded("all.ecore", "power/power.ecore", all_ecore=inner).errors
    assert "`http://example.org/power` is also in another file" in problem.message


def test_a_metamodel_file_and_ecore_files_do_not_become_one() -> None:
    found = loaded("a.metamodel", "city/city.ecore", a_metamodel="metamodel a class Box { }")
    (problem,) = found.errors
    assert problem.message == "this is a second metamodel"
    assert problem.hint is not None and problem.hint.endswith("load only `.ecore` files, which are combined into one")


# --- names ---

QUERIES = """package town
import "http://example.org/city" as c
import "http://example.org/power"

pattern dark(street : c::Street, lamp : power::Lamp) {
    Street.lamps(street, lamp);
    Lamp.state(lamp, State::dark);
    Street.state(street, c::State::closed);
}
pattern nodes(one : c::Node, other : Node) {
    c::Node.streets(one, street);
    power::Node.lamps(other, lamp);
    Street.lamps(street, lamp);
}
"""


def test_names_are_looked_up_in_aliases_packages_and_imports(tmp_path: Path) -> None:
    for name, text in {**FILES, "town.vql": QUERIES, "town.xmi": TOWN}.items():
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / name).write_text(text)
    engine = envgraph.open(tmp_path / "city/city.ecore", tmp_path / "town.vql", tmp_path / "town.xmi")
    (match,) = engine.matches("dark")
    assert match.lamp.state == "dark" and match.street.state == "closed"
    assert [(one.one.cls, one.other.cls) for one in engine.matches("nodes")] == [
        ("city::Node", "power::Node"),
        ("power::Node", "power::Node"),
    ]
    rules = "rule light { lhs { n : power::Node; lamp : Lamp; } modify { set lamp.state = power::State::lit; } }"
    found = from_text(rules)
    engine.add(*found)
    assert engine.apply("light") is not None and engine.count("dark") in (0, 1)
    assert "power::Node" in to_text(*found)


def test_a_class_name_of_two_packages_needs_its_package() -> None:
    found = loaded("city/city.ecore", "q.query", q_query="pattern p(a : Node, b : State) { Node.streets(a, _); }")
    first, *_ = found.errors
    assert first.message == "`Node` is in several packages"
    assert first.hint == "write `city::Node` or `power::Node`"
    text = "pattern p(a : city::Lamp) { Lamp(a); }\npattern q(b : power::Nodes) { Node(b); }"
    found = loaded("city/city.ecore", "q.query", q_query=text)
    assert [one.message for one in found.errors] == [
        "package `city` has no `Lamp`",
        "`Node` is in several packages",
    ]


def test_packages_inside_of_one_file_may_share_names() -> None:
    inner = f'<eSubpackages name="inner" nsURI="http://example.org/inner" nsPrefix="i">{cls("Part")}</eSubpackages>'
    metamodel = parse_ecore(Source("m.ecore", package("outer", cls("Part") + inner)))
    assert list(metamodel.classes) == ["outer::Part", "inner::Part"]
    again = parse_ecore(Source("n.ecore", metamodel_to_ecore(metamodel)))
    assert again.class_list == metamodel.class_list and again.packages == metamodel.packages


def test_packages_with_the_same_name_are_qualified_by_their_prefixes() -> None:
    other = package("city", cls("Node")).replace(
        'nsURI="http://example.org/city" nsPrefix="city"', 'nsURI="u" nsPrefix="old"'
    )
    metamodel = loaded("city/city.ecore", "o.ecore", o_ecore=other).metamodel
    assert metamodel is not None
    assert sorted(metamodel.full_names("Node").values()) == ["city::Node", "old::Node", "power::Node"]


# --- models and files ---


def test_models_of_several_namespaces_are_read_and_written() -> None:
    metamodel = town_metamodel()
    model = parse_xmi(Source("town.xmi", TOWN), metamodel)
    assert [(one.id, one.cls) for one in model.nodes("Lamp")] == [(1, "Lamp"), (2, "Lamp")]
    assert [one.cls for one in model.nodes("city::Node")] == ["city::Node", "power::Node"]
    text = model_to_xmi(model)
    assert "<city:Node " in text and "<power:Node " in text and 'xmlns:power="http://example.org/power"' in text
    assert model_to_xmi(parse_xmi(Source("again.xmi", text), metamodel)) == text


def test_a_class_in_the_wrong_namespace_is_an_error() -> None:
    with pytest.raises(LoadError) as error:
        parse_xmi(Source("t.xmi", TOWN.replace("city:Street", "power:Street")), town_metamodel())
    assert "`Street` is not in the package `http://example.org/power`" in str(error.value)


def test_a_combined_metamodel_is_written_as_one_file_with_subpackages() -> None:
    metamodel = town_metamodel()
    again = parse_ecore(Source("town.ecore", metamodel_to_ecore(metamodel)))
    assert again.class_list == metamodel.class_list and again.enum_types == metamodel.enum_types
    assert again.packages == metamodel.packages
    assert {one.name for one in again.enum_types if isinstance(one, EnumType)} == {
        "city::State",
        "power::State",
    }


def test_a_model_loads_all_metamodels_of_its_schema_location(tmp_path: Path) -> None:
    place = 'xsi:schemaLocation="http://example.org/city city/city.ecore http://example.org/power power/power.ecore"'
    town = TOWN.replace("xmi:version", f"{place} xmi:version")
    found = load_workspace(["town.xmi"], files=TextFiles({**FILES, "town.xmi": town}))
    assert messages_of(found) == [] and len(found.model().nodes()) == 5


def test_names_of_derived_rules_contain_the_package_of_the_class() -> None:
    engine = Engine(envgraph.graph.Model(town_metamodel()))
    (group,) = from_text("derive all = operators for power::Node;")
    engine.add(group)
    made = spelled_out(derived(group, town_metamodel()).rules, town_metamodel())
    assert made[0].name == "all_create_power_Node"
    assert "create node : power::Node;" in to_text(*made)


def test_ambiguous_class_names_in_python_get_a_hint_with_packages() -> None:
    model = parse_xmi(Source("town.xmi", TOWN), town_metamodel())
    with pytest.raises(TypeMismatch, match="write `city::Node` or `power::Node`"):
        model.nodes("Node")
    with pytest.raises(ResolutionError, match="write `Street`"):
        Engine(model).add(*from_text("pattern p(a : city::Street) { Street(a); }", "query"))
    found = loaded("city/city.ecore", "a.model", a_model="model a : city { n : Node { } }")
    assert [one.hint for one in found.errors] == [
        "use an `.xmi` or JSON file for its objects: several packages have a class of this name"
    ]


def test_objects_keep_their_classes_in_json() -> None:
    model = parse_xmi(Source("town.xmi", TOWN), town_metamodel())
    text = json.dumps(model_to_json(model))
    assert '"class": "power::Node"' in text
    assert parse_model(Source("town.json", text), town_metamodel()).state_hash() == model.state_hash()


def test_views_are_updated_for_classes_of_two_packages() -> None:
    engine = Engine(parse_xmi(Source("town.xmi", TOWN), town_metamodel()))
    text = "pattern dark(a : power::Node, l : Lamp) { power::Node.lamps(a, l); Lamp.state(l, power::State::dark); }"
    engine.add(*from_text(text, "query"))
    seen: list[str] = []
    engine.on("dark", appear=lambda a: seen.append(a.cls))
    engine.model.create("power::Node", lamps=[engine.model.create("Lamp")])
    assert seen == ["power::Node", "power::Node"]
    engine.check_integrity()
