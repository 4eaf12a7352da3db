"""Read `.ecore` and `.xmi` files whose links are paths, keys, and children in other files."""

from __future__ import annotations

import atexit
from collections.abc import Callable, Iterator
from pathlib import Path
from shutil import rmtree
from tempfile import mkdtemp

from benchmarks._growth import Case
from envgraph.errors import Source
from envgraph.graph import model_to_xmi
from envgraph.lang import TextFiles, load_workspace
from envgraph.metamodel import metamodel_to_ecore
from tests.reading import parse_ecore, parse_xmi

_HEAD = 'xmlns:xmi="http://www.omg.org/XMI" xmlns:xsi="http://www.w3.org/2001/XMLSchema-instance"'
_STRING = "ecore:EDataType http://www.eclipse.org/emf/2002/Ecore#//EString"
_PARTS = f"""<ecore:EPackage {_HEAD} xmlns:ecore="http://www.eclipse.org/emf/2002/Ecore"
    name="e" nsURI="e" nsPrefix="e">
  <eClassifiers xsi:type="ecore:EClass" name="Part">
    <eStructuralFeatures xsi:type="ecore:EAttribute" name="name" eType="{_STRING}"/>
    <eStructuralFeatures xsi:type="ecore:EReference" name="parts" upperBound="-1" eType="#//Part" containment="true"/>
    <eStructuralFeatures xsi:type="ecore:EReference" name="next" eType="#//Part" eOpposite="#//Part/before"/>
    <eStructuralFeatures xsi:type="ecore:EReference" name="before" eType="#//Part" eOpposite="#//Part/next"/>
    <eStructuralFeatures xsi:type="ecore:EReference" name="uses" upperBound="-1" eType="#//Part"/>
  </eClassifiers>
</ecore:EPackage>"""


def _part(inside: str, attributes: str = "") -> str:
    return f'<e:Part {_HEAD} xmlns:e="e" {attributes}>{inside}</e:Part>'


def cases() -> Iterator[Case]:
    """Yield files to read whose links are paths, keys, and children in other files."""
    metamodel = parse_ecore(Source("e.ecore", _PARTS))

    def one_file(text: str) -> Callable[[], object]:
        return lambda: parse_xmi(Source("a.xmi", text), metamodel)

    def paths(size: int) -> Callable[[], object]:
        return one_file(_part("".join(f'<parts next="//@parts.{(n + 1) % size}"/>' for n in range(size))))

    def keys(size: int) -> Callable[[], object]:
        parts = (f"""<parts name="p{n}" next="//@parts[name='p{(n + 1) % size}']"/>""" for n in range(size))
        return one_file(_part("".join(parts)))

    def hrefs(size: int) -> Callable[[], object]:
        inside = "".join(f'<parts href="b.xmi#/{n}"/><parts/>' for n in range(size))
        words = " ".join(f"//@parts.{n}" for n in range(2 * size))
        main = _part(inside, f'uses="{words}"')
        other = f'<xmi:XMI {_HEAD} xmlns:e="e">{"<e:Part/>" * size}</xmi:XMI>'
        files = TextFiles({"e.ecore": _PARTS, "a.xmi": main, "b.xmi": other})
        return lambda: load_workspace(["e.ecore", "a.xmi"], files=files).model()

    def files(size: int) -> Callable[[], object]:
        main = _part("".join(f'<parts href="f{n}.xmi#/"/>' for n in range(size)))
        directory = Path(mkdtemp())
        atexit.register(rmtree, directory)
        texts = {f"f{n}.xmi": _part("<parts/>") for n in range(size)} | {"e.ecore": _PARTS, "a.xmi": main}
        for name, text in texts.items():
            (directory / name).write_text(text, "utf-8")
        return lambda: load_workspace([directory / "e.ecore", directory / "a.xmi"]).model()

    yield "xmi: paths", 5_000, paths
    yield "xmi: paths with keys", 5_000, keys
    yield "xmi: children by href", 5_000, hrefs
    yield "xmi: a file for each child", 500, files
    yield "ecore: classes, read and written", 1_000, ecore
    yield "xmi: decimals, read and written", 10_000, decimals


_BANK = (
    '<ecore:EPackage xmi:version="2.0" xmlns:xmi="http://www.omg.org/XMI" '
    'xmlns:xsi="http://www.w3.org/2001/XMLSchema-instance" xmlns:ecore="http://www.eclipse.org/emf/2002/Ecore" '
    'name="bank" nsURI="bank" nsPrefix="bank">'
    '<eClassifiers xsi:type="ecore:EDataType" name="Money" instanceClassName="java.math.BigDecimal"/>'
)
_CLASS = (
    '<eClassifiers xsi:type="ecore:EClass" name="C{0}"><eAnnotations source="OCL"><details key="k" value="{0}"/>'
    '</eAnnotations><eStructuralFeatures xsi:type="ecore:EAttribute" name="sum" changeable="false" eType="#//Money"/>'
    '<eStructuralFeatures xsi:type="ecore:EReference" name="parts" upperBound="-1" containment="true" '
    'resolveProxies="false" eType="#//C{0}"/></eClassifiers>'
)


def ecore(classes: int) -> Callable[[], object]:
    """Read and write an `.ecore` file with annotations, flags and a data type."""
    text = _BANK + "".join(map(_CLASS.format, range(classes))) + "</ecore:EPackage>"
    return lambda: metamodel_to_ecore(parse_ecore(Source("bank.ecore", text)))


def decimals(objects: int) -> Callable[[], object]:
    """Read and write an `.xmi` file in which each object has a decimal that no float holds."""
    metamodel = parse_ecore(Source("bank.ecore", f"{_BANK}{_CLASS.format(0)}</ecore:EPackage>"))
    inside = "".join(f'<parts sum="12345678901234567890.{place}"/>' for place in range(objects))
    text = f'<b:C0 xmlns:b="bank">{inside}</b:C0>'
    return lambda: model_to_xmi(parse_xmi(Source("bank.xmi", text), metamodel))
