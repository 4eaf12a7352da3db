"""`.ecore`, `.xmi` and `.vql` files. What is said about mistakes: tests/golden/ecore, tests/golden/xmi."""

from __future__ import annotations

import os
from pathlib import Path
from time import process_time

import pytest

import envgraph
from envgraph.errors import LoadError, Source
from envgraph.graph import Model, model_to_xmi
from envgraph.lang import TextFiles, load_workspace
from envgraph.metamodel import Attribute, Metamodel, metamodel_to_ecore
from tests.reading import parse_ecore, parse_xmi

DATA = Path(__file__).parents[2] / "data" / "emf"
TEXTS = {path.name: path.read_text("utf-8") for path in sorted(DATA.iterdir())}
LIBRARY = parse_ecore(Source("library.ecore", TEXTS["library.ecore"]))
HEAD = 'xmlns:xmi="http://www.omg.org/XMI" xmlns:xsi="http://www.w3.org/2001/XMLSchema-instance"'
HEAD += ' xmlns:lib="http://example.org/library"'


def library(inside: str, attributes: str = 'name="x"') -> Model:
    return parse_xmi(Source("a.xmi", f"<lib:Library {HEAD} {attributes}>{inside}</lib:Library>"), LIBRARY)


def mistakes(text: str, metamodel: Metamodel = LIBRARY) -> list[str]:
    with pytest.raises(LoadError) as caught:
        parse_xmi(Source("a.xmi", text), metamodel)
    return [f"{one.span}: {one.message}" for one in caught.value.diagnostics]


# --- metamodels ---


def test_a_metamodel_has_its_name_uri_and_packages() -> None:
    assert (LIBRARY.name, LIBRARY.uri) == ("library", "http://example.org/library")
    assert [(one.path, one.uri, one.prefix) for one in LIBRARY.packages] == [
        ("", "http://example.org/library", "lib"),
        ("people", "http://example.org/library/people", "people"),
    ]
    assert LIBRARY.classes["Student"].package == "people"


def test_classes_have_their_supertypes_and_docs() -> None:
    assert LIBRARY.classes["Book"].supertypes == ("Item", "Valued")
    assert LIBRARY.classes["Named"].abstract and LIBRARY.classes["Named"].doc == "Whatever has a name."
    assert LIBRARY.key("Film") == ("code",)


def test_attributes_have_types_defaults_and_optionality() -> None:
    found = {str(one): (str(one.type), one.default, one.optional) for one in LIBRARY.attributes}
    assert found["Shelf.number"] == ("int", 1, False)
    assert found["Valued.price"] == ("float", 9.5, False)
    assert found["Film.colour"] == ("bool", True, False)
    assert found["Film.rated"] == ("int", None, True)
    assert found["Book.subtitle"] == ("string", None, True)
    assert found["Named.name"] == ("string", None, False)


def test_enums_keep_the_numbers_of_their_literals() -> None:
    state = LIBRARY.enums["State"]
    assert (state.literals, state.numbers, state.labels) == (("available", "lent", "lost"), (0, 1, 7), ())


def test_an_enum_literal_can_have_a_text_other_than_its_name() -> None:
    text = """<ecore:EPackage xmlns:xsi="http://www.w3.org/2001/XMLSchema-instance"
        xmlns:ecore="http://www.eclipse.org/emf/2002/Ecore" name="p" nsURI="http://p" nsPrefix="p">
      <eClassifiers xsi:type="ecore:EEnum" name="Way">
        <eLiterals name="none" literal="no way"/>
        <eLiterals name="left" literal="to the left" value="4"/>
      </eClassifiers>
      <eClassifiers xsi:type="ecore:EClass" name="Road">
        <eStructuralFeatures xsi:type="ecore:EAttribute" name="way" eType="#//Way" defaultValueLiteral="to the left"/>
      </eClassifiers>
    </ecore:EPackage>"""
    metamodel = parse_ecore(Source("p.ecore", text))
    way = metamodel.feature("Road", "way")
    assert isinstance(way, Attribute) and way.default == "left"
    roads = [f'<p:Road xmlns:p="http://p" way="{value}"/>' for value in ("no way", "left", "4", "0")]
    values = [parse_xmi(Source("a.xmi", road), metamodel).nodes()[0].way for road in roads]
    assert values == ["none", "left", "left", "none"]
    again = parse_ecore(Source("q.ecore", metamodel_to_ecore(metamodel)))
    assert again.enum_types == metamodel.enum_types
    model = Model(metamodel)
    model.create("Road", way="none")
    assert 'way="no way"' in model_to_xmi(model)


