"""Text to data for the five languages and for family files, with diagnostics.

`open` and `load` are what most programs need; `load_workspace` gives everything that files say together with what is
wrong with them, without raising.
"""

from typing import TYPE_CHECKING

from envgraph.errors import later, shorten
from envgraph.lang.family._family import (
    EXPRESSIONS,
    ConstraintsSpec,
    CurriculumSpec,
    EpsilonSpec,
    FamilySpec,
    MutationSpec,
    OptimiseSpec,
    SamplesSpec,
    SearchSpec,
    Strength,
    TrainingSpec,
)
from envgraph.lang.family._family_reader import find_family
from envgraph.lang.family._options import LARGEST, Options
from envgraph.lang.family._section import ComponentSpec, Name, key
from envgraph.lang.loading._checking import conformance
from envgraph.lang.loading._family_check import (
    COMPONENTS,
    NEED_ENVIRONMENT,
    check_family,
    numeric_parameters,
)
from envgraph.lang.loading._import_check import LANGUAGES
from envgraph.lang.loading._open import load, load_workspace, open, open_workspace
from envgraph.lang.loading._workspace import Workspace
from envgraph.lang.read._model import ModelText
from envgraph.lang.syntax._data import bundled_domain, bundled_domains, data_path
from envgraph.lang.syntax._files import Bundle, DiskFiles, Files, TextFiles, file_format, read_source
from envgraph.lang.syntax._formats import FORMATS

if TYPE_CHECKING:
    from envgraph.graph import JsonPath
    from envgraph.lang._constructors import Pattern, Rule, Unit
    from envgraph.lang.format._format import format_text, language_of
    from envgraph.lang.interchange._json import check_json, model_at, parse_json, parse_model
    from envgraph.lang.interchange._level_template import LevelTemplate
    from envgraph.lang.interchange._levels import Level, LevelCell, read_levels
    from envgraph.lang.interchange._pyecore import (
        metamodel_from_pyecore,
        metamodel_to_pyecore,
        model_from_pyecore,
        model_to_pyecore,
    )
    from envgraph.lang.interchange._trace import parse_trace
    from envgraph.lang.read._from_text import from_text
    from envgraph.lang.write._model_to_text import model_to_text
    from envgraph.lang.write._text_derived import spelled_out
    from envgraph.lang.write._to_text import to_text

__all__ = [
    "COMPONENTS",
    "EXPRESSIONS",
    "FORMATS",
    "LANGUAGES",
    "LARGEST",
    "NEED_ENVIRONMENT",
    "Bundle",
    "ComponentSpec",
    "ConstraintsSpec",
    "CurriculumSpec",
    "DiskFiles",
    "EpsilonSpec",
    "FamilySpec",
    "Files",
    "JsonPath",
    "Level",
    "LevelCell",
    "LevelTemplate",
    "ModelText",
    "MutationSpec",
    "Name",
    "OptimiseSpec",
    "Options",
    "Pattern",
    "Rule",
    "SamplesSpec",
    "SearchSpec",
    "Strength",
    "TextFiles",
    "TrainingSpec",
    "Unit",
    "Workspace",
    "bundled_domain",
    "bundled_domains",
    "check_family",
    "check_json",
    "conformance",
    "data_path",
    "file_format",
    "find_family",
    "format_text",
    "from_text",
    "key",
    "language_of",
    "load",
    "load_workspace",
    "metamodel_from_pyecore",
    "metamodel_to_pyecore",
    "model_at",
    "model_from_pyecore",
    "model_to_pyecore",
    "model_to_text",
    "numeric_parameters",
    "open",
    "open_workspace",
    "parse_json",
    "parse_model",
    "parse_trace",
    "read_levels",
    "read_source",
    "spelled_out",
    "to_text",
]

later(
    globals(),
    {
        "envgraph.lang._constructors": "Pattern Rule Unit",
        "envgraph.lang.format._format": "format_text language_of",
        "envgraph.lang.interchange._json": "check_json model_at parse_json parse_model",
        "envgraph.lang.interchange._level_template": "LevelTemplate",
        "envgraph.lang.interchange._levels": "Level LevelCell read_levels",
        "envgraph.lang.interchange._pyecore": "metamodel_from_pyecore metamodel_to_pyecore "
        "model_from_pyecore model_to_pyecore",
        "envgraph.lang.interchange._trace": "parse_trace",
        "envgraph.lang.read._from_text": "from_text",
        "envgraph.lang.write._model_to_text": "model_to_text",
        "envgraph.lang.write._text_derived": "spelled_out",
        "envgraph.lang.write._to_text": "to_text",
        "envgraph.graph": "JsonPath",
    },
)
shorten(globals(), __all__)
