"""`python -m tools.site [FOLDER]`: build the site, `build/site` by default; a warning is an error."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from pathlib import Path

from tools.site.stage import stage

ROOT = Path(__file__).resolve().parents[2]
SETTINGS = Path(__file__).parent
_INDEX = (
    '<!doctype html><meta charset="utf-8"><title>srprov</title><meta http-equiv="refresh" content="0; url=README.html">'
)


def build(folder: Path) -> int:
    """Build the site into a folder, from a stage beside it; return Sphinx's exit code."""
    staged = folder.with_name(f"{folder.name}-source")
    for old in (folder, staged):
        shutil.rmtree(old, ignore_errors=True)
    pages = stage(ROOT, staged)
    print(f"site: {len(pages)} pages; sphinx-build -W", flush=True)
    words = ["-W", "--keep-going", "-q", "-b", "html", "-c", str(SETTINGS), "-d", str(staged / ".doctrees")]
    environment = {**os.environ, "PYTHONPATH": str(ROOT)}
    program = [sys.executable, "-m", "sphinx", *words, str(staged), str(folder)]
    code = subprocess.run(program, env=environment, check=False).returncode
    if code == 0:
        (folder / "index.html").write_text(_INDEX, encoding="utf-8")
    return code


def main() -> int:
    folder = Path(sys.argv[1]) if len(sys.argv) > 1 else ROOT / "build" / "site"
    code = build(folder)
    if code == 0:
        print(f"site: {folder / 'README.html'}")
    return code


if __name__ == "__main__":
    sys.exit(main())
