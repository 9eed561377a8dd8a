"""Projects of other tools that want to keep the importer busy: read in two seconds, or refused."""

from __future__ import annotations

from pathlib import Path

import pytest

from srprov.conversion.compose import Wanted, draft
from srprov.conversion.experiment import MOST_SERVICES
from srprov.errors import UsageError
from tests.bounded import bounded

CONSTRAINT = "node.hostname == r1" + " " * 200_000 + "x"


def wanted(folder: Path, text: str) -> Wanted:
    """Return the import of a file."""
    (folder / "compose.yml").write_text(text)
    return Wanted(files=[str(folder / "compose.yml")], folder=str(folder / "new"))


def test_blanks_in_a_constraint_are_read_in_time(tmp_path: Path) -> None:
    """They could be the value's, or stand behind it."""
    text = f"services: {{a: {{image: x, deploy: {{placement: {{constraints: ['{CONSTRAINT}']}}}}}}}}\n"
    made = wanted(tmp_path, text)
    assert bounded(lambda: len(draft(made).edf["services"])) == 1


def test_services_that_could_name_each_other_are_read_in_time(tmp_path: Path) -> None:
    """The words of all others are gathered once."""
    words = " ".join(f"w{n}" for n in range(60))
    one = "  s{n}: {{image: x, command: '{words}'}}\n"
    made = wanted(tmp_path, "services:\n" + "".join(one.format(n=n, words=words) for n in range(MOST_SERVICES)))
    assert bounded(lambda: len(draft(made).edf["services"])) == MOST_SERVICES


def test_more_services_than_an_instance_has_are_refused(tmp_path: Path) -> None:
    """Each is compared with all others."""
    made = wanted(tmp_path, "services:\n" + "".join(f"  s{n}: {{image: x}}\n" for n in range(MOST_SERVICES + 1)))
    with pytest.raises(UsageError, match=f"{MOST_SERVICES + 1} services"):
        bounded(lambda: draft(made).edf)
