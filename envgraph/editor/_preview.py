"""Draw the model of a document, and explain why a pattern or rule has no match in it."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from envgraph.editor._documents import JsonObject
from envgraph.editor._match_counts import copy_first_model, engine_of
from envgraph.errors import InvalidArgument
from envgraph.match import WhyNot

if TYPE_CHECKING:
    from envgraph.editor._language_service import LanguageService
    from envgraph.graph import Model
    from envgraph.lang import Workspace


def preview(service: LanguageService, params: JsonObject) -> JsonObject | None:
    """Return a picture, as `svg` and `title`; None if there is no model or metamodel to draw.

    The environment's `draw` clause says how the model is drawn. Without one, objects are boxes. A document with a model
    shows this model, at a position in it if there are several; a metamodel is drawn if there is no model.

    Raises:
        InvalidArgument: the model has errors.
    """
    name = service.name_of(params["uri"])
    result = service.checked(name)
    model = _model_at(service, result.workspace, params) or copy_first_model(result.workspace)
    if model is None and result.workspace.models:
        raise InvalidArgument("the model has errors", "correct them first")
    if model is None:
        metamodel = result.metamodel
        return {"svg": metamodel.to_svg(), "title": metamodel.name} if metamodel is not None else None
    return {"svg": model_svg(result.workspace, model), "title": model.name}


def model_svg(workspace: Workspace, model: Model) -> str:
    """Return a picture of a model of a workspace, by the `draw` clause of its first environment if there is one."""
    drawn = next((one for one in workspace.behaviours if one.draw is not None), None)
    if drawn is not None and drawn.draw is not None and not workspace.errors:
        from envgraph.env import scene_of, scene_svg

        return scene_svg(scene_of(model, drawn.draw, drawn.parameters))
    return model.picture().to_svg()


def _model_at(service: LanguageService, workspace: Workspace, params: JsonObject) -> Model | None:
    """Return the model of the document at or before a position; None if the document has no model."""
    document: Any = service.documents.get(params["uri"])
    texts = [one for one in workspace.models if document is not None and one.span.source.name == document.source.name]
    offset = document.offset(params["position"]) if texts and params.get("position") else 0
    before = [one for one in texts if one.span.start <= offset]
    found = (before[-1:] or texts[:1]) if texts else []
    return found[0].model if found else None


def why_not(service: LanguageService, params: JsonObject) -> JsonObject:
    """Return why a pattern, rule or unit has no match in the model, or its match if it has one, as `text`.

    Args:
        service: the open documents.
        params: the `name`, and the `uri` of a document with whose files it is defined; by default the first open one.

    Raises:
        InvalidArgument: there are errors, no model or no such name.
    """
    uri = params.get("uri") or next(iter(service.documents), "")
    workspace = service.checked(service.name_of(uri)).workspace
    engine = engine_of(workspace)
    if engine is None:
        reason = "the files have errors: correct them first" if workspace.errors else "there is no model"
        raise InvalidArgument(reason)
    return {"text": why_not_text(engine.why_not(str(params["name"])))}


def why_not_text(why: WhyNot) -> str:
    """Return the reasons and the lines of the failing constraints, as `envgraph why-not` prints them."""
    return "\n".join([str(why), *(f"\n{span}\n{span.excerpt()}" for span in why.failing_spans())])
