"""A bundle -> findings: what is as it should be, what is not, and what nobody can tell from it.

Takes the path of a bundle; gives a Report. Offline, without robots; nothing of the bundle is run, and nothing is
written but its definitions, into a folder of their own that is gone afterwards.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import ExitStack
from functools import partial
from itertools import islice

import msgspec

from srprov.codes import Code
from srprov.errors import UsageError, visible
from srprov.evidence import checks_crate, checks_files, checks_images, checks_run, checks_values, story
from srprov.evidence.checks_files import Hashed
from srprov.evidence.checks_images import Images
from srprov.evidence.files import ABOUT, MANIFEST, SIGNATURE, NotThere, Undecided, json_of, opened
from srprov.evidence.images import has_images
from srprov.evidence.make import FORMAT
from srprov.evidence.story import Story
from srprov.untrusted import mapping, mappings, strings

MOST_DETAILS = 20
"""Of one check; there may be as many as files."""
LIMITS = (
    "that the data come from these robots, and not from a careful forger",
    "what srprov does not record: where robots stood, light, floor, batteries, firmware of sensors, people",
)
"""What cannot be verified."""
BUILT_OF = "that an image in it was built of the definitions beside it"
ABSENT = "that images can still be had: {} named by their ids, and are not in the bundle"


class Finding(msgspec.Struct, frozen=True):
    """What came of one check."""

    id: str
    what: str
    result: str
    """`pass`, `fail`, `skipped` or `info`"""
    details: tuple[str, ...] = ()


class Report(msgspec.Struct, frozen=True, kw_only=True):
    """What came of all checks."""

    run: str
    findings: tuple[Finding, ...]
    absent: str = "they are"
    """Which images are not in it, in words; empty: none."""
    has_images: bool = False
    hashes: Mapping[str, str] = msgspec.field(default_factory=dict)
    """Name -> sha256 of its files; none where they are not those of its manifest."""

    @property
    def failed(self) -> bool:
        """Whether something is not as it should be."""
        return any(one.result == "fail" for one in self.findings)

    @property
    def unproven(self) -> tuple[str, ...]:
        """What cannot be verified, of this bundle."""
        held, absent = [BUILT_OF] * self.has_images, [ABSENT.format(self.absent)] if self.absent else []
        return (*LIMITS, *held, *absent)


def verify(path: str, signers: str = "") -> Report:
    """Check a bundle.

    Args:
        path: The file.
        signers: An `allowed_signers` file; empty: nobody says whose signature counts.

    Raises:
        UsageError: It is no bundle, or of a format that this srprov does not know.
    """
    with opened(path) as files, ExitStack() as stack:
        hashed = Hashed(files)
        _check_format(hashed, path)
        first = (
            _done("F1", "each file is the one in the manifest", lambda: checks_files.hashes(hashed)),
            _done("F2", "there is no other file", lambda: checks_files.nothing_else(hashed)),
        )
        as_listed = all(one.result == "pass" for one in first)
        bound = hashed.bound() if as_listed else hashed
        told: Story | None = None
        why = ""
        try:
            told = stack.enter_context(story.read(bound.files))
        except NotThere as error:
            why = str(error)
        findings = (*first, *_findings(bound, told, why, signers))
        return Report(
            run=told.run if told else "", findings=findings, absent=_absent(bound),
            has_images=has_images(bound.files), hashes=bound.named() if as_listed else {},
        )  # fmt: skip


def _absent(hashed: Hashed) -> str:
    """Return which images are not in a bundle, in words."""
    if not has_images(hashed.files):
        return "they are"
    try:
        left = mappings(mapping(json_of(hashed.files, ABOUT).get("images")).get("left_out"))
    except NotThere:
        return "they are"
    names = sorted({visible(name[:100]) for one in left for name in strings(one.get("names"))})
    return f"{', '.join(names[:MOST_DETAILS])} are" if names else ""


def _check_format(hashed: Hashed, path: str) -> None:
    try:
        found = json_of(hashed.files, ABOUT).get("format")
    except NotThere as error:
        # so is a bundle in which just that was changed: its manifest says so
        if MANIFEST in hashed.files.sizes:
            return
        raise UsageError(
            f"{path} is no bundle: {error}", hint="name a file that `srprov bundle` made", code=Code.NO_BUNDLE
        ) from None
    if isinstance(found, int) and found > FORMAT:
        raise UsageError(
            f"{path} has the format {found}", hint=f"this srprov knows {FORMAT}: take a newer one", code=Code.NO_BUNDLE
        )


def _findings(hashed: Hashed, told: Story | None, why: str, signers: str) -> Iterator[Finding]:
    yield _done("F3", "results are as their robots sent them", lambda: checks_files.results(hashed))
    yield _signature(hashed, signers)
    yield _done("D1", "the experiment's files are those that were recorded", lambda: _read(hashed, why))
    if told is not None:
        yield from _of_story(hashed, told)
    else:
        yield Finding("*", "what follows from the experiment", "skipped", ("its files cannot be read",))
    yield _done("S1", "the RO-Crate hangs together, and is true of the files", lambda: checks_crate.structure(hashed))
    images = Images(hashed)
    yield _done("I2", "images are what they are called, to the last layer", lambda: checks_images.layout(images))
    if told is not None:
        yield from _of_images(images, told)
    yield _done("P1", "nothing looks like a secret", lambda: checks_files.no_secrets(hashed))


def _of_story(hashed: Hashed, told: Story) -> Iterator[Finding]:
    files = hashed.files
    solved = partial(checks_run.placement, told, files, ours=not checks_crate.is_ours(hashed))
    checks: tuple[tuple[str, str, Callable[[], Iterable[str]]], ...] = (
        ("D2", "points, ids and seeds follow from the experiment", partial(checks_run.design, told)),
        ("D3", "trials were begun in the design's order", partial(checks_run.order, told)),
        ("D4", "the placement follows from facts and experiment", solved),
        ("J1", "the journal is whole, and its events can have happened", partial(checks_run.journal, told)),
        ("J2", "tables follow from the journal", partial(checks_run.tables, told, files)),
        ("J3", "attempts are in their folders", partial(checks_run.folders, told, files)),
        ("M1", "metrics and verdicts follow from logs and results", partial(checks_values.measured, told, files)),
        ("I1", "each service had one image", partial(checks_values.images, told, files)),
        ("H1", "what was measured is of robots that were used", partial(checks_values.robots, told, files)),
    )
    for name, what, check in checks:
        yield _done(name, what, check)
    described = "README, CITATION.cff, RO-Crate and the like follow from the run"
    if other := checks_crate.has_our_rules(hashed):
        yield Finding("S2", described, "skipped", (visible(other),))
    else:
        yield _done("S2", described, partial(checks_crate.follows, hashed, told))
    yield Finding("J4", "what was run", "info", (checks_run.counted(told),))
    yield Finding("C1", "clocks", "info", (checks_run.clocks(told),))


def _of_images(images: Images, told: Story) -> Iterator[Finding]:
    yield _done("I3", "images are those that the run had", lambda: checks_images.of_run(images, told))
    strange = checks_crate.has_our_rules(images.hashed)
    yield _done("I4", "lists of packages follow from the images", lambda: checks_images.packages(images, told, strange))


def _signature(hashed: Hashed, signers: str) -> Finding:
    what = "it is signed by somebody who may"
    if signers:
        return _done("F4", what, lambda: checks_files.signature(hashed, signers))
    there = SIGNATURE in hashed.files.sizes
    why = "it is signed: say by --signers whose signature counts" if there else "it is not signed"
    return Finding("F4", what, "skipped", (why,))


def _read(hashed: Hashed, why: str) -> Iterator[str]:
    if why:
        yield why
    yield from checks_files.inputs(hashed)


def _done(name: str, what: str, check: Callable[[], Iterable[str]]) -> Finding:
    """Do a check; what cannot be done, since something is missing that must be there, has failed."""
    found: list[str] = []
    undecided = ""
    try:
        for one in islice(check(), MOST_DETAILS + 1):
            found.append(visible(one[:500]))
    except NotThere as error:
        found.append(visible(str(error)[:500]))
    except Undecided as error:
        undecided = visible(str(error)[:500])
    if undecided and not found:
        return Finding(name, what, "skipped", (undecided,))
    more = ["and more"] * (len(found) > MOST_DETAILS)
    return Finding(name, what, "fail" if found else "pass", (*found[:MOST_DETAILS], *more))
