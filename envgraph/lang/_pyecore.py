"""Packages and objects of pyecore, and back, for programs that use both.

They cross as text in memory: so they are checked as files are, and pyecore is needed here alone. It comes with the
extra `emf`.
"""

from __future__ import annotations

import io
from collections.abc import Iterator
from typing import Any

from envgraph.errors import InvalidArgument, Source
from envgraph.graph import Model, model_to_xmi
from envgraph.lang._ecore import parse_ecore
from envgraph.lang._xmi import parse_xmi
from envgraph.metamodel import Metamodel, metamodel_to_ecore


def metamodel_from_pyecore(package: Any) -> Metamodel:
    """The metamodel of a `pyecore.ecore.EPackage` and the packages in it.

    Raises:
        LoadError: all that cannot be represented; positions are those of the package as an `.ecore` file.
        InvalidArgument: this is no package, or pyecore is not installed.
    """
    ecore = _module("pyecore.ecore")
    if not isinstance(package, ecore.EPackage):
        raise InvalidArgument(f"a metamodel is made from an EPackage, not from {package!r}")
    etree = _module("lxml.etree")  # which pyecore writes with
    tree = etree.fromstring(_written([package]).encode())
    _add_opposites(tree, package, ecore)
    text = str(etree.tostring(tree, encoding="unicode"))
    return parse_ecore(Source(f"{package.name}.ecore", text))


def metamodel_to_pyecore(metamodel: Metamodel) -> Any:
    """A `pyecore.ecore.EPackage` with the classes and enums of a metamodel.

    Raises:
        InvalidArgument: pyecore is not installed.
    """
    (package,) = _read("metamodel.ecore", metamodel_to_ecore(metamodel), ())
    return package


def model_from_pyecore(*roots: Any, metamodel: Metamodel) -> Model:
    """The model of objects of pyecore, with all that they contain.

    Args:
        *roots: the objects at the top.
        metamodel: of their package, as `metamodel_from_pyecore` makes it.

    Raises:
        LoadError: what the metamodel does not allow; positions are those of the objects as an `.xmi` file.
        InvalidArgument: there are no objects, or pyecore is not installed.
    """
    _module("pyecore.ecore")
    if not roots:
        raise InvalidArgument("a model is made from one object at least")
    return parse_xmi(Source("model.xmi", _written(list(roots))), metamodel)


def model_to_pyecore(model: Model, package: Any = None) -> list[Any]:
    """The objects of a model as objects of pyecore: those at the top, which contain the others.

    Args:
        model: the model.
        package: an `EPackage` with its classes; None for one made of its metamodel.

    Raises:
        InvalidArgument: a string has a character that XML does not have, or pyecore is not installed.
    """
    _module("pyecore.ecore")
    if package is None:
        package = metamodel_to_pyecore(model.metamodel)
    return _read("model.xmi", model_to_xmi(model), _packages(package))


def _module(name: str) -> Any:
    from importlib import import_module

    try:
        return import_module(name)
    except ImportError as error:
        message = "this needs pyecore, which is not installed: pip install 'envgraph[emf]'"
        raise InvalidArgument(message) from error


def _memory(name: str, text: str = "") -> Any:
    """A text that pyecore takes for a file; `written` has what it writes."""
    base = _module("pyecore.resources.resource").URI

    class Memory(base):  # type: ignore[misc, valid-type]  # pyecore has no types
        written = io.BytesIO()

        def create_instream(self) -> io.BytesIO:
            return io.BytesIO(text.encode())

        def create_outstream(self) -> io.BytesIO:
            return self.written

        def close_stream(self) -> None:
            return

    return Memory(name)


def _read(name: str, text: str, packages: Any) -> list[Any]:
    resources = _module("pyecore.resources").ResourceSet()
    for package in packages:
        resources.metamodel_registry[package.nsURI] = package
    return list(resources.get_resource(_memory(name, text)).contents)


def _written(roots: list[Any]) -> str:
    """What pyecore writes of objects; they stay in the resources where they are."""
    target = _memory("objects.xmi")
    resource = _module("pyecore.resources.xmi").XMIResource(target)
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


def _packages(package: Any) -> Iterator[Any]:
    yield package
    for inner in package.eSubpackages:
        yield from _packages(inner)


def _add_opposites(element: Any, package: Any, ecore: Any) -> None:
    """Writes the `eOpposite`s into a tree of a package: pyecore 0.15 leaves them out."""
    for tag, classifier in zip(element.findall("eClassifiers"), package.eClassifiers, strict=True):
        if isinstance(classifier, ecore.EClass):
            features = zip(tag.findall("eStructuralFeatures"), classifier.eStructuralFeatures, strict=True)
            for inner, feature in features:
                if isinstance(feature, ecore.EReference) and feature.eOpposite is not None:
                    inner.set("eOpposite", feature.eOpposite.eURIFragment())
    for tag, inside in zip(element.findall("eSubpackages"), package.eSubpackages, strict=True):
        _add_opposites(tag, inside, ecore)
