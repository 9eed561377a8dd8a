"""ContainerDefinition -> Dockerfile text.

Takes a CDF with `base`; gives the text and a line map. Pure. The order of instructions is the order of reuse: base,
then packages, then what differs from CDF to CDF, so that definitions with one base and equal packages share these
layers on every robot. Packages are sorted for the same reason, and are installed without the CDF's environment.

Every value comes in through `quoting.py`; `run` lines travel as JSON to `/bin/sh -ec`, so that several lines are one
instruction, the first failing command fails the build, and no line can become an instruction of its own.
Source: Dockerfile reference; PEP 668; deb's apt-get(8).
"""

from __future__ import annotations

import posixpath
from collections.abc import Callable, Iterator, Sequence
from functools import partial
from typing import TypeVar

from srprov.codes import Code
from srprov.definitions.containermodel import ContainerDefinition
from srprov.errors import DefinitionError, Diagnostic, Location
from srprov.image_reference import Reference, parse_reference
from srprov.images import quoting
from srprov.images.plan import Dockerfile
from srprov.images.template import template
from srprov.wire import quote

_T = TypeVar("_T")

_MARK = "\x01"
_BUILDERS_OWN = "#(nop)"


class FieldErrors:
    """Collects what is wrong with the fields of a CDF, to report all of it at once."""

    def __init__(self, cdf: ContainerDefinition) -> None:
        """Take the CDF whose lines the problems point to."""
        self.cdf = cdf
        self.problems: list[Diagnostic] = []

    def attempt(self, field: str, make: Callable[[], _T], otherwise: _T) -> _T:
        """Return what `make` gives; its ValueError or OSError becomes a problem of this field."""
        try:
            return make()
        except (ValueError, OSError) as error:
            reason = error.strerror if isinstance(error, OSError) and error.strerror else str(error)
            self.problems.append(Diagnostic(location_of(self.cdf, field), reason, path=field, code=Code.ORIGIN))
            return otherwise

    def raise_any(self) -> None:
        """Raise DefinitionError with everything that was found, if anything was."""
        if self.problems:
            raise DefinitionError(self.problems)


def location_of(cdf: ContainerDefinition, field: str) -> Location:
    """Return the place of a field in the CDF, or of the nearest field around it."""
    while field not in cdf.lines and "." in field:
        field = field.rpartition(".")[0]
    return Location(cdf.location.file or cdf.file, cdf.lines.get(field, cdf.location.line))


def label_line(cdf: ContainerDefinition) -> str:
    """Return the instruction that marks an image as ours, without which nothing is ever pruned.

    Raises:
        ValueError: The name has control characters.
    """
    return f"LABEL {quoting.variable('srprov.cdf', cdf.name)}"


def context_name(index: int) -> str:
    """Return the name of a CDF's file, by its number, in the build context; the user's own never reaches COPY."""
    return f"files/{index}"


def repository_name(index: int) -> str:
    """Return the name of a code repository's folder, by its number, in the build context."""
    return f"repositories/{index}"


def render_dockerfile(cdf: ContainerDefinition, commits: Sequence[str] = ()) -> Dockerfile:
    """Render a CDF that has a `base`; `commits` are those of its code repositories.

    Raises:
        DefinitionError: Values that a Dockerfile cannot hold; all of them, at their lines.
    """
    errors = FieldErrors(cdf)
    base = errors.attempt("base", lambda: _base(cdf.base), None)
    values = {
        "base": base.familiar if base else "scratch",
        **{kind: _packages(errors, kind, getattr(cdf, kind)) for kind in ("apt", "pip", "npm")},
        "environment": _environment(errors),
        "own_variables": cdf.build_environment,
        "repositories": [_repository(errors, i, commit) for i, commit in enumerate(commits)],
        "files": [
            errors.attempt(f"files.{i}", partial(_copy, i, file.source, file.dest), "")
            for i, file in enumerate(cdf.files)
        ],
        "run": [errors.attempt(f"run.{i}", partial(_script, script), "") for i, script in enumerate(cdf.run)],
        **_process(errors),
        "label": errors.attempt("name", lambda: label_line(cdf), ""),
    }
    text, fields = _unmark(template().render(values, at=lambda field: f"{_MARK}{field}{_MARK}"))
    for number, line in enumerate(text.split("\n"), 1):
        if len(line.encode()) > quoting.LONGEST_LINE:
            message = f"it is longer than Docker's builder takes ({quoting.LONGEST_LINE} bytes); put it into a file"
            errors.problems.append(
                Diagnostic(location_of(cdf, fields[number]), message, path=fields[number], code=Code.ORIGIN)
            )
    errors.raise_any()
    return Dockerfile(
        text=text,
        lines={number: location_of(cdf, field) for number, field in fields.items()},
        base=base.canonical if base else "scratch",
        pinned=base.pinned if base else True,
    )


