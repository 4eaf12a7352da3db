"""Metamodels that say how documents look (ExtendedMetaData), and files of Eclipse that are written in other ways."""

from __future__ import annotations

from pathlib import Path

import pytest

from envgraph.errors import LoadError, Source
from envgraph.graph import Model, model_to_xmi
from envgraph.lang import TextFiles, Workspace, load_workspace
from envgraph.metamodel import metamodel_to_ecore
from tests.reading import parse_ecore, parse_xmi

HEAD = (
    'xmlns:xmi="http://www.omg.org/XMI" xmlns:xsi="http://www.w3.org/2001/XMLSchema-instance" '
    'xmlns:ecore="http://www.eclipse.org/emf/2002/Ecore"'
)
ECORE = "http://www.eclipse.org/emf/2002/Ecore"


def attribute(name: str, type_: str = "EString", more: str = "", inside: str = "") -> str:
    start = f'<eStructuralFeatures xsi:type="ecore:EAttribute" name="{name}" {more}'
    return f'{start} eType="ecore:EDataType {ECORE}#//{type_}">{inside}</eStructuralFeatures>'


def reference(name: str, type_: str, more: str = "", inside: str = "") -> str:
    start = f'<eStructuralFeatures xsi:type="ecore:EReference" name="{name}" {more}'
    return f'{start} eType="ecore:EClass {type_}">{inside}</eStructuralFeatures>'


def extended_metadata(**details: str) -> str:
    inside = "".join(f'<details key="{key}" value="{value}"/>' for key, value in details.items())
    return f'<eAnnotations source="http:///org/eclipse/emf/ecore/util/ExtendedMetaData">{inside}</eAnnotations>'


def cls(name: str, *inside: str, more: str = "") -> str:
    return f'<eClassifiers xsi:type="ecore:EClass" name="{name}" {more}>{"".join(inside)}</eClassifiers>'


def package(*inside: str, name: str = "m", uri: str = "http://x/m") -> str:
    return f'<ecore:EPackage {HEAD} name="{name}" nsURI="{uri}" nsPrefix="{name}">{"".join(inside)}</ecore:EPackage>'


MANY = 'upperBound="-1" containment="true"'
MEMBER = f'{MANY} volatile="true" transient="true" derived="true"'
MAP = 'upperBound="-1" unique="false"'
ORDERS = package(
    cls(
        "DocumentRoot",
        extended_metadata(name="", kind="mixed"),
        attribute("mixed", "EFeatureMapEntry", MAP, extended_metadata(kind="elementWildcard", name=":mixed")),
        reference(
            "order",
            "#//Order",
            'upperBound="-2" containment="true" volatile="true" transient="true" derived="true"',
            extended_metadata(kind="element", name="purchase-order", namespace="##targetNamespace"),
        ),
        reference("event", "#//Step", MEMBER, extended_metadata(kind="element", name="event", affiliation="step")),
        reference(
            "start",
            "#//Start",
            MEMBER,
            extended_metadata(kind="element", name="start-event", affiliation="#event"),
        ),
    ),
    cls(
        "Order",
        extended_metadata(name="tOrder", kind="elementOnly"),
        attribute("number", "EInt", "", extended_metadata(kind="attribute", name="no")),
        attribute("remark", "EString", "", extended_metadata(kind="element", name="comment")),
        attribute("group", "EFeatureMapEntry", MAP, extended_metadata(kind="group", name="group:0")),
        reference("priority", "#//Item", MEMBER, extended_metadata(kind="element", name="fast", group="#group:0")),
        reference("standard", "#//Item", MEMBER, extended_metadata(kind="element", name="slow", group="#group:0")),
        reference("step", "#//Step", MANY, extended_metadata(kind="element", name="step")),
        reference("text", "#//Text", MANY, extended_metadata(kind="element", name="text")),
    ),
    cls("Item", attribute("id", "EString", 'iD="true"', extended_metadata(kind="attribute", name="key"))),
    cls("Step", attribute("name")),
    cls("Start", extended_metadata(name="tStart"), more='eSuperTypes="#//Step"'),
    cls(
        "Text",
        extended_metadata(name="tText", kind="simple"),
        attribute("value", "EString", "", extended_metadata(kind="simple", name=":0")),
        attribute("lang", "EString", "", extended_metadata(kind="attribute", name="lang")),
    ),
    cls(
        "Mixed",
        extended_metadata(name="tMixed", kind="mixed"),
        attribute("mixed", "EFeatureMapEntry", MAP, extended_metadata(kind="elementWildcard", name=":mixed")),
        reference("bold", "#//Step", MEMBER, extended_metadata(kind="element", name="b")),
    ),
)


