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
    MAX_ERRORS,
    Diagnostic,
    Note,
    Span,
    count_with_noun,
    did_you_mean,
    has_errors,
    name_hint,
    quote_names,
)
from envgraph.graph import Model
from envgraph.lang.read._grid import GridCell, GridText, LegendEntry, parse_grid
from envgraph.lang.read._imports import Import
from envgraph.lang.read._model_values import (
    NO_VALUE,
    ModelReading,
    describe_value,
    parse_attribute_value,
    parse_attribute_values,
)
from envgraph.lang.read._object_features import LinkBuilder, check_concrete
from envgraph.lang.syntax._parser import ParseResult, select_tokens, select_trees, signed_number_of
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


def parse_imports(parsed: ParseResult) -> tuple[Import, ...]:
    """Return the imports of a parsed `.model` file."""
    found = select_trees(parsed.tree.children, "import") if parsed.tree else []
    paths = [select_tokens(tree.children)[0] for tree in found]
    return tuple(Import(str(path), parsed.span(path)) for path in paths)


def read_models(parsed: ParseResult, metamodel: Metamodel | None) -> ModelFile:
    """Return the models of a parsed file, with all diagnostics; syntax errors are included.

    Args:
        parsed: the file.
        metamodel: the metamodel of its objects. With None, few checks are made, and `ModelText.model` is None.
    """
    diagnostics = list(parsed.diagnostics)
    models: dict[str, ModelText] = {}
    for tree in select_trees(parsed.tree.children, "model") if parsed.tree else []:
        reader = _ModelReader(parsed, metamodel, ModelReading(parsed))
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
            Diagnostic("missing-model", "the file defines no model", parsed.source.span_between(0, 0), hint)
        )
    return ModelFile(tuple(models.values()), tuple(diagnostics))


CreatedObjects = dict[int, list[tuple[int, Span]]]
"""The objects created for a tree, by the tree's `id()`; a tree of a legend creates objects for each letter."""


@dataclass(frozen=True, slots=True)
class _FeatureTask:
    """A feature to set after all objects are created; `cell` is the grid letter whose legend sets the feature."""

    node: int
    feature: Token
    value: Tree[Token]
    made: CreatedObjects
    cell: Span | None = None


@dataclass(slots=True)
class _GridObjects:
    text: GridText
    nodes: dict[tuple[int, int], int]


