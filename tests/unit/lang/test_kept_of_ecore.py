"""What an `.ecore` file says for other tools alone is kept as annotations, and written again."""

from __future__ import annotations

import re
from typing import Any

import pytest

from envgraph.errors import Source
from envgraph.lang import TextFiles, load_workspace
from envgraph.metamodel import Attribute, Class, Metamodel, Scalar, metamodel_to_ecore
from tests.reading import parse_ecore

HEAD = (
    '<ecore:EPackage xmi:version="2.0" xmlns:xmi="http://www.omg.org/XMI" '
    'xmlns:xsi="http://www.w3.org/2001/XMLSchema-instance" xmlns:ecore="http://www.eclipse.org/emf/2002/Ecore" '
    'name="bank" nsURI="http://x/bank" nsPrefix="b">'
)
ECORE = "ecore:EDataType http://www.eclipse.org/emf/2002/Ecore#//"
GENMODEL = "http://www.eclipse.org/emf/2002/GenModel"
BANK = f"""{HEAD}
  <eAnnotations source="http://www.eclipse.org/emf/2002/Ecore">
    <details key="validationDelegates" value="http://www.eclipse.org/emf/2002/Ecore/OCL/Pivot"/>
  </eAnnotations>
  <eAnnotations source="{GENMODEL}"><details key="documentation" value="All."/></eAnnotations>
  <eClassifiers xsi:type="ecore:EDataType" name="Money" instanceClassName="java.math.BigDecimal" serializable="false">
    <eAnnotations source="http:///org/eclipse/emf/ecore/util/ExtendedMetaData">
      <details key="name" value="money"/><details key="baseType" value="decimal"/>
    </eAnnotations>
    <eAnnotations source="{GENMODEL}"><details key="documentation" value="Coins."/></eAnnotations>
  </eClassifiers>
  <eClassifiers xsi:type="ecore:EClass" name="Bank" instanceClassName="my.Bank">
    <eAnnotations source="http://www.eclipse.org/emf/2002/Ecore">
      <details key="constraints" value="positive"/>
    </eAnnotations>
    <eAnnotations source="http://www.eclipse.org/emf/2002/Ecore/OCL/Pivot">
      <details key="positive" value="self.n &gt; 0 and&#10;self.n &lt; &quot;9&quot;"/>
    </eAnnotations>
    <eAnnotations source="{GENMODEL}">
      <details key="documentation" value="A bank."/><details key="image" value="false"/>
    </eAnnotations>
    <eAnnotations source="gmf.node">
      <details key="label.icon" value="no"/><details key="label" value="name"/>
    </eAnnotations>
    <eAnnotations source="empty"/>
    <eStructuralFeatures xsi:type="ecore:EAttribute" name="n" eType="{ECORE}EInt" unsettable="true" changeable="false"/>
    <eStructuralFeatures xsi:type="ecore:EAttribute" name="m" lowerBound="1" eType="#//Money"
        defaultValueLiteral="1.50"/>
    <eStructuralFeatures xsi:type="ecore:EAttribute" name="list" upperBound="-1" ordered="false" unique="false"
        eType="{ECORE}EDate" defaultValueLiteral="2020-01-01"/>
    <eStructuralFeatures xsi:type="ecore:EAttribute" name="word" lowerBound="1" eType="{ECORE}EString" iD="true"/>
    <eStructuralFeatures xsi:type="ecore:EAttribute" name="other" eType="{ECORE}EString" defaultValueLiteral="a"/>
    <eStructuralFeatures xsi:type="ecore:EAttribute" name="kind" lowerBound="1" eType="#//inner/Kind"/>
    <eStructuralFeatures xsi:type="ecore:EAttribute" name="day" eType="#//inner/Day"/>
    <eStructuralFeatures xsi:type="ecore:EReference" name="accounts" upperBound="-1" ordered="false" unique="false"
        eType="#//Account" containment="true" resolveProxies="false" eKeys="#//Account/number #//Named/name"/>
    <eStructuralFeatures xsi:type="ecore:EReference" name="best" upperBound="-2" eType="#//Account"/>
    <eStructuralFeatures xsi:type="ecore:EReference" name="rich" lowerBound="1" upperBound="-1" eType="#//Account"
        changeable="false" volatile="true" transient="true" derived="true" eOpposite="#//Account/bank"/>
    <eStructuralFeatures xsi:type="ecore:EAttribute" name="total" lowerBound="1" eType="#//Money" derived="true"/>
  </eClassifiers>
  <eClassifiers xsi:type="ecore:EClass" name="Account" abstract="true" eSuperTypes="#//Named">
    <eStructuralFeatures xsi:type="ecore:EAttribute" name="number" eType="{ECORE}ELongObject"/>
    <eStructuralFeatures xsi:type="ecore:EReference" name="bank" eType="#//Bank" volatile="true" transient="true"
        derived="true" eOpposite="#//Bank/rich"/>
  </eClassifiers>
  <eClassifiers xsi:type="ecore:EClass" name="Named" abstract="true" interface="true">
    <eStructuralFeatures xsi:type="ecore:EAttribute" name="name" eType="{ECORE}EString"/>
  </eClassifiers>
  <eClassifiers xsi:type="ecore:EClass" name="Loose" interface="true"/>
  <eSubpackages name="inner" nsURI="http://x/inner" nsPrefix="i">
    <eAnnotations source="inside"/>
    <eClassifiers xsi:type="ecore:EEnum" name="Kind" instanceClassName="my.Kind" serializable="false">
      <eAnnotations source="kinds"><details key="a" value="b"/></eAnnotations>
      <eLiterals name="one"/><eLiterals name="two" value="2" literal="zwei"/>
    </eClassifiers>
    <eClassifiers xsi:type="ecore:EDataType" name="Day" instanceClassName="java.util.Date"/>
  </eSubpackages>
</ecore:EPackage>
"""


