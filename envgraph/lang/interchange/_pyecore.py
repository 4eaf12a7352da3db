"""Convert metamodels and models from and to pyecore, for programs that use both libraries.

The data is converted as XML text in memory, so that it is checked like files. Only this module needs pyecore, which is
installed with the extra `emf`.
"""

from __future__ import annotations

import io
import logging
import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from types import ModuleType
from typing import Any
from urllib.parse import quote

from envgraph.errors import SHOWN, Diagnostic, InvalidArgument, LoadError, Source, sort_diagnostics
from envgraph.graph import Model, model_to_xmi
from envgraph.lang.interchange._ecore_document import EcoreDocument, ecore_metamodel_document
from envgraph.lang.interchange._ecore_reader import read_ecore
from envgraph.lang.interchange._xmi_reader import read_xmi
from envgraph.lang.read._ecore_types import ECORE, XML_TYPES
from envgraph.metamodel import Metamodel, metamodel_to_ecore

_ROOT_INDEX = re.compile(r"#/(\d+)/")
"""Matches pyecore's path prefix of parts in one of several roots."""


def metamodel_from_pyecore(package: Any, *others: Any) -> Metamodel:
    """Return the metamodel of a `pyecore.ecore.EPackage`, its subpackages, and all packages that they refer to.

    The logger `envgraph` warns about features that are left out; `Metamodel.left_out` returns the reasons.

    Args:
        package: the metamodel's own package, or the module that pyecore generated for it. The package of Ecore
            (`pyecore.ecore.eClass`) stands for the classes of Ecore.
        *others: further packages to include, which no other package refers to.

    Raises:
        LoadError: parts cannot be represented; positions are those in the packages' `.ecore` text.
        InvalidArgument: an argument is not a package, or pyecore is not installed.
    """
    ecore = _import_module("pyecore.ecore")
    given = (package, *others)
    packages = [getattr(one, "eClass", one) if isinstance(one, ModuleType) else one for one in given]
    for one in packages:
        if not isinstance(one, ecore.EPackage):
            raise InvalidArgument(f"each package must be an EPackage of pyecore, not {one!r}")
    roots = _with_referenced_packages(packages, ecore)
    own_packages = [one for one in roots if one.nsURI != ECORE]
    documents = [EcoreDocument(source) for source in _ecore_sources(own_packages, ecore)] if own_packages else []
    if len(own_packages) < len(roots):
        documents.insert(0 if roots[0].nsURI == ECORE else len(documents), ecore_metamodel_document())
    found = read_ecore(documents)
    if found.metamodel is None:
        raise LoadError(sort_diagnostics(found.diagnostics))
    _log_losses(one for one in found.diagnostics if one.code == "left-out")
    return found.metamodel


def _log_losses(losses: Iterable[Diagnostic]) -> None:
    """Log one warning with the messages of the first five losses and the number of the rest; if none, log nothing."""
    said = [one.message for one in losses]
    if said:
        more = f", and {len(said) - SHOWN.names} more" if len(said) > SHOWN.names else ""
        logging.getLogger("envgraph").warning("%s", "; ".join(said[: SHOWN.names]) + more)


def metamodel_to_pyecore(metamodel: Metamodel) -> Any:
    """Return a `pyecore.ecore.EPackage` with the classes and enums of a metamodel.

    Raises:
        InvalidArgument: pyecore is not installed.
    """
    (package,) = _read_contents("metamodel.ecore", metamodel_to_ecore(metamodel), ())
    return package


def model_from_pyecore(*roots: Any, metamodel: Metamodel) -> Model:
    """Return the model that consists of pyecore objects and all objects that they contain.

    Args:
        *roots: the objects without a container.
        metamodel: the metamodel of their package, made by `metamodel_from_pyecore`.

    Raises:
        LoadError: the metamodel does not allow the objects; positions are those in their `.xmi` text.
        InvalidArgument: no objects are given, or pyecore is not installed.
    """
    _import_module("pyecore.ecore")
    if not roots:
        raise InvalidArgument("no objects are given, but a model needs at least one")
    found = read_xmi(Source("model.xmi", _pyecore_text(list(roots))), metamodel)
    model = found.models[0].model
    if model is None:
        raise LoadError(sort_diagnostics(found.diagnostics))
    _log_losses(one for one in found.diagnostics if one.code == "values-left-out")
    return model


def model_to_pyecore(model: Model, package: Any = None) -> list[Any]:
    """Return the pyecore objects of a model that have no container; they contain all others.

    Args:
        model: the model.
        package: an `EPackage` with the model's classes; None to make one from its metamodel.

    Raises:
        InvalidArgument: a string contains a character that XML does not allow, or pyecore is not installed.
    """
    _import_module("pyecore.ecore")
    if package is None:
        package = metamodel_to_pyecore(model.metamodel)
    packages = _with_referenced_packages([package], _import_module("pyecore.ecore"))
    return _read_contents("model.xmi", model_to_xmi(model), [one for root in packages for one in _all_packages(root)])


def _import_module(name: str) -> Any:
    from importlib import import_module

    try:
        return import_module(name)
    except ImportError as error:
        message = "this needs pyecore, which is not installed: pip install 'envgraph[emf]'"
        raise InvalidArgument(message) from error


