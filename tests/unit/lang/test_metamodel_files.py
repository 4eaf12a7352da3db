"""`.metamodel` files: what they mean. What is said about mistakes: tests/golden/metamodel."""

from typing import Any

from envgraph.metamodel import Annotation, Attribute, Class, EnumType, Glyph, Metamodel, Reference, Scalar
from tests.reading import read_metamodel_text


def file(text: str) -> Any:
    return read_metamodel_text(text)


def metamodel(text: str) -> Metamodel:
    result = file(f"metamodel m {text}")
    assert result.metamodel is not None, result.diagnostics[0]
    return result.metamodel


def test_header_gives_name_and_uri() -> None:
    found = file('metamodel shop uri "http://example.org/shop";').metamodel
    assert found is not None
    assert (found.name, found.uri) == ("shop", "http://example.org/shop")


def test_classes_keep_order_supertypes_and_abstractness() -> None:
    found = metamodel("abstract class A; class B extends A class C extends A, D { } class D")
    assert [(one.name, one.abstract, one.supertypes) for one in found.class_list] == [
        ("A", True, ()),
        ("B", False, ("A",)),
        ("C", False, ("A", "D")),
        ("D", False, ()),
    ]


def test_attributes_have_types_and_defaults() -> None:
    found = metamodel(
        """
        enum Colour { red, green, }
        class A {
            int a = -3; float b = 2; bool c = true; string d = "x"
            Colour e = ::green  Colour f = green  Colour g = Colour::green  Colour h
        }
        """
    )
    colour = EnumType("Colour", ("red", "green"))
    assert found.classes["A"].features == tuple(
        Attribute(name, type_, default, owner="A")
        for name, type_, default in [
            ("a", Scalar.INT, -3),
            ("b", Scalar.FLOAT, 2.0),
            ("c", Scalar.BOOL, True),
            ("d", Scalar.STRING, "x"),
            ("e", colour, "green"),
            ("f", colour, "green"),
            ("g", colour, "green"),
            ("h", colour, None),
        ]
    )
    default = found.classes["A"].features[1]
    assert isinstance(default, Attribute) and type(default.default) is float


def test_references_have_multiplicities_containment_and_opposites() -> None:
    found = metamodel(
        """
        class A {
            refers A one  refers A[2] two  refers A[0..1] maybe  refers A[*] many  refers A[1..*] some
            refers A[] any  refers A[2..3] few
            contains A[0..*] parts opposite whole  refers A[0..1] whole opposite parts
        }
        """
    )
    bounds = {one.name: (one.lower, one.upper) for one in found.references}
    assert bounds == {
        "one": (1, 1),
        "two": (2, 2),
        "maybe": (0, 1),
        "many": (0, None),
        "some": (1, None),
        "any": (0, None),
        "few": (2, 3),
        "parts": (0, None),
        "whole": (0, 1),
    }
    assert [(one.name, one.opposite) for one in found.references if one.containment] == [("parts", "whole")]


def test_annotations_become_key_glyph_and_frozen() -> None:
    found = metamodel('@key(y, x) @glyph("T", "#123456") @frozen class T { int x int y } @glyph("U") class U')
    tile = found.classes["T"]
    assert (tile.key, tile.glyph, tile.frozen) == (("y", "x"), Glyph("T", "#123456"), True)
    assert tile.annotations[0] == Annotation("key", ("y", "x"))
    assert found.classes["U"].glyph == Glyph("U")


def test_doc_comments_stay_with_their_definitions() -> None:
    found = metamodel(
        """
        /** A colour. */ enum Colour { red }
        /** A tile.
         * Of the floor. */
        @frozen class Tile { /** Column. */ int x  int y  /** Beside it. */ refers Tile[0..1] right }
        """
    )
    assert found.enums["Colour"].doc == "A colour."
    assert found.classes["Tile"].doc == "A tile.\nOf the floor."
    assert [one.doc for one in found.classes["Tile"].features] == ["Column.", None, "Beside it."]


def test_every_definition_has_the_span_of_its_name() -> None:
    features = "E e = ::b  refers A[0..1] f opposite g  refers A[0..1] g opposite f"
    found = metamodel(f"enum E {{ a, b }} class A extends B {{ {features} }} class B")

    def text(item: Class | Attribute | Reference | EnumType) -> str:
        assert item.span is not None
        return item.span.text

    assert [text(one) for one in (*found.class_list, *found.enum_types)] == ["A", "B", "E"]
    assert [text(one) for one in found.classes["A"].features] == ["e", "f", "g"]
    places = [(what, span.text) for item in (*found.class_list, *found.enum_types) for what, span in item.places]
    assert places == [("extends B", "B"), ("literal 0", "a"), ("literal 1", "b")]
    first, second, _ = found.classes["A"].features
    assert [(what, span.text) for what, span in first.places] == [("type", "E"), ("default", "::b")]
    assert [(what, span.text) for what, span in second.places] == [
        ("target", "A"),
        ("multiplicity", "[0..1]"),
        ("opposite", "g"),
    ]


def test_keywords_are_names_where_they_are_not_expected() -> None:
    found = metamodel("class uri { string opposite  int ^contains }")
    assert [one.name for one in found.classes["uri"].features] == ["opposite", "contains"]


def test_errors_leave_no_metamodel() -> None:
    assert file("metamodel m class A extends B").metamodel is None
    assert file("metamodel m class A { integer x }").metamodel is None
    assert file("metamodel m class A {").metamodel is None
