"""Small Compose projects, one for each thing that may be written in more than one way, or that may be wrong.

What Docker Compose made of each is stored as a digest in tests/golden/compose_small.json: the test of every day needs
no other program. The long test asks Compose again, and `python -m tests.unit.importing.test_small_projects` stores it.
"""

from __future__ import annotations

import hashlib
import json
import tempfile
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest

from tests.compose_oracle import AVAILABLE, DIFFERENCES, Answer, comparable, compose, differences, ours

TESTS = Path(__file__).resolve().parents[2]
CASES: list[dict[str, Any]] = json.loads((TESTS / "cases" / "compose_small.json").read_text())
GOLDEN = TESTS / "golden" / "compose_small.json"
ON_PURPOSE: Mapping[str, str] = {
    "environment: {A: !!bool yes}": "tags",
    "environment: {A: !!null x}": "tags",
    "<<: {tty: true}\n<<: {init: true}": "tags",
    "services: {a: {image: x}}\n---\nservices: {b: {image: y}}": "documents",
    "build2": "crash",
    "pid:": "crash",
    "mem_limit: 10.5": "fraction",
    "provider: {type: x, options: {a: 1, b: [x, 2], c: true}}": "unmapped",
    "reset anchor": "merged tags",
    "envf 'A'": "last name",
    "envf 'A=\"x\" y'": "last name",
    "envf 'export  A=1\\nexport B'": "last name",
}
"""Case -> what differs in it on purpose."""


@contextmanager
def laid_out(case: Mapping[str, Any]) -> Iterator[Path]:
    """Write a case's files."""
    with tempfile.TemporaryDirectory() as name:
        for path, text in case["files"].items():
            (Path(name) / path).parent.mkdir(parents=True, exist_ok=True)
            (Path(name) / path).write_bytes(text.encode())
        yield Path(name)


def options(case: Mapping[str, Any]) -> dict[str, Any]:
    """Return what the command line says beside the files."""
    return {name: value for name, value in case.items() if name not in ("name", "files", "main")}


def digest(answer: Answer, folder: Path) -> str:
    """Return what tells an answer from others."""
    if answer.refusal:
        return "refused"
    text = json.dumps(comparable(answer.document), sort_keys=True).replace(folder.name.lower(), "FOLDER")
    return hashlib.sha256(text.encode()).hexdigest()[:20]


def asked(case: Mapping[str, Any]) -> tuple[str, list[str]]:
    """Return the digest of what Compose says, and where ours differs."""
    with laid_out(case) as folder:
        theirs = compose(folder, case["main"], **options(case))
        mine, _ = ours(folder, case["main"], **options(case))
        return digest(theirs, folder), differences(theirs, mine)


def test_small_projects_are_read_as_compose_read_them() -> None:
    stored = json.loads(GOLDEN.read_text())
    wrong = []
    for case in CASES:
        with laid_out(case) as folder:
            mine, _ = ours(folder, case["main"], **options(case))
            found = digest(mine, folder)
        unset = "has no value" in mine.refusal
        if (found != stored[case["name"]]) is not (case["name"] in ON_PURPOSE or unset):
            wrong.append((case["name"], mine))
    assert wrong == []


def test_what_differs_on_purpose_is_listed() -> None:
    assert set(ON_PURPOSE.values()) <= set(DIFFERENCES)
    assert set(ON_PURPOSE) <= {case["name"] for case in CASES}


@pytest.mark.soak
@pytest.mark.skipif(not AVAILABLE, reason="Docker Compose is there for x86-64 only")
def test_what_is_stored_is_what_compose_says() -> None:
    stored = json.loads(GOLDEN.read_text())
    answers = {case["name"]: asked(case) for case in CASES}
    assert {name: answer for name, (answer, _) in answers.items()} == stored
    assert {name for name, (_, differs) in answers.items() if differs} == set(ON_PURPOSE)


if __name__ == "__main__":
    lines = [f"{json.dumps(case['name'])}: {json.dumps(asked(case)[0])}" for case in CASES]
    GOLDEN.write_text("{\n" + ",\n".join(lines) + "\n}\n")
