"""Problems in user files, as text with the source line and a caret, as JSON, as SARIF, and as GitLab's Code Quality.

Takes `Diagnostic`s; returns text. Pure.
"""

from __future__ import annotations

import hashlib
import json
import os
from collections.abc import Sequence
from typing import Any

from srprov import __version__
from srprov.codes import Code
from srprov.errors import Diagnostic, visible

_WIDEST = 120
"""Columns of a source line that are shown; of a longer one, the part around the caret."""


def render_problems(problems: Sequence[Diagnostic], word: str = "error") -> str:
    """Return every problem as compilers do: `file:line:column: error[code]: message`, path, line, caret, hint."""
    return "\n".join(_render(problem, word) for problem in sorted(problems))


def _render(problem: Diagnostic, word: str) -> str:
    where = f"  [{visible(problem.path)}]" if problem.path else ""
    lines = [f"{visible(str(problem.location))}: {word}[{problem.code}]: {visible(problem.message)}{where}"]
    if problem.excerpt.strip():
        lines += _caret(problem.excerpt, problem.location.column)
    if problem.hint:
        lines.append(f"    hint: {visible(problem.hint)}")
    return "\n".join(lines)


def _caret(excerpt: str, column: int) -> list[str]:
    """Return the source line and a line with `^` below the column; tabs stay tabs, so that both line up.

    A bar stands before them: a line of a stranger's file that begins with `hint:` would pass for one of srprov's own.
    """
    start = max(0, column - 1 - _WIDEST // 2) if len(excerpt) > _WIDEST else 0
    part = excerpt[start : start + _WIDEST].rstrip()
    before = excerpt[start : column - 1]
    return [f"    | {part}", "    | " + "".join("\t" if letter == "\t" else " " for letter in before) + "^"]


def as_json(problems: Sequence[Diagnostic], warnings: Sequence[Diagnostic] = ()) -> str:
    """Return one JSON document: `{"problems": [{"code", "file", "line", "column", "message", …}], "warnings"}`."""
    return json.dumps({"problems": _rows(problems), "warnings": _rows(warnings)}, indent=2)


def _rows(problems: Sequence[Diagnostic]) -> list[dict[str, Any]]:
    return [
        {
            "code": problem.code,
            "file": problem.location.file,
            "line": problem.location.line,
            "column": problem.location.column,
            "message": problem.message,
            "path": problem.path,
            "hint": problem.hint,
        }
        for problem in sorted(problems)
    ]


def as_sarif(problems: Sequence[Diagnostic], warnings: Sequence[Diagnostic] = ()) -> str:
    """Return a SARIF 2.1.0 log, as code hosts show it beside the lines of a pull request."""
    rules = [_rule(code) for code in sorted({problem.code for problem in (*problems, *warnings)})]
    driver = {"name": "srprov", "version": __version__, "rules": rules}
    run = {
        "tool": {"driver": driver},
        "columnKind": "unicodeCodePoints",
        "results": [
            *(_result(problem, "error") for problem in sorted(problems)),
            *(_result(problem, "warning") for problem in sorted(warnings)),
        ],
    }
    log = {"$schema": "https://json.schemastore.org/sarif-2.1.0.json", "version": "2.1.0", "runs": [run]}
    return json.dumps(log, indent=2)


def _rule(code: Code) -> dict[str, Any]:
    from srprov.explaining import as_markdown, as_text, pages

    page = pages()[code]
    return {
        "id": code,
        "name": "".join(word.capitalize() for word in code.name.split("_")),
        "shortDescription": {"text": f"{page.title[:1].upper()}{page.title[1:]}."},
        "fullDescription": {"text": page.means},
        "help": {"text": as_text(page), "markdown": as_markdown(page)},
    }


def _result(problem: Diagnostic, level: str) -> dict[str, Any]:
    from urllib.parse import quote

    words = problem.message + (f" ({problem.hint})" if problem.hint else "")
    region = {"startLine": problem.location.line, "startColumn": problem.location.column}
    place: dict[str, Any] = {
        "physicalLocation": {"artifactLocation": {"uri": quote(os.fsencode(problem.location.file))}, "region": region}
    }
    if problem.path:
        place["logicalLocations"] = [{"fullyQualifiedName": problem.path}]
    return {"ruleId": problem.code, "level": level, "message": {"text": words}, "locations": [place]}


def _quality_row(problem: Diagnostic, severity: str, fingerprint: str) -> dict[str, Any]:
    return {
        "description": problem.message + (f" ({problem.hint})" if problem.hint else ""),
        "check_name": problem.code,
        "fingerprint": fingerprint,
        "severity": severity,
        "location": {"path": problem.location.file, "lines": {"begin": problem.location.line}},
    }


def as_codequality(problems: Sequence[Diagnostic], warnings: Sequence[Diagnostic] = ()) -> str:
    """Return a Code Quality report, as GitLab shows it on a merge request. A fingerprint outlives a change of the line.

    Source: GitLab's documentation of the format, which is a part of Code Climate's.
    """
    seen: dict[str, int] = {}
    rows = []
    for found, severity in ((problems, "major"), (warnings, "minor")):
        for problem in sorted(found):
            about = "\0".join((problem.location.file, problem.path, problem.message))
            seen[about] = seen.get(about, 0) + 1
            digest = hashlib.sha256(f"{about}\0{seen[about]}".encode("utf-8", "surrogatepass")).hexdigest()
            rows.append(_quality_row(problem, severity, digest))
    return json.dumps(rows, indent=2)
