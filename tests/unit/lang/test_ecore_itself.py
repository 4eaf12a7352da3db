"""The classes of Ecore itself, generic types, and models whose metamodel is Ecore."""

from __future__ import annotations

import pytest

from envgraph.errors import LoadError, Source
from envgraph.lang import TextFiles, load_workspace
from envgraph.metamodel import Metamodel, Reference, metamodel_to_ecore
from tests.reading import parse_ecore

URI = "http://www.eclipse.org/emf/2002/Ecore"
SPACES = f'xmlns:xmi="http://www.omg.org/XMI" xmlns:xsi="http://www.w3.org/2001/XMLSchema-instance" xmlns:ecore="{URI}"'


def package(body: str, name: str = "m", uri: str = "http://m") -> str:
    return f'<ecore:EPackage {SPACES} name="{name}" nsURI="{uri}" nsPrefix="{name}">\n{body}</ecore:EPackage>'


def cls(name: str, inside: str = "", attributes: str = "") -> str:
    return f'<eClassifiers xsi:type="ecore:EClass" name="{name}" {attributes}>{inside}</eClassifiers>\n'


def feature(kind: str, name: str, type_: str = "", inside: str = "", attributes: str = "") -> str:
    type_ = f'eType="{type_}"' if type_ else ""
    return (
        f'<eStructuralFeatures xsi:type="ecore:{kind}" name="{name}" {type_} {attributes}>{inside}'
        "</eStructuralFeatures>\n"
    )


def read(*bodies: str) -> Metamodel:
    return parse_ecore(Source("m.ecore", package("".join(bodies))))


def targets(metamodel: Metamodel, name: str) -> dict[str, str]:
    found = metamodel.features(name).values()
    return {one.name: one.target if isinstance(one, Reference) else str(one.type) for one in found}


# --- classes of Ecore ---

TRACES = package(
    cls("Trace", feature("EReference", "links", f"ecore:EClass {URI}#//EObject", attributes='upperBound="-1"'))
    + cls("Rule", attributes=f'eSuperTypes="{URI}#//ENamedElement"')
    + cls("Note")
)


def test_referenced_ecore_classes_are_added_and_every_class_extends_eobject() -> None:
    found = parse_ecore(Source("m.ecore", TRACES))
    assert [one.uri for one in found.packages] == ["http://m", URI]
    assert targets(found, "Trace") == {"links": "EObject"}
    assert list(found.features("Rule")) == ["eAnnotations", "name"]
    assert all(found.is_a(one, "EObject") for one in found.classes)


def test_a_reference_to_eobject_can_hold_objects_of_any_class() -> None:
    model = (
        f'<xmi:XMI {SPACES} xmlns:m="http://m"><m:Trace links="/1 /2 /0"/><m:Rule name="r"><eAnnotations source="s">'
        '<details key="k" value="v"/></eAnnotations></m:Rule><m:Note/></xmi:XMI>'
    )
    found = load_workspace(["m.ecore", "a.m"], files=TextFiles({"m.ecore": TRACES, "a.m": model}))
    assert not found.errors
    (trace,) = found.model().nodes("Trace")
    assert [one.cls for one in trace.links] == ["Rule", "Note", "Trace"]
    assert trace.links[0].eAnnotations[0].details[0].value == "v"


def test_ecore_classes_are_written_as_references_to_the_uri_of_ecore() -> None:
    found = parse_ecore(Source("m.ecore", TRACES))
    text = metamodel_to_ecore(found)
    assert text.count("<eClassifiers") == 3 and f'eSuperTypes="{URI}#//ENamedElement"' in text
    assert f'eType="ecore:EClass {URI}#//EObject"' in text
    again = parse_ecore(Source("m.ecore", text))
    assert (again.class_list, again.packages) == (found.class_list, found.packages)


