"""Convert the syntax trees of `.model` files to models.

All objects are created first, in the order of the text, so that a name can be used before its object; then the
features are set. Errors are reported, and reading continues with the rest of the file.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import field

from lark import Token, Tree

from envgraph.code import dataclass
from envgraph.errors import (
    MOST_ERRORS,
    Diagnostic,
    Note,
    Span,
    did_you_mean,
    has_errors,
    name_hint,
    plural,
    quoted,
)
from envgraph.graph import Model
from envgraph.lang.read._features import Links, is_concrete
from envgraph.lang.read._grid import Cell, Entry, GridText, read_grid
from envgraph.lang.read._imports import Import
from envgraph.lang.read._model_values import NO_VALUE, Reports, kind_of, value_of, values_of
from envgraph.lang.syntax._parsing import Parsed, signed, tokens, trees
from envgraph.metamodel import (
    Attribute,
    EnumType,
    Feature,
    Metamodel,
    Reference,
    Scalar,
)


@dataclass(frozen=True, slots=True)
class ModelText:
    """A `model` definition of a file.

    Attributes:
        model: None when there are errors.
        spans: the span of each object, by id: its name, or its class if it has no name.
    """

    name: str
    span: Span
    metamodel: str
    model: Model | None
    spans: Mapping[int, Span]


@dataclass(frozen=True, slots=True)
class ModelFile:
    """The models and diagnostics of a file; `parts` are the names of all files from which the models were read."""

    models: tuple[ModelText, ...]
    diagnostics: tuple[Diagnostic, ...]
    parts: tuple[str, ...] = ()


def imports_of(parsed: Parsed) -> tuple[Import, ...]:
    """Return the imports of a parsed `.model` file."""
    found = trees(parsed.tree.children, "import") if parsed.tree else []
    paths = [tokens(tree.children)[0] for tree in found]
    return tuple(Import(str(path), parsed.span(path)) for path in paths)


def read_models(parsed: Parsed, metamodel: Metamodel | None) -> ModelFile:
    """Return the models of a parsed file, with all diagnostics; syntax errors are included.

    Args:
        parsed: the file.
        metamodel: the metamodel of its objects. With None, few checks are made, and `ModelText.model` is None.
    """
    diagnostics = list(parsed.diagnostics)
    models: dict[str, ModelText] = {}
    for tree in trees(parsed.tree.children, "model") if parsed.tree else []:
        reader = _Reader(parsed, metamodel, Reports(parsed))
        text = reader.read(tree)
        diagnostics.extend(reader.reports.diagnostics)
        first = models.setdefault(text.name, text)
        if first is not text:
            note = Note("the first definition is here", first.span)
            message = f"model `{text.name}` is defined twice"
            hint = "choose another name, or leave one out"
            diagnostics.append(Diagnostic("duplicate-definition", message, text.span, hint, notes=(note,)))
    if not models and not diagnostics:
        hint = "write `model name : metamodel { ... }`"
        diagnostics.append(
            Diagnostic("missing-model", "the file defines no model", parsed.source.span(0, 0), hint)
        )
    return ModelFile(tuple(models.values()), tuple(diagnostics))


Made = dict[int, list[tuple[int, Span]]]
"""The objects created for a tree, by the tree's `id()`; a tree of a legend creates objects for each letter."""


@dataclass(frozen=True, slots=True)
class _Task:
    """A feature to set after all objects are created; `cell` is the grid letter whose legend sets the feature."""

    node: int
    feature: Token
    value: Tree[Token]
    made: Made
    cell: Span | None = None


@dataclass(slots=True)
class _Grid:
    text: GridText
    nodes: dict[tuple[int, int], int]


