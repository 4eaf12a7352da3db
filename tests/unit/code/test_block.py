"""Bodies are built from the outside in."""

from __future__ import annotations

from envgraph import code

A, B = code.Local("a"), code.Local("b")


def show(block: code.BodyBuilder) -> str:
    return code.print_source(block.finish_body()).text


def test_statements_are_added_inside_the_open_loops_and_tests() -> None:
    block = code.BodyBuilder()
    block.open_loop(A, code.Name("E"))
    block.open_test(A)
    block.open_test(B)
    block.add(code.ExpressionStatement(code.Call(code.Name("f"), (A,))))
    assert show(block) == "for a in E:\n    if a and b:\n        f(a)\n"


def test_back_to_closes_the_loops_and_tests_opened_since() -> None:
    block = code.BodyBuilder()
    block.add(code.Assign(A, code.Constant(0)))
    place = block.position
    block.open_loop(B, code.Name("E"))
    block.open_test(B)
    block.add(code.Assign(A, B, "+="))
    block.close_to(place)
    assert not block.is_full
    block.open_test(A)
    block.add(code.Return(A))
    assert show(block) == "a = 0\nfor b in E:\n    if b:\n        a += b\nif a:\n    return a\n"


def test_empty_tests_are_left_out_unless_an_empty_body_is_added() -> None:
    block = code.BodyBuilder()
    place = block.position
    block.open_test(A)
    block.close_to(place)
    block.open_test(B)
    block.add()
    assert show(block) == "if b:\n    pass\n"


def test_a_block_is_full_before_the_nesting_limit_of_python() -> None:
    block = code.BodyBuilder()
    depth = 0
    while not block.is_full:
        block.open_test(code.AssignmentExpression(A, code.Name("one")))
        block.add(code.Assign(B, A))
        depth += 1
    block.add(code.Return(B))
    assert 20 < depth < 90
    names = code.define_functions((code.Function("f", (), block.finish_body()),), "deep", {"one": 1})
    assert names["f"]() == 1
    block = code.BodyBuilder()
    while not block.is_full:
        block.open_loop(A, code.Name("E"))
    block.add(code.Return(A))
    assert code.define_functions((code.Function("f", (), block.finish_body()),), "loops", {"E": [3]})["f"]() == 3


def test_counters_are_inserted_after_statements_with_an_origin() -> None:
    block = code.BodyBuilder()
    block.open_loop(A, code.Name("E"))
    block.set_origin("loop")
    block.open_test(A)
    block.set_origin("test")
    block.open_test(code.AssignmentExpression(B, A))
    block.add(code.Assign(B, A))
    block.set_origin("value")
    block.open_test(B)
    block.add(code.ExpressionStatement(code.Call(code.Name("found"), (B,))))
    function = code.Function("f", (), block.finish_body())
    seen: list[str] = []
    found: list[int] = []

    def note(what: str) -> bool:
        seen.append(what)
        return True

    counted = code.with_counters(
        function,
        lambda origin: None if origin is None else code.Call(code.Name("note"), (code.Name(f"the_{origin}"),)),
    )
    names = {"E": [0, 5], "note": note, "found": found.append}
    code.define_functions(
        (counted,),
        "counted",
        names := {**names, "the_loop": "loop", "the_test": "test", "the_value": "value"},
    )
    names["f"]()  # type: ignore[operator]
    assert found == [5]
    assert seen == ["loop", "loop", "test", "value"]
    assert code.print_source((function,)).text.count("\n") == code.print_source((counted,)).text.count("\n") - 2
