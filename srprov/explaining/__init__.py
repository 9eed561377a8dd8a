"""What each code of an error means: a page with a bad example, a good one, and what to do.

Takes a `Code`; gives its `Page`, as a value, as text or as Markdown. Touches the files beside this one, for reading.

A page in those files has `title`, `means` and `do`, and two examples: `bad` gives the error and `good` does not. With
`run`, the words behind `srprov`, an example is files, which tests write and run; `good_run` are other words for the
good one, and `executable` is a file that is a program. Else an example is text as a user sees it. `test` names the test
that shows an error for which files are not enough.
"""

from __future__ import annotations

import functools
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import msgspec

from srprov.codes import Code

_HERE = Path(__file__).parent


class Example(msgspec.Struct, frozen=True, kw_only=True):
    """What a user has before him: files, or text of a terminal or of a part of a file."""

    files: Mapping[str, str]
    """Name -> content."""
    text: str


class Page(msgspec.Struct, frozen=True, kw_only=True):
    """All that is said of one code."""

    code: Code
    title: str
    means: str
    do: str
    run: str
    """The words behind `srprov` that give the error with the files of `bad`."""
    good_run: str
    """Those that give none with the files of `good`."""
    executable: str
    bad: Example
    good: Example
    test: str
    """The test that shows the error where it needs more than files, as `file::function`."""


@functools.cache
def pages() -> Mapping[Code, Page]:
    """Return every page, in the order of the codes."""
    from yaml import CSafeLoader, load

    found: dict[Code, Page] = {}
    for file in sorted(_HERE.glob("*.yml")):
        for number, given in load(file.read_text(encoding="utf-8"), CSafeLoader).items():
            assert Code(number) not in found, number
            found[Code(number)] = _page(Code(number), given)
    return {code: found[code] for code in Code if code in found}


def _page(code: Code, given: Mapping[str, Any]) -> Page:
    unknown = set(given) - {"title", "means", "do", "run", "good_run", "executable", "bad", "good", "test"}
    assert not unknown, f"{code}: {unknown}"
    return Page(
        code=code,
        title=given["title"],
        means=" ".join(given["means"].split()),
        do=" ".join(given["do"].split()),
        run=given.get("run", ""),
        good_run=given.get("good_run", given.get("run", "")),
        executable=given.get("executable", ""),
        bad=_example(given["bad"]),
        good=_example(given["good"]),
        test=given.get("test", ""),
    )


def _example(given: str | Mapping[str, str]) -> Example:
    return Example(files={}, text=given) if isinstance(given, str) else Example(files=given, text="")


def title(code: Code) -> str:
    """Return what an error is called in a line."""
    return pages()[code].title


def as_markdown(page: Page, level: int = 2) -> str:
    """Return a page as Markdown that begins with a heading of this level."""
    parts = [f"{'#' * level} {page.code}: {page.title}", page.means]
    for word, command, one in _examples(page):
        parts += [f"{word}:", *_blocks(one)]
        if command:
            parts.append(_fenced("text", f"$ {command}"))
    return "\n\n".join([*parts, f"**What to do.** {page.do}"]) + "\n"


def _examples(page: Page) -> tuple[tuple[str, str, Example], ...]:
    """Return each example with the word before it and the command that uses it, which is empty where it is text."""
    commands = [f"srprov {words}" if words else "" for words in (page.run, page.good_run)]
    return (
        ("Wrong", commands[0], page.bad),
        ("Right", commands[1] if page.good.files else "", page.good),
    )


def _blocks(one: Example) -> list[str]:
    if one.text:
        return [_fenced("text", one.text)]
    return [_fenced("yaml" if "." in name else "text", f"# {name}\n{content}") for name, content in one.files.items()]


def _fenced(language: str, text: str) -> str:
    return f"```{language}\n{text.rstrip()}\n```"


def as_text(page: Page) -> str:
    """Return a page as plain text, for a terminal."""
    import textwrap

    def wrapped(text: str) -> str:
        return textwrap.fill(text, 100, break_long_words=False, break_on_hyphens=False)

    lines = [f"{page.code}: {page.title}", "", wrapped(page.means)]
    for word, command, one in _examples(page):
        lines += ["", f"{word}:"]
        for name, content in one.files.items() or [("", one.text)]:
            lines += ["", *([f"  {name}"] if name else []), textwrap.indent(content.rstrip(), "    ")]
        lines += ["", f"  $ {command}"] if command else []
    return "\n".join([*lines, "", "What to do:", wrapped(page.do)])


def as_document(page: Page) -> dict[str, Any]:
    """Return a page as `srprov explain --json` prints it."""
    commands = [command for _, command, _ in _examples(page)]
    return {
        "code": page.code,
        "title": page.title,
        "means": page.means,
        "do": page.do,
        "run": commands[0],
        "good_run": commands[1],
        "bad": {"files": dict(page.bad.files), "text": page.bad.text},
        "good": {"files": dict(page.good.files), "text": page.good.text},
    }
