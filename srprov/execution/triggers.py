"""What a build would bring along that nobody was asked about: ONBUILD instructions of the images that it starts from.

An engine runs them as part of the build, so they can copy files of other experiments' images, or fetch a URL from the
robot's own network. Only the image says that it has some, so each is looked at on the robot right before the build.
"""

from __future__ import annotations

import re
from collections.abc import Collection, Mapping
from typing import Any

from msgspec.structs import replace

from srprov import plain_tar
from srprov.definitions.dockerfile import images_of, instructions, is_open, stages
from srprov.image_reference import is_of_a_build, pull_parameters
from srprov.session import Progress, Session
from srprov.untrusted import mapping, mappings, string, strings
from srprov.wire import EngineCall, EngineQuery, Reply

_VARIABLE = re.compile(r"\$\{[a-z_][a-z0-9_]*(?::[-+][^${}\"'\\]*)?\}|\$[a-z_][a-z0-9_]*")
_FROM_OPTION = re.compile(r"(?<!\S)--from=(\S+)")
_PLATFORM = re.compile(r"(?<!\S)--platform=(\S*)")
_ALIKE = {"x86_64": "amd64", "x86-64": "amd64", "aarch64": "arm64"}
_USUAL = {"amd64": "v1", "arm64": "v8", "arm": "v7"}
"""Variant of an architecture that goes without saying."""
_MOST_BYTES = 8 << 20
"""Of a Dockerfile inside a build's context."""
_TRUST = "if you trust it: --allow built-image --allow engine-fetch"


def refuse_triggers(build: EngineCall, session: Session, progress: Progress) -> Reply | None:
    """Return a failure where a build would run what nobody was asked about, and None where it may begin.

    An image that is not there is pulled first, as the build itself would do, which would then run it at once. What has
    a variable or quotes in its name is left to the builder: it was asked for as `built-image` and `engine-fetch`.

    A base by one name may have another image for each platform, with instructions of its own. Of an engine with
    containerd's store a build gets the one that its `--platform` says, and only that of the robot can be looked at.
    What files are copied of is pulled before, too: it could bring the other image that a base's name may mean.

    Raises:
        TransportError: The robot cannot be talked to any more.
    """
    try:
        names = _bases(build.blob)
    except ValueError as error:
        return Reply(status=0, ok=False, err=f"the build's context is not such as srprov writes: {error}")
    looks = [EngineQuery(path=f"/images/{name}/json", params=(("manifests", "1"),)) for name in names]
    replies = session.ask(looks) if looks else ()
    missing = [name for name, reply in zip(names, replies, strict=True) if not reply.ok]
    if built := next(filter(is_of_a_build, missing), ""):
        why = f"{built} is not on the robot, and no registry has what srprov builds: it would be somebody else's"
        return Reply(status=0, ok=False, err=why)
    for name in missing:
        if not (pulled := session.execute(_pull(name, build.timeout_s), progress)).ok:
            return pulled
    if missing:  # all are looked at again: what was pulled for one may be part of what another one's name means
        replies = session.ask(looks)
    for (name, platforms), reply in zip(names.items(), replies, strict=True):
        answer = mapping(reply.json())
        if not reply.ok or not answer:
            return Reply(status=reply.status, ok=False, err=f"the base {name} cannot be looked at: {reply.err}")
        if why := _unasked(name, answer, platforms):
            return Reply(status=0, ok=False, err=f"{why}; {_TRUST}")
    return None


def _unasked(name: str, answer: Mapping[str, Any], platforms: Collection[str] | None) -> str:
    """Return why a build with an image might run what nobody was asked about, or nothing."""
    if not _is_all(answer):
        return f"{name} may mean several images, of which a build may take another than the one that was looked at"
    if platforms is None:  # files of it are copied
        return ""
    if triggers := mapping(answer.get("Config")).get("OnBuild"):
        return f"the base {name} has ONBUILD instructions, which would run unasked: {str(triggers)[:200]}"
    has = _platform(answer)
    if other := next((one for one in sorted(platforms) if _normal(one) != has), None):
        seen = "/".join(filter(None, has)) or "nothing that it names"
        why = f"FROM --platform={other[:60]}: {name} could be looked at for {seen} alone"
        return f"{why}, and another one may have ONBUILD instructions"
    return ""


