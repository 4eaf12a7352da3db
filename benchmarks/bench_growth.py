"""Time at n, 2n and 4n, and the exponent with which it grows.

    python -m benchmarks growth

Seconds of the processor, the least of three runs. The exponent is that of n with which the time would grow from the
first size to the last one: 1 is linear.
"""

from __future__ import annotations

from collections.abc import Callable
from math import log
from time import process_time

from envgraph.errors import Source
from envgraph.graph import model_to_xmi
from envgraph.lang import parse_ecore, parse_xmi
from envgraph.metamodel import metamodel_to_ecore

FULL = 1000
QUICK = 100
RUNS = 3

_HEAD = (
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


def seconds(work: Callable[[], object]) -> float:
    """Return the least time of the processor that a piece of work takes."""
    found = []
    for _ in range(RUNS):
        started = process_time()
        work()
        found.append(process_time() - started)
    return min(found)


def grow(name: str, size: int, work: Callable[[int], Callable[[], object]]) -> None:
    """Print the times of a piece of work that is prepared for n, 2n and 4n."""
    times = [seconds(work(size * factor)) for factor in (1, 2, 4)]
    exponent = log(times[-1] / times[0], 4)
    print(f"{name:34}{size:>9,}" + "".join(f"{one:>9.3f}" for one in times) + f"{exponent:>10.2f}")


def ecore(classes: int) -> Callable[[], object]:
    """Read and write an `.ecore` file with annotations, flags and a data type."""
    text = _HEAD + "".join(map(_CLASS.format, range(classes))) + "</ecore:EPackage>"
    return lambda: metamodel_to_ecore(parse_ecore(Source("bank.ecore", text)))


def decimals(objects: int) -> Callable[[], object]:
    """Read and write an `.xmi` file in which each object has a decimal that no float holds."""
    metamodel = parse_ecore(Source("bank.ecore", f"{_HEAD}{_CLASS.format(0)}</ecore:EPackage>"))
    inside = "".join(f'<parts sum="12345678901234567890.{place}"/>' for place in range(objects))
    text = f'<b:C0 xmlns:b="bank">{inside}</b:C0>'
    return lambda: model_to_xmi(parse_xmi(Source("bank.xmi", text), metamodel))


def main(size: int) -> None:
    """Print a line for each piece of work."""
    print(f"{'':34}{'n':>9}{'n':>9}{'2n':>9}{'4n':>9}{'exponent':>10}")
    grow("classes through .ecore", size, ecore)
    grow("objects with decimals through .xmi", size * 10, decimals)