def loaded(document: str, metamodel: str = ORDERS) -> Workspace:
    return load_workspace(["m.ecore", "a.xmi"], files=TextFiles({"m.ecore": metamodel, "a.xmi": document}))


def order(inside: str, attributes: str = "") -> Workspace:
    return loaded(f'<m:purchase-order xmlns:m="http://x/m" {attributes}>{inside}</m:purchase-order>')


def written_and_read(model: Model) -> Model:
    return parse_xmi(Source("again.xmi", model_to_xmi(model)), model.metamodel)


def lost_values(found: Workspace) -> list[str]:
    return [one.message for one in found.diagnostics if one.code == "values-left-out"]


def test_a_document_root_contains_the_object_of_the_first_tag() -> None:
    model = order("<comment>soon</comment>", 'no="7"').model()
    (root,) = model.nodes("DocumentRoot")
    assert (root.order.number, root.order.remark) == (7, "soon")
    assert written_and_read(model).canonical_hash() == model.canonical_hash()


def test_elements_and_attributes_can_have_the_namespace_prefix_of_the_metamodel() -> None:
    inside = '<m:fast m:key="a"/><slow xmlns="http://x/m" key="b"/>'
    (found,) = order(inside, 'm:no="7"').model().nodes("Order")
    assert (found.number, [one["id"] for one in found.priority], [one["id"] for one in found.standard]) == (
        7,
        ["a"],
        ["b"],
    )


def test_elements_of_a_substitution_group_are_read_as_values_of_its_head() -> None:
    (found,) = order('<m:event name="a"/><m:start-event name="b"/><step name="c"/>').model().nodes("Order")
    assert [(one.cls, one["name"]) for one in found.step] == [
        ("Step", "a"),
        ("Start", "b"),
        ("Step", "c"),
    ]


def test_element_texts_are_read_as_attribute_values_of_simple_content_classes() -> None:
    (found,) = order('<text lang="en">good &amp; cheap</text>').model().nodes("Text")
    assert (found.value, found.lang) == ("good & cheap", "en")


def test_documents_use_the_annotated_names_of_classes_and_ids() -> None:
    document = '<m:tOrder xmlns:m="http://x/m" xmlns:xsi="http://www.w3.org/2001/XMLSchema-instance">{}</m:tOrder>'
    found = loaded(document.format('<step xsi:type="m:tStart" name="s"/><fast key="k"/>')).model()
    assert [one.cls for one in found.nodes("Order")[0].step] == ["Start"]
    assert found.nodes("Item")[0]["id"] == "k"


def test_a_written_metamodel_reads_the_same_documents() -> None:
    document = (
        '<m:purchase-order xmlns:m="http://x/m" no="7"><comment>soon</comment><fast key="a"/><slow key="b"/>'
        '<m:start-event name="s"/><text lang="en">good</text></m:purchase-order>'
    )
    first = loaded(document).model()
    second = loaded(document, metamodel_to_ecore(first.metamodel)).model()
    assert model_to_xmi(second) == model_to_xmi(first)
    (found,) = second.nodes("Order")
    assert (found.number, found.remark, found.text[0].value) == (7, "soon", "good")


def test_metamodel_files_name_elements_by_annotations() -> None:
    space = "http:///org/eclipse/emf/ecore/util/ExtendedMetaData"
    files = {
        "m.metamodel": f"""metamodel m uri "http://x/m"
            @annotation("{space}", name = "tOrder", kind = "elementOnly")
            class Order {{
                @annotation("{space}", name = "no", kind = "attribute")
                int number;
            }}""",
        "a.xmi": '<m:tOrder xmlns:m="http://x/m" no="7"/>',
    }
    (found,) = load_workspace(["m.metamodel", "a.xmi"], files=TextFiles(files)).model().nodes("Order")
    assert found.number == 7


