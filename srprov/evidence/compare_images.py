"""The images of two runs, and the packages that differ in them. Takes runs; gives lines.

Packages are known of images that a bundle holds, by their lists; else as far as a lock recorded what a build ended
with beyond its base.
"""

from __future__ import annotations

import shlex
from collections.abc import Iterator, Mapping

import msgspec

from srprov.codes import Code
from srprov.errors import UsageError
from srprov.evidence.checks_images import locked
from srprov.evidence.compare_runs import Run
from srprov.evidence.files import NotThere, content
from srprov.evidence.grades import DIFFERENT, EQUIVALENT, IDENTICAL, UNKNOWN, Line
from srprov.evidence.images import sbom_name, stored
from srprov.image_reference import BUILT, BUNDLED
from srprov.oci import sbom
from srprov.untrusted import mapping

_MOST_SHOWN = 8
_MOST_SBOM = 64 << 20
_LINKS = {"apt": "=", "pip": "==", "npm": "@"}
_KINDS = {"deb": "apt", "pypi": "pip"}

Packages = Mapping[tuple[str, str], frozenset[str]]
"""Kind and name -> versions."""


class _Of(msgspec.Struct, frozen=True):
    """What is known of the image of a service."""

    name: str
    id: str
    """The digest of its configuration where that is known, else as its engine named it."""
    packages: Packages | None
    by_manifest: bool = False
    """The id is that of a manifest, as an engine with containerd's store names images."""
    whole: bool = False
    """All packages are known, not only those beyond its base."""


def images(a: Run, b: Run) -> Iterator[Line]:
    """Compare the image of each service, by its id, which is a hash of its content and configuration."""
    here, there = _images(a), _images(b)
    for service in sorted(here.keys() | there.keys()):
        one, other = here.get(service), there.get(service)
        if one is None or other is None:
            yield Line(service, DIFFERENT, f"only in {(b if one is None else a).name}")
        elif not (one.id and other.id):
            same = "of the same name" if one.name == other.name else f"{one.name}, and {other.name}"
            yield Line(service, UNKNOWN, f"{same}; its id is not recorded")
        elif one.id == other.id:
            yield Line(service, IDENTICAL, one.name)
        elif one.by_manifest != other.by_manifest:
            text = f"{one.name}, and {other.name}: ids of a containerd store and of another one do not compare"
            yield Line(service, UNKNOWN, f"{text}; a bundle with images tells both")
        else:
            yield _compared(service, one, other)


def _images(run: Run) -> dict[str, _Of]:
    """Return what is known of each service's image.

    Raises:
        UsageError: A list of packages, or the images of a bundle, cannot be read.
    """
    try:
        return dict(_known(run))
    except NotThere as error:
        raise UsageError(
            f"{run.name} cannot be compared: {error}",
            hint=f"srprov verify {shlex.quote(run.name)}",
            code=Code.NOT_COMPARABLE,
        ) from error


def _known(run: Run) -> Iterator[tuple[str, _Of]]:
    by_id = {id_: one for one in stored(run.files) for id_ in one.engine_ids}
    recorded = _recorded(run)
    for service, (name, id_) in run.images.items():
        if id_ in by_id:
            found = by_id[id_]
            yield service, _Of(name, found.id, _listed(run, found.id), whole=True)
        else:
            digits = name.removeprefix(BUNDLED) if name.startswith(BUNDLED) else ""
            manifest = not digits and _names_by_manifest(run, service)
            yield service, _Of(name, f"sha256:{digits}" if digits else id_, recorded.get(name), manifest)


def _names_by_manifest(run: Run, service: str) -> bool:
    facts = mapping(run.robots.get(run.story.last.assignment.get(service, "")))
    return mapping(facts.get("docker")).get("storage_driver") == "overlayfs"  # the classic driver is overlay2


def _listed(run: Run, image: str) -> Packages:
    try:
        found = sbom.read(content(run.files, sbom_name(image), _MOST_SBOM).decode("utf-8", "replace"))
    except NotThere:
        raise
    except ValueError as error:
        raise NotThere(f"{sbom_name(image)}: {error}") from None
    made: dict[tuple[str, str], set[str]] = {}
    for one in found.packages:
        made.setdefault((_KINDS.get(one.kind, one.kind), one.name), set()).add(one.version)
    return {key: frozenset(versions) for key, versions in made.items()}


def _recorded(run: Run) -> dict[str, Packages]:
    """Return content tag -> what the lock of the last session says of its packages."""
    found: dict[str, dict[tuple[str, str], frozenset[str]]] = {}
    for record in locked(run.story.definitions.experiment.file).packages:
        for kind, names in (("apt", record.apt), ("pip", record.pip), ("npm", record.npm)):
            for one in names:
                name, _, version = one.rpartition(_LINKS[kind])
                found.setdefault(record.image, {})[(kind, name)] = frozenset({version})
    return dict(found)


def _compared(service: str, one: _Of, other: _Of) -> Line:
    text = f"{one.name} {_short(one.id)}, and {other.name} {_short(other.id)}"
    if one.packages is None or other.packages is None or one.whole != other.whole:
        return Line(service, DIFFERENT, f"{text}; their packages are not recorded on both sides")
    told = [*_differences(one.packages, other.packages)]
    more = f"; and {len(told) - _MOST_SHOWN} more" if len(told) > _MOST_SHOWN else ""
    if told:
        count = f"{len(told)} package{'s' * (len(told) > 1)} differ{'s' * (len(told) == 1)}"
        return Line(service, DIFFERENT, f"{text}; {count}: {'; '.join(told[:_MOST_SHOWN])}{more}")
    if one.name == other.name and one.name.startswith(BUILT) and one.whole:
        return Line(service, EQUIVALENT, f"{text}: built of the same, with the same packages")
    beyond = "" if one.whole else " beyond their bases"
    return Line(service, DIFFERENT, f"{text}: the same packages{beyond}")


def _differences(a: Packages, b: Packages) -> Iterator[str]:
    """Return each package that differs, with both versions."""
    for kind, name in sorted(a.keys() | b.keys()):
        was, now = a.get((kind, name)), b.get((kind, name))
        if was != now:
            yield f"{name} ({kind}) {_versions(was)}, and {_versions(now)}"


def _versions(some: frozenset[str] | None) -> str:
    return " and ".join(sorted(some)[:3]) if some else "not there"


def _short(text: str) -> str:
    return text.removeprefix("sha256:")[:12]
