"""Packages of an image as a CycloneDX document, and read back from one.

Takes packages; gives text. Equal packages give equal text: no time, no number of its own. Pure.

Source: CycloneDX 1.6, JSON; package-url, "PURL-SPECIFICATION" and "PURL-TYPES".
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from typing import Any
from urllib.parse import quote

import msgspec

from srprov.oci.packages import KINDS, MOST, Package, System
from srprov.untrusted import mapping, mappings, parse_json, string

_ARCH, _BY, _KIND, _UNREAD = "srprov:arch", "srprov:installer", "srprov:kind", "srprov:unread"
_MOST_CHARACTERS = 64 << 20
_MOST_VALUES = 4_000_000
_NO_SYSTEM = System()


class Sbom(msgspec.Struct, frozen=True, kw_only=True):
    """What is installed in an image."""

    image: str
    """The digest of its configuration."""
    name: str
    architecture: str = ""
    system: System = _NO_SYSTEM
    packages: tuple[Package, ...] = ()
    unread: tuple[str, ...] = ()
    """What could not be read of its layers: it may have more packages."""


def text(one: Sbom) -> str:
    """Return the document."""
    about = {
        "type": "container", "bom-ref": "image", "name": one.name, "version": one.image,
        "properties": _properties({_ARCH: one.architecture}) + [{"name": _UNREAD, "value": why} for why in one.unread],
    }  # fmt: skip
    system = one.system
    components = [_component(package, system) for package in one.packages]
    if system.id:
        components.insert(0, {"type": "operating-system", "bom-ref": "system", "name": system.id,
                              **({"version": system.version} if system.version else {})})  # fmt: skip
    document = {
        "$schema": "http://cyclonedx.org/schema/bom-1.6.schema.json", "bomFormat": "CycloneDX", "specVersion": "1.6",
        "version": 1,
        "metadata": {"tools": {"components": [{"type": "application", "name": "srprov"}]},
                     "component": {key: value for key, value in about.items() if value}},
        "components": components,
    }  # fmt: skip
    return json.dumps(document, indent=1, ensure_ascii=False) + "\n"


def _properties(values: Mapping[str, str]) -> list[dict[str, str]]:
    return [{"name": key, "value": value} for key, value in values.items() if value]


def _component(one: Package, system: System) -> dict[str, Any]:
    more = _properties({_KIND: one.kind, _ARCH: one.arch, _BY: one.by})
    ref = "/".join(filter(None, (one.kind, one.name, one.version, one.arch, one.by)))
    return {
        "type": "library", "bom-ref": ref, "name": one.name, "version": one.version, "purl": purl(one, system),
        "properties": more,
    }  # fmt: skip


def purl(one: Package, system: System) -> str:
    """Return the address of a package, as all lists of packages name it."""
    name = one.name.lower().replace("_", "-") if one.kind == "pypi" else one.name
    if one.kind in ("deb", "apk") and system.id:
        name = f"{system.id}/{name}"
    kind = "generic" if one.kind == "ros" else one.kind
    name = f"ros/{name}" if one.kind == "ros" else name
    path = "/".join(quote(part, safe=":") for part in name.split("/"))
    words = [f"arch={quote(one.arch, safe=':')}"] * bool(one.arch)
    if one.kind in ("deb", "apk") and system.id and system.version:
        words.append(f"distro={quote(f'{system.id}-{system.version}', safe=':')}")
    return f"pkg:{kind}/{path}@{quote(one.version, safe=':')}" + (f"?{'&'.join(words)}" if words else "")


def read(source: str) -> Sbom:
    """Read a document that srprov wrote.

    Raises:
        ValueError: It is none.
    """
    document = mapping(parse_json(source, max_characters=_MOST_CHARACTERS, max_values=_MOST_VALUES))
    about = mapping(mapping(document.get("metadata")).get("component"))
    components = mappings(document.get("components"), most=MOST + 1)
    if document.get("bomFormat") != "CycloneDX" or not string(about.get("version")):
        raise ValueError("it is no CycloneDX document of an image")
    named = next((one for one in components if one.get("type") == "operating-system"), {})
    unread = [string(one.get("value")) for one in mappings(about.get("properties")) if one.get("name") == _UNREAD]
    return Sbom(
        image=string(about.get("version")),
        name=string(about.get("name")),
        architecture=_property(about, _ARCH),
        system=System(string(named.get("name")), string(named.get("version"))),
        packages=tuple(sorted(map(_package, (one for one in components if one.get("type") == "library")))),
        unread=tuple(unread),
    )


def _package(one: Mapping[str, Any]) -> Package:
    kind = _property(one, _KIND)
    if kind not in KINDS:
        raise ValueError(f"it has a package of no kind: {string(one.get('name'))[:80]!r}")
    return Package(
        kind, string(one.get("name")), string(one.get("version")), _property(one, _ARCH), _property(one, _BY)
    )


def _property(one: Mapping[str, Any], name: str) -> str:
    found = (
        string(each.get("value")) for each in mappings(one.get("properties"), most=100) if each.get("name") == name
    )
    return next(found, "")
