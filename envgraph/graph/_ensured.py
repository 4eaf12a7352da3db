"""Context managers whose end cannot be missed."""

from __future__ import annotations

from collections.abc import Callable, Generator, Iterator
from contextlib import AbstractContextManager
from functools import partial, wraps
from typing import Any, ParamSpec, TypeVar, cast

P = ParamSpec("P")
T = TypeVar("T")


def ensured(function: Callable[P, Iterator[T]]) -> Callable[P, AbstractContextManager[T]]:
    """As `contextlib.contextmanager`, for generators that let exceptions pass; Ctrl-C finds no gap at either end.

    Python looks for signals where a function begins. An `__exit__` in Python is interrupted there before it has done
    anything, and what it should have ended goes on. A generator that is resumed is interrupted in its `try`. So
    both methods are functions of C that resume a generator: `max` is one that hands any number of values to a `key`.

    >>> @ensured
    ... def told(what):
    ...     print("begin")
    ...     try:
    ...         yield what
    ...     finally:
    ...         print("end")
    >>> with told(5) as number:
    ...     print(number)
    begin
    5
    end
    """

    @wraps(function)
    def made(*arguments: P.args, **named: P.kwargs) -> AbstractContextManager[T]:
        return as_context(_steps(function(*arguments, **named)))

    return made


def as_context(steps: Generator[Any, Any, None]) -> AbstractContextManager[Any]:
    """A context manager of a generator that does what `_steps` does."""
    return cast("AbstractContextManager[Any]", Ensured(steps))


class _Method:
    """A method that each object brings along; from the class it can be called too, as `contextlib.ExitStack` does."""

    def __set_name__(self, owner: type, name: str) -> None:
        self._own = name.replace("__", "_")

    def __get__(self, manager: object, owner: type) -> Callable[..., Any]:
        return self if manager is None else getattr(manager, self._own)

    def __call__(self, manager: object, *arguments: object) -> object:
        return getattr(manager, self._own)(*arguments)


class Ensured:
    """The methods of a context manager."""

    __slots__ = ("_enter_", "_exit_")
    __enter__ = _Method()
    __exit__ = _Method()

    def __init__(self, steps: Generator[Any, Any, None]) -> None:
        self._enter_ = steps.__next__
        # Of several values `max` gives the one with the largest key: here the first, False, so that exceptions pass.
        self._exit_ = partial(max, False, key=steps.send)


def _steps(inner: Iterator[Any]) -> Generator[Any, Any, None]:
    """Gives what the block is about; takes False and the three arguments of `__exit__`, and gives a key for each."""
    assert isinstance(inner, Generator)
    try:
        yield next(inner)
        yield 1
        problem = yield 0
        if problem is None:
            next(inner, None)
        else:
            _end(inner, problem)
    except BaseException as interruption:
        inner.throw(interruption)
        raise
    while True:
        yield 0


def _end(inner: Generator[Any, Any, None], problem: BaseException) -> None:
    trace = problem.__traceback__
    try:
        inner.throw(problem)
    except BaseException as raised:
        if raised is not problem:
            raise
        problem.__traceback__ = trace
