"""HTML of the site that screen readers cannot use is changed, and other HTML is not."""

from __future__ import annotations

from accessible_html import accessible


def test_captions_get_a_level() -> None:
    caption = '<p class="caption" role="heading">Start</p>'
    assert accessible(caption) == '<p class="caption" role="heading" aria-level="2">Start</p>'
    assert accessible(accessible(caption)) == accessible(caption)


def test_lines_of_a_signature_are_no_list_of_descriptions() -> None:
    lines = "<dt>f(\n<dl>\n<dd>a: int,</dd>\n<dd>b: int,</dd>\n</dl>\n)</dt>"
    assert accessible(lines) == (
        '<dt>f(\n<div class="sig-lines">\n<div>a: int,</div>\n<div>b: int,</div>\n</div>\n)</dt>'
    )


def test_real_lists_of_descriptions_stay() -> None:
    described = "<dl>\n<dt>a</dt>\n<dd>b</dd>\n</dl>"
    assert accessible(described) == described
