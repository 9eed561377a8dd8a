"""A container that somebody started by hand -> a service: what it has beyond its image and its engine's defaults.

Takes what an engine says of the container and of its image; gives the service's fields, the secrets that it needs, and
values that must be written nowhere. Pure. What looks like a secret leaves its field and becomes a name.

Source: Docker Engine API 1.41, "Inspect a container", "Inspect an image"; moby `daemon/commit.go` (merge).
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from srprov.image_reference import parse_reference
from srprov.snapshot.mounts import mount_fields
from srprov.snapshot.notes import Notes
from srprov.snapshot.secret_names import Give
from srprov.snapshot.settings import MOST_ENTRIES, few, health_field, host_fields
from srprov.snapshot.suspicion import masked, masked_words, secret_variable
from srprov.untrusted import integer, mapping, string, string_map, strings, text

LONGEST_VALUE = 8192
"""Characters of a variable, a word or a label."""
_LABELS_OF_OTHERS = (
    "com.docker.", "io.docker.", "org.dockerproject.", "org.opencontainers.", "srprov.", "io.portainer.",
    "desktop.docker.",
)  # fmt: skip
_VARIABLE = re.compile(r"[^=\x00\s]{1,200}")
_CONFIG = frozenset((
    "Hostname", "AttachStdin", "AttachStdout", "AttachStderr", "ExposedPorts", "Tty", "OpenStdin", "StdinOnce",
    "Env", "Cmd", "Entrypoint", "Healthcheck", "Image", "Volumes", "WorkingDir", "User", "Labels", "StopSignal",
    "StopTimeout", "OnBuild", "ArgsEscaped", "NetworkDisabled", "Shell",
))  # fmt: skip


@dataclass(frozen=True, kw_only=True, slots=True)
class Service:
    """One container as a service."""

    name: str
    fields: Mapping[str, Any]
    secrets: Mapping[str, str] = field(default_factory=dict)
    """Name of a secret -> the variable of the user's that shall hold it."""
    hidden: tuple[str, ...] = field(default=(), repr=False)
    """Values that must be written nowhere."""


def service_of(
    name: str, box: Mapping[str, Any], image: Mapping[str, Any], runtime: str, notes: Notes, give: Give
) -> Service:
    """Return a container as the service `name`; `runtime` is what its engine runs containers with by default.

    `give` names its secrets.
    """
    subject = f"container {name}"
    config, own, host = mapping(box.get("Config")), mapping(image.get("Config")), mapping(box.get("HostConfig"))
    variables, secrets, hidden = _environment(name, config, own, notes, give)
    fields: dict[str, Any] = {**_image(config, image, subject, notes)}
    network = _network(box, host, subject, notes)
    fields |= network | _process(config, own, subject, notes)
    if variables:
        written = [f"{key}={value}" for key, value in sorted(variables.items())]
        fields["environment"] = few(written, "variables", subject, notes)
    if secrets:
        fields["secrets"] = sorted(secrets)
    fields |= host_fields(host, runtime, subject, notes) | mount_fields(box, own, name, notes)
    if network.get("network") in ("host", "none"):
        fields.pop("ports", None)
    fields |= _exposed(config, own, host)
    if health := health_field(config.get("Healthcheck"), own.get("Healthcheck")):
        health["healthcheck"]["test"] = _words("healthcheck", health["healthcheck"]["test"], subject, notes)
        fields |= health
    fields |= _hostname(box, config, network, subject, notes) | _labels(config, own, subject, notes)
    for key in sorted(map(str, config))[:200]:
        if key not in _CONFIG and key not in ("Domainname", "MacAddress") and config[key]:
            notes.lost(subject, f"{key} is set: an EDF has no such field")
    for key in ("Domainname", "MacAddress"):
        if value := string(config.get(key)):
            notes.lost(subject, f"{key} {text(value, length=60)}: an EDF has no such field")
    return Service(name=name, fields=fields, secrets=secrets, hidden=tuple(hidden))


def _environment(
    name: str, config: Mapping[str, Any], own: Mapping[str, Any], notes: Notes, give: Give
) -> tuple[dict[str, str], dict[str, str], list[str]]:
    """Return the variables that are not the image's: plain ones, those that became secrets, and values to hide."""
    of_image = set(strings(own.get("Env")))
    plain: dict[str, str] = {}
    secrets: dict[str, str] = {}
    hidden: list[str] = []
    subject = f"container {name}"
    for number, one in enumerate(one for one in strings(config.get("Env")) if one not in of_image):
        key, _, value = one.partition("=")
        if number >= 2 * MOST_ENTRIES:
            if number == 2 * MOST_ENTRIES:
                notes.lost(subject, f"only {number} of its variables are captured")
            if len(value) <= LONGEST_VALUE and secret_variable(key, value):
                hidden.append(value)  # it may stand in what is captured
        elif not _VARIABLE.fullmatch(key) or len(value) > LONGEST_VALUE:
            notes.lost(subject, f"the variable {text(key, length=60)!r} has a name or length that an EDF does not take")
            if len(value) <= LONGEST_VALUE and secret_variable(key, value):
                hidden.append(value)
        elif reason := secret_variable(key, value):
            secret, secrets[secret] = give(name, key)
            hidden.append(value)
            words = f"the variable {text(key, length=60)} looks like a secret ({reason})"
            notes.secret(
                subject, f"{words}: it is the secret {secret} now, a file /run/secrets/{secret} of the container"
            )
        else:
            plain[key] = value
    return plain, secrets, [value for value in hidden if value]


