r"""Escape users' text in files generated from templates, so that it can never become code or markup.

Each character with a meaning in the file's language is replaced by an escape, such as `\u0028` for a parenthesis in
Python. Inside quotes the text keeps its value; outside quotes it cannot be read as code.
"""

from __future__ import annotations

import json
import re
from collections.abc import Callable
from functools import partial
from html.entities import codepoint2name
from typing import TYPE_CHECKING, Final

from envgraph.errors import escape_unprintable

if TYPE_CHECKING:
    import jinja2.sandbox


def jinja_environment(loader: jinja2.BaseLoader, suffix: str) -> jinja2.sandbox.SandboxedEnvironment:
    """Return a sandboxed Jinja2 environment that escapes all values for files with a suffix (`suffix`), such as `.py`.

    Results of the suffix's own filters, of macros and of `safe` are not escaped. For unknown suffixes nothing is
    escaped. Undefined variables raise an error.
    """
    from jinja2 import StrictUndefined, pass_context
    from jinja2.sandbox import SandboxedEnvironment
    from markupsafe import Markup

    escape, own = _ESCAPING_BY_SUFFIX.get(suffix.lower(), (None, ""))

    @pass_context  # without it Jinja2 escapes constants as HTML
    def finalize(_: object, value: object) -> object:
        return value if escape is None or isinstance(value, Markup) else Markup(escape(str(value)))

    environment = SandboxedEnvironment(
        loader=loader, undefined=StrictUndefined, finalize=finalize, autoescape=escape is not None,
        keep_trailing_newline=True, trim_blocks=True, lstrip_blocks=True,
    )  # fmt: skip
    environment.filters.update(python=_python_literal, json=_json_literal, markdown=escape_markdown)
    for name in own.split():
        environment.filters[name] = lambda value, write=environment.filters[name]: Markup(write(value))
    return environment


def escape_markdown(text: object) -> str:
    """Escape a text so that Markdown shows it literally, on one line, also in a table cell."""
    return re.sub(r"([\\`*_|<>\[\]&~#])", r"\\\1", escape_unprintable(str(text)))


def _python_literal(value: object) -> str:
    """Return a value as a Python literal. A string is put in double quotes, and unprintable characters are escaped."""
    if not isinstance(value, str):
        return repr(value)
    return '"' + escape_unprintable(value.replace("\\", r"\\")).replace('"', r"\"") + '"'


def _json_literal(value: object) -> str:
    """Format a value as JSON that is also valid in TOML and in a script element of HTML."""
    return _escape_code(r"[^\w -~]|[<>&']", json.dumps(value, ensure_ascii=False, default=list))


def _escape_code(special: str, text: str) -> str:
    # Characters beyond 16 bits have different escapes in different languages, and none of them is special.
    return re.sub(f"(?![\U00010000-\U0010ffff])(?:{special})", lambda at: f"\\u{ord(at[0]):04x}", text)


def _escape_markup(special: str, text: str) -> str:
    lines = "\n".join(map(escape_unprintable, text.split("\n")))  # HTML has no escapes for control characters
    return re.sub(special, lambda at: at[0].translate(_CHARACTER_REFERENCES), lines)


_CHARACTER_REFERENCES: Final = {code: f"&{codepoint2name.get(code, f'#{code}')};" for code in range(128)}
_SPECIAL_CHARACTERS: Final = r"[^\w .,:/+%!?-]"
"""Matches characters that could end a string or a comment, begin markup, or call a function."""
_CODE_SUFFIXES: Final = (".py", ".pyi", ".toml", ".json", ".js", ".ts", ".yaml", ".yml")
_ESCAPING_BY_SUFFIX: Final[dict[str, tuple[Callable[[str], str], str]]] = {
    **dict.fromkeys(_CODE_SUFFIXES, (partial(_escape_code, _SPECIAL_CHARACTERS), "python json")),
    **dict.fromkeys((".html", ".htm", ".xml", ".svg"), (partial(_escape_markup, _SPECIAL_CHARACTERS), "json")),
    ".md": (partial(_escape_markup, r"<|(?<=\])[(:]"), "markdown"),
}
"""By file suffix: the function that escapes texts, and the names of filters whose results need no escaping."""