def test_lost_positions_among_elements_of_a_group_are_counted() -> None:
    found = order('<fast key="a"/><slow key="b"/><fast key="c"/><fast key="d"/>')
    (one,) = found.model().nodes("Order")
    assert [item["id"] for item in one.priority] == ["a", "c", "d"]
    assert lost_values(found) == ["left out: 2 places of `Order.group`"]
    assert lost_values(order('<fast key="a"/><fast key="c"/><slow key="b"/>')) == []


def test_texts_between_tags_are_counted() -> None:
    found = loaded('<m:tMixed xmlns:m="http://x/m">one <b name="x"/> two</m:tMixed>')
    assert [one["name"] for one in found.model().nodes("Mixed")[0].bold] == ["x"]
    assert lost_values(found) == ["left out: 2 texts of `Mixed.mixed`"]


def test_a_derived_containment_is_kept_if_its_class_has_a_feature_map() -> None:
    text = package(
        cls("A", attribute("group", "EFeatureMapEntry", MAP), reference("parts", "#//A", MEMBER)),
        cls("B", reference("parts", "#//A", MEMBER)),
    )
    metamodel = parse_ecore(Source("m.ecore", text))
    assert [*metamodel.features("A")] == ["parts"] and [*metamodel.features("B")] == []


def test_cyclic_substitution_groups_do_not_loop_forever() -> None:
    text = ORDERS.replace('key="affiliation" value="step"', 'key="affiliation" value="start-event"')
    found = loaded('<m:purchase-order xmlns:m="http://x/m"><m:event/></m:purchase-order>', text)
    assert [one.code for one in found.errors] == ["unknown-feature"]


# --- several packages in a file ---

TWO = (
    f"<xmi:XMI {HEAD}>"
    + package(cls("A", reference("b", "#/1/B"), reference("c", "#//C")), cls("C"), name="one", uri="http://x/1")
    + package(cls("B", reference("a", "#/0/A"), more='eSuperTypes="#/0/C"'), name="two", uri="http://x/2")
    + "</xmi:XMI>"
)


def test_a_file_may_hold_several_packages() -> None:
    metamodel = parse_ecore(Source("m.ecore", TWO))
    assert [(one.path, one.uri) for one in metamodel.packages] == [("", "http://x/1"), ("two", "http://x/2")]
    assert {str(one): one.target for one in metamodel.references} == {"A.b": "B", "A.c": "C", "B.a": "A"}
    assert metamodel.supertypes("B") == ("B", "C")
    assert parse_ecore(Source("n.ecore", metamodel_to_ecore(metamodel))).class_list == metamodel.class_list
    other = package(cls("D", more='eSuperTypes="m.ecore#/1/B http://x/1#//A"'), name="other", uri="http://x/3")
    files = TextFiles({"d.ecore": other, "m.ecore": TWO})
    found = load_workspace(["d.ecore"], files=files)
    assert found.errors == () and found.metamodel is not None
    assert found.metamodel.classes["D"].supertypes == ("B", "A")


def test_pyecore_reads_a_file_of_several_packages_alike() -> None:
    side = pytest.importorskip("tests.oracle.pyecore_side", exc_type=ImportError)
    resources = pytest.importorskip("pyecore.resources")
    found = resources.ResourceSet().get_resource(side.Text("m.ecore", TWO)).contents
    assert [one.name for one in found] == ["one", "two"]
    metamodel = parse_ecore(Source("m.ecore", TWO))
    words = side.package_in_words(found[0]) | side.package_in_words(found[1])
    assert words == side.metamodel_in_words(metamodel)


def test_an_element_beside_packages_that_is_not_a_package_is_refused() -> None:
    text = TWO.replace("</xmi:XMI>", "<ecore:EClass name='X'/></xmi:XMI>")
    with pytest.raises(LoadError, match=r"not a `ecore:EClass`"):
        parse_ecore(Source("m.ecore", text))


# --- values ---

VALUES = package(
    '<eClassifiers xsi:type="ecore:EEnum" name="Nothing"/>',
    cls(
        "A",
        attribute("b", "EBoolean"),
        attribute("f", "EDouble"),
        attribute("n").replace(f"ecore:EDataType {ECORE}#//EString", "#//Nothing"),
    ),
)