def _is_all(image: Mapping[str, Any]) -> bool:
    """Return whether a build can get no other image by a name than the one that its engine tells.

    In containerd's store a name may stand for a list of images, made by whoever published it: two for one platform, one
    that is called an attestation and is none, one for another platform than the list says. What the engine tells of
    such a list, what it builds on and what it takes the files of are then not always the same.
    """
    manifests = mappings(image.get("Manifests"))
    if not manifests:  # a classic store, where an id is no digest that a registry knows, or an engine before 28
        return all(one.rpartition("@")[2] != image.get("Id") for one in strings(image.get("RepoDigests")))
    there = [one for one in manifests if one.get("Available") is not False]
    if len(there) != 1 or there[0].get("Kind") != "image":
        return False
    if there == manifests and there[0].get("ID") == image.get("Id"):
        return True
    own = _listed(there[0])
    others = [_listed(one) for one in manifests if one is not there[0]]
    return own[:2] == _platform(image)[:2] and all(all(one[:2]) and one != own for one in others)


def _listed(manifest: Mapping[str, Any]) -> tuple[str, str, str]:
    """Return the platform of an entry of a list, as the list tells it."""
    said = mapping(mapping(manifest.get("Descriptor")).get("platform"))
    return _family(
        _platform({"Os": said.get("os"), "Architecture": said.get("architecture"), "Variant": said.get("variant")})
    )


def _family(platform: tuple[str, str, str]) -> tuple[str, str, str]:
    """Return a platform without what only narrows it: an engine may take any variant, but for those of `arm`."""
    return platform if platform[1] == "arm" else (*platform[:2], "")


def _platform(image: Mapping[str, Any]) -> tuple[str, str, str]:
    """Return system, architecture and variant of an image as its engine tells them."""
    system, architecture, variant = (string(image.get(key)) for key in ("Os", "Architecture", "Variant"))
    return _normal(f"{system}/{architecture}/{variant}")


def _normal(platform: str) -> tuple[str, str, str]:
    """Return a platform as builders compare them; one with a variable is no image's."""
    first, _, rest = platform.lower().partition("/")
    system, architecture, variant = ("linux", first, "") if not rest else (first, *rest.partition("/")[::2])
    architecture = _ALIKE.get(architecture, architecture)
    return system, architecture, "" if variant == _USUAL.get(architecture) else variant


def kept_apart(command: EngineCall) -> EngineCall:
    """Return a build without the engine's cache where a stage begins with nothing; any other command as it is.

    Before Docker 25 every image without a parent counts for such a stage: one that was pulled, or loaded, and says of
    itself that it came of the same first step, would be below what is built, with files of whoever made it.
    """
    if command.path != "/build" or not _may_begin_with_nothing(command.blob):
        return command
    return replace(command, params=(*command.params, ("nocache", "true")))


def _may_begin_with_nothing(context: bytes) -> bool:
    try:
        begins = [image for _, image, _ in stages(_dockerfile(context))]
    except ValueError:  # it is refused, or an engine is asked for what it makes of it
        return True
    return not begins or any(map(_may_be_scratch, begins))


def _may_be_scratch(image: str) -> bool:
    """Return whether a base is `scratch`, or may be: `${BASE}` may, for some value, and `ros:${NAME}` may not."""
    fixed = _VARIABLE.split(image.lower())
    return any(map(is_open, fixed)) or re.fullmatch(".*".join(map(re.escape, fixed)), "scratch") is not None


def _bases(context: bytes) -> dict[str, set[str] | None]:
    """Return the images that a context's Dockerfile starts from, in their order, each with the platforms it names.

    Those that it only copies files of come with None.

    Raises:
        ValueError: It is no context that srprov writes, or its Dockerfile is too large.
    """
    text = _dockerfile(context)
    options = {line: _PLATFORM.findall(rest) for line, word, rest in instructions(text) if word == "FROM"}
    known, found = {"scratch"}, dict[str, set[str] | None]()
    for line, image, name in stages(text):
        if image.lower() not in known and not is_open(image):
            found[image] = {*(found.get(image) or ()), *options[line]}
        known.add(name)
    named = set(images_of(text))
    for _, word, rest in instructions(text):
        for image in _FROM_OPTION.findall(rest) if word == "COPY" else ():
            if image in named and not is_open(image):
                found.setdefault(image, None)
    return found


def _dockerfile(context: bytes) -> str:
    plain_tar.check_paths(plain_tar.members(context))
    content = next((one.content for one in plain_tar.members(context) if one.path == "Dockerfile"), None)
    if content is None or len(content) > _MOST_BYTES:
        raise ValueError(f"it has no Dockerfile of at most {_MOST_BYTES >> 20} MiB")
    return content.decode("utf-8", "replace")


def _pull(name: str, timeout_s: float) -> EngineCall:
    params = pull_parameters(name)
    return EngineCall(method="POST", path="/images/create", params=params, stream=True, timeout_s=timeout_s)
