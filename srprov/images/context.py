"""The build context: which files go in, and the tar that Docker takes.

Takes entries, or a folder's listing with `.dockerignore`; gives entries and bytes. Pure: files are read by the
functions that the caller gives. The tar is the same on every machine: sorted, no times, no owners, modes reduced to
"executable or not".
Source: Docker's `.dockerignore` rules (moby/patternmatcher); POSIX pax format.
"""

from __future__ import annotations

import io
import itertools
import re
import tarfile
from collections.abc import Callable, Iterable, Iterator, Sequence

from srprov.images.plan import ContextFile, ListedFile

Read = Callable[[str], bytes]
"""Absolute path -> content; raises OSError."""
Listing = Callable[[str], Iterable[ListedFile]]
"""Absolute path of a file or folder -> every file in it, at any depth, symbolic links not followed; raises OSError."""

DOCKERFILE = "Dockerfile"
MOST_BYTES = 96 * 1024 * 1024
"""Of all files of a context, which is held in memory."""
_LARGEST_IGNORE = 64 * 1024
_LONGEST_PATTERN = 255
_RANGE = re.compile(r"(\\.|[^\\])(?:-(\\.|[^\\]))?", re.DOTALL)
"""One character of a class, or two with those between them; `\\` takes its meaning from what follows."""
_MOST_WORK = 500_000_000
"""Characters of all patterns times characters of all paths."""
# What never belongs to an image but would change its tag from one clone, or one edit of the experiment, to the next.
# A `.dockerignore` can take it back with `!`.
_ALWAYS = ("**/*.edf", "**/*.cdf", "**/experiment.lock")


def entries_of(prefix: str, source: str, mode: str, listing: Listing, read: Read) -> list[ContextFile]:
    """Return the entries of one file or folder under the name `prefix`; an octal `mode` holds for every file in it.

    Raises:
        OSError: It cannot be read.
        ValueError: The mode is no octal number, or a name has control characters.
    """
    if mode and not re.fullmatch(r"0?[0-7]{3,4}", mode):
        raise ValueError(f"mode '{mode}' is no octal number such as 0755")
    fixed = int(mode, 8) if mode else None
    shipped = (item for item in listing(source) if not item.left_out)
    return _entries(prefix, source, shipped, fixed, read)


def _entries(prefix: str, source: str, items: Iterable[ListedFile], mode: int | None, read: Read) -> list[ContextFile]:
    found, left = [], MOST_BYTES
    for item in items:
        found.append(_entry(prefix, source, item, mode, read))
        left -= len(found[-1].content)
        if left < 0:
            raise ValueError(f"it holds more than {MOST_BYTES >> 20} MiB; a .dockerignore leaves files out")
    return found


def _entry(prefix: str, source: str, item: ListedFile, mode: int | None, read: Read) -> ContextFile:
    if any(ord(c) < 32 for c in item.path) or ".." in item.path.split("/"):
        raise ValueError(f"a file's name cannot be {item.path!r}")
    path = "/".join(part for part in (prefix, item.path) if part)
    if item.link is not None:
        return ContextFile(path=path, link=item.link, mode=0o777)
    content = read(f"{source.rstrip('/')}/{item.path}" if item.path else source)
    return ContextFile(
        path=path, content=content, mode=mode if mode is not None else 0o755 if item.executable else 0o644
    )


def folder_entries(folder: str, listing: Listing, read: Read) -> list[ContextFile]:
    """Return the entries of a Dockerfile's folder, without what its `.dockerignore` leaves out; errors as below."""
    return _entries("", folder, folder_items(folder, listing, read), None, read)


def folder_items(folder: str, listing: Listing, read: Read) -> list[ListedFile]:
    """Return what of a Dockerfile's folder belongs to its build context.

    Raises:
        OSError: Something cannot be read.
        ValueError: A name that cannot be, a pattern that is none, or more than an image's context may hold.
    """
    items = [item for item in listing(folder) if not item.left_out]  # also where a stranger's file takes it back
    ignore = ""
    if any(item.path == ".dockerignore" and item.link is None for item in items):
        content = read(f"{folder.rstrip('/')}/.dockerignore")
        if len(content) > _LARGEST_IGNORE:
            raise ValueError(f".dockerignore is larger than {_LARGEST_IGNORE >> 10} KiB")
        ignore = content.decode("utf-8", "replace")
    locks = [f"{item.path.removesuffix('.edf')}.lock" for item in items if item.path.endswith(".edf")]
    always = [*_ALWAYS, *map(_escaped, locks)]
    ignored = ignore_rule([*always, *ignore.splitlines()], sum(len(item.path) for item in items), len(always))
    return [item for item in items if not ignored(item.path)]


def _escaped(path: str) -> str:
    """Return the pattern of a path alone; one that is too long for a pattern is not left out."""
    escaped = re.sub(r"([*?\[\]\\])", r"\\\1", path)
    return escaped if len(escaped) <= _LONGEST_PATTERN else ""