def _image(config: Mapping[str, Any], image: Mapping[str, Any], subject: str, notes: Notes) -> dict[str, Any]:
    """Return the image by digest; one that no registry gave is taken as it is on the robot."""
    written = string(config.get("Image"))
    try:
        named = parse_reference(written)
    except ValueError:
        named = None
    names = [one for one in (*strings(image.get("RepoDigests")), *strings(image.get("RepoTags")))][:100]
    references = []
    for one in names:
        try:
            references.append(parse_reference(one))
        except ValueError:
            continue
    for known in references:
        if known.digest and (named is None or (known.domain, known.path) == (named.domain, named.path)):
            tag = f":{named.tag}" if named and named.tag and not named.digest else ""
            return {"image": known.familiar.replace("@", f"{tag}@", 1)}
    words = f"no registry has its image by digest ({text(written, length=80)}): it was built or loaded on the robot"
    notes.adapted(subject, f"{words}, and the service runs only where it is")
    if named is not None and any(one.canonical == named.canonical for one in references):
        return {"image": named.familiar, "pull_policy": "never"}
    if references:
        return {"image": references[0].familiar, "pull_policy": "never"}
    notes.lost(subject, "its image has no name any more: give it one on the robot (docker tag), and write it here")
    return {"image": "srprov.invalid/image-without-a-name:unknown", "pull_policy": "never"}


def _network(box: Mapping[str, Any], host: Mapping[str, Any], subject: str, notes: Notes) -> dict[str, Any]:
    mode = string(host.get("NetworkMode"))
    if mode in ("host", "none"):
        return {"network": mode}
    if mode.startswith("container:"):
        notes.lost(subject, "it shares the network of another container: here it is on the overlay")
        return {}
    networks = mapping(mapping(box.get("NetworkSettings")).get("Networks"))
    for name, one in sorted(networks.items())[:20]:
        about = mapping(one)
        fixed = string(mapping(about.get("IPAMConfig")).get("IPv4Address"))
        if fixed:
            notes.lost(
                subject, f"its address {text(fixed, length=40)} on {text(name, length=60)}: overlays have their own"
            )
    if mode not in ("", "default", "bridge"):
        notes.adapted(subject, f"the network {text(mode, length=60)} is the experiment's overlay here")
    return {}


def _process(config: Mapping[str, Any], own: Mapping[str, Any], subject: str, notes: Notes) -> dict[str, Any]:
    found: dict[str, Any] = {}
    entry, words = strings(config.get("Entrypoint")), strings(config.get("Cmd"))
    if entry != strings(own.get("Entrypoint")):
        found["entrypoint"] = _words("entrypoint", entry, subject, notes)
        if words:
            found["command"] = _words("command", words, subject, notes)
    elif words != strings(own.get("Cmd")):
        found["command"] = _words("command", words, subject, notes)
    for key, name in (("WorkingDir", "working_dir"), ("User", "user"), ("StopSignal", "stop_signal")):
        value = string(config.get(key))
        if value and value != string(own.get(key)):
            found[name] = value
    stop = config.get("StopTimeout")
    if isinstance(stop, int) and not isinstance(stop, bool) and stop != 10:
        found["stop_grace_period"] = f"{integer(stop, high=86_400)}s"
    if config.get("Tty") is True:
        found["tty"] = True
    if config.get("OpenStdin") is True:
        found["stdin_open"] = True
    return found


def _exposed(config: Mapping[str, Any], own: Mapping[str, Any], host: Mapping[str, Any]) -> dict[str, Any]:
    """Return the ports that it was told to listen on, and that neither its image says nor a published one does."""
    known = {*mapping(own.get("ExposedPorts")), *mapping(host.get("PortBindings"))}
    found = sorted({str(port) for port in mapping(config.get("ExposedPorts"))} - known)[:MOST_ENTRIES]
    return {"expose": [port.removesuffix("/tcp") for port in found]} if found else {}


def _words(name: str, words: Sequence[str], subject: str, notes: Notes) -> list[str]:
    found = masked_words(words[:MOST_ENTRIES])
    if found != list(words):
        notes.secret(subject, f"its {name} holds what looks like a secret, or too much: *** stands there")
    return found


def _hostname(
    box: Mapping[str, Any], config: Mapping[str, Any], network: Mapping[str, Any], subject: str, notes: Notes
) -> dict[str, Any]:
    name, identity = string(config.get("Hostname")), string(box.get("Id"))
    if not name or name == identity[:12] or network.get("network") == "host":
        return {}
    return {"hostname": name}


def _labels(config: Mapping[str, Any], own: Mapping[str, Any], subject: str, notes: Notes) -> dict[str, Any]:
    of_image = string_map(own.get("Labels"))
    found: dict[str, str] = {}
    every = sorted(string_map(config.get("Labels")).items())
    some = [one for one in every if of_image.get(one[0]) != one[1] and not one[0].startswith(_LABELS_OF_OTHERS)]
    for key, value in few(some, "labels", subject, notes):
        if len(key) + len(value) > LONGEST_VALUE or secret_variable(key, value) or masked(value) != value:
            notes.secret(
                subject, f"the label {text(key, length=60)} looks like a secret, or is too long: it is left out"
            )
        else:
            found[key] = value
    return {"labels": found} if found else {}
