"""The README that is written beside an export: what to give, how to start, and what is not as in the EDF. Pure."""

from __future__ import annotations

import posixpath
import shlex
from collections.abc import Iterable, Iterator

from srprov.definitions.model import Experiment
from srprov.errors import visible
from srprov.exporting.model import EXACT, Export

_LOOK = (
    r"find {} \! -type d \! -type f -o -type f -links +1 -o -perm /6000 -o -name '.?*' -o -name HEAD"
    r" -o -name '_*' -o -name CVS"
)
"""Links by either name, devices, pipes; what runs as somebody else; what programs read by themselves, and version
control's own."""


def readme(experiment: Experiment, export: Export, start: Iterable[str] | None = None) -> str:
    """Return the text, in Markdown; `start` are the lines that say how it is started, without them Compose's."""
    begin = start if start is not None else _start(export)
    parts = [_about(experiment, export), _needs(export), begin, _lent(export), _notes(export), _table(export)]
    return "\n".join(line for part in parts for line in part).rstrip("\n") + "\n"


def _about(experiment: Experiment, export: Export) -> Iterator[str]:
    yield f"# {export.experiment}"
    yield ""
    if experiment.description:
        yield plain(experiment.description)
        yield ""
    yield f"{export.made_by} from `{_code(_beside(export.edf, export))}`."
    yield ""
    said = {"authors": ", ".join(experiment.authors), **experiment.metadata}
    lines = [f"- {key}: {plain(str(value))}" for key, value in said.items() if value]
    yield from [*lines, ""] if lines else []


def _needs(export: Export) -> Iterator[str]:
    if not export.needs:
        return
    yield "## What you must give"
    yield ""
    for one in export.needs:
        yield f"- the {one.kind} `{_code(one.name)}`: {plain(one.what)}"
        yield from ("", f"      {visible(one.command)}", "") if one.command else ()
    yield ""


def _start(export: Export) -> Iterator[str]:
    yield "## Start"
    yield ""
    # a builder would ask git of the folder around, which may be a stranger's, with settings that run programs
    builds = any("build" in file.path.split("/")[:-1] for file in export.files)
    order = "    BUILDX_GIT_INFO=0 docker compose up -d" if builds else "    docker compose up -d"
    for one in export.machines:
        if not one.robot:
            yield "All services run on this machine:"
        else:
            yield f"On {plain(one.robot)}, for {', '.join(one.services)}: copy the folder there, and in it"
        yield from ("", order, "")
    if len(export.machines) > 1:
        yield "Compose knows one machine: start them in the order in which services need each other."
        yield ""
    yield "Before you bring changes, or build anew, `docker compose down`: Compose would make a container while the one"
    yield "before it runs, which can lead the engine to files of this machine while an image fills its own volumes."
    yield ""


def _lent(export: Export) -> Iterator[str]:
    """Yield what is to be known of folders that containers write to: no program here looks at what they leave."""
    if not export.lent:
        return
    yield from ("## Folders that containers write to", "")
    places: dict[str, list[str]] = {}
    for one in export.lent:
        places.setdefault(one.place, []).append(one.service)
    yield from (f"- `{_code(place)}`: {plain(', '.join(names))}" for place, names in places.items())
    yield ""
    yield "A container can leave there a link to a file of yours, a program that is root's whoever starts it, a device,"
    yield "or a repository whose settings `git status` runs. So use no `git`, editor or build in it, and do not copy it"
    yield "(`scp -r`, `cp -rL`, `zip`), before you have looked, with the containers gone:"
    yield from ("", *(f"    {_LOOK.format(shlex.quote(f'./{place}'))}" for place in places), "")
    yield "What that, or `getcap -r`, lists and the seed did not have is the container's: leave it alone, or remove the"
    yield "whole folder."
    yield ""


def _notes(export: Export) -> Iterator[str]:
    if export.notes:
        yield from ("## Notes", "", *(f"- {plain(note)}" for note in export.notes), "")


def _table(export: Export) -> Iterator[str]:
    changed = [one for one in export.fields if one.kind != EXACT]
    yield "## What is not as in the experiment"
    yield ""
    if not changed:
        yield "Nothing."
        return
    yield "| field | line | | |"
    yield "|---|---|---|---|"
    for one in changed:
        place = f"{_beside(one.location.file, export)}:{one.location.line}"
        yield f"| `{_code(one.name)}` | `{_code(place)}` | {one.kind} | {plain(one.words)} |"


def _beside(path: str, export: Export) -> str:
    """Return a path from the EDF's folder: where that is on this machine is nobody else's business."""
    return posixpath.relpath(path, posixpath.dirname(export.edf) or ".")


def plain(text: str) -> str:
    """Return a text in which nothing is Markdown, or the end of a line or a cell."""
    return "".join(f"\\{one}" if one in "\\`*_{}[]<>()#!|" else one for one in visible(text))


def _code(text: str) -> str:
    return visible(text).replace("`", "'").replace("|", "\\|")