def _base(text: str) -> Reference | None:
    """Return the base image; None for `scratch`, which is no image: a Dockerfile says it to begin with nothing."""
    return None if text == "scratch" else parse_reference(text)


def _package(kind: str, name: str) -> str:
    return quote(quoting.package(kind, name))


def _packages(errors: FieldErrors, kind: str, names: tuple[str, ...]) -> str:
    found = {errors.attempt(f"packages.{kind}.{i}", partial(_package, kind, name), "") for i, name in enumerate(names)}
    return " ".join(sorted(found))


def _environment(errors: FieldErrors) -> list[str]:
    pairs = sorted(errors.cdf.build_environment.items())
    return [errors.attempt(f"environment.{name}", partial(quoting.variable, name, value), "") for name, value in pairs]


def _copy(index: int, source: str, dest: str) -> str:
    # with a slash at its end it is a folder to copy into, for files and folders alike
    target = dest + posixpath.basename(source.rstrip("/")) if dest.endswith("/") else dest
    return quoting.exec_form((context_name(index), quoting.path("the destination", target)))


def _script(text: str) -> str:
    """Return the argument of RUN for a script.

    Raises:
        ValueError: It begins as what the builder knows other instructions by.
    """
    if text.startswith(_BUILDERS_OWN):
        raise ValueError("it begins with #(nop), as what Docker's builder makes of other instructions does")
    return quoting.exec_form(("/bin/sh", "-ec", text))


def _repository(errors: FieldErrors, index: int, commit: str) -> dict[str, object]:
    one = errors.cdf.repositories[index]
    words = (repository_name(index), quoting.path("the repository's folder", one.path))
    return {
        "commit": commit,
        "url": one.url,
        "words": errors.attempt(f"repositories.{index}.path", lambda: quoting.exec_form(words), ""),
        "run": [_script(f"cd {quote(one.path)}\n{script}") for script in one.run],
    }


def _process(errors: FieldErrors) -> dict[str, str]:
    runtime = errors.cdf.runtime

    def one(field: str, value: str, form: Callable[[str], str]) -> str:
        return errors.attempt(field, lambda: form(value), "") if value else ""

    return {
        "working_dir": one("working_dir", runtime.working_dir, lambda v: quoting.path("the working directory", v)),
        "user": one("user", runtime.user, quoting.user),
        "stop_signal": one("stop_signal", runtime.stop_signal, quoting.signal),
        "entrypoint": "" if runtime.entrypoint is None else quoting.exec_form(runtime.entrypoint),
        "command": "" if runtime.command is None else quoting.exec_form(runtime.command),
    }


def _unmark(marked: str) -> tuple[str, dict[int, str]]:
    """Return the text without marks, and the field of each line. No value has control characters, so none can mark."""
    lines: list[str] = []
    fields: dict[int, str] = {}
    field = "base"
    for number, marked_line in enumerate(marked.rstrip("\n").split("\n"), 1):
        line = marked_line
        if line.startswith(_MARK):
            _, field, line = line.split(_MARK, 2)
        lines.append(line)
        fields[number] = field
    return "\n".join(lines) + "\n", fields


def instruction_lines(text: str) -> Iterator[int]:
    """Yield the line at which each instruction begins: Docker's `Step 3` is the third of them."""
    escape, inside, seen = "\\", False, False
    for number, line in enumerate(text.split("\n"), 1):
        stripped = line.strip()
        if not seen and stripped.replace(" ", "").lower() == "#escape=`":
            escape = "`"
        if not stripped or stripped.startswith("#"):
            continue
        seen = True
        if not inside:
            yield number
        inside = stripped.endswith(escape)
