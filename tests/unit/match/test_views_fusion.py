"""Delta functions that hear of the same change are one function, which does once what they begin with alike."""

from __future__ import annotations

from itertools import chain, pairwise

from envgraph import code
from envgraph.graph import Model
from envgraph.match import FREE
from envgraph.match.views.delta._fusion import BranchGroup, fused_source, insert_nest, merge_groups
from envgraph.metamodel import Attribute, Class, Metamodel, Reference, Scalar
from envgraph.pattern import Library, LinkAtom
from tests.unit.match.kinds import watched
from tests.unit.match.writing import equal, find, fold, neg, path, pattern

POSTS = Metamodel(
    "posts",
    (
        Class(
            "Post",
            features=(
                Attribute("lit", Scalar.BOOL),
                Reference("next", "Post", 0, None),
            ),
        ),
    ),
)
LIT, NEXT = POSTS.attributes[0], POSTS.references[0]
CHAIN = pattern(
    "chain(a : Post, b : Post, c : Post, d : Post)",
    [
        path("Post.lit", "a", True),
        path("Post.next", "a", "b"),
        path("Post.next", "b", "c"),
        path("Post.next", "c", "d"),
    ],
)
FAR = [path("Post.next", "a", "c"), find("far", "c", "b")]
LAST = pattern("last(a : Post, b : Post, c : Post)", [path("Post.next", "a", "b"), path("Post.next", "b", "c")])


def test_common_prefixes_of_delta_functions_are_merged() -> None:
    library = Library(POSTS)
    library.add(CHAIN, LAST)
    model = Model(POSTS)
    views = watched(model, library)
    wiring = views.watched_views.network.subscriptions
    links = [delta for delta in wiring.deltas if isinstance(delta.occurrence.relation, LinkAtom)]
    assert len(links) == 5
    text = fused_source(wiring._planner, links, True).text
    # Three places look at the targets of the new link's target, three at the sources of its source; one of the former
    # does so only under a condition.
    assert text.count("in F0[a1]:") == 2
    assert text.count("in B0[a0]:") == 2  # one of them inside a loop that two places share
    assert text.count("    derive_0(") == 3
    assert text.count("    derive_1(") == 2


def test_merged_functions_find_the_same_rows() -> None:
    library = Library(POSTS)
    library.add(CHAIN, LAST)
    model = Model(POSTS)
    posts = [model.graph.new("Post") for _ in range(4)]
    model.graph.set_value(posts[0], LIT, True)
    views = watched(model, library)
    for source, target in pairwise(posts):
        model.graph.link(source, NEXT, target)
        views.check_integrity()
    model.graph.link(posts[3], NEXT, posts[3])  # one link at several places of a body
    views.check_integrity()
    assert views.count("chain", (FREE,) * 4) == 1
    assert views.count("last", (FREE,) * 3) == 4
    model.graph.link(posts[0], NEXT, posts[0])
    views.check_integrity()
    for source in reversed(posts):
        for target in list(model.graph.targets(source, NEXT)):
            model.graph.unlink(source, NEXT, target)
            views.check_integrity()
    assert views.count("chain", (FREE,) * 4) == views.count("last", (FREE,) * 3) == 0


def test_deletions_of_rows_inserted_later_in_a_merged_loop_are_exact() -> None:
    marks = ("lamp", "wire", "mark")
    posts = Metamodel("posts", (Class("Post", features=tuple(Reference(n, "Post", 0, None) for n in marks)),))
    lamp, wire, mark = posts.references
    library = Library(posts)
    library.add(
        pattern(
            "differ(x : Post, y : Post, a : Post, b : Post)",
            [
                path("Post.mark", "x", "_"),
                neg(path("Post.mark", "y", "_")),
                path("Post.lamp", "x", "a"),
                path("Post.lamp", "y", "b"),
                path("Post.wire", "x", "y"),
            ],
        )
    )
    model = Model(posts)
    first, second, third, *others = (model.graph.new("Post") for _ in range(12))
    for target in (third, second):
        model.graph.link(first, lamp, target)
    for other in (first, *others):
        model.graph.link(first, wire, other)
        model.graph.link(other, wire, first)
    views = watched(model, library)
    # With x and y the same post, a new mark adds each row at the first place, and takes it away at the second.
    model.graph.link(first, mark, second)
    views.check_integrity()
    model.graph.link(others[0], lamp, third)
    views.check_integrity()
    assert views.count("differ", (FREE,) * 4) == 2
    model.graph.unlink(first, mark, second)
    views.check_integrity()
    assert views.count("differ", (FREE,) * 4) == 0


