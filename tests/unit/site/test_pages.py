"""How pages of the manual become tests: what is run, and that what they print is really looked for."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from tests.pages import ROOT, blocks, missing, play

PAGE = """# A page

<!-- file: sub/hello.txt -->
```text
hello
```

<!-- run -->
```console
$ cat sub/hello.txt
hello
$ echo 'done in 3.2 s: 12 changed'; echo 0a1b2c3d4e5f
done in 41.7 s: 1 changed
…
ffff00000000
```

<!-- run: exit 3 -->
```sh
# a comment
true
exit 3
```

<!-- lab -->
```
touch lab
```
"""


def test_a_page_is_done_as_it_stands(tmp_path: Path) -> None:
    page = tmp_path / "page.md"
    page.write_text(PAGE)
    play(page, tmp_path, {})
    assert (tmp_path / "sub/hello.txt").read_text() == "hello\n" and not (tmp_path / "lab").exists()
    play(page, tmp_path, {}, lab=True)
    assert (tmp_path / "lab").exists()


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ("$ cat sub/hello.txt\nhello", "$ cat sub/hello.txt\nbye", "did not print 'bye'"),
        ("exit 3\n```", "exit 4\n```", "exit 4, not 3"),
        ("true", "false", "exit 1, not 0"),
        ("41.7 s: 1 changed", "41.7 s: 1 failed", "did not print"),
    ],
)
def test_what_is_not_so_fails(tmp_path: Path, old: str, new: str, said: str) -> None:
    page = tmp_path / "page.md"
    assert PAGE.count(old) == 1
    page.write_text(PAGE.replace(old, new))
    with pytest.raises(AssertionError, match=said):
        play(page, tmp_path, {})


@pytest.mark.parametrize("wrong", ["<!-- run -->\nno block\n", "<!-- run: fast -->\n```\ntrue\n```\n"])
def test_a_mark_that_means_nothing_is_an_error(tmp_path: Path, wrong: str) -> None:
    (tmp_path / "page.md").write_text(wrong)
    with pytest.raises(ValueError, match=r"mark|run: fast"):
        blocks(tmp_path / "page.md")


def test_lines_are_looked_for_in_their_order() -> None:
    assert missing(["a", "b"], "a\nx\nb") == ""
    assert missing(["b", "a"], "a\nb") == "a"
    assert missing(["robot1  … up"], "robot12   is long up") == ""
    assert missing(["robot1 up"], "robot1 down") == "robot1 up"


def test_every_mark_of_the_manual_is_one() -> None:
    pages = [ROOT / "README.md", *sorted((ROOT / "docs").glob("*.md"))]
    assert sum(len(blocks(page)) for page in pages) > 0


def test_readers_see_the_name_of_every_file_that_they_are_to_write() -> None:
    """It stands in the text before the block, since the mark is a comment."""
    unseen = []
    for page in sorted((ROOT / "docs").glob("*.md")):
        text = page.read_text(encoding="utf-8")
        for mark in re.finditer(r"^<!-- file: (\S+) -->\n", text, re.MULTILINE):
            if f"`{mark[1]}`" not in "\n".join(text[: mark.start()].splitlines()[-4:]):
                unseen.append(f"{page.name}: {mark[1]}")
    assert unseen == []
