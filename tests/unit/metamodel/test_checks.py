"""What is wrong with a metamodel is said at once, with a code and a hint."""

import pytest

from envgraph.errors import ResolutionError, Source
from envgraph.metamodel import Attribute, Class, EnumType, Glyph, Metamodel, Reference, Scalar

INT = Scalar.INT
WAY = EnumType("Way", ("west", "east"))


def problems(*classes, enums=()):
    """Diagnostics of a metamodel that must have some."""
    with pytest.raises(ResolutionError) as caught:
        Metamodel("m", classes, enums)
    return caught.value.diagnostics


def cls(name, *features, **more):
    return Class(name, features=features, **more)


@pytest.mark.parametrize(
    ("classes", "code", "message", "hint"),
    [
        (
            [cls("A"), cls("A")],
            "duplicate-definition",
            "`A` is defined twice",
            "rename or delete one of the two definitions",
        ),
        ([cls("A", supertypes=("B",)), cls("C")], "unknown-class", "unknown class `B`", "there is `C`"),
        (
            [cls("Tile", supertypes=("Stat",)), cls("State")],
            "unknown-class",
            "unknown class `Stat`",
            "did you mean `State`?",
        ),
        (
            [cls("A", supertypes=("A",))],
            "cyclic-inheritance",
            "`A` is its own supertype",
            "remove one supertype of the cycle",
        ),
        (
            [cls("B"), cls("A", supertypes=("B", "B"))],
            "duplicate-definition",
            "`A` names a supertype twice",
            "write each name once",
        ),
        (
            [cls("A", Attribute("x", INT), Reference("x", "A"))],
            "duplicate-definition",
            "`A.x` is defined twice",
            "rename or delete one of the two definitions",
        ),
        (
            [cls("A", Attribute("x", INT)), cls("B", Attribute("x", INT), supertypes=("A",))],
            "duplicate-definition",
            "`B` already inherits `x` from `A`",
            "leave it out here, or choose another name",
        ),
        (
            [cls("A", Attribute("x", INT)), cls("B", Attribute("x", INT)), cls("C", supertypes=("A", "B"))],
            "duplicate-definition",
            "`C` inherits `x` from both `A` and `B`",
            "rename one of them, or move it to a common supertype",
        ),
        (
            [cls("A", Attribute("x", INT, 1.5))],
            "wrong-type",
            "default of `x` is not of type `int`",
            "write the type as `float`, or the default without a fraction",
        ),
        (
            [cls("A", Attribute("x", INT, True))],
            "wrong-type",
            "default of `x` is not of type `int`",
            "write a value of that type, or no default",
        ),
        (
            [cls("A", Attribute("x", Scalar.FLOAT, float("nan")))],
            "wrong-type",
            "default of `x` is not of type `float`",
            "write a value of that type, or no default",
        ),
        (
            [cls("A", Reference("r", "A", 2, 1))],
            "bad-multiplicity",
            "`r` cannot have 2..1 targets",
            "write the lower bound first; the upper bound must be at least 1",
        ),
        (
            [cls("A", Reference("r", "A", 0, 0))],
            "bad-multiplicity",
            "`r` cannot have 0..0 targets",
            "write the lower bound first; the upper bound must be at least 1",
        ),
        (
            [cls("A", Reference("r", "A", -1, None))],
            "bad-multiplicity",
            "`r` cannot have -1..* targets",
            "write the lower bound first; the upper bound must be at least 1",
        ),
        ([cls("A", Reference("r", "B"))], "unknown-class", "unknown class `B`", "there is `A`"),
        (
            [cls("A", Reference("r", "A", opposite="s"), Reference("t", "A"))],
            "unknown-reference",
            "`A` has no reference `s`",
            "declare `refers A[0..1] s opposite r` in `A`",
        ),
        (
            [cls("A", Reference("r", "A", opposite="x"), Attribute("x", INT))],
            "unknown-reference",
            "`A` has no reference `x`",
            "declare `refers A[0..1] x opposite r` in `A`",
        ),
        (
            [cls("A", Reference("r", "B", opposite="s")), cls("B", Reference("s", "A"))],
            "opposite-mismatch",
            "`A.r` and `B.s` are not each other's opposites",
            "declare `refers A[1] s opposite r` in `B`",
        ),
        (
            [cls("A", Reference("r", "A", 0, None, containment=True, opposite="r"))],
            "opposite-mismatch",
            "both ends of a pair of opposites use `contains`",
            "write `refers` at one end",
        ),
        (
            [
                cls("A", Reference("r", "B", 0, None, containment=True, opposite="s")),
                cls("B", Reference("s", "A", 0, None, opposite="r")),
            ],
            "bad-multiplicity",
            "`s` leads to the container, so it can have at most 1 target",
            "write `[1]` or `[0..1]`",
        ),
        (
            [cls("A", Attribute("column", INT), key=("colum",))],
            "unknown-attribute",
            "`@key` names `colum`, which is not an attribute of `A`",
            "did you mean `column`?",
        ),
        (
            [cls("A", Reference("r", "A"), key=("r",))],
            "unknown-attribute",
            "`@key` names `r`, which is not an attribute of `A`",
            "remove it: a key consists of attributes",
        ),
        (
            [cls("A", Attribute("x", INT), key=("x", "x"))],
            "duplicate-definition",
            "`@key` of `A` names `x` twice",
            "write each name once",
        ),
        (
            [cls("A", glyph=Glyph("AB"))],
            "bad-glyph",
            "the glyph of `A` is not a single letter",
            "write one letter",
        ),
        (
            [cls("A", glyph=Glyph("A", "red"))],
            "bad-glyph",
            "the glyph of `A` has the invalid colour `red`",
            "write `#rrggbb`",
        ),
        (
            [cls("A", glyph=Glyph("x")), cls("B", glyph=Glyph("x"))],
            "bad-glyph",
            "`B` and `A` share the glyph `x`",
            "choose another letter",
        ),
        ([cls("A b")], "bad-name", "`A b` is not a valid name", "use only letters, digits and `_`: `A_b`"),
        ([cls("")], "bad-name", "`` is not a valid name", "use only letters, digits and `_`"),
        ([cls("3a")], "bad-name", "`3a` is not a valid name", "use only letters, digits and `_`: `_3a`"),
        (
            [cls("A", Attribute("x-y", INT))],
            "bad-name",
            "`x-y` is not a valid name",
            "use only letters, digits and `_`: `x_y`",
        ),
        ([cls("int")], "bad-name", "`int` is the name of a built-in type", "choose another name"),
        ([cls("A", Attribute("x", WAY))], "unknown-enum", "unknown enum `Way`", None),
    ],
)
def test_a_problem_has_a_code_a_message_and_a_hint(classes, code, message, hint):
    found = {(problem.code, problem.message, problem.hint) for problem in problems(*classes)}
    assert (code, message, hint) in found
    assert len(found) == 1