@dataclass(slots=True)
class _Reader:
    """A reader of one model.

    `_names` maps names to object ids, or to None if the class is invalid. `_cell_of` is the span of the grid letter
    being read.
    """

    parsed: Parsed
    metamodel: Metamodel | None
    reports: Reports
    spans: dict[int, Span] = field(default_factory=dict)
    _model: Model = field(init=False)
    _links: Links = field(init=False)
    _names: dict[str, tuple[int | None, Span]] = field(default_factory=dict)
    _unknown: int = 0
    _cell_of: Span | None = None
    _grids: dict[str, _Grid] = field(default_factory=dict)
    _tasks: list[_Task] = field(default_factory=list)

    def read(self, tree: Tree[Token]) -> ModelText:
        name, metamodel = tokens(tree.children)
        self._model = Model(self.metamodel or Metamodel(str(metamodel), ()), str(name))
        self._links = Links(self._model, self.reports.error, self.spans, repeated=True)
        if self.metamodel and metamodel != self.metamodel.name:
            hint = (
                did_you_mean(metamodel, [self.metamodel.name]) or f"the metamodel is `{self.metamodel.name}`"
            )
            self.reports.error("unknown-metamodel", f"unknown metamodel `{metamodel}`", metamodel, hint)
        with self._model.loading():
            self._fill_model(tree)
        complete = self.metamodel and not has_errors([*self.parsed.diagnostics, *self.reports.diagnostics])
        return ModelText(
            str(name), self.parsed.span(name), str(metamodel), self._model if complete else None, self.spans
        )

    def _fill_model(self, tree: Tree[Token]) -> None:
        top: Made = {}
        for entry in trees(tree.children, "entry"):
            self._object(entry, top)
        if self.metamodel:
            for grid in self._grids.values():
                self._neighbours(grid)
                for (column, row), node in grid.nodes.items():
                    self._model.graph.places[f"{grid.text.name}[{column},{row}]"] = node
            for task in self._tasks:
                self._assign(task)

    # --- objects ---

    def _object(self, tree: Tree[Token], made: Made) -> None:
        """Create and record in `made` the object of an `entry`, `object` or `unnamed` tree, with all nested objects."""
        *name, cls = tokens(tree.children)
        where = self.parsed.span(name[0] if name else cls)
        node = self._create(str(cls), self.parsed.span(cls), name[0] if name else None, where)
        if node is not None:
            made[id(tree)] = [(node, where)]
        self._body(node, next(iter(trees(tree.children, "body")), None), made)

    def _create(self, cls: str, cls_span: Span, name: Token | None, where: Span) -> int | None:
        known = self._instantiable(cls, cls_span)
        if name is not None and not self._free(name):
            name = None
        node = self._model.graph.new(cls, str(name) if name else None) if known else None
        if name is not None:
            self._names[str(name)] = (node, self.parsed.span(name))
        if node is not None:
            self.spans[node] = self._cell_of or where
        return node

    def _instantiable(self, cls: str, span: Span) -> bool:
        metamodel = self.metamodel
        if metamodel is None:
            return False
        if cls not in metamodel.classes:
            hint = name_hint(cls, metamodel.classes)
            if metamodel.named(cls):
                hint = (
                    "use an `.xmi` or JSON file for its objects: several packages have a class of this name"
                )
            self.reports.error("unknown-class", f"unknown class `{cls}`", span, hint)
            return False
        return is_concrete(metamodel, cls, cls, self.reports.error, span)

    def _free(self, name: Token) -> bool:
        if str(name) not in self._names:
            return True
        self._duplicate("objects", name, self._names[str(name)][1])
        return False

    def _duplicate(self, what: str, name: Token, first: Span) -> None:
        notes = (Note("the first one is here", first),)
        message, hint = f"there are two {what} `{name}`", "choose another name for one"
        self.reports.error("duplicate-object", message, name, hint, notes)

    def _body(self, node: int | None, body: Tree[Token] | None, made: Made, cell: Span | None = None) -> None:
        """Create the objects nested in an object; add a task for each feature; report features that are set twice."""
        first: dict[str, Token] = {}
        for assignment in trees(body.children) if body else []:
            feature = tokens(assignment.children, "NAME")[0]
            value = trees(assignment.children)[0]
            self._declare(value, made)
            if first.setdefault(str(feature), feature) is not feature:
                note = Note("the first value is here", self.parsed.span(first[str(feature)]))
                hint = "remove one; write several targets as a list: `[a, b]`"
                self.reports.error("duplicate-feature", f"`{feature}` is set twice", feature, hint, (note,))
            elif node is not None:
                self._tasks.append(_Task(node, feature, value, made, self._cell_of))

    def _declare(self, value: Tree[Token], made: Made) -> None:
        """Create all objects inside a value: a single object, or the objects in a list, a table or a grid."""
        match value.data:
            case "object" | "unnamed":
                self._object(value, made)
            case "list":
                for item in trees(value.children):
                    self._declare(item, made)
            case "table":
                self._table(value, made)
            case "grid":
                self._grid(value, made)

    def _table(self, tree: Tree[Token], made: Made) -> None:
        cls, *columns = tokens(tree.children)
        rows: list[tuple[int, Span]] = []
        for line in trees(tree.children, "line"):
            name = next(iter(tokens(line.children)), None)
            cells = trees(line.children)
            where = self.parsed.span(name or cells[0])
            node = self._create(str(cls), self.parsed.span(cls), name, where)
            if node is not None:
                rows.append((node, where))
            if len(cells) != len(columns):
                self._wrong_cells(line, cells, columns)
            for column, cell in zip(columns, cells, strict=False):
                self._declare(cell, made)
                if node is not None:
                    self._tasks.append(_Task(node, column, cell, made))
        made[id(tree)] = rows

    def _wrong_cells(self, line: Tree[Token], cells: Sequence[Tree[Token]], columns: Sequence[Token]) -> None:
        if self.parsed.mended(line):
            return
        where = cells[len(columns)] if len(cells) > len(columns) else line
        hint = f"the columns are {quoted(columns)}"
        self.reports.error(
            "wrong-columns",
            f"this line has {plural(len(cells), 'value')} for {plural(len(columns), 'column')}",
            where,
            hint,
        )

    # --- grids ---

    def _grid(self, tree: Tree[Token], made: Made) -> None:
        text = read_grid(self.reports, tree, self.metamodel)
        grid = _Grid(text, {})
        first = self._grids.setdefault(str(text.name), grid)
        if first is not grid:
            self._duplicate("grids", text.name, self.parsed.span(first.text.name))
        for cell in text.cells:
            if cell.entry is not None and cell.entry.cls is not None:
                self._letter(grid, cell, cell.entry)
        made[id(tree)] = [
            (grid.nodes[at], cell.where) for cell in text.cells if (at := _at(cell)) in grid.nodes
        ]

    def _letter(self, grid: _Grid, cell: Cell, entry: Entry) -> None:
        own: Made = {}
        where = entry.where if entry.where.end else cell.where
        node = self._create(entry.cls or "", where, None, cell.where)
        if node is not None:
            grid.nodes[_at(cell)] = node
            self._position(grid, cell, node)
        around, self._cell_of = self._cell_of, cell.where
        self._body(node, entry.body, own)
        self._cell_of = around

    def _position(self, grid: _Grid, cell: Cell, node: int) -> None:
        """Set the `int` attributes that hold the column and row of a grid object; report attributes of other types."""
        for kind, index in (("column", cell.column), ("row", cell.row)):
            axis = grid.text.axes.get(kind)
            feature = self._feature(node, axis.attribute) if axis else None
            if axis is None or feature is None:
                continue
            if isinstance(feature, Attribute) and feature.type is Scalar.INT and not feature.many:
                self._model.graph.set_value(node, feature, index)
            else:
                message = f"`{feature}` is not an `int`, so it cannot hold the {kind}"
                self.reports.error("wrong-type", message, axis.attribute, "name an attribute of type `int`")

    def _neighbours(self, grid: _Grid) -> None:
        for kind, (right, down) in (("column", (1, 0)), ("row", (0, 1))):
            axis = grid.text.axes.get(kind)
            if axis is None or axis.next is None:
                continue
            for (column, row), node in grid.nodes.items():
                after = grid.nodes.get((column + right, row + down))
                if after is not None:
                    self._link_next(node, axis.next, after)

    def _link_next(self, node: int, token: Token, after: int) -> None:
        feature = self._feature(node, token)
        if isinstance(feature, Attribute):
            self.reports.error(
                "wrong-type", f"`{feature}` is an attribute, not a reference", token, "name a reference"
            )
        elif feature is not None:
            self._links.fill(node, feature, [(after, self.parsed.span(token))])

    # --- features ---

    def _feature(self, node: int, token: Token) -> Feature | None:
        assert self.metamodel is not None
        cls = self._model.graph.class_of(node)
        found = self.metamodel.feature(cls, str(token))
        if found is None:
            known = self.metamodel.features(cls)
            hint = self.metamodel.left_out(cls, str(token)) or did_you_mean(token, known)
            hint = hint or (f"it has {quoted(known)}" if known else "it has no features")
            self.reports.error("unknown-feature", f"`{cls}` has no feature `{token}`", token, hint)
        return found

    def _assign(self, task: _Task) -> None:
        feature = self._feature(task.node, task.feature)
        if isinstance(feature, Attribute):
            self._set(task, feature)
        elif feature is not None:
            self._links.fill(task.node, feature, self._targets(task.value, feature, task.made), task.cell)

    def _set(self, task: _Task, attribute: Attribute) -> None:
        if task.value.data == "none":
            self._model.graph.set_value(task.node, attribute, None)
            return
        if attribute.many:
            self._model.graph.set_value(task.node, attribute, values_of(task.value, attribute, self.reports))
            return
        value = value_of(task.value, attribute, self.reports)
        if value is not None:
            self._model.graph.set_value(task.node, attribute, value)

    # --- references ---

    def _targets(self, tree: Tree[Token], reference: Reference, made: Made) -> Iterator[tuple[int, Span]]:
        match tree.data:
            case "none":
                return
            case "list":
                for item in trees(tree.children):
                    yield from self._targets(item, reference, made)
            case "object" | "unnamed" | "grid" | "table":
                yield from made.get(id(tree), ())
            case "name":
                yield from self._named(tokens(tree.children)[0])
            case "cell":
                yield from self._cell(tree)
            case _:
                message = f"`{reference}` takes objects of class `{reference.target}`, not {kind_of(tree)}"
                hint = f"name an object of class `{reference.target}`"
                self.reports.error("wrong-type", message, tree, hint)

    def _named(self, token: Token) -> Iterator[tuple[int, Span]]:
        if str(token) in self._names:
            node, _ = self._names[str(token)]
            if node is not None:
                yield node, self.parsed.span(token)
            return
        if token in self.parsed.lost:
            return
        # Comparing every unknown name with every known name would take minutes.
        self._unknown += 1
        hint = did_you_mean(token, self._names) if self._unknown <= MOST_ERRORS else None
        if token == "null":
            hint = NO_VALUE
        elif self.metamodel and str(token) in self.metamodel.classes:
            hint = f"write `{token} {{ }}` for a new object"
        elif str(token) in self._grids:
            hint = f"write `{token}[column, row]` for an object of the grid"
        elif hint is None and any(str(token) in enum.literals for enum in self._enums()):
            hint = f"write `::{token}` for a literal"
        elif hint is None and self._unknown <= MOST_ERRORS:
            hint = name_hint(token, self._names)
        self.reports.error("unknown-object", f"unknown object `{token}`", token, hint)

    def _enums(self) -> Iterable[EnumType]:
        return self.metamodel.enum_types if self.metamodel else ()

    def _cell(self, tree: Tree[Token]) -> Iterator[tuple[int, Span]]:
        name = tokens(tree.children)[0]
        if str(name) not in self._grids:
            if name not in self.parsed.lost:
                self.reports.error(
                    "unknown-object", f"unknown grid `{name}`", name, name_hint(name, self._grids)
                )
            return
        grid = self._grids[str(name)]
        column, row = (int(signed(part)) for part in trees(tree.children))
        node = grid.nodes.get((column, row))
        if node is not None:
            yield node, self.parsed.span(tree)
        elif not (0 <= column < grid.text.width and 0 <= row < grid.text.height):
            hint = f"it has {plural(grid.text.width, 'column')} and {plural(grid.text.height, 'row')}, counted from 0"
            self.reports.error("outside-grid", f"`{name}` has no column {column}, row {row}", tree, hint)
        elif not self.reports.diagnostics:
            message = f"there is no object at column {column}, row {row}"
            hint = (
                f"choose a cell whose letter stands for an object; columns and rows of `{name}` count from 0"
            )
            self.reports.error("unknown-object", message, tree, hint)


def _at(cell: Cell) -> tuple[int, int]:
    return cell.column, cell.row