def metamodel(text: str = BANK) -> Metamodel:
    return parse_ecore(Source("bank.ecore", text))


def in_words(thing: Any) -> object:
    """An object of pyecore with all that is in it: texts, names of what is named, and parts in the order of names."""
    found = {}
    for feature in thing.eClass.eAllStructuralFeatures():
        if feature.derived or feature.transient or feature.name in ("eGenericType", "eGenericSuperTypes"):
            continue
        value = getattr(thing, feature.name)
        parts = list(value) if feature.many else [value]
        if feature.name == "details":
            found["details"] = dict(value)
        elif getattr(feature, "containment", False):
            found[feature.name] = sorted((in_words(part) for part in parts if part is not None), key=str)
        else:
            found[feature.name] = [getattr(part, "name", part) for part in parts]
    return found


def test_pyecore_sees_the_same_package_before_and_after() -> None:
    side = pytest.importorskip("tests.oracle.pyecore_side", exc_type=ImportError)
    unknown = ' eKeys="[^"]*"| instanceClassName="my.Kind"'  # to pyecore
    texts = [re.sub(unknown, "", text) for text in (BANK, metamodel_to_ecore(metamodel()))]
    before, after = (in_words(side.read_package(text)) for text in texts)
    assert before == after
    assert "my.Bank" in str(after) and "positive" in str(after) and "label.icon" in str(after)


def test_reading_and_writing_twice_changes_nothing() -> None:
    once = metamodel()
    text = metamodel_to_ecore(once)
    again = metamodel(text)
    assert (again.class_list, again.enum_types, again.packages) == (
        once.class_list,
        once.enum_types,
        once.packages,
    )
    assert metamodel_to_ecore(again) == text


def test_written_files_have_all_annotations_and_attributes() -> None:
    """Compare word for word, since pyecore reads neither `eKeys` nor `serializable`."""
    text = metamodel_to_ecore(metamodel())
    for word in (
        'name="Money" instanceClassName="java.math.BigDecimal" serializable="false"',
        'eKeys="#//Account/number #//Named/name"',
        'name="Loose" abstract="false" interface="true"',
        'name="best" upperBound="-2"',
        'lowerBound="1" eType="#//Money" defaultValueLiteral="1.50"',
        'eType="#//inner/Day"',
        'unique="false"',
        'name="Kind" instanceClassName="my.Kind" serializable="false"',
    ):
        assert word in text, word


def test_annotations_are_data_in_their_order() -> None:
    bank = metamodel().classes["Bank"]
    assert [one.arguments[0] for one in bank.annotations if one.name == "annotation"] == [
        "http://www.eclipse.org/emf/2002/Ecore",
        "http://www.eclipse.org/emf/2002/Ecore/OCL/Pivot",
        "http://www.eclipse.org/emf/2002/GenModel",
        "gmf.node",
        "empty",
    ]
    assert bank.doc == "A bank."
    assert bank.annotations[1].named == (("positive", 'self.n > 0 and\nself.n < "9"'),)
    assert bank.annotations[3].arguments == ("gmf.node", "label.icon", "no", "label", "name")


def test_defaults_of_ecore_need_no_annotation() -> None:
    plain = Metamodel("m", [Class("A", features=(Attribute("n", Scalar.INT), Attribute("s", Scalar.STRING)))])
    assert all(not one.annotations for one in metamodel(metamodel_to_ecore(plain)).attributes)