@pytest.mark.parametrize(
    ("enums", "code", "message"),
    [
        ([EnumType("E", ())], "empty-enum", "enum `E` has no literals"),
        ([EnumType("E", ("a", "b", "a"))], "duplicate-definition", "literal `a` of `E` is defined twice"),
        ([WAY, WAY], "duplicate-definition", "`Way` is defined twice"),
        ([EnumType("A", ("a",))], "duplicate-definition", "`A` is defined twice"),
        ([EnumType("E", ("a b",))], "bad-name", "`a b` is not a valid name"),
        ([EnumType("float", ("a",))], "bad-name", "`float` is the name of a built-in type"),
    ],
)
def test_enums_are_checked(enums, code, message):
    (problem,) = problems(cls("A"), enums=enums)
    assert (problem.code, problem.message) == (code, message)


def test_a_default_that_is_not_a_literal_gets_a_hint_with_a_similar_literal():
    (problem,) = problems(cls("A", Attribute("way", WAY, "wst")), enums=[WAY])
    assert (problem.code, problem.hint) == ("wrong-type", "did you mean `west`?")


def test_an_attribute_of_another_enum_of_the_same_name_is_a_problem():
    other = EnumType("Way", ("up", "down"))
    (problem,) = problems(cls("A", Attribute("way", other)), enums=[WAY])
    assert problem.message == "the enum `Way` of `way` differs from the metamodel's enum of this name"


def test_an_opposite_must_be_declared_in_the_target_class():
    found = problems(
        cls("A", Reference("r", "C", opposite="s")),
        cls("B", Reference("s", "A", opposite="r")),
        cls("C", supertypes=("B",)),
    )
    assert [problem.hint for problem in found] == [
        "declare `refers A[1] s opposite r` in `C`",
        "declare `refers B[1] r opposite s` in `A`",
    ]


def test_a_cycle_of_supertypes_is_reported_once_with_all_its_classes():
    found = problems(cls("A", supertypes=("B",)), cls("B", supertypes=("C",)), cls("C", supertypes=("A",)))
    assert [problem.message for problem in found] == ["`A` is its own supertype"]
    assert [note.message for note in found[0].notes] == ["`B` extends `C` here", "`C` extends `A` here"]


def test_a_redefined_inherited_feature_is_reported_once():
    x = Attribute("x", INT)
    found = problems(
        cls("A", x),
        cls("B", x, supertypes=("A",)),
        cls("C", supertypes=("B",)),
        cls("D", supertypes=("C",)),
    )
    assert [problem.message for problem in found] == ["`B` already inherits `x` from `A`"]


def test_a_feature_inherited_through_two_supertypes_is_one_feature():
    metamodel = Metamodel(
        "m",
        [
            cls("A", Attribute("x", INT)),
            cls("B", supertypes=("A",)),
            cls("C", supertypes=("A",)),
            cls("D", supertypes=("B", "C")),
        ],
    )
    assert list(metamodel.features("D")) == ["x"]


def test_all_problems_are_reported_at_once():
    found = problems(
        cls("A", Reference("r", "B"), supertypes=("C",)),
        cls("D", Attribute("x", INT, "1")),
        enums=[EnumType("E", ())],
    )
    assert [problem.code for problem in found] == [
        "empty-enum",
        "unknown-class",
        "unknown-class",
        "wrong-type",
    ]


def test_problems_have_the_span_of_the_wrong_part():
    source = Source("m.metamodel", "class A extends B { int x = true }")
    extends, default = source.span_between(16, 17), source.span_between(28, 32)
    found = problems(
        cls(
            "A",
            Attribute("x", INT, True, span=source.span_between(24, 25), places=(("default", default),)),
            supertypes=("B",),
            span=source.span_between(6, 7),
            places=(("extends B", extends),),
        )
    )
    assert [problem.span for problem in found] == [extends, default]


def test_problems_of_definitions_without_places_have_the_span_of_the_name():
    source = Source("m.metamodel", "class A { refers B r }")
    (problem,) = problems(
        cls("A", Reference("r", "B", span=source.span_between(19, 20)), span=source.span_between(6, 7))
    )
    assert problem.span == source.span_between(19, 20)
