"""The check of the built site finds broken links and what pages load from other sites."""

from __future__ import annotations

from pathlib import Path

import pytest
from built_links import problems_of_site


def problems(folder: Path, body: str) -> list[str]:
    """Return the problems of a page with this body, beside a page with the anchor `there`."""
    (folder / "other.html").write_text('<h1 id="there">Other</h1>')
    (folder / "index.html").write_text(f'<main id="here">{body}</main>')
    return list(problems_of_site(folder))


@pytest.mark.parametrize(
    "body",
    [
        '<a href="other.html">x</a>',
        '<a href="other.html#there">x</a>',
        '<a href="#here">x</a>',
        '<a href="https://example.org/#missing">x</a>',
        '<link rel="canonical" href="https://example.org">',
    ],
)
def test_links_that_lead_somewhere_are_no_problem(tmp_path: Path, body: str) -> None:
    assert problems(tmp_path, body) == []


@pytest.mark.parametrize(
    ("body", "problem"),
    [
        ('<a href="missing.html">x</a>', "index.html links to missing.html, which does not exist"),
        ('<a href="#gone">x</a>', "index.html links to #gone, but the page has no such anchor"),
        ('<a href="other.html#gone">x</a>', "index.html links to other.html#gone, but the page has no such anchor"),
        ('<img src="missing.svg">', "index.html links to missing.svg, which does not exist"),
        (
            '<link rel="stylesheet" href="https://example.org/a.css">',
            "index.html loads https://example.org/a.css from another site",
        ),
    ],
)
def test_broken_links_and_foreign_resources_are_reported(tmp_path: Path, body: str, problem: str) -> None:
    assert problems(tmp_path, body) == [problem]
