"""Features that an `.ecore` file has and a metamodel cannot hold: the rest of the file is used."""

from __future__ import annotations

import pytest

from envgraph.errors import Severity
from envgraph.lang import TextFiles, load_workspace

ECORE = """<ecore:EPackage xmlns:xsi="http://www.w3.org/2001/XMLSchema-instance"
    xmlns:ecore="http://www.eclipse.org/emf/2002/Ecore" name="m" nsURI="m" nsPrefix="m">
  <eClassifiers xsi:type="ecore:EClass" name="Item">
    <eStructuralFeatures xsi:type="ecore:EAttribute" name="words" transient="true" eType="ecore:EDataType http://www.eclipse.org/emf/2002/Ecore#//EString"/>
    <eStructuralFeatures xsi:type="ecore:EReference" name="long" derived="true" containment="true" eType="#//Item"/>
  </eClassifiers>
  <eClassifiers xsi:type="ecore:EClass" name="Book" eSuperTypes="#//Item">
    <eStructuralFeatures xsi:type="ecore:EAttribute" name="pages" eType="ecore:EDataType http://www.eclipse.org/emf/2002/Ecore#//EInt"/>
  </eClassifiers>
</ecore:EPackage>
"""
XMI = """<m:Book xmlns:m="m" pages="3" long="x">
  <words>a</words>
  <words>b</words>
</m:Book>
"""


def loaded(query: str):
    files = {"m.ecore": ECORE, "m.xmi": XMI, "q.query": f'import "m.ecore"\n{query}'}
    return load_workspace(["m.xmi", "q.query"], files=TextFiles(files))


def test_features_left_out_of_a_metamodel_are_warnings_and_not_errors() -> None:
    found = loaded("pattern p(b : Book) { Book.pages(b, 3); }")
    assert [(one.severity, one.code) for one in found.diagnostics if one.code == "left-out"] == [
        (Severity.WARNING, "left-out"),
        (Severity.WARNING, "left-out"),
    ]
    assert not [one for one in found.diagnostics if one.severity is Severity.ERROR]


@pytest.mark.parametrize(
    ("body", "reason"),
    [
        ("Book.words(b, _);", "it is transient, and was left out of the metamodel"),
        ("Book.long(b, _);", "it is derived, and was left out of the metamodel"),
        ("check(b.words == 3);", "it is transient, and was left out of the metamodel"),
    ],
)
def test_a_query_with_a_left_out_feature_gets_the_reason_as_a_hint(body: str, reason: str) -> None:
    found = loaded(f"pattern p(b : Book) {{ Book(b); {body} }}")
    errors = [one for one in found.diagnostics if one.severity is Severity.ERROR]
    assert [(one.code, one.hint) for one in errors] == [("unknown-feature", reason)]


def test_a_feature_of_another_class_is_an_unknown_feature() -> None:
    found = loaded("pattern p(b : Book) { Book.word(b, _); }")
    assert [one.code for one in found.diagnostics if one.severity is Severity.ERROR] == ["unknown-feature"]


@pytest.mark.parametrize("fragment", ["/@items.0", "/x", "@items.0"])
def test_a_fragment_without_a_root_is_an_unknown_object(fragment: str) -> None:
    reference = (
        '<eStructuralFeatures xsi:type="ecore:EReference" name="next" eType="#//Item"/>'
        '<eStructuralFeatures xsi:type="ecore:EReference" name="items" upperBound="-1" '
        'containment="true" eType="#//Item"/>'
    )
    text = ECORE.replace('name="Item">', f'name="Item">{reference}')
    model = f'<m:Book xmlns:m="m" next="{fragment}"/>'
    found = load_workspace(["m.xmi", "m.ecore"], files=TextFiles({"m.ecore": text, "m.xmi": model}))
    errors = [one.code for one in found.diagnostics if one.severity is Severity.ERROR]
    assert errors == ["unknown-object"]
