"""Which image a robot needs, and where it comes from: the registry, a build, or another robot. Pure."""

from __future__ import annotations

import hashlib
from typing import Any

from srprov.codes import Code
from srprov.controller.image_builders import alike
from srprov.controller.render_inputs import RenderInputs
from srprov.definitions.model import Service
from srprov.errors import UsageError
from srprov.facts.model import HostFacts
from srprov.image_reference import Reference, is_of_a_build, parse_reference
from srprov.record.memory import built_for
from srprov.resource import resource_id


def normalise(text: str) -> str:
    """Return an image's name as Docker lists it: `busybox` is `busybox:latest`; beside a digest a tag says nothing."""
    reference = parse_reference(text)
    tag = "" if reference.digest else reference.tag
    return Reference(reference.domain, reference.path, tag, reference.digest).familiar


def image_of(inputs: RenderInputs, service: Service) -> str:
    """Return the image that a service runs: a bundle's, the one it names, its CDF's, or its build's content tag."""
    if service.name in inputs.bundled:
        return inputs.bundled[service.name].name
    if service.image:
        return normalise(service.image)
    if service.cdf in inputs.images:
        return inputs.images[service.cdf].tag
    return normalise(inputs.references[service.cdf])


def robot_images(inputs: RenderInputs, blobs: dict[str, bytes]) -> dict[str, list[dict[str, Any]]]:
    """Return robot -> its images; one to build comes from a robot that has it, else from the builder.

    That is one of the same architecture: a host of the group `builders`, or the first robot where there is no such
    group. Where none of the group is in reach, each builds its own.
    A robot has it for others when its image is one that this machine had built for that architecture, or when it is a
    builder: of any other one the tag alone is its own word.
    """
    wanted: dict[str, dict[str, dict[str, Any]]] = {}
    present = {(h, e.name) for h, items in inputs.snapshot.observed.items() for e in items if e.module == "image"}
    trusted = _known(inputs)
    plans = {plan.tag: plan for plan in inputs.images.values()}
    for name, host in sorted(inputs.placed.items()):
        facts = inputs.snapshot.facts.get(host)
        if facts is None or (inputs.images_for and name not in inputs.images_for):
            continue
        image = image_of(inputs, inputs.experiment.services[name])
        if name in inputs.bundled:
            wanted.setdefault(host, {})[image] = _cached(inputs, image, inputs.bundled[name].id, host)
            continue
        if image not in plans:
            wanted.setdefault(host, {})[image] = {"name": image, "source": "pull", "needs": []}
            continue
        possible = _alike(inputs, facts)
        if (host, image) in present:
            wanted.setdefault(host, {}).setdefault(image, _copied(inputs, image, host, host))
            continue
        holder = next((h for h in possible if (h, image) in trusted), None)
        building = [h for h in possible if h in inputs.builders] if inputs.builders else possible
        builder = holder or next((h for h in building if (h, image) not in present), host)
        if holder is None:
            plan = plans[image]
            digest = hashlib.sha256(plan.context).hexdigest()
            blobs[digest] = plan.context
            build = {"name": image, "source": "build", "blob": digest, "unpinned": not plan.pinned, "needs": []}
            wanted.setdefault(builder, {})[image] = build
        if builder != host:
            wanted.setdefault(host, {})[image] = _copied(
                inputs, image, builder, host, trusted.get((builder, image), ""), base_name(plans[image].base)
            )
    runs = {host: list(inputs.snapshot.facts[host].runs) for host in wanted}
    return {host: [{**images[name], "runs": runs[host]} for name in sorted(images)] for host, images in wanted.items()}


def _known(inputs: RenderInputs) -> dict[tuple[str, str], str]:
    """Return (robot, image) -> its id, where others may have the image from the robot.

    What a builder has counts whoever had it built: else a robot that is none would build it for the others.
    """
    known, found = inputs.known_images, dict[tuple[str, str], str]()
    for host, facts in inputs.snapshot.facts.items():
        for seen in inputs.snapshot.observed.get(host, ()):
            if seen.module == "image" and (
                host in inputs.builders or seen.state["id"] in known.get(built_for(seen.name, facts.arch), ())
            ):
                found[host, seen.name] = str(seen.state["id"])
    return found


def base_name(base: str) -> str:
    """Return an image as engines list it; nothing for one that only its build knows, by a variable."""
    try:
        return normalise(base)
    except ValueError:
        return ""


def _copied(
    inputs: RenderInputs, image: str, source: str, host: str, id_: str = "", base: str = ""
) -> dict[str, Any]:  # fmt: skip
    copy = {"name": image, "source": "copy", "from": source, "needs": [resource_id(source, "image", image)]}
    known = inputs.copied.get((host, image), {})
    return {**copy, "id": id_, "way": inputs.copy_way, "base": base, "missing": None, **known}


def _cached(inputs: RenderInputs, image: str, id_: str, host: str) -> dict[str, Any]:
    found: dict[str, Any] = {
        "name": image,
        "source": "cache",
        "id": id_,
        "way": inputs.copy_way,
        "missing": None,
        "needs": [],
    }
    return {**found, **inputs.copied.get((host, image), {})}


def _alike(inputs: RenderInputs, facts: HostFacts) -> list[str]:
    """Return the reachable robots of the same architecture with an engine: builders first, then in name order."""
    return sorted(alike(inputs.snapshot, facts.arch), key=lambda host: (host not in inputs.builders, host))


def check_there(inputs: RenderInputs, *, seen: bool) -> None:
    """Refuse a plan that would bring an image to a robot whose service says `never`, or one of srprov's own names.

    No registry is asked for what srprov builds: whoever has taken that name on Docker Hub would give the robot an image
    under the tag of another experiment's build, which then ran as that. `seen` says that the robots were looked at.

    Raises:
        UsageError: Names each.
    """
    present = {(h, one.name) for h, items in inputs.snapshot.observed.items() for one in items if one.module == "image"}
    built = {one.tag for one in inputs.images.values()}
    never, nobody_s = list[str](), list[str]()
    reachable = {name: robot for name, robot in inputs.placed.items() if robot in inputs.snapshot.facts}
    for name, robot in sorted(reachable.items()) if seen else ():
        image = image_of(inputs, inputs.experiment.services[name])
        if (robot, image) in present:
            continue
        told = f"{name}: {image} is not on {robot}"
        never += [told] if inputs.experiment.services[name].runtime.pull_policy == "never" else []
        nobody_s += [told] if is_of_a_build(image) and image not in built and name not in inputs.bundled else []
    if never:
        hint = "load it there, or use pull_policy: missing"
        raise UsageError(f"pull_policy is never: {'; '.join(never)}", hint=hint, code=Code.NO_IMAGE)
    if nobody_s:
        hint = "build it there first, by the experiment that it is of; or give the service that one's CDF"
        what = f"no registry has what srprov builds: {'; '.join(nobody_s)}"
        raise UsageError(what, hint=hint, code=Code.NO_IMAGE)
