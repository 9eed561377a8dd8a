"""The images of a run in its crate, and in the words of its README. Pure.

Source: Workflow Run RO-Crate 0.5, "Container images".
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping

from srprov.evidence.crate_base import Entity, Told, file_id, image_id, ref
from srprov.evidence.files import Files
from srprov.evidence.images import LAYOUT, sbom_name, stored
from srprov.evidence.story import Story
from srprov.image_reference import BUILT, BUNDLED, parse_reference
from srprov.oci.layout import NAMES, REF_NAME, Stored, sha256


def of_services(story: Story, files: Files) -> Mapping[str, Stored]:
    """Return service -> its image, as the run stated it last, of those that the bundle holds.

    Raises:
        NotThere: The images cannot be read.
    """
    by_id = {id_: one for one in stored(files) for id_ in one.engine_ids}
    return {service: by_id[id_] for service, (_, id_) in story.images.items() if id_ in by_id}


def images(told: Told) -> Iterator[Entity]:
    """Return the images of the trials' services, as far as their engines named them."""
    for service, (name, digest) in told.story.images.items():
        yield {
            "@id": image_id(service), "@type": "ContainerImage", "name": name, "identifier": digest,
            "additionalType": ref("https://w3id.org/ro/terms/workflow-run#DockerImage"),
            **(_in_bundle(told, told.images[service]) if service in told.images else {}),
        }  # fmt: skip


def _in_bundle(told: Told, one: Stored) -> Entity:
    """Return what is known of an image that lies in the bundle."""
    found: Entity = {"identifier": one.id, "sha256": sha256(one.manifest).removeprefix("sha256:")}
    try:
        reference = parse_reference(one.names[0])
    except ValueError:
        reference = None
    if reference and not one.names[0].startswith(BUILT):
        found |= {"registry": reference.domain, "tag": reference.tag}
    if (name := sbom_name(one.id)) in told.files:
        found["subjectOf"] = ref(file_id(name))
    return found


def in_words(told: Told) -> str:
    """Return what README.md says of the images that a bundle holds."""
    known = {id_ for one in told.images.values() for id_ in one.engine_ids}
    absent = sorted({name for name, id_ in told.story.images.values() if id_ not in known})
    more = f"\nNot in it are {', '.join(absent)}: they must be obtainable by their names." if absent else ""
    return f"""Images are in `{LAYOUT}`, an OCI layout; `sbom/` lists the packages of each. An engine gets all by

    tar -C {LAYOUT[:-1]} -c . | docker load

or one by its name, `{REF_NAME}` in `{LAYOUT}index.json`, by

    skopeo copy oci:{LAYOUT[:-1]}:NAME docker-daemon:NAME

They are called `{BUNDLED}DIGEST` then; what the experiment calls each is `{NAMES}` there. Verify the bundle before.
{more}

"""
