"""Write the TextMate grammars of the languages, from the grammars in `grammars/`: `python grammars.py FOLDER`.

A TextMate grammar colours a text line by line with regular expressions. So a word is a keyword if the grammar allows
the keyword between the tokens before and after the word. Tokens on other lines are unknown, which allows any keyword.
"""

from __future__ import annotations

import json
import re
import sys
from pathlib import Path
from typing import Any

sys.path.append(str(Path(__file__).parents[2] / "docs" / "extensions"))

from grammar_files import LANGUAGES
from language_tokens import NAME, LanguageTokens, is_word, tokens_of

JsonObject = dict[str, Any]

CONSTANTS = frozenset({"true", "false", "none", "TRUE", "FALSE"})
_TYPE_KEYWORDS = frozenset({"class", "enum", "metamodel"})
"""The keywords that are followed by the name of a new type; other declaring keywords precede names of functions."""
_COMMENT_OR_END = r"$|//|/\*"

_COMMENTS: list[JsonObject] = [
    {"match": r"//.*$", "name": "comment.line.double-slash"},
    {"begin": r"/\*\*(?!/)", "end": r"\*/", "name": "comment.block.documentation"},
    {"begin": r"/\*", "end": r"\*/", "name": "comment.block"},
]
_ESCAPES = [{"match": r"\\(u[0-9a-fA-F]{4}|.)", "name": "constant.character.escape"}]
_STRINGS: list[JsonObject] = [
    # A string that is not closed ends with its line, so that a half-typed string does not colour the rest of the file.
    {"begin": '"(?!"")', "end": '"|$', "name": "string.quoted.double", "patterns": _ESCAPES},
    {"begin": "'", "end": "'|$", "name": "string.quoted.single", "patterns": _ESCAPES},
]
_TERMINALS: dict[str, list[JsonObject]] = {
    "WHITESPACE": [],
    "LINE_COMMENT": [_COMMENTS[0]],
    "BLOCK_COMMENT": _COMMENTS[1:],
    "STRING": _STRINGS,
    "TEXT": [{"begin": '"""', "end": '"""', "name": "string.quoted.triple"}],
}
"""By terminal of the grammars that may contain a line end, or has parts: the rules that colour it."""
_STARTS = {"STRING": "[\"']", "TEXT": '"""', "INT": r"\d", "LONG": r"\d", "FLOAT": r"\d"}
_ENDS = {"STRING": "[\"']", "TEXT": '"""', "INT": r"\w", "LONG": r"\w", "FLOAT": r"\w"}
"""By terminal: a regular expression for its first or last character."""


def grammar_of(language: str) -> JsonObject:
    """Return the TextMate grammar of a language as JSON."""
    tokens = tokens_of(language)
    rules = [
        *_terminal_rules(tokens),
        *_prefix_rules(tokens),
        *_keyword_rules(tokens),
        *_name_rules(tokens),
        *_sign_rules(tokens),
    ]
    return _named_grammar(language, f"envgraph {language}", rules)


def _named_grammar(language: str, name: str, rules: list[JsonObject]) -> JsonObject:
    suffix = f".envgraph.{language}"
    return {"name": name, "scopeName": f"source{suffix}", "patterns": [_with_suffix(rule, suffix) for rule in rules]}


def _terminal_rules(tokens: LanguageTokens) -> list[JsonObject]:
    """Return the rules for comments, strings and numbers, in the order in which the lexer tries them."""
    rules: list[JsonObject] = [*_COMMENTS]
    for name, expression in tokens.patterns.items():
        if name not in tokens.ignored and name != NAME:
            rules += _TERMINALS.get(name, [{"match": expression, "name": "constant.numeric"}])
    return rules


def _prefix_rules(tokens: LanguageTokens) -> list[JsonObject]:
    """Return the rules for tokens that only a name can follow: they colour the name, too, whatever word it is."""
    following: dict[str, set[str]] = {}
    for before, after in tokens.pairs:
        following.setdefault(before, set()).add(after)
    rules = []
    for token in sorted(
        token for token, after in following.items() if after == {NAME} and token not in tokens.patterns
    ):
        scope = _keyword_scope(token, tokens) if is_word(token) else _sign_scope(token)
        first = rf"(\b{token}\b){_before(token, tokens, token)}" if is_word(token) else f"({re.escape(token)})"
        captures = {"1": {"name": scope}, "2": {"name": _scope_after(token, tokens)}}
        rules.append({"match": rf"{first}\s*({tokens.patterns[NAME]})", "captures": captures})
    return rules


def _keyword_rules(tokens: LanguageTokens) -> list[JsonObject]:
    """Return the rules for keywords; keywords with the same neighbours and the same scope share a rule."""
    groups: dict[tuple[str, str, str], list[str]] = {}
    for word in sorted(tokens.keywords):
        key = (_before(word, tokens, "WORDS"), _after(word, tokens), _keyword_scope(word, tokens))
        groups.setdefault(key, []).append(word)
    return [
        {"match": rf"\b(?:{'|'.join(words)})\b{before.replace('WORDS', '|'.join(words))}{after}", "name": scope}
        for (before, after, scope), words in groups.items()
    ]


