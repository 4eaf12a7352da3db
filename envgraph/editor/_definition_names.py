"""Find the names in syntax trees of environments, models and metamodels."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from envgraph.editor._mention_data import Holder, Scope
from envgraph.editor._name_finder import Handler, NameFinder, add_parameter, define, names_in, trees_in

# --- environments ---


def _inner_scope(finder: NameFinder, tree: Any, scope: Scope | None, holder: Holder | None) -> None:
    """Find the names of a clause, whose own variables are known only in it."""
    inner = Scope(scope.name if scope else "", scope)
    if tree.data == "action":
        names = names_in(tree)
        finder.add("action", names[0], inner, tree)
    finder.walk(tree, inner)


def _environment(finder: NameFinder, tree: Any, scope: Scope | None, holder: Holder | None) -> None:
    """Find the names of an environment; its parameters and agents are known in all clauses."""
    agents = [each for clauses in trees_in(tree, "clauses") for each in trees_in(clauses, "agent")]
    define("environment", whole=True)(finder, tree, scope, holder)
    within = finder.work[-1][1] if finder.work else None
    if within is not None:
        within.parameters += [str(name) for agent in agents for name in names_in(agent)[:1]]


def _around(finder: NameFinder, tree: Any, scope: Scope | None, holder: Holder | None) -> None:
    inner = Scope(scope.name if scope else "", scope)
    for name in names_in(tree)[:1]:
        finder.add("variable", name, inner)
    finder.walk(tree, inner)


def _draw_grid(finder: NameFinder, tree: Any, scope: Scope | None, holder: Holder | None) -> None:
    own = finder.type_of(trees_in(tree, "type")[0])
    for name in names_in(tree):
        finder.add("feature", name, scope, holder=own)
    finder.walk(tree, scope)


def _token(finder: NameFinder, tree: Any, scope: Scope | None, holder: Holder | None) -> None:
    inner = Scope(scope.name if scope else "", scope)
    add_parameter(finder, tree, inner, holder) if trees_in(tree, "type") else finder.walk(tree, inner)
    if not trees_in(tree, "type"):
        finder.add("variable", names_in(tree)[0], inner)


# --- models ---


def _model(finder: NameFinder, tree: Any, scope: Scope | None, holder: Holder | None) -> None:
    name, metamodel = names_in(tree)[:2]
    within = Scope(f"model {name}")
    finder.add("model", name, within, tree)
    finder.add("metamodel", metamodel, within)
    finder.walk(tree, within)


def _object(finder: NameFinder, tree: Any, scope: Scope | None, holder: Holder | None) -> None:
    """Add an object: `name : Class { .. }` or `Class { .. }`."""
    *names, cls = names_in(tree) or [None]
    if cls is None:
        return  # An arrow of a rule without a name, such as `a -> b`.
    for name in names:
        finder.add("object", name, scope, tree)
    finder.add("class", cls, scope)
    finder.walk(tree, scope, ("class", str(cls)))


def _object_value(finder: NameFinder, tree: Any, scope: Scope | None, holder: Holder | None) -> None:
    """Add a name as a value: an object, or a literal if the feature is an attribute."""
    finder.add("object", tree.children[0], scope, holder=holder)


def _grid(finder: NameFinder, tree: Any, scope: Scope | None, holder: Holder | None) -> None:
    finder.add("object", names_in(tree)[0], scope, tree)
    legend = [each for part in trees_in(tree, "legend") for each in trees_in(part, "legend_class")]
    own: Holder = ("classes", tuple(("class", str(one.children[1])) for one in legend))
    finder.walk(tree, scope, own)


def _legend_class(finder: NameFinder, tree: Any, scope: Scope | None, holder: Holder | None) -> None:
    finder.add("class", tree.children[1], scope)
    finder.walk(tree, scope, ("class", str(tree.children[1])))


def _grid_features(finder: NameFinder, tree: Any, scope: Scope | None, holder: Holder | None) -> None:
    for name in names_in(tree):
        finder.add("feature", name, scope, holder=holder)


def _table(finder: NameFinder, tree: Any, scope: Scope | None, holder: Holder | None) -> None:
    cls, *features = names_in(tree)
    finder.add("class", cls, scope)
    own: Holder = ("class", str(cls))
    for name in features:
        finder.add("feature", name, scope, holder=own)
    for line in reversed(trees_in(tree, "line")):
        for name in names_in(line):
            finder.add("object", name, scope, line)
        for feature, value in zip(features, trees_in(line), strict=False):
            finder.work.append((value, scope, ("member", own, str(feature))))


# --- metamodels ---


def _header(finder: NameFinder, tree: Any, scope: Scope | None, holder: Holder | None) -> None:
    finder.add("metamodel", names_in(tree)[0], None, tree)


def _class(finder: NameFinder, tree: Any, scope: Scope | None, holder: Holder | None) -> None:
    name = names_in(tree)[0]
    own = Scope(f"class {name}")
    finder.add("class", name, own, tree)
    for part in trees_in(tree, "extends"):
        for above in names_in(part):
            finder.add("class", above, own)
    finder.walk(tree, own, ("class", str(name)))


def _enum(finder: NameFinder, tree: Any, scope: Scope | None, holder: Holder | None) -> None:
    name = names_in(tree)[0]
    own = Scope(f"enum {name}")
    finder.add("class", name, own, tree)
    for literal in trees_in(tree, "literal"):
        finder.add("literal", literal.children[0], own, literal, holder=("class", str(name)))


def _member(finder: NameFinder, tree: Any, scope: Scope | None, holder: Holder | None) -> None:
    type_, name, *opposite = names_in(tree)
    finder.add("class", type_, scope)
    finder.add("feature", name, scope, tree, holder=holder)
    for other in opposite:
        finder.add("feature", other, scope, holder=("class", str(type_)))
    finder.work += [(one, scope, ("class", str(type_))) for one in trees_in(tree, "enum_literal")]


DEFINITION_HANDLERS: Mapping[str, Handler] = {
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
"""By grammar rule: the function that adds its names."""
