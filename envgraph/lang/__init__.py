"""Parse the five languages and family files into data, and write data as text.

Most programs need only `open` and `load`. `load_workspace` raises no exception for mistakes in files, but returns all
data together with all diagnostics.
"""

from typing import TYPE_CHECKING

from envgraph.code import later

if TYPE_CHECKING:
    from envgraph.graph import JsonPath as JsonPath
    from envgraph.lang._constructors import Pattern as Pattern, Rule as Rule, Unit as Unit
    from envgraph.lang.family._family import (
        EXPRESSIONS as EXPRESSIONS,
        FamilySpec as FamilySpec,
        OptimiseSpec as OptimiseSpec,
        Strength as Strength,
    )
    from envgraph.lang.family._family_reader import find_family as find_family
    from envgraph.lang.family._options import LARGEST as LARGEST, Options as Options
    from envgraph.lang.family._section import ComponentSpec as ComponentSpec, Name as Name, key as key
    from envgraph.lang.format._format import format_text as format_text, language_of as language_of
    from envgraph.lang.interchange._json import (
        check_json as check_json,
        model_at as model_at,
        parse_json as parse_json,
        parse_model as parse_model,
    )
    from envgraph.lang.interchange._level_template import LevelTemplate as LevelTemplate
    from envgraph.lang.interchange._levels import Level as Level, read_levels as read_levels
    from envgraph.lang.interchange._pyecore import (
        metamodel_from_pyecore as metamodel_from_pyecore,
        metamodel_to_pyecore as metamodel_to_pyecore,
        model_from_pyecore as model_from_pyecore,
        model_to_pyecore as model_to_pyecore,
    )
    from envgraph.lang.interchange._trace import parse_trace as parse_trace
    from envgraph.lang.loading._checking import conformance as conformance
    from envgraph.lang.loading._family_check import (
        COMPONENTS as COMPONENTS,
        NEED_ENVIRONMENT as NEED_ENVIRONMENT,
        check_family as check_family,
        numeric_parameters as numeric_parameters,
    )
    from envgraph.lang.loading._import_check import LANGUAGES as LANGUAGES
    from envgraph.lang.loading._open import (
        load as load,
        load_workspace as load_workspace,
        open as open,
        open_workspace as open_workspace,
    )
    from envgraph.lang.loading._workspace import Workspace as Workspace
    from envgraph.lang.read._from_text import from_text as from_text
    from envgraph.lang.read._model import ModelText as ModelText
    from envgraph.lang.syntax._data import (
        bundled_domain as bundled_domain,
        bundled_domains as bundled_domains,
        data_path as data_path,
    )
    from envgraph.lang.syntax._files import (
        Bundle as Bundle,
        DiskFiles as DiskFiles,
        Files as Files,
        TextFiles as TextFiles,
        file_format as file_format,
        read_source as read_source,
    )
    from envgraph.lang.syntax._formats import FORMATS as FORMATS
    from envgraph.lang.write._model_to_text import model_to_text as model_to_text
    from envgraph.lang.write._text_derived import spelled_out as spelled_out
    from envgraph.lang.write._to_text import to_text as to_text

later(globals())
