"""Find the names in syntax trees of queries and rules, and in the expressions of all languages."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import Any

from envgraph.editor._mention_data import Holder, Mention, Scope

Handler = Callable[["NameFinder", Any, Scope | None, Holder | None], None]
"""A function that adds the names of a tree in a scope; the holder has the features that the tree names."""


def is_token(item: Any) -> bool:
    """Return True if a child of a tree is a token."""
    return isinstance(item, str)


def is_tree(item: Any) -> bool:
    """Return True if a child of a tree is a tree."""
    return item is not None and not isinstance(item, str)


class NameFinder:
    """Walks over a syntax tree and collects its names.

    Attributes:
        found: the names so far.
        work: trees whose names are still to be found, each with its scope and with the object that has its features.
    """

    def __init__(self, handlers: Mapping[str, Handler]) -> None:
        self._handlers = handlers
        self.found: list[Mention] = []
        self.work: list[tuple[Any, Scope | None, Holder | None]] = []

    def find(self, root: Any) -> list[Mention]:
        """Return all names in a tree. A stack is used, since expressions may be thousands of operators deep."""
        self.work = [(one, None, None) for one in root.children if is_tree(one)]
        while self.work:
            tree, scope, holder = self.work.pop()
            handle = self._handlers.get(str(tree.data))
            if handle is not None:
                handle(self, tree, scope, holder)
            else:
                self.walk(tree, scope, holder)
        return self.found

    def walk(self, tree: Any, scope: Scope | None, holder: Holder | None = None) -> None:
        """Find the names in the children of a tree later."""
        self.work += [(one, scope, holder) for one in reversed(tree.children) if is_tree(one)]

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
        self.found.append(found)

    def add_chain(self, tokens: Sequence[Any], holder: Holder, scope: Scope | None) -> Holder:
        """Add the features of a path such as `.f.g`; return the holder of a feature after the path."""
        for token in tokens:
            self.add("feature", token, scope, holder=holder)
            holder = ("member", holder, str(token))
        return holder

    def type_of(self, tree: Any) -> Holder:
        """Return the class that a `type` tree names."""
        return ("class", str(tree.children[-1])) if tree.data == "type" else ("class", "")


def names_in(tree: Any) -> list[Any]:
    return [one for one in tree.children if is_token(one) and one.type == "NAME"]


def trees_in(tree: Any, *kinds: str) -> list[Any]:
    return [one for one in tree.children if is_tree(one) and (not kinds or one.data in kinds)]


_TEXT_ARGUMENTS = ("message", "severity")
"""Arguments of annotations that are texts."""


def define(kind: str, whole: bool = False) -> Handler:
    """Return the handler of a definition. With `whole`, all variables are known in the whole definition."""

    def handle(finder: NameFinder, tree: Any, scope: Scope | None, holder: Holder | None) -> None:
        names = names_in(tree)
        if not names:
            return
        within = Scope(f"{kind} {names[0]}")
        finder.add(kind, names[0], within, tree)
        for item in (each for part in trees_in(tree, "parameters") for each in trees_in(part, "parameter")):
            within.parameters += [str(name) for name in names_in(item)]
        if whole:
            finder.walk(tree, within)
            return
        for part in reversed(trees_in(tree)):
            inner = Scope(within.name, within) if part.data == "body" else within
            finder.work.append((part, inner, None))

    return handle


def _annotation(finder: NameFinder, tree: Any, scope: Scope | None, holder: Holder | None) -> None:
    """Add the arguments of annotations that name something: variables of a pattern or rule, attributes of a class."""
    name = str(tree.children[0])
    values = [("", each) for part in trees_in(tree, "annotation_argument") for each in trees_in(part)]
    named = [(str(part.children[0]), each) for part in trees_in(tree, "annotation_named") for each in trees_in(part)]
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
        finder.found.append(Mention("unknown", scope.name.rpartition(" ")[2], start, end))


def _package(finder: NameFinder, tree: Any, scope: Scope | None, holder: Holder | None) -> None:
    """Add the package of the file, under its last name."""
    for part in trees_in(tree, "qualified_name"):
        *before, name = names_in(part)
        finder.add("package", name, None, tree, qualifier=".".join(map(str, before)))


def _nothing(finder: NameFinder, tree: Any, scope: Scope | None, holder: Holder | None) -> None:
    """Add nothing: this has no effect."""


def _import_file(finder: NameFinder, tree: Any, scope: Scope | None, holder: Holder | None) -> None:
    seen = False
    for token in tree.children:
        if is_token(token) and token.type == "STRING":
            seen = True
            finder.add("file", token, scope)
        elif is_token(token) and seen and token.type == "NAME":
            finder.add("alias", token, scope, tree)


def _qualified(kind: str) -> Callable[[NameFinder, Any, Scope | None], str]:
    def add(finder: NameFinder, tree: Any, scope: Scope | None) -> str:
        names = names_in(tree)
        finder.add(kind, names[-1], scope, qualifier=".".join(map(str, names[:-1])))
        return ".".join(map(str, names))

    return add


_add_pattern, _add_rule = _qualified("pattern"), _qualified("rule")


def _import_pattern(finder: NameFinder, tree: Any, scope: Scope | None, holder: Holder | None) -> None:
    for part in trees_in(tree, "qualified_name"):
        _add_pattern(finder, part, scope)


def add_parameter(finder: NameFinder, tree: Any, scope: Scope | None, holder: Holder | None) -> None:
    """Add the name of a parameter, of the domain of an action, of an agent, or after `for`."""
    names = names_in(tree)
    if names and scope is not None:
        finder.add("variable", names[0], scope, tree)
        for type_ in trees_in(tree, "type"):
            scope.add_type(str(names[0]), finder.type_of(type_))
    finder.walk(tree, scope)


def _type(finder: NameFinder, tree: Any, scope: Scope | None, holder: Holder | None) -> None:
    alias, name = tree.children[0], tree.children[-1]
    if is_token(alias) and alias is not name:
        finder.add("alias", alias, scope)
    finder.add("class", name, scope, qualifier=str(alias) if is_token(alias) and alias is not name else "")


def _terms(tree: Any) -> list[Any]:
    return [term for part in trees_in(tree, "terms") for term in part.children]


def _note_types(tree: Any, scope: Scope | None, holders: Iterator[Holder] | Sequence[Holder]) -> None:
    for term, holder in zip(_terms(tree), holders, strict=False):
        if scope is not None and is_tree(term) and term.data == "variable" and term.children[0] != "_":
            scope.add_type(str(term.children[0]), holder)


def _type_constraint(finder: NameFinder, tree: Any, scope: Scope | None, holder: Holder | None) -> None:
    _note_types(tree, scope, [finder.type_of(tree.children[0])])
    finder.walk(tree, scope)


def _path_constraint(finder: NameFinder, tree: Any, scope: Scope | None, holder: Holder | None) -> None:
    source = finder.type_of(tree.children[0])
    target = source
    for path in trees_in(tree, "path"):
        target = finder.add_chain(names_in(path), source, scope)
    _note_types(tree, scope, [source, target])
    finder.walk(tree, scope)


def _pattern_call(finder: NameFinder, tree: Any, scope: Scope | None, holder: Holder | None) -> None:
    name, *rest = trees_in(tree)
    pattern = _add_pattern(finder, name, scope)
    _note_types(tree, scope, [("argument", pattern, index) for index in range(len(_terms(tree)))])
    finder.work += [(one, scope, None) for one in reversed(rest)]


def _variable(finder: NameFinder, tree: Any, scope: Scope | None, holder: Holder | None) -> None:
    finder.add("variable", tree.children[0], scope)


def _enum_literal(finder: NameFinder, tree: Any, scope: Scope | None, holder: Holder | None) -> None:
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


def _navigation(finder: NameFinder, tree: Any, scope: Scope | None, holder: Holder | None) -> None:
    finder.add("feature", tree.children[-1], scope, holder=_expression_holder(tree.children[0], scope))
    finder.walk(tree, scope)


def _class_behind(finder: NameFinder, tree: Any, scope: Scope | None, holder: Holder | None) -> None:
    """Add the class after `as` or `instanceof`."""
    finder.add("class", tree.children[-1], scope)
    finder.walk(tree, scope)


def _function(finder: NameFinder, tree: Any, scope: Scope | None, holder: Holder | None) -> None:
    finder.add("function", tree.children[0], scope)
    finder.walk(tree, scope)


def _chain(finder: NameFinder, tree: Any, scope: Scope | None, holder: Holder | None) -> None:
    """Add a path such as `x.f.g`."""
    first, *features = names_in(tree)
    finder.add("variable", first, scope)
    finder.add_chain(features, ("variable", scope, str(first)), scope)


# --- rules ---


def _vertex(finder: NameFinder, tree: Any, scope: Scope | None, holder: Holder | None) -> None:
    name, types = tree.children[0], trees_in(tree, "type")
    finder.add("variable", name, scope, tree if types else None)
    for type_ in types:
        if scope is not None:
            scope.add_type(str(name), finder.type_of(type_))
    own: Holder = ("variable", scope, str(name))
    finder.work += [(one, scope, own) for one in reversed(trees_in(tree))]


def _assignment(finder: NameFinder, tree: Any, scope: Scope | None, holder: Holder | None) -> None:
    """Add the feature of an assignment, in a vertex or in an object of a model."""
    name = tree.children[0]
    finder.add("feature", name, scope, holder=holder or ("class", ""))
    finder.walk(tree, scope, ("member", holder or ("class", ""), str(name)))


def _graph(finder: NameFinder, tree: Any, scope: Scope | None, holder: Holder | None) -> None:
    children = tree.children
    for place in range(1, len(children) - 1, 2):
        left, arrow, right = children[place - 1 : place + 2]
        names = names_in(arrow)
        if not names:
            continue
        source, target = (right, left) if arrow.data == "backward" else (left, right)
        own: Holder = ("variable", scope, str(source.children[0]))
        finder.add("feature", names[0], scope, holder=own)
        if scope is not None:
            scope.add_type(str(target.children[0]), ("member", own, str(names[0])))
    finder.walk(tree, scope)


def _set(finder: NameFinder, tree: Any, scope: Scope | None, holder: Holder | None) -> None:
    first, *features = names_in(tree)
    finder.add("variable", first, scope)
    target = finder.add_chain(features, ("variable", scope, str(first)), scope)
    finder.walk(tree, scope, target)


def _move(finder: NameFinder, tree: Any, scope: Scope | None, holder: Holder | None) -> None:
    moved, to, *features = names_in(tree)
    finder.add("variable", moved, scope)
    finder.add("variable", to, scope)
    finder.add_chain(features, ("variable", scope, str(to)), scope)


def _variables(finder: NameFinder, tree: Any, scope: Scope | None, holder: Holder | None) -> None:
    """Add the variables of `merge`, `retype` and `redirect`."""
    for name in names_in(tree):
        finder.add("variable", name, scope)
        for type_ in trees_in(tree, "type"):
            if scope is not None:
                scope.add_type(str(name), finder.type_of(type_))
    finder.walk(tree, scope)


def _call(finder: NameFinder, tree: Any, scope: Scope | None, holder: Holder | None) -> None:
    """Add the name of the rule or unit that is called."""
    for part in trees_in(tree):
        if part.data == "qualified_name":
            _add_rule(finder, part, scope)
        else:
            finder.work.append((part, scope, None))


def _asked(finder: NameFinder, tree: Any, scope: Scope | None, holder: Holder | None) -> None:
    finder.add("rule", names_in(tree)[-1], scope)


QUERY_HANDLERS: Mapping[str, Handler] = {
    "annotation": _annotation,
    "package": _package,
    "import_file": _import_file,
    "import": _import_file,
    "import_pattern": _import_pattern,
    "import_java": _nothing,
    "pattern": define("pattern"),
    "declaration": define("function", whole=True),
    "rule": define("rule", whole=True),
    "unit": define("rule", whole=True),
    "derivation": define("rule", whole=True),
    "parameter": add_parameter,
    "domain": add_parameter,
    "agent": add_parameter,
    "each_name": add_parameter,
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
}
"""By grammar rule: the function that adds its names. The names of rules are the same in all languages."""