def test_a_transient_end_of_an_opposite_pair_is_kept() -> None:
    railway = parse_ecore(Source("railway.ecore", TEXTS["railway.ecore"]))
    route = railway.feature("SwitchPosition", "route")
    assert route is not None and not isinstance(route, Attribute) and route.opposite == "follows"


def test_ranges_are_written_to_ecore_and_read_back() -> None:
    text = "metamodel m class A { @range(-1, 10) int size @range(0.0000001, 0.5) float share }"
    before = load_workspace(["m.metamodel"], files=TextFiles({"m.metamodel": text}))
    assert before.metamodel is not None
    files = TextFiles({"m.ecore": metamodel_to_ecore(before.metamodel)})
    after = load_workspace(["m.ecore"], files=files).metamodel
    assert after is not None and after.class_list == before.metamodel.class_list


def test_glyphs_keys_and_frozen_classes_are_written_to_ecore_and_read_back() -> None:
    metamodel = envgraph.open("burning_forest").model.metamodel
    again = parse_ecore(Source("a.ecore", metamodel_to_ecore(metamodel)))
    assert again.class_list == metamodel.class_list
    assert again.classes["BurningTile"].glyph == metamodel.classes["BurningTile"].glyph


def test_types_and_opposites_can_be_given_in_tags() -> None:
    text = """<ecore:EPackage xmlns:xsi="http://www.w3.org/2001/XMLSchema-instance" xmlns:xmi="http://www.omg.org/XMI"
        xmlns:ecore="http://www.eclipse.org/emf/2002/Ecore" name="p" nsURI="http://p" nsPrefix="p">
      <eClassifiers xsi:type="ecore:EClass" name="A" xmi:id="a1">
        <eSuperTypes href="#//B"/>
        <eStructuralFeatures xsi:type="ecore:EAttribute" name="n">
          <eType xsi:type="ecore:EDataType" href="http://www.eclipse.org/emf/2002/Ecore#//EInt"/>
        </eStructuralFeatures>
      </eClassifiers>
      <eClassifiers xsi:type="ecore:EClass" name="B">
        <eStructuralFeatures xsi:type="ecore:EReference" name="a" eType="a1"/>
        <eStructuralFeatures xsi:type="ecore:EReference" name="b" eType="#//@eClassifiers.1"/>
        <eStructuralFeatures xsi:type="ecore:EAttribute" name="x" eType="ecore:EDataType http://www.eclipse.org/emf/2003/XMLType#//UnsignedInt"/>
      </eClassifiers>
    </ecore:EPackage>"""
    metamodel = parse_ecore(Source("p.ecore", text))
    assert metamodel.supertypes("A") == ("A", "B")
    targets = [(one.name, one.target) for one in metamodel.references]
    assert targets == [("a", "A"), ("b", "B")]
    assert [str(one.type) for one in metamodel.attributes] == ["int", "int"]


# --- models ---


def test_a_model_has_its_containment_tree_and_references() -> None:
    model = load_workspace([DATA / "library.xmi"]).model()
    root = model.nodes("Library")[0]
    assert root.director["name"] == "Cora"
    assert [item["name"] for shelf in root.shelves for item in shelf.items] == [
        "Emma",
        "Amélie",
        "Momo",
        "Ran",
    ]
    student = model.nodes("Student")[0]
    assert [item["name"] for item in student.borrowed] == ["Momo", "Amélie"]  # in the order of its own list
    assert model.nodes("Film")[0].lentTo == student