def test_ecore_classes_are_not_added_if_only_ecore_data_types_are_used() -> None:
    found = read(
        cls(
            "A",
            feature("EAttribute", "a", f"ecore:EDataType {URI}#//EInt")
            + feature("EReference", "all", f"ecore:EClass {URI}#//EObject", attributes='derived="true"'),
        )
    )
    assert list(found.classes) == ["A"] and found.supertypes("A") == ("A",)


def test_a_loaded_file_with_the_uri_of_ecore_defines_the_classes_of_ecore() -> None:
    own = package(cls("EObject") + cls("EThing"), "ecore", URI)
    other = package(cls("A", attributes=f'eSuperTypes="{URI}#//EThing"'))
    files = TextFiles({"m.ecore": other, "Ecore.ecore": own})
    found = load_workspace(["m.ecore", "Ecore.ecore"], files=files).metamodel
    assert found and {*found.classes} == {"A", "EObject", "EThing"} and found.is_a("A", "EObject")
    (problem,) = load_workspace(["m.ecore"], files=TextFiles({"m.ecore": other})).errors
    assert problem.message == "Ecore has no type `EThing`"


@pytest.mark.parametrize("start", ["platform:/plugin/", "../../", "platform:/resource/"])
def test_ecore_can_be_referenced_by_the_path_of_its_eclipse_plugin(start: str) -> None:
    path = f"{start}org.eclipse.emf.ecore/model/Ecore.ecore"
    found = read(
        cls(
            "A",
            feature("EAttribute", "a", f"ecore:EDataType {path}#//EInt"),
            f'eSuperTypes="{path}#//EClass"',
        )
    )
    assert found.is_a("A", "EClassifier") and str(found.feature("A", "a").type) == "int"


# --- features ---


def test_volatile_features_are_kept_and_feature_maps_are_left_out() -> None:
    string = f"ecore:EDataType {URI}#//EString"
    found = read(
        cls(
            "A",
            feature("EAttribute", "volatile", string, attributes='volatile="true"')
            + feature("EAttribute", "cache", string, attributes='transient="true"')
            + feature(
                "EAttribute",
                "mixed",
                f"ecore:EDataType {URI}#//EFeatureMapEntry",
                attributes='upperBound="-1"',
            )
            + feature("EReference", "b", "#//B", attributes='containment="true" eOpposite="#//B/a"')
            + feature("EReference", "seen", "#//B", attributes='transient="true" eOpposite="#//B/sees"'),
        )
        + cls(
            "B",
            feature("EReference", "a", "#//A", attributes='transient="true" eOpposite="#//A/b"')
            + feature("EReference", "sees", "#//A", attributes='transient="true" eOpposite="#//A/seen"'),
        )
    )
    assert (list(found.features("A")), list(found.features("B"))) == (["volatile", "b"], ["a"])
    assert found.left_out_reason("A", "mixed") == "it is a feature map, and was left out of the metamodel"


# --- generic types ---

BOX = cls(
    "Box",
    '<eTypeParameters name="T"/>'
    + feature("EReference", "content", inside='<eGenericType eTypeParameter="#//Box/T"/>'),
)


def generic(classifier: str, arguments: str = "") -> str:
    return f'<eGenericType eClassifier="{classifier}">{arguments}</eGenericType>'


def test_arguments_are_left_out() -> None:
    arguments = '<eTypeArguments eClassifier="#//A"/><eTypeArguments><eUpperBound eClassifier="#//A"/></eTypeArguments>'
    found = read(
        BOX,
        cls(
            "A",
            feature("EReference", "boxes", inside=generic("#//Box", arguments), attributes='upperBound="-1"'),
        ),
        cls("B", f'<eGenericSuperTypes eClassifier="#//Box">{arguments}</eGenericSuperTypes>'),
        cls("C", feature("EAttribute", "type", inside=generic(f"{URI}#//EJavaClass", "<eTypeArguments/>"))),
    )
    assert targets(found, "A") == {"boxes": "Box"} and found.is_a("B", "Box")
    assert targets(found, "C") == {"type": "string"}
    assert targets(found, "B") == {"content": "EObject"}


