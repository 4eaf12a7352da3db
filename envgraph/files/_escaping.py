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

from envgraph.errors import visible

if TYPE_CHECKING:
    import jinja2.sandbox


def jinja_environment(loader: jinja2.BaseLoader, ending: str) -> jinja2.sandbox.SandboxedEnvironment:
    """Return a sandboxed Jinja2 environment that escapes all values for files with a suffix (`ending`), such as `.py`.

    Results of the suffix's own filters, of macros and of `safe` are not escaped. For unknown suffixes nothing is
    escaped. Undefined variables raise an error.
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
    """Escape a text so that Markdown shows it literally, on one line, also in a table cell."""
    return re.sub(r"([\\`*_|<>\[\]&~#])", r"\\\1", visible(str(text)))


def _python(value: object) -> str:
    """Return a value as a Python literal. A string is put in double quotes, and unprintable characters are escaped."""
    if not isinstance(value, str):
        return repr(value)
    return '"' + visible(value.replace("\\", r"\\")).replace('"', r"\"") + '"'


def _json(value: object) -> str:
    """Format a value as JSON that is also valid in TOML and in a script element of HTML."""
    return _escaped(r"[^\w -~]|[<>&']", json.dumps(value, ensure_ascii=False, default=list))


def _escaped(special: str, text: str) -> str:
    # Characters beyond 16 bits have different escapes in different languages, and none of them is special.
    return re.sub(f"(?![\U00010000-\U0010ffff])(?:{special})", lambda at: f"\\u{ord(at[0]):04x}", text)


def _referred(special: str, text: str) -> str:
    lines = "\n".join(map(visible, text.split("\n")))  # HTML has no escapes for control characters
    return re.sub(special, lambda at: at[0].translate(_REFERENCES), lines)


_REFERENCES: Final = {code: f"&{codepoint2name.get(code, f'#{code}')};" for code in range(128)}
_SPECIAL: Final = r"[^\w .,:/+%!?-]"
"""Matches characters that could end a string or a comment, begin markup, or call a function."""
_CODE: Final = (".py", ".pyi", ".toml", ".json", ".js", ".ts", ".yaml", ".yml")
_LANGUAGES: Final[dict[str, tuple[Callable[[str], str], str]]] = {
    **dict.fromkeys(_CODE, (partial(_escaped, _SPECIAL), "python json")),
    **dict.fromkeys((".html", ".htm", ".xml", ".svg"), (partial(_referred, _SPECIAL), "json")),
    ".md": (partial(_referred, r"<|(?<=\])[(:]"), "markdown"),
}
"""By file suffix: the function that escapes texts, and the names of filters whose results need no escaping."""
