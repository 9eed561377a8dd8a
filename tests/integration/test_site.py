"""The manual as a site: Sphinx finds nothing to warn of, and a built page asks no other host for anything."""

from __future__ import annotations

import re
import subprocess
import sys
from pathlib import Path

import pytest

from tests.pages import ROOT

pytestmark = pytest.mark.soak  # half a minute, and it takes the extra `docs`

ASKED = re.compile(
    r"""<(?:script|img|iframe|source|audio|video|embed)\b[^>]*\bsrc=["'](?:https?:)?//"""
    r"""|<link\b[^>]*\brel=["'](?:stylesheet|preload|icon|preconnect|modulepreload)["'][^>]*href=["'](?:https?:)?//"""
    r"""|@import\s+(?:url\()?["']?(?:https?:)?//|url\(\s*["']?(?:https?:)?//"""
)


def test_the_site_is_built_without_a_warning_and_asks_nobody(tmp_path: Path) -> None:
    folder = tmp_path / "site"
    done = subprocess.run(
        [sys.executable, "-m", "tools.site", str(folder)], cwd=ROOT, capture_output=True, text=True, timeout=400
    )
    assert done.returncode == 0, done.stderr
    pages = sorted(folder.rglob("*.html"))
    assert len(pages) > 80 and (folder / "reference/verbs/apply.html") in pages
    files = [*pages, *folder.rglob("*.css"), *folder.rglob("*.svg")]
    asked = {path.relative_to(folder).as_posix(): ASKED.findall(path.read_text(encoding="utf-8")) for path in files}
    assert {name: found for name, found in asked.items() if found} == {}
    apply = (folder / "reference/verbs/apply.html").read_text(encoding="utf-8")
    assert "--allow" in apply and "SRPROV_APPLY_ALLOW" in apply
    assert 'href="docs/tutorial.html"' in (folder / "README.html").read_text(encoding="utf-8")


@pytest.mark.parametrize(
    ("markup", "asks"),
    [
        ('<script src="https://cdn.example/x.js">', True),
        ("<img src='//cdn.example/x.png'>", True),
        ('<link rel="stylesheet" type="text/css" href="https://cdn.example/x.css">', True),
        ("@import url(https://cdn.example/x.css)", True),
        ('<a href="https://example.org">', False),
        ('<script src="_static/x.js">', False),
    ],
)
def test_what_asks_is_found(markup: str, asks: bool) -> None:
    assert bool(ASKED.search(markup)) == asks
