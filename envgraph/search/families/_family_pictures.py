"""Pictures of families: their members with captions, as SVG, as text, and for notebooks."""

from __future__ import annotations

import re
from collections.abc import Sequence
from typing import TYPE_CHECKING, Final

from envgraph.code import dataclass
from envgraph.draw import escape_markup, html_picture, shorten
from envgraph.errors import SHOWN
from envgraph.search.families._certificate_texts import format_certificates

if TYPE_CHECKING:
    from envgraph.search.families._member_family import Family, Member


@dataclass(frozen=True, slots=True)
class FamilyStyle:
    """The sizes of a picture of a family, in CSS pixels."""

    size: int = 200  # width and height of the picture of a member
    gap: int = 24  # between pictures
    line: int = 17  # height of a line of a caption
    columns: int = 3
    letters: int = 27  # of a line of a caption, so that it is not wider than its picture


STYLE: Final = FamilyStyle()


def format_measure(values: Sequence[float]) -> tuple[str, ...]:
    """Format the values of a measure as text, all as integers or all with three decimals (tiny ones as "2.28e-05").

    >>> format_measure((3.0, 12.0)), format_measure((0.5, 1.0, 0.0000228))
    (('3', '12'), ('0.500', '1.000', '2.28e-05'))
    """
    whole = all(float(value).is_integer() for value in values)
    return tuple(
        f"{value:.0f}" if whole else f"{value:.3g}" if 0 < abs(value) < 0.0005 else f"{value:.3f}" for value in values
    )


def format_measures(family: Family, member: Member) -> list[tuple[str, str]]:
    """Return pairs of the name and the value of each measure of a member, formatted by `format_measure`."""
    place = family.members.index(member)
    return [(name, format_measure([one.measures[name] for one in family.members])[place]) for name in member.measures]


def family_svg(family: Family) -> str:
    """Return an SVG text of all members, three in a row, with name and measures below."""
    members = family.members
    columns = min(STYLE.columns, len(members))
    step = STYLE.size + STYLE.gap + STYLE.line * (1 + len(members[0].measures)) + 6
    width, height = columns * (STYLE.size + STYLE.gap) + STYLE.gap, -(-len(members) // columns) * step + STYLE.gap
    title = escape_markup(f"{family.name}: {len(members)} environments")
    parts = [
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {width} {height}" width="{width}" height="{height}" '
        f'role="img" aria-label="{title}">\n<title>{title}</title>',
        f'<rect width="{width}" height="{height}" rx="8" fill="#ffffff"/>',
    ]
    for place, member in enumerate(members):
        x, y = STYLE.gap + place % columns * (STYLE.size + STYLE.gap), STYLE.gap + place // columns * step
        parts.append(_placed_svg(family.svg(member), x, y))
        parts += _caption_elements(family, member, x + STYLE.size / 2, y + STYLE.size + STYLE.line + 2)
    return "\n".join([*parts, "</svg>"]) + "\n"


def _caption_elements(family: Family, member: Member, x: float, y: float) -> list[str]:
    lines = [member.name, *(f"{name} {value}" for name, value in format_measures(family, member))]
    parts = []
    for number, text in enumerate(lines):
        weight = ' font-weight="bold"' if not number else ""
        full = f"<title>{escape_markup(text)}</title>" if len(text) > STYLE.letters else ""
        parts.append(
            f'<text x="{x:g}" y="{y + number * STYLE.line:g}" text-anchor="middle" fill="#1f2933" '
            f'font-family="system-ui, sans-serif" font-size="13"{weight}>'
            f"{escape_markup(shorten(text, STYLE.letters))}{full}</text>"
        )
    return parts


def _placed_svg(svg: str, x: int, y: int) -> str:
    """Return an SVG text moved to a position in an enclosing SVG, and scaled to the size of all pictures."""
    head, rest = svg.split(">", 1)
    kept = re.sub(r'\s(width|height)="[^"]*"', "", head)
    return f'{kept} x="{x}" y="{y}" width="{STYLE.size}" height="{STYLE.size}">{rest}'


def member_html(family: Family, member: Member) -> str:
    """Return HTML of a member for notebooks: its picture, with name, measures and certificates below."""
    pairs = format_measures(family, member) + format_certificates(member, family.members)
    facts = "".join(f"<br>{escape_markup(name)} {escape_markup(value)}" for name, value in pairs)
    given = " (initial)" if member.initial else ""
    text = f"<b>{escape_markup(member.name)}</b>{given}{facts}"
    picture = html_picture(lambda: family.svg(member))
    style = "margin:0;width:min-content;min-width:15em;overflow-wrap:anywhere"  # as wide as the picture
    return f'<figure style="{style}">{picture}<figcaption>{text}</figcaption></figure>'


def family_html(family: Family) -> str:
    """Return HTML of a family for notebooks: its members side by side. Of many members only some are shown."""
    *first, target = family.members
    hidden = max(0, len(family.members) - SHOWN.pictures)
    shown = [member_html(family, member) for member in (*first[: SHOWN.pictures - 1], target)]
    note = f" ({hidden:,} members before {escape_markup(target.name)} are not shown)" if hidden else ""
    style = "display:flex;flex-wrap:wrap;gap:1em"
    return f'<b>{escape_markup(family.name)}</b>{note}<div style="{style}">{"".join(shown)}</div>'