def test_derived_containments_annotated_as_attributes_stay_derived() -> None:
    said = (
        '<eAnnotations source="http:///org/eclipse/emf/ecore/util/ExtendedMetaData">'
        '<details key="kind" value="attribute"/></eAnnotations>'
    )
    flags = 'containment="true" derived="true" transient="true" volatile="true"'
    text = (
        f'{HEAD}<eClassifiers xsi:type="ecore:EClass" name="A">'
        f'<eStructuralFeatures xsi:type="ecore:EReference" name="nodes" {flags} eType="#//A">{said}'
        "</eStructuralFeatures></eClassifiers></ecore:EPackage>"
    )
    (reference,) = metamodel(text).references
    assert reference.annotations[-1].named == (
        ("derived", "true"),
        ("transient", "true"),
        ("volatile", "true"),
    )
    assert metamodel(metamodel_to_ecore(metamodel(text))).references == (reference,)


def test_volatile_features_are_computed_as_derived_ones() -> None:
    flags = 'transient="true" volatile="true"'
    text = (
        f'{HEAD}<eClassifiers xsi:type="ecore:EClass" name="A">'
        f'<eStructuralFeatures xsi:type="ecore:EReference" name="owner" {flags} lowerBound="1" eType="#//A"/>'
        "</eClassifiers></ecore:EPackage>"
    )
    first = metamodel(text)
    (owner,) = first.references
    assert (owner.annotations[0].name, owner.lower) == ("derived", 0)
    written = metamodel_to_ecore(first)
    assert 'derived="false"' in written and 'lowerBound="1"' in written
    assert metamodel(written).references == (owner,)


def test_documentation_is_written_first() -> None:
    text = f"""{HEAD}<eClassifiers xsi:type="ecore:EClass" name="A">
        <eAnnotations source="http://www.eclipse.org/emf/2002/GenModel"><details key="documentation" value="d"/>
        </eAnnotations>
        <eAnnotations source="subsets"/></eClassifiers></ecore:EPackage>"""
    written = metamodel_to_ecore(metamodel(text))
    assert written.index("documentation") < written.index("subsets")


def test_lost_parts_of_an_ecore_file_are_counted() -> None:
    text = (
        HEAD
        + '<eClassifiers xsi:type="ecore:EEnum" name="E" xmi:id="_1"><eLiterals name="a"><eAnnotations source="s"/>'
        '</eLiterals><eLiterals name="b"><eAnnotations source="s"/></eLiterals></eClassifiers>'
        '<eClassifiers xsi:type="ecore:EClass" name="A" xmi:id="_2"><eOperations name="f"/>'
        '<eAnnotations source="deep" references="#//E"><eAnnotations source="t"/><contents xsi:type="ecore:EObject"/>'
        "</eAnnotations></eClassifiers></ecore:EPackage>"
    )
    found = load_workspace(["m.ecore"], files=TextFiles({"m.ecore": text})).diagnostics
    assert [one.message for one in found] == [
        "left out: 2 attributes `xmi:id` of other tools",
        "left out: 2 tags `eAnnotations` in `EEnumLiteral`",
        "left out: 1 operation of classes",
        "left out: 1 attribute `references` in annotations",
        "left out: 1 tag `eAnnotations` in annotations",
        "left out: 1 tag `contents` in annotations",
    ]
    assert {one.code for one in found} == {"left-out"}


RICH = """import epackage "http://x/bank"
@QueryBasedFeature pattern rich(this : Bank, target : Account) {
    Bank.accounts(this, target); Account.number(target, n); check(n > 9);
}
@QueryBasedFeature pattern bank(this : Account, target : Bank) { Bank.rich(target, this); }
pattern of(account : Account, owner : Bank) { Account.bank(account, owner); }
"""


def test_derived_features_are_kept_and_queries_define_them() -> None:
    concrete = BANK.replace('name="Account" abstract="true"', 'name="Account"')
    model = '<b:Bank xmlns:b="http://x/bank" n="1"><accounts number="3"/><accounts number="10"/></b:Bank>'
    texts = {"bank.ecore": concrete, "bank.xmi": model, "rich.vql": RICH}
    workspace = load_workspace(["bank.ecore", "bank.xmi", "rich.vql"], files=TextFiles(texts))
    assert [str(one) for one in workspace.diagnostics if one.code == "derived-feature"] == []
    engine = workspace.engine()
    (bank,) = engine.model.nodes("Bank")
    assert [one.number for one in bank.rich] == [10]
    assert [match["account"].number for match in engine.matches("of")] == [10]
    first = bank.accounts[0]
    first.number = 11
    assert [one.number for one in bank.rich] == [11, 10] and first.bank == bank
