"""Exit codes that verbs give by themselves; an error brings its own, see `errors.py`."""

from __future__ import annotations

BUG = 1
DIFFERENCES = 2
"""`plan --detailed-exitcode` found something to change."""
FAILED = 3
UNREACHABLE = 4
USAGE = 5
INTERRUPTED = 130