def test_missing_attributes_have_their_default_or_no_value() -> None:
    model = load_workspace([DATA / "library.xmi"]).model()
    emma, momo = model.nodes("Book")
    assert (emma.price, momo.price) == (12.0, 9.5)
    assert (emma.subtitle, momo.subtitle) == (None, "")
    assert emma.state == "available" and model.nodes("Film")[1].rated is None


def test_ids_become_names_and_references_use_them() -> None:
    model = library('<members xmi:id="jane" name="Jane"/><members name="Max" friends="jane"/>', 'director="jane"')
    assert model["jane"]["name"] == "Jane"
    assert list(model["jane"].friends) == [model.nodes("Person")[1]]
    text = model_to_xmi(model)
    assert 'director="jane"' in text and 'friends="jane"' in text and 'friends="//@members.1"' in text


def test_a_target_given_twice_is_one_link() -> None:
    model = library('<members name="a" friends="/0/@members.1 //@members.1"/><members name="b"/>')
    assert [list(person.friends) for person in model.nodes("Person")] == [
        [model.nodes("Person")[1]],
        [model.nodes("Person")[0]],
    ]


def test_an_object_name_that_is_not_a_valid_id_is_not_used_in_references() -> None:
    model = library('<members name="Jane"/><members name="Max"/>')
    jane, other = model.nodes("Person")
    jane.object_name = "//@members.1"
    other.friends = [jane]
    again = parse_xmi(Source("b.xmi", model_to_xmi(model)), LIBRARY)
    assert again.nodes("Person")[1].friends[0].object_name == "//@members.1"
    assert again.canonical_hash() == model.canonical_hash()


@pytest.mark.parametrize("text", ["INF", "Infinity", "inf"])
def test_infinity_is_written_in_several_ways(text: str) -> None:
    item = '<shelves><items xsi:type="lib:Book" code="1" name="a" price="-{}"/></shelves>'
    model = library(item.format(text))
    assert model.nodes("Book")[0].price == float("-inf")
    assert 'price="-Infinity"' in model_to_xmi(model)


def test_attribute_values_can_be_given_in_tags_and_be_nil() -> None:
    model = library(
        '<shelves><items xsi:type="lib:Book" code="1" name="a">'
        '<subtitle>two\nlines &amp; more</subtitle><price xsi:nil="true"/></items></shelves>'
    )
    book = model.nodes("Book")[0]
    assert (book.subtitle, book.price) == ("two\nlines & more", None)
    again = parse_xmi(Source("b.xmi", model_to_xmi(model)), LIBRARY)
    assert (again.nodes("Book")[0].subtitle, again.nodes("Book")[0].price) == ("two\nlines & more", None)


def test_an_xmi_element_can_contain_several_root_objects() -> None:
    model = parse_xmi(Source("a.xmi", f'<xmi:XMI {HEAD}><lib:Shelf number="4"/><lib:Shelf/></xmi:XMI>'), LIBRARY)
    assert [shelf.number for shelf in model.nodes("Shelf")] == [4, 1]
    assert len(parse_xmi(Source("b.xmi", model_to_xmi(model)), LIBRARY)) == 2
    empty = Model(LIBRARY)
    assert len(parse_xmi(Source("c.xmi", model_to_xmi(empty)), LIBRARY)) == 0


def test_other_documents_are_read_into_the_same_model() -> None:
    main = f'<lib:Library {HEAD} name="x"><director href="staff/people.xmi#//@members.0"/></lib:Library>'
    staff = f'<lib:Library {HEAD} name="y" director="//@members.0"><members name="Ann"/></lib:Library>'
    texts = {"main.xmi": main, "staff/people.xmi": staff}
    workspace = load_workspace(["library.ecore", "main.xmi"], files=TextFiles(TEXTS | texts))
    assert workspace.errors == () and len(workspace.models) == 1
    model = workspace.model()
    assert model.nodes("Library")[0].director["name"] == "Ann"
    assert set(workspace.bundle().texts) == {"library.ecore", "main.xmi", "staff/people.xmi"}
    both = load_workspace(["staff/people.xmi", "library.ecore", "main.xmi"], files=TextFiles(TEXTS | texts))
    assert [text.name for text in both.models] == ["main"]


