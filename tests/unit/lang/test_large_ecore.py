"""Large `.ecore` files, and those with thousands of mistakes: read in a time that grows with the file."""

from __future__ import annotations

from collections.abc import Callable
from time import process_time

import pytest

from envgraph.errors import LoadError, Source
from tests.profile import NIGHTLY
from tests.reading import parse_ecore

HEAD = (
    '<ecore:EPackage xmlns:xmi="http://www.omg.org/XMI" xmlns:xsi="http://www.w3.org/2001/XMLSchema-instance" '
    'xmlns:ecore="http://www.eclipse.org/emf/2002/Ecore" name="m" nsURI="m">\n'
)
CLASS = '<eClassifiers xsi:type="ecore:EClass" name="{}" {}/>\n'


def package(body: str) -> Source:
    return Source("m.ecore", f"{HEAD}{body}</ecore:EPackage>")


def attributes(count: int) -> Source:
    return package(CLASS.format("A", " ".join(f'a{n}="1"' for n in range(count))))


def unknown(count: int) -> Source:
    return package("".join(CLASS.format(f"C{n}", f'eSuperTypes="#//D{n}"') for n in range(count)))


def chain(count: int) -> Source:
    above = ["", *(f'eSuperTypes="#//C{n}"' for n in range(count - 1))]
    return package("".join(CLASS.format(f"C{n}", above[n]) for n in range(count)))


def ring(count: int) -> Source:
    return package("".join(CLASS.format(f"C{n}", f'eSuperTypes="#//C{(n + 1) % count}"') for n in range(count)))


def wide(count: int) -> Source:
    """One class below all others, and names that are not ASCII."""
    names = [f"Ü{n}" for n in range(count)]
    return package(
        CLASS.format("Last", f'eSuperTypes="{" ".join(f"#//{name}" for name in names)}"')
        + "".join(CLASS.format(name, "") for name in names)
    )


def codes(source: Source) -> list[str]:
    try:
        parse_ecore(source)
    except LoadError as error:
        return [one.code for one in error.diagnostics]
    return []


@pytest.mark.parametrize("make", [attributes, unknown, chain, ring, wide])
def test_reading_takes_time_in_proportion_to_the_file(make: Callable[[int], Source]) -> None:
    codes(make(10))

    def seconds(count: int) -> float:
        source = make(count)
        started = process_time()
        codes(source)
        return process_time() - started

    few = 1000 if NIGHTLY else 400
    # A quadratic pass takes a hundred times as long.
    assert seconds(10 * few) < 40 * max(seconds(few), 0.02)


def test_a_file_with_too_many_tags_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    with pytest.raises(LoadError) as caught:
        parse_ecore(package(CLASS.format("C", "") * 200_000))
    (problem,) = caught.value.diagnostics
    assert problem.message == "the file has more than 100,000 tags"
    assert problem.span and problem.span.line == 100_001 and "ENVGRAPH_LIMITS" in str(problem.hint)
    monkeypatch.setenv("ENVGRAPH_LIMITS", "0.0001")
    assert codes(package(CLASS.format("A", "") + CLASS.format("B", ""))) == []
    assert codes(package(CLASS.format("C", "") * 10)) == ["too-many-tags"]


@pytest.mark.parametrize(
    ("make", "code"),
    [(attributes, "unknown-attribute"), (unknown, "unknown-class")],
)
def test_reading_stops_after_a_hundred_errors(make: Callable[[int], Source], code: str) -> None:
    assert sorted(codes(make(3000))) == sorted([code] * 100 + ["too-many-errors"])
    assert codes(make(99)) == [code] * 99


def test_a_cycle_of_thousands_of_supertypes_is_one_error() -> None:
    assert codes(ring(3000)) == ["cyclic-inheritance"]


def test_a_chain_of_thousands_of_supertypes_is_read() -> None:
    found = parse_ecore(chain(5000))
    assert len(found.supertypes("C4999")) == 5000
    assert len(found.concrete_classes("C0")) == 5000
    assert found.is_a("C4999", "C0")
    assert found.features("C4999") == {}


def test_spans_are_exact_in_texts_with_non_ascii_letters() -> None:
    text = CLASS.format("Last", 'eSuperTypes="#//Ü #//Nö #//Ü2"') + CLASS.format("Ü", "") + CLASS.format("Ü2", "")
    with pytest.raises(LoadError) as caught:
        parse_ecore(package(text))
    assert [one.span.text for one in caught.value.diagnostics] == ["#//Nö"]
