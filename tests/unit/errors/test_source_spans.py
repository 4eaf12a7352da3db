"""Positions, spans and excerpts."""

import pytest

from envgraph.errors import Source

TEXT = "class C {\n\tint metods\r\n}\n"


def test_positions_count_from_one_and_include_the_end():
    source = Source("m", TEXT)
    assert source.position(0) == (1, 1)
    assert source.position(9) == (1, 10)
    assert source.position(10) == (2, 1)
    assert source.position(len(TEXT)) == (4, 1)
    assert Source("m", "").position(0) == (1, 1)


def test_lines_come_without_their_ends():
    source = Source("m", TEXT)
    assert [source.line(number) for number in range(1, 6)] == ["class C {", "\tint metods", "}", "", ""]


def test_spans_are_clipped_to_the_text():
    source = Source("m", "abc")
    assert (source.span(-3, 99).start, source.span(-3, 99).end) == (0, 3)
    assert (source.span(2, 1).start, source.span(2, 1).end) == (2, 2)


def test_a_span_knows_its_place_and_text():
    span = Source("m.metamodel", TEXT).span(15, 21)
    assert (span.line, span.column, span.text, str(span)) == (2, 6, "metods", "m.metamodel:2:6")
    assert span.to(span.source.span(22, 24)).text == "metods\r\n}"
    assert span.to(span.source.span(0, 5)) == span


@pytest.mark.parametrize(
    ("start", "end", "expected"),
    [
        (6, 7, " 1 | class C {\n   |       ^"),
        (15, 21, " 2 | \tint metods\n   | \t    ^^^^^^"),
        (8, 24, " 1 | class C {\n   |         ^"),
        (25, 25, " 4 | \n   | ^"),
        (9, 9, " 1 | class C {\n   |          ^"),
    ],
)
def test_excerpts_mark_the_first_line_of_a_span(start, end, expected):
    assert Source("m", TEXT).span(start, end).excerpt() == expected


def test_readings_of_one_file_are_different_sources():
    one, other = Source("m", TEXT), Source("m", TEXT)
    assert one != other
    assert one.span(0, 1) == one.span(0, 1) != other.span(0, 1)


def test_carets_stand_below_wide_and_combined_characters() -> None:
    source = Source("a", "\u65e5\u672c e\u0301 xyz \u8a9e!")
    assert source.span(6, 9).excerpt().split("\n")[1] == "   |        ^^^"
    assert source.span(10, 11).excerpt().split("\n")[1] == "   |            ^^"
