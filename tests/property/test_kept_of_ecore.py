"""Random `.ecore` files say the same after they have been read and written, attribute by attribute of the XML."""

from __future__ import annotations

from xml.etree import ElementTree
from xml.sax.saxutils import quoteattr

from hypothesis import given, strategies as st

from envgraph.errors import Source
from envgraph.metamodel import metamodel_to_ecore
from tests.reading import parse_ecore

HEAD = (
    '<ecore:EPackage xmi:version="2.0" xmlns:xmi="http://www.omg.org/XMI" '
    'xmlns:xsi="http://www.w3.org/2001/XMLSchema-instance" xmlns:ecore="http://www.eclipse.org/emf/2002/Ecore" '
    'name="p" nsURI="p" nsPrefix="p"><eClassifiers xsi:type="ecore:EDataType" name="Money" '
    'instanceClassName="java.math.BigDecimal"/><eClassifiers xsi:type="ecore:EDataType" name="Raw" '
    'instanceClassName="int"/><eClassifiers xsi:type="ecore:EEnum" name="Kind"><eLiterals name="a"/></eClassifiers>'
    '<eClassifiers xsi:type="ecore:EClass" name="Part"/><eClassifiers xsi:type="ecore:EClass" name="Whole">'
)
LIBRARY = (
    "EInt",
    "ELong",
    "EIntegerObject",
    "EBigInteger",
    "EFloat",
    "EDouble",
    "EDoubleObject",
    "EBigDecimal",
)
TYPES = [f"ecore:EDataType http://www.eclipse.org/emf/2002/Ecore#//{name}" for name in (*LIBRARY, "EBoolean")]
TYPES += [f"ecore:EDataType http://www.eclipse.org/emf/2002/Ecore#//{name}" for name in ("EString", "EChar", "EDate")]
TYPES += [
    "ecore:EDataType http://www.eclipse.org/emf/2003/XMLType#//Decimal",
    "#//Money",
    "#//Raw",
    "#//Kind",
]
USUAL = {
    **{
        "ordered": "true",
        "unique": "true",
        "changeable": "true",
        "resolveProxies": "true",
        "lowerBound": "0",
    },
    **{"upperBound": "1", "volatile": "false", "unsettable": "false", "iD": "false", "containment": "false"},
}
"""What Ecore means where nothing is said."""
FLAGS = ("ordered", "unique", "changeable", "volatile", "unsettable")
BOOLS = st.sampled_from(["true", "false"])


@st.composite
def features(draw: st.DrawFn) -> dict[str, str]:
    """The XML attributes of a feature."""
    found = {name: draw(BOOLS) for name in draw(st.sets(st.sampled_from(FLAGS)))}
    if draw(st.booleans()):
        found["lowerBound"] = draw(st.sampled_from(["0", "1"]))
    if draw(st.booleans()):
        found["upperBound"] = draw(st.sampled_from(["1", "2", "-1", "-2"]))
    if draw(st.booleans()):
        found |= {"xsi:type": "ecore:EReference", "eType": "#//Part"}
        found |= {name: draw(BOOLS) for name in draw(st.sets(st.sampled_from(["containment", "resolveProxies"])))}
        return found
    found |= {"xsi:type": "ecore:EAttribute", "eType": draw(st.sampled_from(TYPES))}
    word = found["eType"].rpartition("/")[2]
    if draw(st.booleans()):
        texts = {"EBoolean": "true", "Kind": "a"}.get(word, draw(st.sampled_from(["0", "1", "7"])))
        found["defaultValueLiteral"] = texts
    return found


def feature_attributes(text: str) -> list[dict[str, str]]:
    """What the tags of the features say beside the usual."""
    tags = ElementTree.fromstring(text).iter("eStructuralFeatures")
    return [{key: value for key, value in tag.attrib.items() if USUAL.get(key) != value} for tag in tags]


@given(st.lists(features(), max_size=4))
def test_ecore_features_keep_their_xml_attributes_after_reading_and_writing(
    found: list[dict[str, str]],
) -> None:
    tags = [
        f"<eStructuralFeatures name='f{place}' {' '.join(f'{key}={quoteattr(value)}' for key, value in one.items())}/>"
        for place, one in enumerate(found)
    ]
    text = f"{HEAD}{''.join(tags)}</eClassifiers></ecore:EPackage>"
    metamodel = parse_ecore(Source("p.ecore", text))
    written = metamodel_to_ecore(metamodel)
    assert feature_attributes(written) == feature_attributes(text)
    again = parse_ecore(Source("p.ecore", written))
    assert (again.class_list, again.packages) == (metamodel.class_list, metamodel.packages)