def test_documents_may_name_each_other() -> None:
    one = f'<lib:Library {HEAD} name="x"><members name="A" friends="b.xmi#//@members.0"/></lib:Library>'
    other = f'<lib:Library {HEAD} name="y"><members name="B" friends="lib:Person a.xmi#//@members.0"/></lib:Library>'
    texts = TEXTS | {"a.xmi": one, "b.xmi": other}
    model = load_workspace(["library.ecore", "a.xmi"], files=TextFiles(texts)).model()
    ann, ben = model.nodes("Person")
    assert list(ann.friends) == [ben] and len(model) == 4


def test_errors_in_referenced_documents_are_reported_at_their_position() -> None:
    names = "".join(f'<members name="{name}" friends="{name}.xmi#/"/>' for name in "bc")
    texts = {
        "a.xmi": f'<lib:Library {HEAD} name="a">{names}</lib:Library>',
        "b.xmi": f'\n<lib:Library {HEAD} name="b"/>',
        "c.xmi": f'\n\n<lib:Library {HEAD} nam="c"/>',
    }
    problems = load_workspace(["library.ecore", "a.xmi"], files=TextFiles(TEXTS | texts)).diagnostics
    found = [f"{str(one.span).rpartition(':')[0]}: {one.message}" for one in problems]
    wrong = "a.xmi:1: `Person.friends` takes objects of class `Person`, not a `Library`"
    assert found == [
        wrong,
        wrong,
        "c.xmi:3: `Library` has no feature `nam`",
    ]
    assert [str(note.span) for one in problems for note in one.notes] == ["b.xmi:2:2", "c.xmi:3:2"]


def test_urls_are_not_fetched_and_entities_are_not_expanded() -> None:
    found = mistakes(f'<lib:Library {HEAD} name="x"><director href="https://example.org/a.xmi#/"/></lib:Library>')
    assert len(found) == 1 and "it is a URL" in found[0]
    bomb = '<!DOCTYPE a [<!ENTITY b "c"><!ENTITY d SYSTEM "library.ecore">]><a>&b;&d;</a>'
    assert mistakes(bomb) == [
        "a.xmi:1:1: a document type is not allowed, because it could refer to other files or define endless entities"
    ]


def test_too_deeply_nested_tags_are_refused() -> None:
    endless = "<a>" * 100_002
    for read in (
        lambda: parse_ecore(Source("a.ecore", endless)),
        lambda: parse_xmi(Source("a.xmi", endless), LIBRARY),
    ):
        with pytest.raises(LoadError) as error:
            read()
        deep = error.value.diagnostics[-1]
        assert deep.message == "the tags are nested more than 100,000 deep"
        assert deep.span is not None and deep.span.start == 300_001


def test_a_deep_model_is_read_and_written() -> None:
    text = """<ecore:EPackage xmlns:xsi="http://www.w3.org/2001/XMLSchema-instance"
        xmlns:ecore="http://www.eclipse.org/emf/2002/Ecore" name="d" nsURI="http://d" nsPrefix="d">
      <eClassifiers xsi:type="ecore:EClass" name="A">
        <eStructuralFeatures xsi:type="ecore:EReference" name="c" upperBound="-1" eType="#//A" containment="true"/>
      </eClassifiers></ecore:EPackage>"""
    metamodel = parse_ecore(Source("d.ecore", text))
    depth = 5_000
    deep = f'<d:A xmlns:d="http://d">{"<c>" * depth}{"</c>" * depth}</d:A>'
    started = process_time()
    model = parse_xmi(Source("deep.xmi", deep), metamodel)
    assert len(model) == depth + 1
    assert len(parse_xmi(Source("deep.xmi", model_to_xmi(model)), metamodel)) == depth + 1
    assert process_time() - started < 5


def test_reading_stops_after_a_hundred_errors() -> None:
    tags = "".join(f"<shelf{number}/>" for number in range(100_000))
    found = mistakes(f'<lib:Library {HEAD} name="x">{tags}</lib:Library>')
    assert len(found) == 101 and found[-1].endswith("too many mistakes: the rest of the file is not read")


