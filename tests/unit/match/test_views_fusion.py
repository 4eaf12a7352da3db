"""Delta functions that hear of the same change are one function, which does once what they begin with alike."""

from __future__ import annotations

from itertools import chain, pairwise

from envgraph import code
from envgraph.graph import Model
from envgraph.match import FREE
from envgraph.match.views.delta._fusion import Group, fused_source, insert, merged
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
LAST = pattern(
    "last(a : Post, b : Post, c : Post)", [path("Post.next", "a", "b"), path("Post.next", "b", "c")]
)


def test_what_two_functions_begin_with_alike_is_written_once() -> None:
    library = Library(POSTS)
    library.add(CHAIN, LAST)
    model = Model(POSTS)
    views = watched(model, library)
    wiring = views.kept.network.wiring
    links = [delta for delta in wiring.deltas if isinstance(delta.occurrence.relation, LinkAtom)]
    assert len(links) == 5
    text = fused_source(wiring._planner, links, True).text
    # Three places look at the targets of the new link's target, three at the sources of its source; one of the former
    # does so only under a condition.
    assert text.count("in F0[a1]:") == 2
    assert text.count("in B0[a0]:") == 2  # one of them inside a loop that two places share
    assert text.count("    derive_0(") == 3
    assert text.count("    derive_1(") == 2


def test_functions_that_are_one_find_what_each_would_find() -> None:
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


def test_what_a_view_loses_at_one_place_may_have_come_at_another_in_a_later_pass_of_the_same_loop() -> None:
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


def test_explain_tells_what_a_function_does_for_the_tuples_that_there_are() -> None:
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
    found = code.For(V1, code.Index(code.Name("F"), V0), (code.Do(code.Call(code.Name(name), (V1,))),))
    return (code.If(T0, (code.Assign(code.Tuple((V0,)), table), found)),)


def each(name: str) -> code.Body:
    """A function of all elements."""
    return (code.For(V0, code.Name("F"), (code.Do(code.Call(code.Name(name), (V0,))),)),)


def fused(*nests: tuple[tuple[str, bool], code.Body]) -> str:
    groups: list[Group] = []
    for change, nest in nests:
        insert(groups, nest, change)
    return code.printed(merged(groups)).text


def text(*parts: code.Body) -> str:
    return code.printed(tuple(chain.from_iterable(parts))).text


def test_loops_over_names_that_stand_for_different_things_are_not_one() -> None:
    one, other = first_and_then(T0, "f"), first_and_then(U0, "g")
    assert fused((("p", True), one), (("q", True), other)) == text(one) + text(other).split("\n", 1)[1]
    again = first_and_then(T0, "g")
    assert fused((("p", True), one), (("q", True), again)) == text(one) + "        g(v1)\n"


def test_gains_and_losses_of_a_view_stay_apart_and_in_order() -> None:
    gain, lose = each("add"), each("drop")
    assert fused((("p", True), gain), (("p", False), lose)) == text(gain, lose)
    assert fused((("p", True), gain), (("q", False), lose)) == text(gain) + "    drop(v0)\n"
    between = (code.If(code.Name("c"), (code.Do(code.Call(code.Name("drop"), (code.Local("a0"),))),)),)
    whole = fused((("p", True), gain), (("p", False), between), (("p", True), gain))
    assert whole == text(gain, between, gain)


def test_what_only_some_need_stands_inside_what_all_need() -> None:
    tests = [code.Operation("==", (V0, code.Constant(n))) for n in range(3)]

    def nest(which: int, name: str) -> code.Body:
        return (
            code.For(
                V0,
                code.Name("F"),
                (code.If(tests[0], (code.If(tests[which], (code.Do(code.Call(code.Name(name), (V0,))),)),)),),
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


def test_what_has_two_halves_is_no_nest() -> None:
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
