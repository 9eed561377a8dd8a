"""Documents of the kind that is wanted: an EDF, a CDF or an inventory. A file of another kind is refused by its name.

Takes a path, or a document; gives the document, or one problem in the place of all those that a file of another kind
would have: which kind it is, and what to do with it. Touches the file for reading.
"""

from __future__ import annotations

import os
import re
from collections.abc import Collection

from srprov.codes import Code
from srprov.errors import DefinitionError, Diagnostic, Location
from srprov.yamldoc import loader
from srprov.yamldoc.nodes import Map, Node, Scalar, Seq

WORDS = {"edf": "an EDF", "cdf": "a CDF", "inventory": "an inventory"}

_OURS = frozenset(
    {"relations", "pools", "weights", "placement", "network", "parameters", "trials", "results", "metrics", "playbooks"}
)
"""Keys of an EDF that Compose does not have."""
_OUR_SERVICES = frozenset({"cdf", "cost", "requires", "robot", "per_robot"})
_COMPOSE = frozenset({"version", "networks", "configs", "include", "models"})
"""Keys of a Compose file that an EDF does not have."""
_COMPOSE_SERVICES = frozenset(
    {"build", "container_name", "networks", "network_mode", "links", "external_links", "deploy", "extends", "configs"}
    | {"volumes_from", "dns", "mac_address", "develop", "attach", "annotations", "platform", "models", "scale"}
)
_COMPOSE_NAME = re.compile(r"(?:docker-)?compose(?:[.-].*)?\.ya?ml", re.IGNORECASE)
_SWARMROB = frozenset({"image", "environment", "depends_on", "devices", "volumes", "deploy"})
_PLAY = frozenset({"tasks", "roles", "pre_tasks", "post_tasks", "handlers", "gather_facts", "become"})
_IMPORTED = frozenset({"import_playbook", "ansible.builtin.import_playbook"})
_GROUP = frozenset({"hosts", "children", "vars"})

_KUBERNETES = (re.compile(r"^apiVersion:", re.MULTILINE), re.compile(r"^kind:", re.MULTILINE))
_INI_GROUP = re.compile(r"\[[A-Za-z0-9_.-]+(?::(?:vars|children))?\]\s*(?:[#;].*)?")
_MOST_LETTERS = 100_000
"""Of a text that is no YAML; what kind it is shows before."""

_HINTS = {
    "a Compose file": "`srprov import compose FILE -o DIR` makes an experiment of it",
    "a Compose file or a definition of SwarmRob": "`srprov import compose FILE -o DIR` makes an experiment of it; of "
    "one of SwarmRob's, `srprov import swarmrob`",
    "a file of Kubernetes": "srprov does not import it: write each container as a service of an EDF",
    "a playbook of Ansible": "its tasks become CDFs and an EDF, as docs/from-ansible.md shows",
    "an inventory": "name it with -i",
    "a CDF": "a service of an EDF names it: services: {NAME: {cdf: FILE}}",
    "an EDF": "name it as the FILE, and the robots with -i",
}


def read(path: str, wanted: str, shown: str = "") -> Node | None:
    """Read a document that should be an `edf`, a `cdf` or an `inventory`; None when it is empty.

    Raises:
        DefinitionError: It cannot be read, or is of another kind.
    """
    try:
        root = loader.read(path, shown)
    except DefinitionError as error:
        if error.problems[0].code is Code.YAML and (kind := _kind_of_text(path, shown)):
            raise _mistaken(kind, wanted, Location(shown or path)) from None
        raise
    check(root, wanted, path)
    return root


def check(root: Node | None, wanted: str, path: str) -> None:
    """Raise DefinitionError with one problem when a document is surely of another kind than is wanted."""
    kind = _kind(root, os.path.basename(path)) if root is not None else ""
    if root is not None and kind and kind != WORDS[wanted]:
        raise _mistaken(kind, wanted, Location(root.source.file, root.line, root.column))


def _mistaken(kind: str, wanted: str, place: Location) -> DefinitionError:
    message = f"this is {kind}, not {WORDS[wanted]}"
    return DefinitionError([Diagnostic(place, message, hint=_HINTS[kind], code=Code.WRONG_KIND)])


def _kind(root: Node, name: str) -> str:
    """Return what a document surely is, or nothing."""
    if isinstance(root, Seq):
        if any(isinstance(item, Map) and _is_play(item.entries.keys()) for item in root.items):
            return "a playbook of Ansible"
        words = all(isinstance(item, Scalar) for item in root.items)
        return "an inventory" if words and _begins_as_ini(root.source.text) else ""
    if not isinstance(root, Map):
        return ""
    keys = root.entries.keys()
    for key in ("edf", "cdf"):
        if isinstance(root.entries.get(key), Scalar):
            return WORDS[key]
    if _is_inventory(root):
        return "an inventory"
    if {"apiVersion", "kind"} <= keys:
        return "a file of Kubernetes"
    services = root.entries.get("services")
    return _with_services(root, services, name) if isinstance(services, Map) else ""


def _is_play(keys: Collection[str]) -> bool:
    return ("hosts" in keys and any(key in _PLAY for key in keys)) or any(key in _IMPORTED for key in keys)


def _with_services(root: Map, services: Map, name: str) -> str:
    inside = {key for one in services.entries.values() if isinstance(one, Map) for key in one.entries}
    if root.entries.keys() & _OURS or inside & _OUR_SERVICES:
        return "an EDF"
    if not (root.entries.keys() & _COMPOSE or inside & _COMPOSE_SERVICES or _COMPOSE_NAME.fullmatch(name)):
        return ""
    swarmrob = "version" in root.entries and inside <= _SWARMROB
    return "a Compose file or a definition of SwarmRob" if swarmrob else "a Compose file"


def _is_inventory(root: Map) -> bool:
    """Return whether every key holds a group; a file of one word could be anything."""
    groups = [one for one in root.entries.values() if isinstance(one, Map) and one.entries.keys() & _GROUP]
    return bool(groups) and all(
        one in groups or (isinstance(one, Scalar) and not one.text) for one in root.entries.values()
    )


def _kind_of_text(path: str, shown: str) -> str:
    try:
        text = loader.read_text(path, shown)[:_MOST_LETTERS]
    except DefinitionError:
        return ""
    if all(one.search(text) for one in _KUBERNETES):
        return "a file of Kubernetes"
    return "an inventory" if _begins_as_ini(text) else ""


def _begins_as_ini(text: str) -> bool:
    lines = (line.strip() for line in text[:_MOST_LETTERS].splitlines())
    return bool(_INI_GROUP.fullmatch(next((line for line in lines if line and line[0] not in "#;"), "")))