def _before(word: str, tokens: LanguageTokens, words: str) -> str:
    """Return a lookbehind that checks the token before a keyword; at the start of a line, any token is accepted.

    Write the lookbehind after the keyword: it also contains the keyword, as `words`. Expressions that begin with a word
    are found several times as fast as expressions that begin with a lookbehind.
    """
    allowed = {before for before, after in tokens.pairs if after == word}
    parts = ["^", r"\*/"]
    if NAME in allowed:
        parts.append(r"\w")
    elif keywords := sorted(filter(is_word, allowed - set(tokens.patterns))):
        parts.append(rf"\b(?:{'|'.join(keywords)})")
    parts += sorted({_ENDS[name] for name in allowed & set(_ENDS)} - set(parts))
    for sign in (sign for sign in tokens.signs if sign in allowed):
        longer = [one for one in tokens.signs if one.endswith(sign) and one != sign and one not in allowed]
        others = "".join(sorted({re.escape(one.removesuffix(sign)[-1]) for one in longer}))
        parts.append((f"(?:^|[^{others}])" if others else "") + re.escape(sign))
    return rf"(?<=(?:{'|'.join(parts)})\s*\b(?:{words}))"


def _after(word: str, tokens: LanguageTokens) -> str:
    """Return a lookahead for the tokens that may follow a keyword; the end of a line allows any."""
    allowed = {after for before, after in tokens.pairs if before == word}
    parts = [_COMMENT_OR_END]
    if NAME in allowed:
        parts.append(r"\^?[^\W\d]")
    elif words := sorted(filter(is_word, allowed - set(tokens.patterns))):
        parts.append(rf"(?:{'|'.join(words)})\b")
    parts += sorted({_STARTS[name] for name in allowed & set(_STARTS)})
    for sign in (sign for sign in tokens.signs if sign in allowed):
        longer = [one for one in tokens.signs if one.startswith(sign) and one != sign and one not in allowed]
        guard = "".join(rf"(?!{re.escape(one.removeprefix(sign))})" for one in longer)
        parts.append(re.escape(sign) + guard)
    return rf"(?=\s*(?:{'|'.join(parts)}))"


def _name_rules(tokens: LanguageTokens) -> list[JsonObject]:
    return [
        {"match": r"\^?\b[[:upper:]]\w*", "name": "entity.name.type"},
        {"match": tokens.patterns[NAME], "name": "variable.other"},
    ]


def _sign_rules(tokens: LanguageTokens) -> list[JsonObject]:
    """Return a rule for each scope of signs; the longest sign is tried first."""
    groups: dict[str, list[str]] = {}
    for sign in tokens.signs:
        groups.setdefault(_sign_scope(sign), []).append(re.escape(sign))
    return [{"match": "|".join(signs), "name": scope} for scope, signs in groups.items()]


def _keyword_scope(word: str, tokens: LanguageTokens) -> str:
    if word in CONSTANTS:
        return "constant.language"
    return "storage.type" if word in tokens.declaring else "keyword.control"


def _scope_after(token: str, tokens: LanguageTokens) -> str:
    """Return the scope of a name that follows a keyword or a sign."""
    if token == "@":
        return "entity.name.function.decorator"
    if token not in tokens.declaring:
        return "variable.other"
    return "entity.name.type" if token in _TYPE_KEYWORDS else "entity.name.function"


def _sign_scope(sign: str) -> str:
    if sign == "@":
        return "punctuation.definition.decorator"
    return "punctuation" if sign in "()[]{},;" else "keyword.operator"


def _with_suffix(rule: JsonObject, suffix: str) -> JsonObject:
    """Return a rule whose scopes end with the name of the language, as TextMate asks for."""
    changed = dict(rule)
    if "name" in rule:
        changed["name"] += suffix
    if "captures" in rule:
        changed["captures"] = {key: {"name": one["name"] + suffix} for key, one in rule["captures"].items()}
    if "patterns" in rule:
        changed["patterns"] = [_with_suffix(one, suffix) for one in rule["patterns"]]
    return changed


def toml_grammar() -> JsonObject:
    """Return the TextMate grammar of family files, which are written in TOML; VS Code has no grammar for TOML."""
    comment = {"match": "#.*$", "name": "comment.line.number-sign"}
    key = r"""(?:[\w-]+|"[^"]*"|'[^']*')"""
    values = [
        {"begin": '"""', "end": '"""', "name": "string.quoted.triple", "patterns": _ESCAPES},
        {"begin": "'''", "end": "'''", "name": "string.quoted.triple"},
        {"begin": '"', "end": '"|$', "name": "string.quoted.double", "patterns": _ESCAPES},
        {"begin": "'", "end": "'|$", "name": "string.quoted.single"},
        {"match": r"\b(?:true|false)\b", "name": "constant.language"},
        {
            "match": r"[+-]?\b(?:0[xob][\da-fA-F_]+|\d[\d_]*(?:\.[\d_]+)?(?:[eE][+-]?\d+)?|inf|nan)\b",
            "name": "constant.numeric",
        },
        {"match": r"[\[\]{},]", "name": "punctuation"},
    ]
    rules: list[JsonObject] = [
        comment,
        {
            "match": rf"^\s*(\[\[?)\s*({key}(?:\s*\.\s*{key})*)\s*(\]\]?)",
            "captures": {"1": {"name": "punctuation"}, "2": {"name": "entity.name.type"}, "3": {"name": "punctuation"}},
        },
        {
            "match": rf"({key}(?:\s*\.\s*{key})*)\s*(=)",
            "captures": {"1": {"name": "variable.other"}, "2": {"name": "keyword.operator"}},
        },
        *values,
    ]
    return _named_grammar("toml", "envgraph family", rules)


def write_grammars(folder: Path) -> None:
    """Write `LANGUAGE.tmLanguage.json` for each language into a folder, and `toml.tmLanguage.json` for family files."""
    folder.mkdir(parents=True, exist_ok=True)
    grammars = {language: grammar_of(language) for language in LANGUAGES} | {"toml": toml_grammar()}
    for language, grammar in grammars.items():
        text = json.dumps(grammar, indent=1, ensure_ascii=False) + "\n"
        (folder / f"{language}.tmLanguage.json").write_text(text, "utf-8")


if __name__ == "__main__":
    write_grammars(Path(sys.argv[1]))