@pytest.mark.parametrize(
    ("text", "value"), [("TRUE", True), ("True", True), ("fAlSe", False), ("1", True), ("0", False)]
)
def test_bools_can_be_written_in_several_ways(text: str, value: bool) -> None:
    assert loaded(f'<m:A xmlns:m="http://x/m" b="{text}"/>', VALUES).model().nodes("A")[0].b is value


def test_an_unknown_word_for_a_bool_is_an_error() -> None:
    found = loaded('<m:A xmlns:m="http://x/m" b="yes"/>', VALUES)
    assert [one.message for one in found.errors] == ["`A.b` takes a `bool`, not `yes`"]


def test_nan_is_refused_with_a_reason_or_left_out_if_unresolved_is_allowed() -> None:
    texts = {"m.ecore": VALUES, "a.xmi": '<m:A xmlns:m="http://x/m" f="NaN"/>'}
    (found,) = load_workspace(["m.ecore", "a.xmi"], files=TextFiles(texts)).errors
    assert found.message == "`A.f` takes a `float`, not `NaN`" and "no query could find it" in str(found.hint)
    lenient = load_workspace(["m.ecore", "a.xmi"], files=TextFiles(texts), allow_unresolved=True)
    assert lenient.model().nodes("A")[0].f == 0.0
    assert [one.code for one in lenient.diagnostics if "NaN" in one.message] == ["values-left-out"]


def test_an_enum_without_literals_is_left_out_with_its_attributes() -> None:
    found = loaded('<m:A xmlns:m="http://x/m"/>', VALUES)
    assert found.metamodel is not None and not found.metamodel.enums
    assert found.metamodel.left_out_reason("A", "n") == "its enum `Nothing` has no literals, and was left out"
    assert [one.message for one in found.diagnostics if one.code == "left-out"] == ["the enum `Nothing` is left out"]


# --- metamodels as values ---


def test_references_to_ecore_classes_can_hold_classes_of_a_loaded_metamodel() -> None:
    texts = {
        "a.ecore": package(
            cls("P", reference("of", f"{ECORE}#//EClass"), reference("type", f"{ECORE}#//EClassifier")),
            name="p",
            uri="p",
        ),
        "b.ecore": package(cls("E", attribute("size", "EInt"))),
        "a.xmi": f'<p:P xmlns:p="p" {HEAD} type="ecore:EDataType {ECORE}#//EString"><of href="http://x/m#//E"/></p:P>',
    }
    model = load_workspace(["a.ecore", "b.ecore", "a.xmi"], files=TextFiles(texts)).model()
    (found,) = model.nodes("P")
    assert found.type["name"] == "EString"
    (size,) = found.of.eStructuralFeatures
    assert (found.of["name"], size["name"], size.eType["name"]) == ("E", "size", "EInt")
    assert len(model.nodes("EPackage")) == 1 and len(model.nodes("EDataType")) == 2  # of Ecore what is named
    model.check_integrity()


def test_only_referenced_types_of_ecore_become_objects() -> None:
    texts = {"a.xmi": package(cls("A", attribute("n", "EInt"), reference("o", f"{ECORE}#//EObject")))}
    query = f'import "{ECORE}"\npattern types(c : EClassifier, n : string) {{ EClassifier.name(c, n); }}'
    found = load_workspace(["a.xmi", "q.vql"], files=TextFiles(texts | {"q.vql": query}))
    assert found.errors == ()
    assert {one["name"] for one in found.model().nodes("EClassifier")} == {"A", "EInt", "EObject"}


def test_platform_resource_paths_are_resolved_to_other_files(tmp_path: Path) -> None:
    metamodel = package(cls("A", attribute("name"), reference("to", "#//A")))
    texts = {
        "proj/models/m.ecore": metamodel,
        "proj/models/a.xmi": '<m:A xmlns:m="http://x/m"><to href="platform:/resource/proj/data/b%20c.xmi#/"/></m:A>',
        "proj/data/b c.xmi": '<m:A xmlns:m="http://x/m" name="there"/>',
    }
    for name, text in texts.items():
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).write_text(text, "utf-8")
    model = load_workspace([tmp_path / "proj/models/m.ecore", tmp_path / "proj/models/a.xmi"]).model()
    assert model.nodes("A")[0].to["name"] == "there"


# --- opposites that contradict each other ---

