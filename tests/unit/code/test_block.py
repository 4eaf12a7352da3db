"""Bodies are built from the outside in."""

from __future__ import annotations

from envgraph import code

A, B = code.Local("a"), code.Local("b")


def show(block: code.Block) -> str:
    return code.printed(block.body()).text


def test_what_follows_stands_inside() -> None:
    block = code.Block()
    block.loop(A, code.Name("E"))
    block.test(A)
    block.test(B)
    block.add(code.Do(code.Call(code.Name("f"), (A,))))
    assert show(block) == "for a in E:\n    if a and b:\n        f(a)\n"


def test_it_goes_back_to_where_it_was() -> None:
    block = code.Block()
    block.add(code.Assign(A, code.Constant(0)))
    place = block.place
    block.loop(B, code.Name("E"))
    block.test(B)
    block.add(code.Assign(A, B, "+="))
    block.back_to(place)
    assert not block.full
    block.test(A)
    block.add(code.Return(A))
    assert show(block) == "a = 0\nfor b in E:\n    if b:\n        a += b\nif a:\n    return a\n"


def test_tests_under_which_nothing_stands_are_left_out_unless_that_is_added() -> None:
    block = code.Block()
    place = block.place
    block.test(A)
    block.back_to(place)
    block.test(B)
    block.add()
    assert show(block) == "if b:\n    pass\n"


def test_it_is_full_before_python_has_enough() -> None:
    block = code.Block()
    depth = 0
    while not block.full:
        block.test(code.Let(A, code.Name("one")))
        block.add(code.Assign(B, A))
        depth += 1
    block.add(code.Return(B))
    assert 20 < depth < 90
    names = code.define((code.Function("f", (), block.body()),), "deep", {"one": 1})
    assert names["f"]() == 1
    block = code.Block()
    while not block.full:
        block.loop(A, code.Name("E"))
    block.add(code.Return(A))
    assert code.define((code.Function("f", (), block.body()),), "loops", {"E": [3]})["f"]() == 3


def test_counters_stand_behind_what_comes_from_somewhere() -> None:
    block = code.Block()
    block.loop(A, code.Name("E"))
    block.come_from("loop")
    block.test(A)
    block.come_from("test")
    block.test(code.Let(B, A))
    block.add(code.Assign(B, A))
    block.come_from("value")
    block.test(B)
    block.add(code.Do(code.Call(code.Name("found"), (B,))))
    function = code.Function("f", (), block.body())
    seen: list[str] = []
    found: list[int] = []

    def note(what: str) -> bool:
        seen.append(what)
        return True

    counted = code.with_counters(
        function,
        lambda origin: (
            None if origin is None else code.Call(code.Name("note"), (code.Name(f"the_{origin}"),))
        ),
    )
    names = {"E": [0, 5], "note": note, "found": found.append}
    code.define(
        (counted,),
        "counted",
        names := {**names, "the_loop": "loop", "the_test": "test", "the_value": "value"},
    )
    names["f"]()  # type: ignore[operator]
    assert found == [5]
    assert seen == ["loop", "loop", "test", "value"]
    assert code.printed((function,)).text.count("\n") == code.printed((counted,)).text.count("\n") - 2