def test_a_type_parameter_is_replaced_by_its_first_bound() -> None:
    parameters = (
        '<eTypeParameters name="T"><eBounds eClassifier="#//A"/><eBounds eClassifier="#//Box"/></eTypeParameters>'
        '<eTypeParameters name="U"><eBounds eTypeParameter="#//B/T"/></eTypeParameters><eTypeParameters name="V"/>'
        f'<eTypeParameters name="N"><eBounds eClassifier="{URI}#//EIntegerObject"/></eTypeParameters>'
    )
    inside = "".join(
        feature(kind, name.lower(), inside=f'<eGenericType eTypeParameter="#//B/{name}"/>')
        for kind, name in (("EReference", "T"), ("EReference", "U"), ("EAttribute", "V"), ("EAttribute", "N"))
    )
    found = read(BOX, cls("A"), cls("B", parameters + inside))
    assert targets(found, "B") == {"t": "A", "u": "A", "v": "string", "n": "int"}


def test_left_out_type_parameters_and_arguments_are_reported() -> None:
    text = package(BOX + cls("A", feature("EReference", "box", inside=generic("#//Box", "<eTypeArguments/>"))))
    found = load_workspace(["m.ecore"], files=TextFiles({"m.ecore": text})).diagnostics
    assert [one.message for one in found if one.code == "generic-type"] == [
        "`Box` is read without its type parameters",
        "`content` is read without its type arguments",
        "`box` is read without its type arguments",
    ]


def test_type_parameters_that_bound_each_other_are_an_error() -> None:
    parameters = "".join(
        f'<eTypeParameters name="{one}"><eBounds eTypeParameter="#//B/{other}"/></eTypeParameters>'
        for one, other in ("TU", "UT")
    )
    inside = feature("EReference", "t", inside='<eGenericType eTypeParameter="#//B/T"/>')
    with pytest.raises(LoadError) as caught:
        read(cls("B", parameters + inside))
    errors = [one.message for one in caught.value.diagnostics if one.severity == "error"]
    assert errors == ["the bounds of this type parameter refer to each other"]


# --- models of Ecore ---

QUERY = f"""import "{URI}"
pattern typed(owner : EClass, feature : EStructuralFeature, type : EClassifier) {{
    EClass.eStructuralFeatures(owner, feature);
    EStructuralFeature.eType(feature, type);
}}
pattern named(element : ENamedElement, name : java String) {{ ENamedElement.name(element, name); }}
"""


def test_an_ecore_file_can_be_queried_as_a_model_of_ecore() -> None:
    model = package(
        cls("A", feature("EReference", "b", "#//B") + feature("EReference", "b2", "#//sub/C"))
        + cls("B", feature("EReference", "self", "#//B"))
        + f'<eSubpackages name="sub">{cls("C")}</eSubpackages>'
    )
    found = load_workspace(["a.xmi", "q.vql"], files=TextFiles({"a.xmi": model, "q.vql": QUERY}))
    assert not found.errors
    engine = found.engine()
    rows = {(one.owner.name, one.feature.name, one.type.name) for one in engine.matches("typed")}
    assert rows == {("A", "b", "B"), ("A", "b2", "C"), ("B", "self", "B")}
    assert engine.count("named") == 8


def test_references_number_elements_with_the_same_name() -> None:
    operation = '<eOperations name="get"><eParameters name="{}" eType="#//A"/></eOperations>'
    body = cls("A", operation.format("x") + operation.format("y"))
    metamodel = package(cls("Use", feature("EReference", "of", f"{URI}#//EParameter", attributes='upperBound="-1"')))
    model = f'<m:Use {SPACES} xmlns:m="http://m" of="a.ecore#//A/get/x a.ecore#//A/get.1/y"/>'
    files = TextFiles({"m.ecore": metamodel, "a.ecore": package(body, "a", "a"), "a.use": model})
    found = load_workspace(["m.ecore", "a.use"], files=files)
    assert not found.errors
    assert [one.name for one in found.model().nodes("Use")[0].of] == ["x", "y"]