def test_each_unknown_name_is_reported_once() -> None:
    tags = '<items xsi:type="lib:Bok"/>' * 300 + '<items xsi:type="lib:Book" titel="a"/>' * 300 + "<other/>"
    found = mistakes(f'<lib:Library {HEAD} name="x"><shelves>{tags}</shelves></lib:Library>')
    assert [one.partition(": ")[2] for one in found] == [
        "unknown class `Bok`",
        "`Book` has no feature `titel`",
        "`Shelf` has no feature `other`",
    ]


def test_dangling_references_in_a_large_file_are_reported_within_the_time_limit() -> None:
    people = "".join(f'<members name="{n}" friends="p{n}"/>' for n in range(20_000))
    started = process_time()
    assert len(mistakes(f'<lib:Library {HEAD} name="x">{people}</lib:Library>')) == 101
    assert process_time() - started < 10


def test_objects_are_named_by_their_id_attribute() -> None:
    codes = ("a-1", "a-1", "two words", "", "only", "42", "x:y", "named")
    books = "".join(f'<items xsi:type="lib:Book" name="b" code="{code}"/>' for code in codes)
    places = " ".join(f"//@shelves.0/@items.{n}" for n in range(len(codes)))
    person = f'<members name="p" borrowed="{places}"/><members xmi:id="named" name="q"/>'
    model = library(f"<shelves>{books}</shelves>{person}")
    text = model_to_xmi(model)
    first = "//@shelves.0/@items."
    assert f'borrowed="{first}0 {first}1 {first}2 {first}3 only 42 {first}6 {first}7"' in text
    again = parse_xmi(Source("a.xmi", text), LIBRARY)
    assert [book.code for book in again.nodes("Person")[0].borrowed] == list(codes)
    assert model_to_xmi(again) == text


# --- encodings and files ---


@pytest.mark.parametrize(
    ("encoding", "declared"),
    [
        ("utf-8", ""),
        ("utf-8-sig", ""),
        ("latin-1", "ISO-8859-1"),
        ("utf-16", "UTF-16"),
        ("cp1250", "windows-1250"),
    ],
)
def test_files_may_have_any_encoding_that_they_declare(tmp_path: Path, encoding: str, declared: str) -> None:
    head = f'<?xml version="1.0" encoding="{declared}"?>' if declared else ""
    file = tmp_path / "a.xmi"
    file.write_bytes(f'{head}<lib:Library {HEAD} name="Bücherei"/>'.encode(encoding))
    workspace = load_workspace([DATA / "library.ecore", file])
    assert workspace.model().nodes()[0].name == "Bücherei"
    # What is kept is text, which is written as UTF-8.
    bundle = workspace.bundle()
    again = load_workspace(bundle.roots, files=TextFiles(bundle.texts))
    assert again.model().nodes()[0].name == "Bücherei"


@pytest.mark.parametrize(
    ("data", "message"),
    [
        (b'<lib:Library name="B\xfc"/>', "1:21: the byte 0xfc is not UTF-8"),
        (b'<?xml version="1.0" encoding="ASCII"?>\n<a b="\xc3\xbc"/>', "2:7: the byte 0xc3 is not ASCII"),
        (b'<?xml version="1.0" encoding="rot13"?><n/>', "1:31: unknown encoding `rot13`"),
        (b'<?xml version="1.0" encoding="unicode_escape"?><n/>', "1:31: unknown encoding `unicode_escape`"),
        (b"\xff\xfe<\0a\0\xff", "1:3: the byte 0xff is not UTF-16-LE"),
        (b"  \n", "1:1: the file is empty"),
        (b"\0\0\0", "1:1: `\\x00` is not allowed in XML"),
    ],
)
@pytest.mark.parametrize("name", ["a.xmi", "a.ecore"])
def test_bytes_that_do_not_fit_the_encoding_are_reported(tmp_path: Path, name: str, data: bytes, message: str) -> None:
    (tmp_path / name).write_bytes(data)
    problems = load_workspace([DATA / "library.ecore"] * (name == "a.xmi") + [tmp_path / name]).errors
    assert [f"{one.span}: {one.message}".partition(name + ":")[2] for one in problems] == [message]


