"""Check that the elements of an `.ecore` file are Ecore packages and have only the parts that Ecore defines."""

from __future__ import annotations

import re
from collections.abc import Sequence
from functools import cache

from envgraph.errors import MAX_NESTING, did_you_mean
from envgraph.lang.interchange._ecore_document import ecore_metamodel_document
from envgraph.lang.interchange._ecore_name_resolution import EcoreNameResolver, children_named
from envgraph.lang.read._ecore_types import ECORE
from envgraph.lang.syntax._xml_parser import XMI, XSI, XmlElement


@cache
def _known_parts(kind: str) -> tuple[Sequence[str], Sequence[str]]:
    """Return the XML attributes and the child tags that Ecore allows for elements of the Ecore class `kind`."""
    ecore = ecore_metamodel_document()
    classes = ecore.parts_by_name(ecore.packages[0])
    attributes: list[str] = []
    children: list[str] = []
    above = [kind]
    for name in above:
        above += re.findall(r"\w+$", classes[name].get("eSuperTypes"))
        for one in classes[name].children:
            own = one.attributes["name"]
            contained = one.attributes.get("containment") == "true"
            attributes += [] if contained else [own]
            children += [own] if one.attributes["xsi:type"] == "ecore:EReference" else []
    return attributes, children


class EcoreChecker(EcoreNameResolver):
    """A checker of one file that records the Ecore class of each element and reports parts unknown to Ecore."""

    def check_package(self) -> bool:
        """Return True if the file is XML with only Ecore packages at the top; otherwise report the problem."""
        root, problem = self.document.root, self.document.problem
        if problem or root is None:
            self.shared.diagnostics.extend([problem] if problem else [])
            self.shared.lost_names |= self.all_words()
            return False
        return self._is_package(root)

    def enter_packages(self, paths: set[str]) -> None:
        """Record and check all packages and their contents, and add their paths to `paths`.

        The first package has the path ""; all further root packages, also of later files, are nested in it.
        """
        self.document.index_elements(self._owners)
        for root in self.document.roots:
            path = root.attributes.get("name") or "package" if paths else ""
            while path in paths:
                path += "_"
            self._enter_package(path, root)
            paths |= {path for path, _ in self.packages}

    def all_words(self) -> set[str]:
        """Return all words of the text, since each may be the name of a part that could not be read."""
        return set(re.findall(r"[^\W\d]\w*", self.places.source.text))

    def _is_package(self, root: XmlElement) -> bool:
        others = [one for one in self.document.top_elements if one not in self.document.roots]
        if self.document.roots and not others:
            return True
        root = others[0] if others else root
        where = self.places.tag_span(root.byte)
        hint: str | None
        if root.name == "EPackage":
            message = "this is an `EPackage` of another language than Ecore"
            hint = f'write `xmlns:ecore="{ECORE}"` and `ecore:EPackage`'
        else:
            message = f"a metamodel must be an `ecore:EPackage`, not a `{root.tag}`"
            hint = "rename a model to end with `.xmi`" if root.namespace and root.name != "schema" else None
        self.report_error("not-ecore", message, where, hint)
        return False

    def _enter_package(self, path: str, element: XmlElement, depth: int = 0) -> None:
        self.packages.append((path, element))
        self._kinds[element] = "EPackage"
        self._check_parts(element, "EPackage")
        if depth > MAX_NESTING:
            where, hint = self.places.tag_span(element.byte), f"use at most {MAX_NESTING} levels"
            self.report_error("nested-too-deeply", "packages are nested too deeply", where, hint)
            return
        for classifier in children_named(element, "eClassifiers"):
            self._enter_classifier(classifier)
        for inner in children_named(element, "eSubpackages"):
            name = inner.get("name")
            self._enter_package(f"{path}.{name}" if path else name, inner, depth + 1)

    def _enter_classifier(self, element: XmlElement) -> None:
        kind = self._ecore_class_of(element, ("EClass", "EEnum", "EDataType"), "a classifier")
        if kind is None:
            self.shared.lost_names.add(element.get("name"))
            return
        self._kinds[element] = kind
        self._check_parts(element, kind)
        features = ("EAttribute", "EReference")
        for member in children_named(element, "eStructuralFeatures") if kind == "EClass" else ():
            found = self._ecore_class_of(member, features, "a feature")
            if found is None:
                self.shared.lost_names.add(member.get("name"))
            else:
                self._kinds[member] = found
                self._check_parts(member, found)
        for literal in children_named(element, "eLiterals") if kind == "EEnum" else ():
            self._check_parts(literal, "EEnumLiteral")

    def _ecore_class_of(self, element: XmlElement, allowed: Sequence[str], noun: str) -> str | None:
        """Return the Ecore class that an element's `xsi:type` names; report a class not in `allowed`, and return
        None.
        """
        key = element.qualified_key("type", XSI, XMI)
        if key is None:
            wrong = next((one for one in element.attributes if one.endswith(":type")), None)
            if wrong:
                where = self.places.attribute_name_span(element.byte, wrong)
                hint = f'write `xmlns:xsi="{XSI}"` in the first tag'
                message = f"the prefix `{wrong.rpartition(':')[0]}` is not declared"
                self.report_error("unknown-prefix", message, where, hint)
                return None
            hint = f'write `xsi:type="ecore:{allowed[0]}"`'
            self.report_error("missing-type", f"{noun} needs an `xsi:type`", self.places.tag_span(element.byte), hint)
            return None
        value = element.attributes[key]
        prefix, _, name = value.rpartition(":")
        if name in allowed and element.scope.get(prefix) == ECORE:
            return name
        where = self.attribute_span(element, key)
        if name in allowed:
            hint = did_you_mean(prefix, element.scope) or f'write `xmlns:{prefix}="{ECORE}"` in the first tag'
            self.report_error("unknown-prefix", f"`{prefix}` is not the prefix of Ecore's namespace", where, hint)
        else:
            hint = did_you_mean(name, allowed) or "write one of " + ", ".join(f"`ecore:{one}`" for one in allowed)
            self.report_error("unknown-type", f"{noun} cannot be `{value}`", where, hint)
        return None

    def _check_parts(self, element: XmlElement, kind: str) -> None:
        """Report XML attributes and child tags that Ecore lacks, and record those of other tools as not preserved."""
        attributes, children = _known_parts(kind)
        for key in element.attributes:
            if ":" in key and key.split(":")[0] not in ("xmlns", "xsi") and not key.endswith(":version"):
                self.record_dropped("attribute", f"`{key}` of other tools", element)
            if ":" not in key and key != "xmlns" and key not in attributes:
                where = self.places.attribute_name_span(element.byte, key)
                message = f"`{kind}` has no attribute `{key}`"
                self.report_error("unknown-attribute", message, where, did_you_mean(key, attributes))
        for child in element.children:
            if child.name == "Extension" or (kind, child.name) == ("EEnumLiteral", "eAnnotations"):
                self.record_dropped("tag", f"`{child.name}` in `{kind}`", child)
            elif child.name not in children:
                message = f"`{kind}` has no child tag `{child.name}`"
                hint = did_you_mean(child.name, children)
                self.report_error("unknown-element", message, self.places.tag_span(child.byte), hint)
