"""A robot whose programs say more than any robot has: this machine, asked over its own shell, with another `ip`."""

from __future__ import annotations

import os
import subprocess
import sys
import time
from pathlib import Path

import pytest

IP = r"""#!/bin/sh
many() {
  awk -v text="$1" 'BEGIN { printf "["; for (i = 0; i < 60000; i++) printf "%s" text, i ? "," : "", i; print "]" }'
}
case "$0 $*" in
  *bridge*" fdb show") many '{"ifname":"srpv%d","mac":"0","dst":"1"}' ;;
  *"addr show") many '{"ifname":"srpv%d","linkinfo":{"info_kind":"vxlan"}}' ;;
  *) echo '[]' ;;
esac
"""
"""60,000 links, and as many entries of them."""


@pytest.mark.skipif(os.geteuid() != 0, reason="needs root, as a robot's shell is root's")
def test_links_without_end_are_read_soon_and_not_believed(tmp_path: Path) -> None:
    """Each entry was looked at for each link once: 3.6 thousand million times, while all other robots waited."""
    for name in ("ip", "bridge"):
        (tmp_path / name).write_text(IP)
        (tmp_path / name).chmod(0o755)
    (tmp_path / "i.yml").write_text("all: {hosts: {talker: {ansible_connection: local}}}\n")
    home = {"HOME": str(tmp_path / "home"), "XDG_CACHE_HOME": str(tmp_path / "cache")}
    began = time.monotonic()
    asked = subprocess.run(
        [sys.executable, "-m", "srprov", "facts", "-i", "i.yml"], cwd=tmp_path, capture_output=True, text=True,
        env={**os.environ, **home, "PATH": f"{tmp_path}:{os.environ['PATH']}"}, timeout=60, check=False,
    )  # fmt: skip
    assert asked.returncode == 4 and "more than 1000 things of the kind vxlan" in asked.stderr, asked
    assert time.monotonic() - began < 30
