"""The real Docker Compose as the judge of what is written for it, and its copy for robots of the lab."""

from __future__ import annotations

import json
import os
import subprocess
from pathlib import Path
from typing import Any

import pytest

from tests import compose_oracle

DEADLINE_S = 60


def binary() -> str:
    """Return the path of the program; whoever asks on another kind of machine is skipped."""
    if not compose_oracle.AVAILABLE:
        pytest.skip("Docker Compose is there for x86-64 alone")
    return str(compose_oracle.program())


def config(folder: Path, **environ: str) -> tuple[dict[str, Any], str]:
    """Return what Compose makes of the file in a folder, with `$$` as `$`, and what it says on standard error.

    Raises:
        AssertionError: It refuses the file.
    """
    done = subprocess.run(
        [binary(), "--profile", "*", "config", "--format", "json"], cwd=folder, capture_output=True, text=True,
        timeout=DEADLINE_S, check=False, env={"PATH": os.environ["PATH"], "HOME": str(folder), **environ},
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    found = json.loads(done.stdout.replace("$$", "$"))
    assert isinstance(found, dict)
    return found, done.stderr
