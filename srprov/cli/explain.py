"""`srprov explain`: what the code of an error means, with examples and what to do; no robot is asked."""

from __future__ import annotations

import click

from srprov.cli import options
from srprov.cli.output import out, out_json
from srprov.codes import Code
from srprov.errors import UsageError


@click.command()
@click.argument("code", required=False, metavar="[CODE]")
@options.JSON
def explain(code: str | None, as_json: bool) -> int:
    """Explain the CODE of an error, such as SRP-105: what is wrong, an example of it, the same put right, what to do.

    Without CODE, list all of them with one line each.
    """
    from srprov import explaining

    if code is None:
        every = explaining.pages()
        if as_json:
            out_json({"codes": [{"code": page.code, "title": page.title} for page in every.values()]})
        else:
            out("\n".join(f"{page.code}  {page.title}" for page in every.values()))
        return 0
    page = explaining.pages()[_code(code)]
    if as_json:
        out_json({"codes": [explaining.as_document(page)]})
    else:
        out(explaining.as_text(page))
    return 0


def _code(word: str) -> Code:
    """Return the code that the user means: `SRP-105`, `srp-105` or `105`."""
    known = [one.value for one in Code]
    wanted = word.upper() if word.upper().startswith("SRP-") else f"SRP-{word}"
    if wanted not in known:
        hint = "`srprov explain` lists all codes"
        raise UsageError(f"there is no code '{word[:40]}'", hint=hint, code=Code.OPTION_VALUE)
    return Code(wanted)
