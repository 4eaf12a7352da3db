r"""Text of users in files that templates make: it stays text, whatever characters it has.

What could mean something in the language of a file becomes an escape: `\u0028` for a parenthesis in Python. So a text
is the same between quotes, and cannot be read as code where there are none.
"""

from __future__ import annotations

import json
import re
from collections.abc import Callable
from functools import partial
from html.entities import codepoint2name
from typing import TYPE_CHECKING, Final

from envgraph.errors import visible

if TYPE_CHECKING:
    import jinja2.sandbox


def jinja_environment(loader: jinja2.BaseLoader, ending: str) -> jinja2.sandbox.SandboxedEnvironment:
    """Return a Jinja2 environment that escapes values as files with an ending, such as `.py`, need it.

    Results of the filters of the language, of macros and of `safe` are not escaped, and for other endings nothing is.
    """
    from jinja2 import StrictUndefined, pass_context
    from jinja2.sandbox import SandboxedEnvironment
    from markupsafe import Markup

    escape, own = _LANGUAGES.get(ending.lower(), (None, ""))

    @pass_context  # without it Jinja2 escapes constants as HTML
    def finalize(_: object, value: object) -> object:
        return value if escape is None or isinstance(value, Markup) else Markup(escape(str(value)))

    environment = SandboxedEnvironment(
        loader=loader, undefined=StrictUndefined, finalize=finalize, autoescape=escape is not None,
        keep_trailing_newline=True, trim_blocks=True, lstrip_blocks=True,
    )  # fmt: skip
    environment.filters.update(python=_python, json=_json, markdown=markdown)
    for name in own.split():
        environment.filters[name] = lambda value, write=environment.filters[name]: Markup(write(value))
    return environment


def markdown(text: object) -> str:
    """Return a text in one line of Markdown, in which nothing is markup: it may stand in a table."""
    return re.sub(r"([\\`*_|<>\[\]&~#])", r"\\\1", visible(str(text)))


def _python(value: object) -> str:
    """Return a value as Python text; a string is between double quotes, and all other quotes in it are escaped."""
    if not isinstance(value, str):
        return repr(value)
    return '"' + visible(value.replace("\\", r"\\")).replace('"', r"\"") + '"'


def _json(value: object) -> str:
    """Return a value as JSON that may also stand in TOML and in a script of HTML."""
    return _escaped(r"[^\w -~]|[<>&']", json.dumps(value, ensure_ascii=False, default=list))


def _escaped(special: str, text: str) -> str:
    # Beyond 16 bits languages have different escapes, and no character is special.
    return re.sub(f"(?![\U00010000-\U0010ffff])(?:{special})", lambda at: f"\\u{ord(at[0]):04x}", text)


def _referred(special: str, text: str) -> str:
    lines = "\n".join(map(visible, text.split("\n")))  # HTML has no names of control characters
    return re.sub(special, lambda at: at[0].translate(_REFERENCES), lines)


_REFERENCES: Final = {code: f"&{codepoint2name.get(code, f'#{code}')};" for code in range(128)}
_SPECIAL: Final = r"[^\w .,:/+%!?-]"
"""Characters that may end a string or a comment, begin markup, or call a function."""
_CODE: Final = (".py", ".pyi", ".toml", ".json", ".js", ".ts", ".yaml", ".yml")
_LANGUAGES: Final[dict[str, tuple[Callable[[str], str], str]]] = {
    **dict.fromkeys(_CODE, (partial(_escaped, _SPECIAL), "python json")),
    **dict.fromkeys((".html", ".htm", ".xml", ".svg"), (partial(_referred, _SPECIAL), "json")),
    ".md": (partial(_referred, r"<|(?<=\])[(:]"), "markdown"),
}
"""The function that escapes texts in files with an ending, and the filters whose results need no escaping."""
