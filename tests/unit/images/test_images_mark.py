"""The mark by which containers of a build are known, and that it is on nothing else."""

from __future__ import annotations

import itertools
import re

import pytest

from srprov.errors import Location
from srprov.images.mark import MARK, UNMARK, marked
from srprov.images.plan import Dockerfile
from srprov.modules.container_leftover import BUILD
from srprov.modules.module import INSTANCE


@pytest.mark.parametrize(
    "text",
    [
        "FROM a\nRUN b\n",
        "# escape=`\nFROM a `\n  AS x\nRUN b `\n  c\nFROM x\n",
        "ARG V=1\nfrom a:$V\n# what follows\n\nRUN b \\\n# FROM nothing\n  c\nFROM b\nCOPY --from=0 /a /a\n",
        "FROM a\n",
    ],
)
def test_every_stage_begins_with_the_mark_and_the_image_ends_without_it(text: str) -> None:
    """Whatever instruction stands after a FROM, comes after the mark; the other lines stay, in their order."""
    lines = {number: Location("D", number) for number in range(1, text.count("\n") + 1)}
    found = marked(Dockerfile(text=text, lines=lines))
    now = found.text.splitlines()
    assert [line for line in now if line not in (MARK, UNMARK)] == text.splitlines()
    stages = len(re.findall(r"(?im)^from ", text))
    assert (now.count(MARK), now.count(UNMARK), now[-1]) == (stages, 1, UNMARK)
    for number, place in found.lines.items():
        assert now[number - 1] == text.splitlines()[place.line - 1]
    assert len(found.lines) == len(lines)
    instructions = re.sub(r"(?m)^#.*\n|^\n|[\\`]\n", "", found.text).splitlines()
    for this, after in itertools.pairwise(instructions):
        assert not this.lower().startswith("from ") or after == MARK


def test_the_mark_is_what_the_container_module_looks_for() -> None:
    """Two rooms say it, and neither may import the other."""
    assert f"LABEL {INSTANCE}={BUILD}" == MARK
    assert f'LABEL {INSTANCE}=""' == UNMARK
