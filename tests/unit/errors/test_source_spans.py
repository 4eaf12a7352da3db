"""Positions, spans and excerpts."""

import pytest

from envgraph.errors import Source

TEXT = "class C {\n\tint metods\r\n}\n"


def test_positions_count_from_one_and_include_the_end():
    source = Source("m", TEXT)
    assert source.line_and_column(0) == (1, 1)
    assert source.line_and_column(9) == (1, 10)
    assert source.line_and_column(10) == (2, 1)
    assert source.line_and_column(len(TEXT)) == (4, 1)
    assert Source("m", "").line_and_column(0) == (1, 1)


def test_lines_are_returned_without_line_ends():
    source = Source("m", TEXT)
    assert [source.line_text(number) for number in range(1, 6)] == ["class C {", "\tint metods", "}", "", ""]


def test_spans_are_clipped_to_the_text():
    source = Source("m", "abc")
    assert (source.span_between(-3, 99).start, source.span_between(-3, 99).end) == (0, 3)
    assert (source.span_between(2, 1).start, source.span_between(2, 1).end) == (2, 2)


def test_a_span_has_its_position_and_text():
    span = Source("m.metamodel", TEXT).span_between(15, 21)
    assert (span.line, span.column, span.text, str(span)) == (2, 6, "metods", "m.metamodel:2:6")
    assert span.joined_with(span.source.span_between(22, 24)).text == "metods\r\n}"
    assert span.joined_with(span.source.span_between(0, 5)) == span


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
    assert Source("m", TEXT).span_between(start, end).excerpt() == expected


def test_sources_with_the_same_name_and_text_are_not_equal():
    one, other = Source("m", TEXT), Source("m", TEXT)
    assert one != other
    assert one.span_between(0, 1) == one.span_between(0, 1) != other.span_between(0, 1)


def test_carets_are_aligned_with_wide_and_combined_characters() -> None:
    source = Source("a", "\u65e5\u672c e\u0301 xyz \u8a9e!")
    assert source.span_between(6, 9).excerpt().split("\n")[1] == "   |        ^^^"
    assert source.span_between(10, 11).excerpt().split("\n")[1] == "   |            ^^"
