"""Excerpts of texts that a terminal cannot show as they are."""

from envgraph.errors import Source


def test_of_a_long_line_the_surroundings_are_shown() -> None:
    text = "a" * 5000 + " nope " + "b" * 5000
    line, carets = Source("m", text).span(5001, 5005).excerpt().split("\n")
    assert len(line) < 400
    assert line[carets.index("^") :].startswith("nope ")
    assert carets.endswith(" ^^^^")
    line, carets = Source("m", text).span(0, 9000).excerpt().split("\n")
    assert line.startswith(" 1 | aaa")
    assert len(carets) <= len(line)


def test_control_characters_are_not_sent_to_the_terminal() -> None:
    line, carets = Source("m", "a\x1b[31m\tnope\x00").span(6, 10).excerpt().split("\n")
    assert "\x1b" not in line
    assert "\x00" not in line
    assert line.startswith(" 1 | a\N{REPLACEMENT CHARACTER}[31m\t")
    assert "\t" in carets or carets.endswith("^")
