"""Write functions and patterns as `.query` files, and rules, units and derivations as `.rules` files."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import replace

from envgraph.code import differing_fields
from envgraph.errors import Diagnostic, InvalidArgument, LoadError, Severity, Source
from envgraph.lang.format._format_text import format_text
from envgraph.lang.read._file_reading import TypeNames
from envgraph.lang.read._query_reader import read_query
from envgraph.lang.read._rules_reader import read_rules
from envgraph.lang.syntax._grammar import Grammar, load_grammar
from envgraph.lang.syntax._lexer import END
from envgraph.lang.syntax._parse_stack import ParseStack
from envgraph.lang.syntax._parser import parse
from envgraph.lang.write._rule_writer import RuleWriter, definition_as_read
from envgraph.lang.write._term_writer import TermWriter, normalised_doc
from envgraph.pattern import Body, Derivation, FunctionDeclaration, Pattern, Rule, Unit

Definition = Pattern | Rule | Unit | Derivation | FunctionDeclaration


def to_text(*definitions: Definition, imports: Iterable[str] = ()) -> str:
    """Return the text of a file with the given definitions; definitions read from the text equal the given ones.

    Equal here ignores differences without meaning. A rule read from text repeats weight, priority, semantics and
    homomorphic names in its annotations. The ends of its edges are among its nodes. A `Create` that is not a single
    chain of arrows becomes several. A unit is one flat sequence. Lines of a comment have no trailing blanks.

    Args:
        definitions: patterns and declarations of functions; or rules, units and derivations. All must be in one
            package.
        imports: paths of the files that the text imports.

    Returns:
        The text of a `.query` file for patterns and functions (functions come first), else of a `.rules` file, in the
        style of `format_text`.

    Raises:
        InvalidArgument: the text of a definition does not exist. This concerns invalid names (names of derived rules
            contain dots), exact types, paths without a class, infinite numbers, ints of more than 64 bits, and choices
            between steps that are not calls. Or patterns are mixed with rules, or the packages differ.

    >>> from envgraph.pattern import LeftSide, Modification, RetypeAction, Rule, RuleNode, Variable
    >>> burn = Rule(
    ...     "burn",
    ...     left=LeftSide((RuleNode("tile", "RoadTile"),)),
    ...     right=Modification((RetypeAction(Variable("tile"), "BurningTile"),)),
    ...     weight=2.0,
    ... )
    >>> print(to_text(burn, imports=["forest.query"]), end="")
    import "forest.query"
    <BLANKLINE>
    @weight(2.0)
    rule burn {
        lhs { tile : RoadTile; }
        modify { retype tile : BurningTile; }
    }
    """
    language = _language_for(definitions)
    keywords = load_grammar(language).lexer.keywords
    functions = [one for one in definitions if isinstance(one, FunctionDeclaration)]
    definitions = (*functions, *(one for one in definitions if not isinstance(one, FunctionDeclaration)))
    packages = {one.package: None for one in definitions[len(functions) :]}
    if len(packages) > 1:
        names = ", ".join(f"`{name}`" if name else "none" for name in packages)
        raise InvalidArgument(f"the definitions are of several packages ({names}): write one file for each")
    terms = TermWriter("the file", keywords)
    package = next(iter(packages), "")
    head = f"package {terms.format_dotted_name(package)}\n\n" if package else ""
    head += "".join(f"import {terms.format_value(path)}\n" for path in imports)
    parts = [_format_definition(one, keywords) for one in definitions]
    try:
        text = format_text(language, _remove_needless_escapes(load_grammar(language), "\n\n".join((head, *parts))))
    except LoadError as error:
        raise _unwritable_error(definitions, error.diagnostics) from None
    _check_round_trip(definitions, language, text)
    return text


def _language_for(definitions: Sequence[Definition]) -> str:
    patterns = [one for one in definitions if isinstance(one, Pattern | FunctionDeclaration)]
    if patterns and len(patterns) < len(definitions):
        raise InvalidArgument("patterns and rules cannot be written to one file: write one file for each")
    return "query" if patterns else "rules"


def _format_definition(one: Definition, keywords: Iterable[str]) -> str:
    if isinstance(one, Pattern):
        return _format_pattern(one, TermWriter(one.qualified_name, keywords))
    if isinstance(one, FunctionDeclaration):
        text = TermWriter(one.name, keywords)
        head = (
            f"{text.format_doc_comment(one.doc)}function "
            f"{text.format_name(one.name)}{text.format_parameters(one.parameters)}"
        )
        return f"{head} : {text.format_type_name(one.result)};"
    return RuleWriter(one.qualified_name, keywords).format_definition(one)


def _format_pattern(one: Pattern, text: TermWriter) -> str:
    if not one.bodies:
        text.raise_unwritable("the pattern has no body")
    marks = "".join(f"{text.format_annotation(annotation)}\n" for annotation in one.annotations)
    words = "".join(f"{word} " for word in ("private" if one.private else "", one.strategy or "") if word)
    bodies = " or ".join(_format_body(body, text) for body in one.bodies)
    return (
        f"{text.format_doc_comment(one.doc)}{marks}{words}pattern "
        f"{text.format_name(one.name)}{text.format_parameters(one.parameters)} {bodies}"
    )


def _format_body(body: Body, text: TermWriter) -> str:
    name = f"{text.format_name(body.name)} " if body.name is not None else ""
    return name + "{\n" + "".join(f"{text.format_condition(one)};\n" for one in body.constraints) + "}"


def _remove_needless_escapes(grammar: Grammar, text: str) -> str:
    """Return the text without the `^` before words that are no keywords at their position."""
    source = Source("<text>", text)
    stack = ParseStack(grammar, source, grammar.lexer.split_text(source).lexemes)
    parts, end, index = [], 0, 0
    while True:
        lexeme = stack.lexemes[index]
        keyword = grammar.lexer.keywords.get(lexeme.value) if lexeme.is_escaped else None
        if keyword and not grammar.accepts(stack.states, keyword):
            parts.append(text[end : lexeme.start])
            end = lexeme.start + 1
        terminal = stack.terminal_of(stack.states, index) or stack.split_sign(stack.states, index)
        if terminal is None or terminal == END:  # the formatter reports texts that cannot be parsed
            return "".join((*parts, text[end:]))
        grammar.advance(stack.states, terminal)
        index += 1


# --- the text is read once more


def _check_round_trip(definitions: Sequence[Definition], language: str, text: str) -> None:
    """Parse the text again, and raise InvalidArgument if the definitions read differ from the given ones."""
    parsed = parse(language, Source("<text>", text))
    types = TypeNames()  # `TypeNames` without a metamodel keeps the package in front of each name
    read = read_query(parsed, types) if language == "query" else read_rules(parsed, types)
    errors = [one for one in read.diagnostics if one.severity is Severity.ERROR]
    if errors:
        raise _unwritable_error(definitions, errors)
    found: tuple[Definition, ...] = read.definitions
    for one, other in zip(definitions, found, strict=True):
        wanted = (
            replace(one, doc=normalised_doc(one.doc))
            if isinstance(one, Pattern | FunctionDeclaration)
            else definition_as_read(one)
        )
        if wanted != other:
            different = ", ".join(differing_fields(wanted, other))
            reason = f"the text would be read with another value of {different}"
            TermWriter(one.qualified_name, ()).raise_unwritable(reason)


def _unwritable_error(definitions: Sequence[Definition], errors: Sequence[Diagnostic]) -> InvalidArgument:
    first = errors[0]
    line = first.span.source.text[: first.span.start].count("\n") if first.span else 0
    names = ", ".join(f"`{one.qualified_name}`" for one in definitions)
    shown = first.span.source.text.split("\n")[line].strip() if first.span else ""
    return InvalidArgument(f"{names} cannot be written as text: {first.message}, in `{shown}`")
