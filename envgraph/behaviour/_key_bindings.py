"""Assign keys of the keyboard to actions: the keys that `@key` names, and other keys for actions without `@key`."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping, Sequence
from string import ascii_lowercase
from types import MappingProxyType
from typing import Final

from envgraph.behaviour._behaviour import Agent, Behaviour
from envgraph.behaviour._key_index import KeyIndex, expand_action
from envgraph.behaviour._parameter_domains import domain_type
from envgraph.metamodel import Metamodel
from envgraph.pattern import ObjectType

NAMED_KEYS: Final[Mapping[str, int]] = {
    "ArrowRight": 2**30 + 79, "ArrowLeft": 2**30 + 80, "ArrowDown": 2**30 + 81, "ArrowUp": 2**30 + 82,
    "Enter": 13, "Tab": 9, "Backspace": 8, "Delete": 127,
}  # fmt: skip
"""Key codes of SDL and pygame by their names on the web (`KeyboardEvent.key`)."""

PLAY_COMMANDS: Final[Mapping[str, tuple[str, str]]] = {
    "undo": ("u", "Backspace"),
    "restart": ("r", "Delete"),
    "next": ("n", "Tab"),
    "quit": ("q", "Escape"),
}
"""Commands for people who play, each with two keys. A key of an action does the action instead."""

_ARROWS: Final = {
    "left": "ArrowLeft", "right": "ArrowRight", "up": "ArrowUp", "down": "ArrowDown",
    "west": "ArrowLeft", "east": "ArrowRight", "north": "ArrowUp", "south": "ArrowDown",
}  # fmt: skip
_SPARE_KEYS: Final = (*"123456789", *(one for one in ascii_lowercase if one not in "unrq"))
"""Digits, then the letters that are no keys of `PLAY_COMMANDS`."""


def normal_key(key: str) -> str:
    """Return the name of a key in `key_bindings`: the same for `a` and `A`."""
    return key.casefold()[0] if len(key) == 1 else key


def key_code(key: str) -> int | None:
    """Return the key code of a character or of one of `NAMED_KEYS`, the same for `a` and `A`; None for others."""
    return ord(normal_key(key)) if len(key) == 1 else NAMED_KEYS.get(key)


def action_keys(behaviour: Behaviour, keys: KeyIndex, metamodel: Metamodel) -> dict[str, list[str]]:
    """Return the keys that `@key` gives to actions, by the name of the action, such as `go(left)`.

    The keys of a clause belong to its actions in their order. Further keys begin again with the first action, except
    if a parameter is an object: other members of the family may have more objects.
    """
    found: dict[str, list[str]] = {}
    owners: tuple[Behaviour | Agent, ...] = (behaviour, *behaviour.agents)
    for action in (one for owner in owners for one in owner.actions if one.keys):
        names = [name for name, _ in expand_action(action, keys, metamodel)]
        is_open = any(isinstance(domain_type(one, metamodel), ObjectType) for _, one in action.parameters)
        for place, key in enumerate(action.keys[: len(names)] if is_open else action.keys):
            found.setdefault(names[place % len(names)], []).append(key)
    return found


def key_bindings(names: Sequence[str], written: Mapping[str, Iterable[str]] = MappingProxyType({})) -> dict[str, int]:
    """Return the number of the action that each key does, by the name of the key; `a` stands for `A` too.

    An action without written keys gets an arrow if its name has a direction, otherwise one of `_SPARE_KEYS`, as long
    as one is free.

    Args:
        names: the names of all actions, in the order of their numbers.
        written: the keys that `@key` gives to actions, by name; see `action_keys`.

    >>> key_bindings(["moveLeft", "move(right)", "wait", "lift"], {"lift": ["L", "Enter"]})
    {'l': 3, 'Enter': 3, 'ArrowLeft': 0, 'ArrowRight': 1, '1': 2}
    """
    found: dict[str, int] = {}
    for number, name in enumerate(names):
        for key in written.get(name, ()):
            found.setdefault(normal_key(key), number)
    rest = [number for number, name in enumerate(names) if not written.get(name)]
    bare = []
    for number in rest:
        words = re.findall("[A-Z]?[a-z]+|[A-Z]+", names[number])
        arrows = [_ARROWS[word.lower()] for word in words if word.lower() in _ARROWS]
        if len({*arrows}) != 1 or found.setdefault(arrows[0], number) != number:
            bare.append(number)
    spare = (key for key in _SPARE_KEYS if key not in found)
    return {**found, **dict(zip(spare, bare, strict=False))}
