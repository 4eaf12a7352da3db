"""Find the names in a syntax tree, with what each may refer to.

The names of a part of a text are found once, without knowledge of other parts. What a name refers to is looked up
when a request needs it (see `_name_index`), so an edit does not invalidate the names of other parts.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import field
from functools import lru_cache
from typing import Any

from envgraph.code import dataclass
from envgraph.lang import TextPart

Holder = tuple[Any, ...]
"""An object that has a feature, before it is looked up: ("class", name), ("variable", scope, name), ("member", holder,
feature) or ("argument", name of a pattern, position)."""


@dataclass(slots=True, eq=False)
class Scope:
    """The variables of a definition, or of a body or clause in it.

    Attributes:
        name: the kind and the name of the definition, such as "pattern big".
        outer: the surrounding scope.
        parameters: the variables that are known in the whole definition.
        types: what is known of the classes of each variable.
    """

    name: str
    outer: Scope | None = None
    parameters: list[str] = field(default_factory=list)
    types: dict[str, list[Holder]] = field(default_factory=dict)

    def home(self, variable: str) -> Scope:
        """Return the scope that a variable belongs to: the outermost one that declares it, else this one."""
        if self.outer is not None and variable in self.outer.parameters:
            return self.outer
        return self

    def add_type(self, variable: str, holder: Holder) -> None:
        """Note something about the class of a variable."""
        self.home(variable).types.setdefault(variable, []).append(holder)


@dataclass(frozen=True, slots=True, eq=False)
class Mention:
    """A name in a part of a text.

    Attributes:
        kind: the kind of definition that it refers to: "class" (or an enum), "feature", "literal", "pattern", "rule",
            "function", "variable", "object", "metamodel", "alias", "file", "environment", "action", "model".
        text: the name, without `^`.
        start, end: its place, as offsets from the start of the part.
        is_definition: True if the name is defined here.
        scope: the scope in which it stands; None outside of definitions.
        holder: of a feature or literal: the object or enum that has it; of an object: the feature whose value it is.
        qualifier: the text before the name: a package or an alias.
        tree_end: of a definition: the end of the whole definition; `tree_start` is its start.
    """

    kind: str
    text: str
    start: int
    end: int
    is_definition: bool = False
    scope: Scope | None = None
    holder: Holder | None = None
    qualifier: str = ""
    tree_start: int = 0
    tree_end: int = 0


@dataclass(frozen=True, slots=True)
class PartNames:
    """The names in a part of a text.

    Attributes:
        all: all names, in their order.
        definitions: those that are defined here, without variables.
        by_text: the names by their texts.
    """

    all: tuple[Mention, ...]
    definitions: tuple[Mention, ...]
    by_text: Mapping[str, Sequence[Mention]]


def is_token(item: Any) -> bool:
    """Return True if a child of a tree is a token."""
    return isinstance(item, str)


def is_tree(item: Any) -> bool:
    """Return True if a child of a tree is a tree."""
    return item is not None and not isinstance(item, str)


def mentions_of(part: TextPart) -> PartNames:
    """Return the names in a part of a text. The result is kept as long as the text of the part stays the same."""
    return _find_names(part.language, part.text)


@lru_cache(maxsize=8192)
def _find_names(language: str, text: str) -> PartNames:
    tree = TextPart(language, 0, text).reading.tree
    found = sorted(_Finder().find(tree), key=lambda one: (one.start, one.end)) if tree is not None else []
    by_text: dict[str, list[Mention]] = {}
    for one in found:
        by_text.setdefault(one.text, []).append(one)
    return PartNames(tuple(found), tuple(one for one in found if one.is_definition and one.kind != "variable"), by_text)


class _Finder:
    """Walks over a syntax tree and collects its names."""

    def __init__(self) -> None:
        self._found: list[Mention] = []
        self._work: list[tuple[Any, Scope | None, Holder | None]] = []

    def find(self, root: Any) -> list[Mention]:
        """Return all names in a tree. A stack is used, since expressions may be thousands of operators deep."""
        self._work = [(one, None, None) for one in root.children if is_tree(one)]
        while self._work:
            tree, scope, holder = self._work.pop()
            handle = _HANDLERS.get(str(tree.data))
            if handle is not None:
                handle(self, tree, scope, holder)
            else:
                self.walk(tree, scope, holder)
        return self._found

    def walk(self, tree: Any, scope: Scope | None, holder: Holder | None = None) -> None:
        """Find the names in the children of a tree later."""
        self._work += [(one, scope, holder) for one in reversed(tree.children) if is_tree(one)]

    def add(self, kind: str, token: Any, scope: Scope | None, definition: Any = None, **more: Any) -> None:
        """Add a name; `definition` is the tree that it defines."""
        start, end = token.start_pos, token.end_pos
        if start is None or end is None or start == end:
            return  # A token that was inserted to repair the text.
        if kind == "variable":
            if token == "_":
                return
            scope = scope.home(str(token)) if scope else None
        places = {"tree_start": definition.meta.start_pos, "tree_end": definition.meta.end_pos} if definition else {}
        found = Mention(kind, str(token), start, end, definition is not None, scope, **more, **places)
        self._found.append(found)

    def add_chain(self, tokens: Sequence[Any], holder: Holder, scope: Scope | None) -> Holder:
        """Add features, each of the object that the one before leads to; return where the last one leads."""
        for token in tokens:
            self.add("feature", token, scope, holder=holder)
            holder = ("member", holder, str(token))
        return holder

    def type_of(self, tree: Any) -> Holder:
        """Return the class that a `type` tree names."""
        return ("class", str(tree.children[-1])) if tree.data == "type" else ("class", "")


def _names(tree: Any) -> list[Any]:
    return [one for one in tree.children if is_token(one) and one.type == "NAME"]


def _trees(tree: Any, *kinds: str) -> list[Any]:
    return [one for one in tree.children if is_tree(one) and (not kinds or one.data in kinds)]


_TEXT_ARGUMENTS = ("message", "severity")
"""Arguments of annotations that are texts."""
_Handler = Callable[[_Finder, Any, Scope | None, Holder | None], None]


def _define(kind: str, whole: bool = False) -> _Handler:
    """Return the handler of a definition. With `whole`, all variables are known in the whole definition."""

    def handle(finder: _Finder, tree: Any, scope: Scope | None, holder: Holder | None) -> None:
        names = _names(tree)
        if not names:
            return
        within = Scope(f"{kind} {names[0]}")
        finder.add(kind, names[0], within, tree)
        for item in (each for part in _trees(tree, "parameters") for each in _trees(part, "parameter")):
            within.parameters += [str(name) for name in _names(item)]
        if whole:
            finder.walk(tree, within)
            return
        for part in reversed(_trees(tree)):
            inner = Scope(within.name, within) if part.data == "body" else within
            finder._work.append((part, inner, None))

    return handle


def _annotation(finder: _Finder, tree: Any, scope: Scope | None, holder: Holder | None) -> None:
    """Add the arguments of annotations that name something: variables of a pattern or rule, attributes of a class."""
    name = str(tree.children[0])
    values = [("", each) for part in _trees(tree, "annotation_argument") for each in _trees(part)]
    named = [(str(part.children[0]), each) for part in _trees(tree, "annotation_named") for each in _trees(part)]
    for key, value in [*values, *named]:
        for token in value.children if value.data in ("annotation_name", "annotation_string") else ():
            if name == "key" and holder is not None:
                finder.add("feature", token, scope, holder=holder)
            elif name == "QueryBasedFeature" and key == "feature":
                finder.add("unknown", token, scope)
            elif scope is not None and (name == "hom" or (token in scope.parameters and key not in _TEXT_ARGUMENTS)):
                finder.add("variable", token, scope)
    if name == "QueryBasedFeature" and scope is not None and not any(key == "feature" for key, _ in named):
        # The pattern defines the feature of its own name, so neither can be renamed alone.
        start, end = tree.children[0].start_pos, tree.children[0].end_pos
        finder._found.append(Mention("unknown", scope.name.rpartition(" ")[2], start, end))


def _package(finder: _Finder, tree: Any, scope: Scope | None, holder: Holder | None) -> None:
    """Add the package of the file, under its last name."""
    for part in _trees(tree, "qualified_name"):
        *before, name = _names(part)
        finder.add("package", name, None, tree, qualifier=".".join(map(str, before)))


def _nothing(finder: _Finder, tree: Any, scope: Scope | None, holder: Holder | None) -> None:
    """Add nothing: this has no effect."""


def _import_file(finder: _Finder, tree: Any, scope: Scope | None, holder: Holder | None) -> None:
    seen = False
    for token in tree.children:
        if is_token(token) and token.type == "STRING":
            seen = True
            finder.add("file", token, scope)
        elif is_token(token) and seen and token.type == "NAME":
            finder.add("alias", token, scope, tree)


def _qualified(kind: str) -> Callable[[_Finder, Any, Scope | None], str]:
    def add(finder: _Finder, tree: Any, scope: Scope | None) -> str:
        names = _names(tree)
        finder.add(kind, names[-1], scope, qualifier=".".join(map(str, names[:-1])))
        return ".".join(map(str, names))

    return add


_add_pattern, _add_rule = _qualified("pattern"), _qualified("rule")


def _import_pattern(finder: _Finder, tree: Any, scope: Scope | None, holder: Holder | None) -> None:
    for part in _trees(tree, "qualified_name"):
        _add_pattern(finder, part, scope)


def _parameter(finder: _Finder, tree: Any, scope: Scope | None, holder: Holder | None) -> None:
    """Add a parameter, the domain of an action, an agent or a name behind `for`."""
    names = _names(tree)
    if names and scope is not None:
        finder.add("variable", names[0], scope, tree)
        for type_ in _trees(tree, "type"):
            scope.add_type(str(names[0]), finder.type_of(type_))
    finder.walk(tree, scope)


def _type(finder: _Finder, tree: Any, scope: Scope | None, holder: Holder | None) -> None:
    alias, name = tree.children[0], tree.children[-1]
    if is_token(alias) and alias is not name:
        finder.add("alias", alias, scope)
    finder.add("class", name, scope, qualifier=str(alias) if is_token(alias) and alias is not name else "")


def _terms(tree: Any) -> list[Any]:
    return [term for part in _trees(tree, "terms") for term in part.children]


def _note_types(tree: Any, scope: Scope | None, holders: Iterator[Holder] | Sequence[Holder]) -> None:
    for term, holder in zip(_terms(tree), holders, strict=False):
        if scope is not None and is_tree(term) and term.data == "variable" and term.children[0] != "_":
            scope.add_type(str(term.children[0]), holder)


def _type_constraint(finder: _Finder, tree: Any, scope: Scope | None, holder: Holder | None) -> None:
    _note_types(tree, scope, [finder.type_of(tree.children[0])])
    finder.walk(tree, scope)


def _path_constraint(finder: _Finder, tree: Any, scope: Scope | None, holder: Holder | None) -> None:
    source = finder.type_of(tree.children[0])
    target = source
    for path in _trees(tree, "path"):
        target = finder.add_chain(_names(path), source, scope)
    _note_types(tree, scope, [source, target])
    finder.walk(tree, scope)


def _pattern_call(finder: _Finder, tree: Any, scope: Scope | None, holder: Holder | None) -> None:
    name, *rest = _trees(tree)
    pattern = _add_pattern(finder, name, scope)
    _note_types(tree, scope, [("argument", pattern, index) for index in range(len(_terms(tree)))])
    finder._work += [(one, scope, None) for one in reversed(rest)]


def _variable(finder: _Finder, tree: Any, scope: Scope | None, holder: Holder | None) -> None:
    finder.add("variable", tree.children[0], scope)


def _enum_literal(finder: _Finder, tree: Any, scope: Scope | None, holder: Holder | None) -> None:
    *before, name = [one for one in tree.children if is_token(one)]
    for token, kind in zip(before[::-1], ("class", "alias"), strict=False):
        finder.add(kind, token, scope)
    finder.add("literal", name, scope, holder=("class", str(before[-1])) if before else holder)


def _expression_holder(tree: Any, scope: Scope | None) -> Holder:
    """Return the object that an expression before a dot stands for."""
    names: list[str] = []
    while is_tree(tree) and tree.data == "navigation":
        names.append(str(tree.children[-1]))
        tree = tree.children[0]
    found: Holder = ("class", "")
    if is_tree(tree) and tree.data == "variable" and scope is not None:
        found = ("variable", scope, str(tree.children[0]))
    for name in reversed(names):
        found = ("member", found, name)
    return found


def _navigation(finder: _Finder, tree: Any, scope: Scope | None, holder: Holder | None) -> None:
    finder.add("feature", tree.children[-1], scope, holder=_expression_holder(tree.children[0], scope))
    finder.walk(tree, scope)


def _class_behind(finder: _Finder, tree: Any, scope: Scope | None, holder: Holder | None) -> None:
    """Add the class of a cast or of `instanceof`."""
    finder.add("class", tree.children[-1], scope)
    finder.walk(tree, scope)


def _function(finder: _Finder, tree: Any, scope: Scope | None, holder: Holder | None) -> None:
    finder.add("function", tree.children[0], scope)
    finder.walk(tree, scope)


def _chain(finder: _Finder, tree: Any, scope: Scope | None, holder: Holder | None) -> None:
    """Add a path such as `x.f.g`."""
    first, *features = _names(tree)
    finder.add("variable", first, scope)
    finder.add_chain(features, ("variable", scope, str(first)), scope)


# --- rules ---


def _vertex(finder: _Finder, tree: Any, scope: Scope | None, holder: Holder | None) -> None:
    name = tree.children[0]
    finder.add("variable", name, scope)
    for type_ in _trees(tree, "type"):
        if scope is not None:
            scope.add_type(str(name), finder.type_of(type_))
    own: Holder = ("variable", scope, str(name))
    finder._work += [(one, scope, own) for one in reversed(_trees(tree))]


def _assignment(finder: _Finder, tree: Any, scope: Scope | None, holder: Holder | None) -> None:
    """Add the feature of an assignment, in a vertex or in an object of a model."""
    name = tree.children[0]
    finder.add("feature", name, scope, holder=holder or ("class", ""))
    finder.walk(tree, scope, ("member", holder or ("class", ""), str(name)))


def _graph(finder: _Finder, tree: Any, scope: Scope | None, holder: Holder | None) -> None:
    children = tree.children
    for place in range(1, len(children) - 1, 2):
        left, arrow, right = children[place - 1 : place + 2]
        names = _names(arrow)
        if not names:
            continue
        source, target = (right, left) if arrow.data == "backward" else (left, right)
        own: Holder = ("variable", scope, str(source.children[0]))
        finder.add("feature", names[0], scope, holder=own)
        if scope is not None:
            scope.add_type(str(target.children[0]), ("member", own, str(names[0])))
    finder.walk(tree, scope)


def _set(finder: _Finder, tree: Any, scope: Scope | None, holder: Holder | None) -> None:
    first, *features = _names(tree)
    finder.add("variable", first, scope)
    target = finder.add_chain(features, ("variable", scope, str(first)), scope)
    finder.walk(tree, scope, target)


def _move(finder: _Finder, tree: Any, scope: Scope | None, holder: Holder | None) -> None:
    moved, to, *features = _names(tree)
    finder.add("variable", moved, scope)
    finder.add("variable", to, scope)
    finder.add_chain(features, ("variable", scope, str(to)), scope)


def _variables(finder: _Finder, tree: Any, scope: Scope | None, holder: Holder | None) -> None:
    """Add the variables of `merge`, `retype` and `redirect`."""
    for name in _names(tree):
        finder.add("variable", name, scope)
        for type_ in _trees(tree, "type"):
            if scope is not None:
                scope.add_type(str(name), finder.type_of(type_))
    finder.walk(tree, scope)


def _call(finder: _Finder, tree: Any, scope: Scope | None, holder: Holder | None) -> None:
    """Add the rule of a call in a unit or environment."""
    for part in _trees(tree):
        if part.data == "qualified_name":
            _add_rule(finder, part, scope)
        else:
            finder._work.append((part, scope, None))


def _asked(finder: _Finder, tree: Any, scope: Scope | None, holder: Holder | None) -> None:
    finder.add("rule", _names(tree)[-1], scope)


# --- environments ---


def _inner_scope(finder: _Finder, tree: Any, scope: Scope | None, holder: Holder | None) -> None:
    """Find the names of a clause, whose own variables are known only in it."""
    inner = Scope(scope.name if scope else "", scope)
    if tree.data == "action":
        names = _names(tree)
        finder.add("action", names[0], inner, tree)
    finder.walk(tree, inner)


def _environment(finder: _Finder, tree: Any, scope: Scope | None, holder: Holder | None) -> None:
    """Find the names of an environment; its parameters and agents are known in all clauses."""
    agents = [each for clauses in _trees(tree, "clauses") for each in _trees(clauses, "agent")]
    _define("environment", whole=True)(finder, tree, scope, holder)
    within = finder._work[-1][1] if finder._work else None
    if within is not None:
        within.parameters += [str(name) for agent in agents for name in _names(agent)[:1]]


def _around(finder: _Finder, tree: Any, scope: Scope | None, holder: Holder | None) -> None:
    inner = Scope(scope.name if scope else "", scope)
    for name in _names(tree)[:1]:
        finder.add("variable", name, inner)
    finder.walk(tree, inner)


def _draw_grid(finder: _Finder, tree: Any, scope: Scope | None, holder: Holder | None) -> None:
    own = finder.type_of(_trees(tree, "type")[0])
    for name in _names(tree):
        finder.add("feature", name, scope, holder=own)
    finder.walk(tree, scope)


def _token(finder: _Finder, tree: Any, scope: Scope | None, holder: Holder | None) -> None:
    inner = Scope(scope.name if scope else "", scope)
    _parameter(finder, tree, inner, holder) if _trees(tree, "type") else finder.walk(tree, inner)
    if not _trees(tree, "type"):
        finder.add("variable", _names(tree)[0], inner)


# --- models ---


def _model(finder: _Finder, tree: Any, scope: Scope | None, holder: Holder | None) -> None:
    name, metamodel = _names(tree)[:2]
    within = Scope(f"model {name}")
    finder.add("model", name, within, tree)
    finder.add("metamodel", metamodel, within)
    finder.walk(tree, within)


def _object(finder: _Finder, tree: Any, scope: Scope | None, holder: Holder | None) -> None:
    """Add an object: `name : Class { .. }` or `Class { .. }`."""
    *names, cls = _names(tree)
    for name in names:
        finder.add("object", name, scope, tree)
    finder.add("class", cls, scope)
    finder.walk(tree, scope, ("class", str(cls)))


def _object_value(finder: _Finder, tree: Any, scope: Scope | None, holder: Holder | None) -> None:
    """Add a name as a value: an object, or a literal if the feature is an attribute."""
    finder.add("object", tree.children[0], scope, holder=holder)


def _grid(finder: _Finder, tree: Any, scope: Scope | None, holder: Holder | None) -> None:
    finder.add("object", _names(tree)[0], scope, tree)
    legend = [each for part in _trees(tree, "legend") for each in _trees(part, "legend_class")]
    own: Holder = ("classes", tuple(("class", str(one.children[1])) for one in legend))
    finder.walk(tree, scope, own)


def _legend_class(finder: _Finder, tree: Any, scope: Scope | None, holder: Holder | None) -> None:
    finder.add("class", tree.children[1], scope)
    finder.walk(tree, scope, ("class", str(tree.children[1])))


def _grid_features(finder: _Finder, tree: Any, scope: Scope | None, holder: Holder | None) -> None:
    for name in _names(tree):
        finder.add("feature", name, scope, holder=holder)


def _table(finder: _Finder, tree: Any, scope: Scope | None, holder: Holder | None) -> None:
    cls, *features = _names(tree)
    finder.add("class", cls, scope)
    own: Holder = ("class", str(cls))
    for name in features:
        finder.add("feature", name, scope, holder=own)
    for line in reversed(_trees(tree, "line")):
        for name in _names(line):
            finder.add("object", name, scope, line)
        for feature, value in zip(features, _trees(line), strict=False):
            finder._work.append((value, scope, ("member", own, str(feature))))


# --- metamodels ---


def _header(finder: _Finder, tree: Any, scope: Scope | None, holder: Holder | None) -> None:
    finder.add("metamodel", _names(tree)[0], None, tree)


def _class(finder: _Finder, tree: Any, scope: Scope | None, holder: Holder | None) -> None:
    name = _names(tree)[0]
    own = Scope(f"class {name}")
    finder.add("class", name, own, tree)
    for part in _trees(tree, "extends"):
        for above in _names(part):
            finder.add("class", above, own)
    finder.walk(tree, own, ("class", str(name)))


def _enum(finder: _Finder, tree: Any, scope: Scope | None, holder: Holder | None) -> None:
    name = _names(tree)[0]
    own = Scope(f"enum {name}")
    finder.add("class", name, own, tree)
    for literal in _trees(tree, "literal"):
        finder.add("literal", literal.children[0], own, literal, holder=("class", str(name)))


def _member(finder: _Finder, tree: Any, scope: Scope | None, holder: Holder | None) -> None:
    type_, name, *opposite = _names(tree)
    finder.add("class", type_, scope)
    finder.add("feature", name, scope, tree, holder=holder)
    for other in opposite:
        finder.add("feature", other, scope, holder=("class", str(type_)))
    finder._work += [(one, scope, ("class", str(type_))) for one in _trees(tree, "enum_literal")]


_HANDLERS: Mapping[str, _Handler] = {
    "annotation": _annotation,
    "package": _package,
    "import_file": _import_file,
    "import": _import_file,
    "import_pattern": _import_pattern,
    "import_java": _nothing,
    "pattern": _define("pattern"),
    "declaration": _define("function", whole=True),
    "rule": _define("rule", whole=True),
    "unit": _define("rule", whole=True),
    "derivation": _define("rule", whole=True),
    "parameter": _parameter,
    "domain": _parameter,
    "agent": _parameter,
    "each_name": _parameter,
    "type": _type,
    "type_constraint": _type_constraint,
    "path_constraint": _path_constraint,
    "pattern_call": _pattern_call,
    "variable": _variable,
    "enum_literal": _enum_literal,
    "aliased_literal": _enum_literal,
    "navigation": _navigation,
    "cast": _class_behind,
    "instance_test": _class_behind,
    "function": _function,
    "chain": _chain,
    "vertex": _vertex,
    "assignment": _assignment,
    "graph": _graph,
    "set": _set,
    "move": _move,
    "merge": _variables,
    "retype": _variables,
    "redirect": _variables,
    "call": _call,
    "rule_call": _call,
    "asked": _asked,
    "environment": _environment,
    "action": _inner_scope,
    "each": _inner_scope,
    "on": _inner_scope,
    "refused": _inner_scope,
    "reset": _inner_scope,
    "observation": _inner_scope,
    "around": _around,
    "draw_grid": _draw_grid,
    "drawn": _draw_grid,
    "token": _token,
    "model": _model,
    "entry": _object,
    "object": _object,
    "unnamed": _object,
    "name": _object_value,
    "cell": _object_value,
    "grid": _grid,
    "legend_class": _legend_class,
    "column": _grid_features,
    "row": _grid_features,
    "table": _table,
    "header": _header,
    "class": _class,
    "enum": _enum,
    "attribute": _member,
    "reference": _member,
}
"""By grammar rule: the function that adds its names. The names of rules are the same in all languages."""
