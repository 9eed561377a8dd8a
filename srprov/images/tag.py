"""The content tag, and the plan of an image: everything that goes in, known before anything is built.

Takes a ContainerDefinition and functions that read the controller's files; gives an ImagePlan. Pure. The tag is a
hash of content only: no absolute path, no time, no owner. So equal definitions have equal tags on any machine and
from any folder, and a robot that has the tag needs no build. Platforms are not part of it: one tag names the same
content on every architecture.
"""

from __future__ import annotations

import functools
import hashlib
import json
import posixpath
import re
from collections.abc import Callable, Iterable, Sequence
from functools import partial

from msgspec.structs import replace

from srprov import plain_tar
from srprov.definitions.containermodel import ContainerDefinition
from srprov.definitions.dockerfile import stages, until_stage
from srprov.errors import Location
from srprov.image_reference import parse_reference
from srprov.images.args import with_args, with_digests
from srprov.images.context import DOCKERFILE, Listing, Read, context_tar, entries_of, folder_entries
from srprov.images.dockerfile import (
    FieldErrors,
    context_name,
    instruction_lines,
    label_line,
    render_dockerfile,
    repository_name,
)
from srprov.images.mark import marked
from srprov.images.plan import Checkout, ContextFile, Dockerfile, ImagePlan

_TAG_LENGTH = 32
"""128 bits: nobody finds two definitions with one tag. With 64, two processors do within half an hour, and the image of
one then runs as that of the other, wherever it was built before."""
_FORMAT = 1
"""Counts up when the same definition shall build something else than before."""

_FOLDER = 0o755


Checkouts = Callable[[ContainerDefinition, int], Checkout]
"""A CDF and the number of one of its code repositories -> what it gives; raises ValueError or OSError."""


def no_repositories(cdf: ContainerDefinition, index: int) -> Checkout:
    """Refuse: for callers that have nobody who fetches."""
    raise ValueError("nobody fetches repositories here")


def plan_image(
    cdf: ContainerDefinition, listing: Listing, read: Read, checkout: Checkouts = no_repositories
) -> ImagePlan:
    """Plan the image of a CDF that has a `base` or a `dockerfile`.

    Args:
        cdf: the definition; one with `image` has nothing to build.
        listing: gives the files below a path of the controller.
        read: gives one file's content.
        checkout: gives a code repository's commit and files.

    Raises:
        DefinitionError: Fields that cannot become an image, files that cannot be read; all of them, at their lines.
        ValueError: The CDF names a ready image.
    """
    if cdf.image:
        raise ValueError(f"{cdf.name} names a ready image: nothing is built")
    moving: tuple[str, ...] = ()
    if cdf.dockerfile:
        written, entries = _from_folder(cdf, listing, read)
    else:
        written, entries, moving = generated(cdf, listing, read, checkout)
    dockerfile = marked(written)
    return ImagePlan(
        tag=f"{repository_of(cdf)}:{content_hash(dockerfile, entries)[:_TAG_LENGTH]}",
        dockerfile=dockerfile.text,
        context=context_tar(dockerfile.text, entries),
        base=dockerfile.base,
        pinned=dockerfile.pinned,
        moving=moving,
        platforms=cdf.platforms,
        lines=dockerfile.lines,
    )


def content_hash(dockerfile: Dockerfile, entries: Iterable[ContextFile]) -> str:
    """Return the sha256 in hex over the Dockerfile, its base, and every file's name, mode and content."""
    files = sorted(
        [entry.path, f"{entry.mode:04o}", entry.link or "", hashlib.sha256(entry.content).hexdigest()]
        for entry in entries
        if entry.path != DOCKERFILE
    )
    whole = {"format": _FORMAT, "dockerfile": dockerfile.text, "base": dockerfile.base, "files": files}
    return hashlib.sha256(json.dumps(whole, sort_keys=True, separators=(",", ":")).encode()).hexdigest()


@functools.lru_cache(maxsize=4096)  # many images of a plan file may have one context
def read_context(context: bytes) -> tuple[str, str]:
    """Return a build context's content tag and Dockerfile; "" for one that `plan_image` would not write."""
    try:
        members = list(plain_tar.members(context))
        plain_tar.check_paths(members)
        text = next(one.content or b"" for one in members if one.path == DOCKERFILE).decode()
    except (ValueError, StopIteration):
        return "", ""
    entries = [ContextFile(path=one.path, content=one.content or b"", mode=one.mode, link=one.link)
               for one in members if not one.is_folder]  # fmt: skip
    folders = {one.path for one in members if one.is_folder and one.mode == _FOLDER}
    above = {one.path.rpartition("/")[0] for one in members} - {""}
    own = ContextFile(path=DOCKERFILE, content=text.encode())
    paths = [one.path for one in members]
    if paths != sorted(paths) or folders != above or len(folders) + len(entries) != len(members) or own not in entries:
        return "", ""
    base, pinned = _bases(text)
    return content_hash(Dockerfile(text=text, base=base, pinned=pinned), entries)[:_TAG_LENGTH], text