def test_a_file_that_is_far_too_large_is_refused(tmp_path: Path) -> None:
    for name, size, limit in (("a.ecore", 17, 16), ("a.xmi", 257, 256)):
        (tmp_path / name).touch()
        os.truncate(tmp_path / name, size * 1024 * 1024)
        (problem,) = load_workspace([tmp_path / name]).errors
        assert problem.message == f"the file has more than {limit} MB"


# --- imports ---


@pytest.mark.parametrize("order", [("library.ecore", "library.vql"), ("library.vql", "library.ecore")])
def test_a_query_file_imports_a_metamodel_by_its_uri(order: tuple[str, str]) -> None:
    workspace = load_workspace(order, files=TextFiles(TEXTS))
    assert workspace.errors == ()
    assert "freeBook" in [pattern.name for pattern in workspace.patterns]


def test_a_metamodel_may_be_imported_by_its_name() -> None:
    query = 'package q import "library" as l pattern shelf(s : l::Shelf) { Shelf(s); }'
    assert load_workspace(["library.ecore", "q.vql"], files=TextFiles(TEXTS | {"q.vql": query})).errors == ()


def test_rules_and_models_import_by_uri_too() -> None:
    texts = TEXTS | {
        "a.model": 'import "http://example.org/library"\nmodel a : library { l : Library { name = "x" } }',
        "r.rules": 'package r\nimport "http://example.org/library"\n'
        "rule add { lhs { l : Library; } modify { create l -shelves-> s : Shelf; } }",
    }
    workspace = load_workspace(["a.model", "r.rules", "library.ecore"], files=TextFiles(texts))
    assert [one.message for one in workspace.errors] == []
    assert workspace.engine().apply("add") is not None


def test_an_unknown_uri_is_one_mistake() -> None:
    query = 'package q\nimport "http://example.org/libary"\npattern shelf(s : Shelf) { Shelf(s); }'
    texts = TextFiles(TEXTS | {"q.vql": query})
    (problem,) = load_workspace(["library.ecore", "q.vql"], files=texts).errors
    assert f"{problem.span}: {problem.message}" == "q.vql:2:8: no metamodel has the uri `http://example.org/libary`"
    assert problem.hint == "did you mean `http://example.org/library`?"
    (problem,) = load_workspace(["q.vql"], files=texts).errors
    assert problem.hint is not None and "--metamodel" in problem.hint


def test_files_are_loaded_into_an_engine_whose_metamodel_they_import(tmp_path: Path) -> None:
    engine = envgraph.open(DATA / "library.xmi")
    envgraph.load(engine, DATA / "library.vql")
    assert engine.count("freeBook") == 1
    (tmp_path / "more.query").write_text("package more pattern shelf(s : Shelf) { Shelf(s); }")
    envgraph.load(engine, tmp_path / "more.query")  # and needs no import at all
    assert engine.count("shelf") == 2


def test_the_same_metamodel_in_two_formats_is_merged(tmp_path: Path) -> None:
    metamodel = envgraph.open("burning_forest").model.metamodel
    (tmp_path / "forest.ecore").write_text(metamodel_to_ecore(metamodel))
    engine = envgraph.open(tmp_path / "forest.ecore", "burning_forest")
    assert engine.count("burningTile") == 20


@pytest.mark.parametrize(
    ("pattern", "count"),
    [
        ("posLength", 2),
        ("switchMonitored", 1),
        ("switchSet", 1),
        ("routeSensor", 0),
        ("deadEnd", 1),
        ("reachable", 7),
    ],
)
def test_viatra_queries_have_the_expected_numbers_of_matches(pattern: str, count: int) -> None:
    engine = envgraph.open(DATA / "railway.ecore", DATA / "railway.xmi", DATA / "railway.vql")
    assert engine.count(pattern) == count


def test_queries_that_import_ecore_can_use_its_data_types() -> None:
    engine = envgraph.open(DATA / "library.xmi", DATA / "library.vql")
    assert [match.pages for match in engine.matches("longBook")] == [474]