PAIRS = package(
    cls(
        "R",
        reference("all", "#//R", MANY),
        reference("x", "#//R", 'eOpposite="#//R/y"'),
        reference("y", "#//R", 'eOpposite="#//R/x"'),
    )
)
CONTRADICTION = """<m:R xmlns:m="http://x/m">
  <all x="//@all.1"/>
  <all y="//@all.2"/>
  <all/>
</m:R>"""


def test_contradicting_opposite_references_are_an_error_with_both_positions() -> None:
    (found,) = loaded(CONTRADICTION, PAIRS).errors
    assert found.span is not None and found.span.text == "//@all.2"
    assert [note.span.text for note in found.notes] == ["all"] and "a.xmi:2:4" in str(found.notes[0].span)
    assert "--allow-unresolved" in str(found.hint)


def test_allow_unresolved_keeps_the_first_of_contradicting_opposite_references() -> None:
    texts = TextFiles({"m.ecore": PAIRS, "a.xmi": CONTRADICTION})
    found = load_workspace(["m.ecore", "a.xmi"], files=texts, allow_unresolved=True)
    assert [(one.code, one.hint) for one in found.diagnostics if one.code != "conformance"] == [
        ("opposites-differ", "this is left out: the first is kept")
    ]
    model = found.model()
    model.check_integrity()
    first, second, third = model.nodes("R")[0].all
    assert (first.x, second.y, third.x) == (second, first, None)


# --- documents of other tools: tests/data/documents/README.md ---

DOCUMENTS = Path(__file__).parents[2] / "data" / "documents"
FLOWS = """import "http://www.omg.org/spec/BPMN/20100524/MODEL"
import "http://www.omg.org/spec/BPMN/20100524/DI"
pattern follows(before : string, after : string) {
    FlowNode.outgoing(x, flow); SequenceFlow.targetRef(flow, y); FlowNode.id(x, before); FlowNode.id(y, after);
    FlowNode.incoming(y, flow); BPMNEdge.bpmnElement(_, flow);
}"""


def diagram(name: str) -> Workspace:
    names = ("bpmn.ecore", name)
    texts = {one: (DOCUMENTS / one).read_text("utf-8") for one in names} | {"q.vql": FLOWS}
    return load_workspace([*names, "q.vql"], files=TextFiles(texts))


def test_a_process_of_the_camunda_modeler_is_read() -> None:
    found = diagram("i18n.bpmn")
    assert found.errors == ()
    rows = found.engine().matches("follows")
    assert {(row["before"], row["after"]) for row in rows} == {
        ("StartEvent_1", "Activity_0eb4n4l"),
        ("Activity_0eb4n4l", "Event_1kw5c3l"),
    }
    (shape,) = [one for one in found.model().nodes("BPMNShape") if one.bPMNLabel is not None]
    assert (shape.bounds.x, shape.bPMNLabel.bounds.height, shape.bpmnElement["name"]) == (
        432.0,
        14.0,
        "Ended",
    )
    assert lost_values(found) == [
        "left out: 1 attribute `modeler:executionPlatform` of other tools",
        "left out: 1 attribute `modeler:executionPlatformVersion` of other tools",
        "left out: 1 text of `Documentation.mixed`",
        "left out: 3 values of `ExtensionElements.any`",
    ]


def test_a_process_of_the_signavio_editor_is_read() -> None:
    found = diagram("category.bpmn")
    (group,) = found.model().nodes("Group")
    assert group.categoryValueRef["value"] == "group with label"
    assert lost_values(found) == ["left out: 2 values of `ExtensionElements.any`"]
    (style,) = found.model().nodes("BPMNLabelStyle")
    assert (style.font["name"], style.font.size, found.model().nodes("BPMNLabel")[0].labelStyle) == (
        "Arial",
        11.0,
        style,
    )


@pytest.mark.parametrize("name", ["i18n.bpmn", "category.bpmn"])
def test_pyecore_reads_written_documents_alike(name: str) -> None:
    side = pytest.importorskip("tests.oracle.pyecore_side", exc_type=ImportError)
    model = diagram(name).model()
    model.check_integrity()
    assert written_and_read(model).canonical_hash() == model.canonical_hash()
    known = side.read_package(metamodel_to_ecore(model.metamodel))
    roots = side.read_objects(model_to_xmi(model), known)
    assert side.objects_in_words(roots, model.metamodel) == side.model_in_words(model)
