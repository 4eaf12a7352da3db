"""Find the feature and the type of the value that is expected at the cursor."""

from __future__ import annotations

from collections.abc import Mapping
from itertools import pairwise

from envgraph.editor._cursors import Cursor, split_arguments
from envgraph.editor._scopes import Definitions, Scope, attribute_type
from envgraph.metamodel import Feature, Reference, Scalar

_TRUTH = ("true", "false")
_PLACES = ("grid", "table")
_AGGREGATES = ("avg", "count", "max", "min", "sum")
_SCALARS = frozenset(one.value for one in Scalar)


class WantedValue:
    """The value that is expected at a cursor, as far as the text before the cursor shows."""

    def __init__(self, cursor: Cursor, definitions: Definitions, scope: Scope) -> None:
        self._cursor = cursor
        self._definitions = definitions
        self._scope = scope

    def feature(self) -> Feature | None:
        """Return the feature whose value is at the cursor: the one before `=`, or that of the column of a table."""
        cursor = self._cursor
        features, opening = self.block_features()
        if opening is None:
            return None
        inside = cursor.lexemes[opening + 1 : cursor.index]
        depth = cursor.lexemes[opening].brace_depth + 1
        if cursor.lexemes[opening - 1].value == ")":
            return self._column(opening)
        pairs = ((one, after) for one, after in pairwise(inside) if one.brace_depth == depth)
        named = [one.value for one, after in pairs if after.value == "="]
        return features.get(named[-1]) if named else None

    def type(self) -> str:
        """Return the name of the type that a value at the cursor must have; "" if any type is possible."""
        cursor = self._cursor
        before = cursor.before().value
        if before == "::":
            before = cursor.before(2).value
        if before in ("==", "!=", "="):
            return self._type_before_comparison()
        call = cursor.call()
        if call is None or (before not in ("(", ",")):
            return ""
        place, path = call.opening - 1, list[str]()
        while place > 1 and cursor.lexemes[place - 1].value == ".":
            path.insert(0, cursor.lexemes[place].value)
            place -= 2
        base = cursor.lexemes[place].value
        if cursor.lexemes[place - 1].value == "find" or (place and self._is_call(base)):
            known = self._definitions.patterns if cursor.lexemes[place - 1].value == "find" else self._definitions.rules
            signature = known.get(".".join([base, *path]))
            found = signature.parameters[call.position : call.position + 1] if signature else ()
            return found[0][1] if found else ""
        cls = self._definitions.find_class(base)
        if cls is None:
            return ""
        return [cls, self._definitions.type_of_path(cls, path)][min(call.position, 1)] if path else cls

    def excludes(self, keyword: str) -> bool:
        """Return True if a keyword begins a value, but no value of the type that can be here."""
        if self._cursor.language == "metamodel":
            declared = self._cursor.before(3).value
            return keyword in _TRUTH and (self._cursor.before().value != "=" or declared not in ("bool", "]"))
        feature = self.feature() if self._cursor.language == "model" else None
        if isinstance(feature, Reference):
            return keyword in _TRUTH or (keyword in _PLACES and not feature.containment)
        if feature is not None and keyword in _PLACES:
            return True
        type_ = attribute_type(feature) if feature is not None else self.type()
        is_known = type_ in _SCALARS or self._definitions.is_class(type_) or bool(self._definitions.find_enum(type_))
        wanted = {"bool"} if keyword in _TRUTH else {"int", "float"} if keyword in _AGGREGATES else {type_}
        return is_known and type_ not in wanted

    def block_features(self) -> tuple[Mapping[str, Feature], int | None]:
        """Return the features of the object whose block the cursor is in, and the index of the block's `{`."""
        opening = self._cursor.enclosing("{", through="[")
        if opening is None or opening == 0:
            return {}, None
        cls = self._definitions.find_class(self._cursor.lexemes[opening - 1].value)
        return self._definitions.features(cls), opening

    def _column(self, opening: int) -> Feature | None:
        """Return the feature of the column of a table in whose block, opened at an index, the cursor is."""
        lexemes = self._cursor.lexemes
        start = next((place for place in range(opening, 0, -1) if lexemes[place].value == "("), 1)
        columns = [one[0].value for one in split_arguments(lexemes[start + 1 : opening]) if one]
        line = lexemes[opening + 1 : self._cursor.index]
        last = max((place for place, one in enumerate(line) if one.value == ";"), default=-1)
        place = len([*split_arguments(line[last + 1 :])]) - 1
        features = self._definitions.features(self._definitions.find_class(lexemes[start - 1].value))
        return features.get(columns[place]) if 0 <= place < len(columns) else None

    def _is_call(self, name: str) -> bool:
        return self._cursor.language in ("rules", "environment") and name in self._definitions.rules

    def _type_before_comparison(self) -> str:
        """Return the type of the variable or path before `==`, `!=` or `=`."""
        cursor = self._cursor
        distance = 2 + (cursor.before().value == "::")
        path: list[str] = []
        while cursor.before(distance).kind == "NAME":
            path.insert(0, cursor.before(distance).value)
            if cursor.before(distance + 1).value != ".":
                break
            distance += 2
        if not path:
            return ""
        if len(path) == 1 and cursor.enclosing("{") is not None and cursor.before(distance + 1).value in ("{", ","):
            feature = self.block_features()[0].get(path[0])
            return self._definitions.type_of_path(feature.owner, path) if feature else ""
        type_ = self._scope.type_of(path[0])
        return self._definitions.type_of_path(type_, path[1:]) if type_ else ""
