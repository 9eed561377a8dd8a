"""A page for each verb, from click itself."""

from __future__ import annotations

from collections.abc import Iterator

from srprov.cli.commands import Option, Verb, verbs
from srprov.cli.main import _VERBS, cli
from tools.site.markup import block, code, text


def pages() -> dict[str, str]:
    """Return the name of a page -> its Markdown; those of verbs below a verb stand on its page."""
    by_page: dict[str, list[Verb]] = {}
    for verb in verbs(cli):
        by_page.setdefault(verb.name.split()[0], []).append(verb)
    made = {f"reference/verbs/{name}.md": _page(listed) for name, listed in by_page.items()}
    return {"reference/verbs.md": _index(list(by_page)), **made}


def _index(names: list[str]) -> str:
    rows = [f"| [{name}](verbs/{name}.md) | {text(_VERBS[name])} |" for name in names]
    listed = [f"verbs/{name}" for name in names]
    head = ["# Verbs", "", "Every verb with its options, as `srprov VERB --help` has them.", "", "| verb | does |"]
    toctree = ["```{toctree}", ":hidden:", "", *listed, "```"]
    return "\n".join([*head, "|---|---|", *rows, "", *toctree]) + "\n"


def _page(listed: list[Verb]) -> str:
    lines: list[str] = []
    for depth, verb in enumerate(listed):
        lines += [f"{'##' if depth else '#'} srprov {verb.name}", "", block(verb.usage), ""]
        for part in verb.paragraphs:
            lines += [block(part.text) if part.as_is else text(part.text), ""]
        lines += _options(verb)
    return "\n".join(lines)


def _options(verb: Verb) -> Iterator[str]:
    """Yield the table of a verb's options."""
    listed = [option for option in verb.options if "--help" not in option.names]
    if listed:
        yield from ("| option | does | environment |", "|---|---|---|")
    for option in listed:
        variable = code(option.variable) if option.variable else ""
        yield f"| {_names(option)} | {text(option.help).replace('  ', '<br>')} | {variable} |"
    yield ""


def _names(option: Option) -> str:
    names = ", ".join(code(name) for name in option.names)
    return f"{names} {text(option.value)}".rstrip()