def ignore_rule(patterns: Iterable[str], characters: int = 0, before: int = 0) -> Callable[[str], bool]:
    """Return a function that says whether a path is left out; the last pattern for it or a folder above decides.

    Of a pattern that cannot be taken its line is told, and no word: an archive may have given a file of the user's own
    the name `.dockerignore`, and what is wrong is shown to whoever reads the log of a check.

    Args:
        patterns: Lines of a `.dockerignore`.
        characters: Of all paths that will be asked for. What a pattern costs grows with its length and the path's.
        before: How many patterns stand before the file's first line.

    Raises:
        ValueError: A pattern is none or too long, or there are too many for so many files.
    """
    rules: list[tuple[re.Pattern[str], bool]] = []
    work = 0
    for number, raw in enumerate(patterns, 1 - before):
        place = f"line {number} of .dockerignore" if number > 0 else "what never belongs to an image"
        pattern = raw.strip().removeprefix("\ufeff")
        if not pattern or pattern.startswith("#"):
            continue
        keep = pattern.startswith("!")
        parts = [p for p in pattern.removeprefix("!").strip().split("/") if p not in ("", ".")]
        work += len(pattern) * characters
        if len(pattern) > _LONGEST_PATTERN or work > _MOST_WORK:
            why = "is too long" if len(pattern) > _LONGEST_PATTERN else "comes after too many for so many files"
            raise ValueError(f"{place} {why}")
        if parts:
            rules.append((_compiled(parts, place), keep))

    def ignored(path: str) -> bool:
        verdict = False
        for rule, keep in rules:
            if rule.fullmatch(path):
                verdict = not keep
        return verdict

    return ignored


def _compiled(parts: Sequence[str], place: str) -> re.Pattern[str]:
    try:
        # whatever lies below a match is matched too
        return re.compile(_regex(parts) + r"(/.*)?", re.DOTALL)
    except re.error:
        raise ValueError(f"{place} is no pattern") from None


def _regex(parts: Sequence[str]) -> str:
    """Translate Go's filepath.Match with `**`, which stands for any number of folders.

    What stands behind a `*` or `**` is taken where it is found first, and never looked for again when the rest does
    not fit: for these patterns nothing is lost by that, and the time does not grow with the number of stars.
    """
    out, chunk, anywhere = "", [], False  # type: str, list[str], bool
    groups = itertools.count()
    for part in [*parts, "**"]:
        if part != "**":
            chunk.append(_segment(part, groups))
        elif chunk:
            fixed = "/".join(chunk)
            out += ("/" if out else "") + (_once(f"(?:[^/]*/)*?{fixed}(?=/|\\Z)", groups) if anywhere else fixed)
            chunk, anywhere = [], True
        else:
            anywhere = True
    # a pattern that ends in `**` means what lies in the folder, not the folder
    return (f"{out}/.*" if out else ".*") if parts[-1] == "**" else out


def _once(regex: str, groups: Iterator[int]) -> str:
    """Return a regular expression that never takes back what it has matched."""
    name = f"g{next(groups)}"
    return f"(?=(?P<{name}>{regex}))(?P={name})"


def _segment(part: str, groups: Iterator[int]) -> str:
    """Translate what stands between two slashes."""
    first, *between = _between_stars(part)
    if not between:
        return first
    *steps, last = between
    return first + "".join(_once(f"[^/]*?{one}", groups) for one in steps if one) + f"[^/]*{last}"


def _between_stars(part: str) -> list[str]:
    """Return the regular expressions of what stands before, between and behind the stars."""
    found, rest = [""], part
    while rest:
        if group := re.match(r"\[(\^?)((?:\\.|[^\]\\])+)\]", rest):
            found[-1] += f"(?!/)[{group[1]}{_RANGE.sub(_escaped_range, group[2])}]"
            rest = rest[group.end() :]
            continue
        char, rest = rest[0], rest[1:]
        if char == "*":
            found.append("")
        elif char == "\\" and rest:
            found[-1] += re.escape(rest[0])
            rest = rest[1:]
        else:
            found[-1] += "[^/]" if char == "?" else re.escape(char)
    return found


def _escaped_range(match: re.Match[str]) -> str:
    """Return one character, or two with a hyphen between them, so that Python gives none of them a meaning."""
    low, high = (end and re.escape(end.removeprefix("\\")) for end in match.groups())
    return f"{low}-{high}" if high else low


def context_tar(dockerfile: str, entries: Iterable[ContextFile]) -> bytes:
    """Return the tar, the same bytes for equal entries in whatever order they come.

    `dockerfile` is in it under the name `Dockerfile`, in place of an entry that has this name.
    """
    own = ContextFile(path=DOCKERFILE, content=dockerfile.encode())
    by_path = {**{entry.path: entry for entry in entries}, DOCKERFILE: own}
    folders = {"/".join(path.split("/")[:depth]) for path in by_path for depth in range(1, path.count("/") + 1)}
    out = io.BytesIO()
    with tarfile.open(fileobj=out, mode="w", format=tarfile.PAX_FORMAT) as tar:
        for path in sorted(folders | by_path.keys()):
            info = tarfile.TarInfo(path)  # its defaults: time 0, owner 0, no names
            entry = by_path.get(path)
            if entry is None:
                info.type, info.mode = tarfile.DIRTYPE, 0o755
                tar.addfile(info)
                continue
            info.mode = entry.mode
            if entry.link is not None:
                info.type, info.linkname = tarfile.SYMTYPE, entry.link
                tar.addfile(info)
                continue
            info.size = len(entry.content)
            tar.addfile(info, io.BytesIO(entry.content))
    return out.getvalue()
