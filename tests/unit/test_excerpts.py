"""Excerpts of texts that a terminal cannot show as they are."""

from envgraph.errors import Source


def test_excerpts_of_long_lines_show_the_surroundings_of_the_span() -> None:
    text = "a" * 5000 + " nope " + "b" * 5000
    line, carets = Source("m", text).span_between(5001, 5005).excerpt().split("\n")
    assert len(line) < 400
    assert line[carets.index("^") :].startswith("nope ")
    assert carets.endswith(" ^^^^")
    line, carets = Source("m", text).span_between(0, 9000).excerpt().split("\n")
    assert line.startswith(" 1 | aaa")
    assert len(carets) <= len(line)


def test_excerpts_contain_no_control_characters() -> None:
    line, carets = Source("m", "a\x1b[31m\tnope\x00").span_between(6, 10).excerpt().split("\n")
    assert "\x1b" not in line
    assert "\x00" not in line
    assert line.startswith(" 1 | a\N{REPLACEMENT CHARACTER}[31m\t")
    assert "\t" in carets or carets.endswith("^")
