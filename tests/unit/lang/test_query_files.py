"""`.query` files as patterns."""

from typing import Any

import pytest

from envgraph.errors import Severity
from envgraph.lang import TextFiles, load_workspace
from envgraph.metamodel import Annotation
from envgraph.pattern import (
    Aggregate,
    Binary,
    Body,
    Check,
    Closure,
    ColumnMark,
    Comparison,
    Constant,
    Constraint,
    EnumLiteral,
    Evaluation,
    Navigation,
    Negation,
    Parameter,
    PathConstraint,
    Pattern,
    PatternCall,
    TypeConstraint,
    Variable,
)
from tests.reading import read_definitions

x, y, n = Variable("x"), Variable("y"), Variable("n")
anonymous = Variable("_")


def read(text: str) -> Any:
    return read_definitions(text, "query")


def read_without_errors(text: str) -> Any:
    file = read(text)
    assert file.diagnostics == ()
    return file


def constraint(text: str) -> Constraint:
    """The one constraint of a body."""
    (only,) = read_without_errors(f"pattern p(x, y) {{ {text} }}").definitions[0].bodies[0].constraints
    return only


@pytest.mark.parametrize(
    ("text", "data"),
    [
        ("Tile(x);", TypeConstraint("Tile", x)),
        ("Tile.up(x, y);", PathConstraint("Tile", ("up",), x, y)),
        ("Tile.up.left.x(x, 3);", PathConstraint("Tile", ("up", "left", "x"), x, Constant(3))),
        ("Tile.up+(x, y);", PathConstraint("Tile", ("up",), x, y, Closure.PLUS)),
        ("Tile.up.left*(x, y);", PathConstraint("Tile", ("up", "left"), x, y, Closure.STAR)),
        ("find q(x, _);", PatternCall("q", (x, anonymous))),
        ("find a.b.q();", PatternCall("a.b.q", ())),
        ("find q+(x, y);", PatternCall("q", (x, y), Closure.PLUS)),
        ("find q * (x, y);", PatternCall("q", (x, y), Closure.STAR)),
        ("neg find q(x);", Negation(PatternCall("q", (x,)))),
        ("neg Tile(x);", Negation(TypeConstraint("Tile", x))),
        ("neg Tile.up(x, _);", Negation(PathConstraint("Tile", ("up",), x, anonymous))),
        ("x == y;", Comparison("==", x, y)),
        ("x === y;", Comparison("==", x, y)),
        ("x != y;", Comparison("!=", x, y)),
        ("x == -1.5;", Comparison("==", x, Constant(-1.5))),
        ("Tile.x(x, -7);", PathConstraint("Tile", ("x",), x, Constant(-7))),
        ("find q(0l, 'a', TRUE, false);", PatternCall("q", tuple(map(Constant, (0, "a", True, False))))),
        ("find q(Way::west, ::east);", PatternCall("q", (EnumLiteral("Way", "west"), EnumLiteral(None, "east")))),
        ("check(x > 1);", Check(Binary(">", x, Constant(1)))),
        ("check x.up == none;", Check(Binary("==", Navigation(x, "up"), Constant(None)))),
        ("n == eval(x + 1);", Comparison("==", n, Evaluation(Binary("+", x, Constant(1))))),
        ("n == count find q(x, _);", Comparison("==", n, Aggregate("count", PatternCall("q", (x, anonymous))))),
        ("n == count Tile(_);", Comparison("==", n, Aggregate("count", TypeConstraint("Tile", anonymous)))),
        (
            "n == sum Tile.x(_, #);",
            Comparison("==", n, Aggregate("sum", PathConstraint("Tile", ("x",), anonymous, ColumnMark()))),
        ),
        ("min find q(#) != max find q(#);", Comparison("!=", *(
            Aggregate(function, PatternCall("q", (ColumnMark(),))) for function in ("min", "max")
        ))),
        (
            "find q(avg find r(#), eval(1), count Tile(x));",
            PatternCall(
                "q",
                (
                    Aggregate("avg", PatternCall("r", (ColumnMark(),))),
                    Evaluation(Constant(1)),
                    Aggregate("count", TypeConstraint("Tile", x)),
                ),
            ),
        ),
        ("find ^find(^count, _named);", PatternCall("find", (Variable("count"), Variable("_named")))),
        ("java Integer(x);", TypeConstraint("int", x)),
    ],
)  # fmt: skip
def test_a_constraint_is_parsed_to_its_data(text: str, data: Constraint) -> None:
    assert constraint(text) == data