def _memory_resource(name: str, text: str = "") -> Any:
    """Return a pyecore resource in memory that reads `text`; the attribute `written` receives what is written to it."""
    base = _import_module("pyecore.resources.resource").URI

    class Memory(base):  # type: ignore[misc, valid-type]  # pyecore has no type hints
        written = io.BytesIO()

        def create_instream(self) -> io.BytesIO:
            return io.BytesIO(text.encode())

        def create_outstream(self) -> io.BytesIO:
            return self.written

        def close_stream(self) -> None:
            return

    return Memory(name)


def _read_contents(name: str, text: str, packages: Any) -> list[Any]:
    resources = _import_module("pyecore.resources").ResourceSet()
    for package in packages:
        resources.metamodel_registry[package.nsURI] = package
    return list(resources.get_resource(_memory_resource(name, text)).contents)


def _pyecore_text(roots: list[Any]) -> str:
    """Return the XMI text that pyecore writes for objects; afterwards they are in their own resources again."""
    target = _memory_resource("objects.xmi")
    resource = _import_module("pyecore.resources.xmi").XMIResource(target)
    homes = [root._eresource for root in roots]
    resource.contents = roots
    try:
        for root in roots:
            root._eresource = resource
        resource.save(output=target)
    finally:
        for root, home in zip(roots, homes, strict=True):
            root._eresource = home
    return str(target.written.getvalue(), "utf-8")


def _all_packages(package: Any) -> Iterator[Any]:
    yield package
    for inner in package.eSubpackages:
        yield from _all_packages(inner)


def _with_referenced_packages(packages: Sequence[Any], ecore: Any) -> list[Any]:
    """Return the outermost packages of these packages and of all that they refer to, without libraries not given."""
    found: list[Any] = []
    asked = [_outermost(package) for package in packages]
    open_ = list(asked)
    while open_:
        root = open_.pop(0)
        known = root.nsURI in (ECORE, XML_TYPES)
        if root in found or (known and root not in asked):
            continue
        found.append(root)
        if not known:
            open_.extend(
                _outermost(other) for inner in _all_packages(root) for other in _referenced_packages(inner, ecore)
            )
    return found


def _referenced_packages(package: Any, ecore: Any) -> Iterator[Any]:
    for classifier in package.eClassifiers:
        if isinstance(classifier, ecore.EClass):
            types = [feature.eType for feature in classifier.eStructuralFeatures]
            for type_ in (*classifier.eSuperTypes, *types):
                if type_ is not None and type_.ePackage is not None:
                    yield type_.ePackage


def _outermost(package: Any) -> Any:
    while package.eSuperPackage is not None:
        package = package.eSuperPackage
    return package


def _ecore_sources(packages: Sequence[Any], ecore: Any) -> Iterator[Source]:
    """Yield the texts of packages as `.ecore` files that refer to each other by file name."""
    etree = _import_module("lxml.etree")  # lxml is installed with pyecore, which writes with it
    tree = etree.fromstring(_pyecore_text(list(packages)).encode())
    elements = [tree] if len(packages) == 1 else list(tree)
    names: list[str] = []
    for package in packages:
        name = package.name or "package"
        names.append(name if name not in names else f"{name}-{len(names)}")
    for name, element, package in zip(names, elements, packages, strict=True):
        files = [("" if other == name else f"{quote(other)}.ecore") for other in names]
        _use_file_names_in_references(element, files)
        _add_opposites(element, package, ecore, dict(zip(packages, files, strict=True)))
        yield Source(f"{name}.ecore", str(etree.tostring(element, encoding="unicode")))


def _use_file_names_in_references(tree: Any, files: Sequence[str]) -> None:
    """Replace references such as `#/1/A` in an XML tree by `b.ecore#//A`, with the name of file 1 from `files`."""
    for part in tree.iter():
        for attribute in ("eType", "eSuperTypes"):
            if attribute in part.attrib:
                text = part.attrib[attribute]
                part.attrib[attribute] = _ROOT_INDEX.sub(lambda found: f"{files[int(found[1])]}#//", text)


def _add_opposites(element: Any, package: Any, ecore: Any, files: Mapping[Any, str]) -> None:
    """Add the `eOpposite` attributes to the XML of a package, because pyecore 0.15 omits them."""
    for tag, classifier in zip(element.findall("eClassifiers"), package.eClassifiers, strict=True):
        if isinstance(classifier, ecore.EClass):
            features = zip(tag.findall("eStructuralFeatures"), classifier.eStructuralFeatures, strict=True)
            for inner, feature in features:
                if isinstance(feature, ecore.EReference) and feature.eOpposite is not None:
                    inner.set("eOpposite", _feature_path(feature.eOpposite, files))
    for tag, inside in zip(element.findall("eSubpackages"), package.eSubpackages, strict=True):
        _add_opposites(tag, inside, ecore, files)


def _feature_path(feature: Any, files: Mapping[Any, str]) -> str:
    """Return the path of a feature: the file, then `#//Class/feature` with the packages around the class."""
    steps = [feature.name, feature.eContainingClass.name]
    package = feature.eContainingClass.ePackage
    while package.eSuperPackage is not None:
        steps.append(package.name)
        package = package.eSuperPackage
    return f"{files[package]}#//{'/'.join(reversed(steps))}"