@dataclass(slots=True)
class _ModelReader:
    """A reader of one model.

    `_names` maps names to object ids, or to None if the class is invalid. `_current_letter` is the span of the grid
    letter being read.
    """

    parsed: ParseResult
    metamodel: Metamodel | None
    reports: ModelReading
    spans: dict[int, Span] = field(default_factory=dict)
    _model: Model = field(init=False)
    _links: LinkBuilder = field(init=False)
    _names: dict[str, tuple[int | None, Span]] = field(default_factory=dict)
    _unknown: int = 0
    _current_letter: Span | None = None
    _grids: dict[str, _GridObjects] = field(default_factory=dict)
    _tasks: list[_FeatureTask] = field(default_factory=list)

    def read(self, tree: Tree[Token]) -> ModelText:
        name, metamodel = select_tokens(tree.children)
        self._model = Model(self.metamodel or Metamodel(str(metamodel), ()), str(name))
        self._links = LinkBuilder(self._model, self.reports.error, self.spans, repeated=True)
        if self.metamodel and metamodel != self.metamodel.name:
            hint = did_you_mean(metamodel, [self.metamodel.name]) or f"the metamodel is `{self.metamodel.name}`"
            self.reports.error("unknown-metamodel", f"unknown metamodel `{metamodel}`", metamodel, hint)
        with self._model.loading():
            self._fill_model(tree)
        complete = self.metamodel and not has_errors([*self.parsed.diagnostics, *self.reports.diagnostics])
        return ModelText(
            str(name), self.parsed.span(name), str(metamodel), self._model if complete else None, self.spans
        )

    def _fill_model(self, tree: Tree[Token]) -> None:
        top: CreatedObjects = {}
        for entry in select_trees(tree.children, "entry"):
            self._create_object(entry, top)
        if self.metamodel:
            for grid in self._grids.values():
                self._link_neighbours(grid)
                for (column, row), node in grid.nodes.items():
                    self._model.graph.grid_positions[f"{grid.text.name}[{column},{row}]"] = node
            for task in self._tasks:
                self._assign(task)

    # --- objects ---

    def _create_object(self, tree: Tree[Token], made: CreatedObjects) -> None:
        """Create and record in `made` the object of an `entry`, `object` or `unnamed` tree, with all nested objects."""
        *name, cls = select_tokens(tree.children)
        where = self.parsed.span(name[0] if name else cls)
        node = self._new_node(str(cls), self.parsed.span(cls), name[0] if name else None, where)
        if node is not None:
            made[id(tree)] = [(node, where)]
        self._read_body(node, next(iter(select_trees(tree.children, "body")), None), made)

    def _new_node(self, cls: str, cls_span: Span, name: Token | None, where: Span) -> int | None:
        known = self._check_instantiable(cls, cls_span)
        if name is not None and not self._check_free_name(name):
            name = None
        node = self._model.graph.new(cls, str(name) if name else None) if known else None
        if name is not None:
            self._names[str(name)] = (node, self.parsed.span(name))
        if node is not None:
            self.spans[node] = self._current_letter or where
        return node

    def _check_instantiable(self, cls: str, span: Span) -> bool:
        metamodel = self.metamodel
        if metamodel is None:
            return False
        if cls not in metamodel.classes:
            hint = name_hint(cls, metamodel.classes)
            if metamodel.full_names(cls):
                hint = "use an `.xmi` or JSON file for its objects: several packages have a class of this name"
            self.reports.error("unknown-class", f"unknown class `{cls}`", span, hint)
            return False
        return check_concrete(metamodel, cls, cls, self.reports.error, span)

    def _check_free_name(self, name: Token) -> bool:
        if str(name) not in self._names:
            return True
        self._report_duplicate("objects", name, self._names[str(name)][1])
        return False

    def _report_duplicate(self, what: str, name: Token, first: Span) -> None:
        notes = (Note("the first one is here", first),)
        message, hint = f"there are two {what} `{name}`", "choose another name for one"
        self.reports.error("duplicate-object", message, name, hint, notes)

    def _read_body(self, node: int | None, body: Tree[Token] | None, made: CreatedObjects) -> None:
        """Create the objects nested in an object; add a task for each feature; report features that are set twice."""
        first: dict[str, Token] = {}
        for assignment in select_trees(body.children) if body else []:
            feature = select_tokens(assignment.children, "NAME")[0]
            value = select_trees(assignment.children)[0]
            self._create_nested(value, made)
            if first.setdefault(str(feature), feature) is not feature:
                note = Note("the first value is here", self.parsed.span(first[str(feature)]))
                hint = "remove one; write several targets as a list: `[a, b]`"
                self.reports.error("duplicate-feature", f"`{feature}` is set twice", feature, hint, (note,))
            elif node is not None:
                self._tasks.append(_FeatureTask(node, feature, value, made, self._current_letter))

    def _create_nested(self, value: Tree[Token], made: CreatedObjects) -> None:
        """Create all objects inside a value: a single object, or the objects in a list, a table or a grid."""
        match value.data:
            case "object" | "unnamed":
                self._create_object(value, made)
            case "list":
                for item in select_trees(value.children):
                    self._create_nested(item, made)
            case "table":
                self._create_table(value, made)
            case "grid":
                self._create_grid(value, made)

    def _create_table(self, tree: Tree[Token], made: CreatedObjects) -> None:
        cls, *columns = select_tokens(tree.children)
        rows: list[tuple[int, Span]] = []
        for line in select_trees(tree.children, "line"):
            name = next(iter(select_tokens(line.children)), None)
            cells = select_trees(line.children)
            where = self.parsed.span(name or cells[0])
            node = self._new_node(str(cls), self.parsed.span(cls), name, where)
            if node is not None:
                rows.append((node, where))
            if len(cells) != len(columns):
                self._report_wrong_cells(line, cells, columns)
            for column, cell in zip(columns, cells, strict=False):
                self._create_nested(cell, made)
                if node is not None:
                    self._tasks.append(_FeatureTask(node, column, cell, made))
        made[id(tree)] = rows

    def _report_wrong_cells(self, line: Tree[Token], cells: Sequence[Tree[Token]], columns: Sequence[Token]) -> None:
        if self.parsed.has_mistake(line):
            return
        where = cells[len(columns)] if len(cells) > len(columns) else line
        hint = f"the columns are {quote_names(columns)}"
        self.reports.error(
            "wrong-columns",
            f"this line has {count_with_noun(len(cells), 'value')} for {count_with_noun(len(columns), 'column')}",
            where,
            hint,
        )

    # --- grids ---

    def _create_grid(self, tree: Tree[Token], made: CreatedObjects) -> None:
        text = parse_grid(self.reports, tree, self.metamodel)
        grid = _GridObjects(text, {})
        first = self._grids.setdefault(str(text.name), grid)
        if first is not grid:
            self._report_duplicate("grids", text.name, self.parsed.span(first.text.name))
        for cell in text.cells:
            if cell.entry is not None and cell.entry.cls is not None:
                self._create_letter_object(grid, cell, cell.entry)
        made[id(tree)] = [
            (grid.nodes[at], cell.where) for cell in text.cells if (at := _cell_position(cell)) in grid.nodes
        ]

    def _create_letter_object(self, grid: _GridObjects, cell: GridCell, entry: LegendEntry) -> None:
        own: CreatedObjects = {}
        where = entry.where if entry.where.end else cell.where
        node = self._new_node(entry.cls or "", where, None, cell.where)
        if node is not None:
            grid.nodes[_cell_position(cell)] = node
            self._set_position(grid, cell, node)
        around, self._current_letter = self._current_letter, cell.where
        self._read_body(node, entry.body, own)
        self._current_letter = around

    def _set_position(self, grid: _GridObjects, cell: GridCell, node: int) -> None:
        """Set the `int` attributes that hold the column and row of a grid object; report attributes of other types."""
        for kind, index in (("column", cell.column), ("row", cell.row)):
            axis = grid.text.axes.get(kind)
            feature = self._find_feature(node, axis.attribute) if axis else None
            if axis is None or feature is None:
                continue
            if isinstance(feature, Attribute) and feature.type is Scalar.INT and not feature.many:
                self._model.graph.set_value(node, feature, index)
            else:
                message = f"`{feature}` is not an `int`, so it cannot hold the {kind}"
                self.reports.error("wrong-type", message, axis.attribute, "name an attribute of type `int`")

    def _link_neighbours(self, grid: _GridObjects) -> None:
        for kind, (right, down) in (("column", (1, 0)), ("row", (0, 1))):
            axis = grid.text.axes.get(kind)
            if axis is None or axis.next_reference is None:
                continue
            for (column, row), node in grid.nodes.items():
                after = grid.nodes.get((column + right, row + down))
                if after is not None:
                    self._link_next(node, axis.next_reference, after)

    def _link_next(self, node: int, token: Token, after: int) -> None:
        feature = self._find_feature(node, token)
        if isinstance(feature, Attribute):
            self.reports.error("wrong-type", f"`{feature}` is an attribute, not a reference", token, "name a reference")
        elif feature is not None:
            self._links.link_targets(node, feature, [(after, self.parsed.span(token))])

    # --- features ---

    def _find_feature(self, node: int, token: Token) -> Feature | None:
        assert self.metamodel is not None
        cls = self._model.graph.class_of(node)
        found = self.metamodel.feature(cls, str(token))
        if found is None:
            known = self.metamodel.features(cls)
            hint = self.metamodel.left_out_reason(cls, str(token)) or did_you_mean(token, known)
            hint = hint or (f"it has {quote_names(known)}" if known else "it has no features")
            self.reports.error("unknown-feature", f"`{cls}` has no feature `{token}`", token, hint)
        return found

    def _assign(self, task: _FeatureTask) -> None:
        feature = self._find_feature(task.node, task.feature)
        if isinstance(feature, Attribute):
            self._set_value(task, feature)
        elif feature is not None:
            self._links.link_targets(
                task.node, feature, self._resolve_targets(task.value, feature, task.made), task.cell
            )

    def _set_value(self, task: _FeatureTask, attribute: Attribute) -> None:
        if task.value.data == "none":
            self._model.graph.set_value(task.node, attribute, None)
            return
        if attribute.many:
            self._model.graph.set_value(
                task.node, attribute, parse_attribute_values(task.value, attribute, self.reports)
            )
            return
        value = parse_attribute_value(task.value, attribute, self.reports)
        if value is not None:
            self._model.graph.set_value(task.node, attribute, value)

    # --- references ---

    def _resolve_targets(
        self, tree: Tree[Token], reference: Reference, made: CreatedObjects
    ) -> Iterator[tuple[int, Span]]:
        match tree.data:
            case "none":
                return
            case "list":
                for item in select_trees(tree.children):
                    yield from self._resolve_targets(item, reference, made)
            case "object" | "unnamed" | "grid" | "table":
                yield from made.get(id(tree), ())
            case "name":
                yield from self._resolve_name(select_tokens(tree.children)[0])
            case "cell":
                yield from self._resolve_cell(tree)
            case _:
                message = f"`{reference}` takes objects of class `{reference.target}`, not {describe_value(tree)}"
                hint = f"name an object of class `{reference.target}`"
                self.reports.error("wrong-type", message, tree, hint)

    def _resolve_name(self, token: Token) -> Iterator[tuple[int, Span]]:
        if str(token) in self._names:
            node, _ = self._names[str(token)]
            if node is not None:
                yield node, self.parsed.span(token)
            return
        if token in self.parsed.lost_names:
            return
        # Comparing every unknown name with every known name would take minutes.
        self._unknown += 1
        hint = did_you_mean(token, self._names) if self._unknown <= MAX_ERRORS else None
        if token == "null":
            hint = NO_VALUE
        elif self.metamodel and str(token) in self.metamodel.classes:
            hint = f"write `{token} {{ }}` for a new object"
        elif str(token) in self._grids:
            hint = f"write `{token}[column, row]` for an object of the grid"
        elif hint is None and any(str(token) in enum.literals for enum in self._enums()):
            hint = f"write `::{token}` for a literal"
        elif hint is None and self._unknown <= MAX_ERRORS:
            hint = name_hint(token, self._names)
        self.reports.error("unknown-object", f"unknown object `{token}`", token, hint)

    def _enums(self) -> Iterable[EnumType]:
        return self.metamodel.enum_types if self.metamodel else ()

    def _resolve_cell(self, tree: Tree[Token]) -> Iterator[tuple[int, Span]]:
        name = select_tokens(tree.children)[0]
        if str(name) not in self._grids:
            if name not in self.parsed.lost_names:
                self.reports.error("unknown-object", f"unknown grid `{name}`", name, name_hint(name, self._grids))
            return
        grid = self._grids[str(name)]
        column, row = (int(signed_number_of(part)) for part in select_trees(tree.children))
        node = grid.nodes.get((column, row))
        if node is not None:
            yield node, self.parsed.span(tree)
        elif not (0 <= column < grid.text.width and 0 <= row < grid.text.height):
            hint = (
                f"it has {count_with_noun(grid.text.width, 'column')} and "
                f"{count_with_noun(grid.text.height, 'row')}, counted from 0"
            )
            self.reports.error("outside-grid", f"`{name}` has no column {column}, row {row}", tree, hint)
        elif not self.reports.diagnostics:
            message = f"there is no object at column {column}, row {row}"
            hint = f"choose a cell whose letter stands for an object; columns and rows of `{name}` count from 0"
            self.reports.error("unknown-object", message, tree, hint)


def _cell_position(cell: GridCell) -> tuple[int, int]:
    return cell.column, cell.row