def test_explain_counts_rows_of_merged_functions() -> None:
    library = Library(POSTS)
    library.add(LAST, pattern("far(a : Post, b : Post)", [path("Post.next", "a", "b")], FAR))
    model = Model(POSTS)
    hub, *leaves = (model.graph.new("Post") for _ in range(5))
    views = watched(model, library)
    assert "actually" not in views.explain("last")  # there is no link yet
    for leaf in leaves:
        model.graph.link(leaf, NEXT, hub)
    text = views.explain("last")
    assert "when Post.next(a, b) is inserted" in text
    assert text.count("actually 0)") == 2
    model.graph.link(hub, NEXT, leaves[0])
    model.graph.link(hub, NEXT, leaves[1])
    # Of six links four lead to the hub, from which there are two; two lead to leaves, from which there is one each.
    text = views.explain("last")
    assert text.count("actually 1.67)") == 2
    assert "when find far(" in views.explain("far")  # recursive patterns, too


V0, V1, T0, U0 = map(code.Local, ("v0", "v1", "t0", "u0"))


def first_and_then(table: code.Local, name: str) -> code.Body:
    """The first of a tuple, and what a function does with all that a table has for it."""
    found = code.For(
        V1, code.Subscript(code.Name("F"), V0), (code.ExpressionStatement(code.Call(code.Name(name), (V1,))),)
    )
    return (code.If(T0, (code.Assign(code.Tuple((V0,)), table), found)),)


def each(name: str) -> code.Body:
    """A function of all elements."""
    return (code.For(V0, code.Name("F"), (code.ExpressionStatement(code.Call(code.Name(name), (V0,))),)),)


def fused(*nests: tuple[tuple[str, bool], code.Body]) -> str:
    groups: list[BranchGroup] = []
    for change, nest in nests:
        insert_nest(groups, nest, change)
    return code.print_source(merge_groups(groups)).text


def text(*parts: code.Body) -> str:
    return code.print_source(tuple(chain.from_iterable(parts))).text


def test_loops_over_different_relations_are_not_merged() -> None:
    one, other = first_and_then(T0, "f"), first_and_then(U0, "g")
    assert fused((("p", True), one), (("q", True), other)) == text(one) + text(other).split("\n", 1)[1]
    again = first_and_then(T0, "g")
    assert fused((("p", True), one), (("q", True), again)) == text(one) + "        g(v1)\n"


def test_insertions_and_deletions_of_merged_views_keep_their_order() -> None:
    gain, lose = each("add"), each("drop")
    assert fused((("p", True), gain), (("p", False), lose)) == text(gain, lose)
    assert fused((("p", True), gain), (("q", False), lose)) == text(gain) + "    drop(v0)\n"
    between = (code.If(code.Name("c"), (code.ExpressionStatement(code.Call(code.Name("drop"), (code.Local("a0"),))),)),)
    whole = fused((("p", True), gain), (("p", False), between), (("p", True), gain))
    assert whole == text(gain, between, gain)


def test_specific_steps_are_nested_in_common_steps() -> None:
    tests = [code.Operation("==", (V0, code.Constant(n))) for n in range(3)]

    def nest(which: int, name: str) -> code.Body:
        return (
            code.For(
                V0,
                code.Name("F"),
                (
                    code.If(
                        tests[0],
                        (code.If(tests[which], (code.ExpressionStatement(code.Call(code.Name(name), (V0,))),)),),
                    ),
                ),
            ),
        )

    one, other, again = nest(1, "f"), nest(2, "g"), nest(1, "h")
    lines = fused((("p", True), one), (("q", True), other), (("r", True), again)).splitlines()
    assert lines == [
        "for v0 in F:",
        "    if v0 == 0 and v0 == 1:",
        "        f(v0)",
        "        h(v0)",
        "    if v0 == 0 and v0 == 2:",
        "        g(v0)",
    ]


def test_functions_with_two_parts_are_not_nested() -> None:
    library = Library(POSTS)
    heads = "(a : Post, b : Post, n : int)"
    counted = pattern(
        f"busy{heads}", [path("Post.next", "a", "b"), equal("n", fold("count", path("Post.next", "b", "_")))]
    )
    library.add(counted, LAST)
    model = Model(POSTS)
    posts = [model.graph.new("Post") for _ in range(4)]
    views = watched(model, library)
    for source in posts:
        for target in posts:
            model.graph.link(source, NEXT, target)
            views.check_integrity()
    for source in posts:
        model.graph.unlink(source, NEXT, posts[1])
        views.check_integrity()
    assert views.count("busy", (FREE,) * 3) == 12