def base_of(context: bytes) -> str:
    """Return what `ImagePlan.base` is of a build context that `plan_image` wrote; "" for another one."""
    return _bases(read_context(context)[1])[0]


def locate_failure(plan: ImagePlan, output: str) -> Location | None:
    """Return the user's line behind a failed build, from what the builder said; None when it does not tell."""
    if parse := re.findall(r"(?:parse error (?:on )?line |Dockerfile:)([0-9]{1,6})", output):
        return plan.lines.get(int(parse[-1]))
    steps = re.findall(r"\bStep ([0-9]{1,6})/[0-9]{1,6} :", output)
    starts = list(instruction_lines(plan.dockerfile))
    if steps and 0 < int(steps[-1]) <= len(starts):
        return plan.lines.get(starts[int(steps[-1]) - 1])
    return None


def repository_of(cdf: ContainerDefinition) -> str:
    """Return `srprov/<name>`, the name as Docker allows it: lower case, single separators, never empty."""
    return f"srprov/{re.sub(r'[^a-z0-9]+', '-', cdf.name.lower()).strip('-')[:100] or 'cdf'}"


def generated(
    cdf: ContainerDefinition, listing: Listing, read: Read, checkout: Checkouts
) -> tuple[Dockerfile, Sequence[ContextFile], tuple[str, ...]]:
    """Return the Dockerfile of a CDF that has a `base`, its build context, and what names of repositories are now.

    The last line of the Dockerfile says that srprov built the image.

    Raises:
        DefinitionError: As `plan_image`.
    """
    errors, none = FieldErrors(cdf), Checkout(commit="", files=())
    places = range(len(cdf.repositories))
    taken = [errors.attempt(f"repositories.{i}", partial(checkout, cdf, i), none) for i in places]
    dockerfile = render_dockerfile(cdf, [one.commit for one in taken])
    entries = [
        replace(file, path=f"{repository_name(i)}/{file.path}") for i, one in enumerate(taken) for file in one.files
    ]
    for index, file in enumerate(cdf.files):
        found = partial(entries_of, context_name(index), file.source, file.mode, listing, read)
        entries += errors.attempt(f"files.{index}", found, entries[:0])
    errors.raise_any()
    return dockerfile, entries, tuple(one.moving for one in taken if one.moving)


def _from_folder(cdf: ContainerDefinition, listing: Listing, read: Read) -> tuple[Dockerfile, Sequence[ContextFile]]:
    errors = FieldErrors(cdf)
    for field in ("apt", "pip", "npm", "files", "run"):
        if getattr(cdf, field):
            name = f"packages.{field}" if field in ("apt", "pip", "npm") else field
            errors.attempt(name, _refuse, None)
    text = errors.attempt("dockerfile", lambda: tailored(cdf), "")
    label = errors.attempt("name", lambda: label_line(cdf), "")
    entries: list[ContextFile] = []
    entries = errors.attempt(
        "dockerfile",
        lambda: folder_entries(cdf.context or posixpath.dirname(cdf.dockerfile), listing, read),
        entries,
    )
    errors.raise_any()
    lines = {number: Location(cdf.dockerfile, number) for number in range(1, text.count("\n") + 1)}
    base, pinned = _bases(text)
    return Dockerfile(text=f"{text}{label}\n", lines=lines, base=base, pinned=pinned), entries


def tailored(cdf: ContainerDefinition) -> str:
    """Return a Dockerfile as it is built: its values for ARG and digests in it, up to the stage that is wanted.

    Raises:
        ValueError: A value for an ARG cannot be written there.
    """
    whole = until_stage(cdf.dockerfile_text.replace("\r\n", "\n"), cdf.target).rstrip("\n") + "\n"
    return with_digests(with_args(whole, cdf.build_args), cdf.pins)


def _refuse() -> None:
    raise ValueError("a Dockerfile is built as it is: write this into it, or use `base` instead of `dockerfile`")


def _bases(text: str) -> tuple[str, bool]:
    """Return what the last stage starts from, and whether all stages start from digests."""
    known: dict[str, str] = {}
    base, pinned = "", True
    for _, image, name in stages(text):
        base = known.get(image.lower(), image)
        if image.lower() not in known and base != "scratch":
            try:
                reference = parse_reference(base)
                base, pinned = reference.canonical, pinned and reference.pinned
            except ValueError:
                pinned = False  # a variable stands in it; only the builder knows
        if name:
            known[name] = base
    return base, pinned and bool(base)