def test_a_file_with_all_constructs_is_parsed() -> None:
    text = """
        package a.b
        import "m.metamodel"
        import "n.query" as other;
        import pattern c.d.helper

        /**
         * Two lines
         * of prose.
         */
        @Constraint(key = {x, y}, severity = "error", message = "no")
        private search pattern p(in x : Tile, out n : java java.lang.Integer, way : other::Way) = first {
            find helper(x);
        } or {
            other::Tile.up(x, _);
        }
        incremental pattern q() { find p(_, _, _); }
    """
    file = read_without_errors(text)
    header = file.header
    assert (header.package, [one.name for one in header.patterns]) == ("a.b", ["c.d.helper"])
    assert [(one.path, one.alias) for one in header.imports] == [("m.metamodel", None), ("n.query", "other")]
    first, second = file.definitions
    assert first == Pattern(
        name="p",
        parameters=(Parameter("x", "Tile", "in"), Parameter("n", "int", "out"), Parameter("way", "Way")),
        bodies=(
            Body((PatternCall("c.d.helper", (x,)),), "first"),
            Body((PathConstraint("Tile", ("up",), x, anonymous),)),
        ),
        package="a.b",
        private=True,
        strategy="search",
        annotations=(
            Annotation("Constraint", (), (("key", "x"), ("key", "y"), ("severity", "error"), ("message", "no"))),
        ),
        doc="Two lines\nof prose.",
    )
    assert (second.strategy, second.parameters, second.doc) == ("incremental", (), None)


@pytest.mark.parametrize("name", ["from", "to", "at", "links", "step", "state", "load", "take", "pattern", "or"])
def test_keywords_are_names_where_they_are_not_expected(name: str) -> None:
    text = f"package {name} pattern {name}({name} : {name}) {{ {name}.{name}({name}, _); find {name}({name}); }}"
    (pattern,) = read_without_errors(text).definitions
    assert pattern.bodies[0].constraints[1] == PatternCall(name, (Variable(name),))


def test_a_pattern_on_one_line_without_blanks_is_parsed() -> None:
    (pattern,) = read_without_errors("pattern p(x:A){A.b(x,y);y!=x;check(x.c<-1);}").definitions
    assert len(pattern.bodies[0].constraints) == 3


def test_an_unused_import_of_a_pattern_is_a_warning() -> None:
    (problem,) = read("import pattern a.b\npattern p(x) { A(x); }").diagnostics
    assert (problem.code, problem.severity) == ("unused-import", Severity.WARNING)
    assert problem.span is not None
    assert problem.span.text == "a.b"


def test_a_pattern_with_an_unreadable_statement_is_left_out_and_the_others_are_read() -> None:
    file = read("pattern p(x) { A(x == y); }\npattern q(x) { A(x); }\npattern r(x) { A(x) }")
    assert [pattern.name for pattern in file.definitions] == ["q", "r"]
    assert "p" in file.lost
    assert len(file.diagnostics) == 2


def test_a_class_named_like_an_ecore_data_type_is_a_class() -> None:
    texts = {
        "m.metamodel": "metamodel m\nclass EDate { int day }\n",
        "a.model": 'import "m.metamodel"\nmodel a : m { one : EDate { day = 3 } }\n',
        "q.query": 'import "m.metamodel"\npattern days(d : EDate, n : int) { EDate.day(d, n); }\n',
    }
    engine = load_workspace(["q.query", "a.model"], files=TextFiles(texts)).engine()
    assert [match["n"] for match in engine.matches("days")] == [3]
