"""Desired resources and what was found -> a Plan. Pure.

Steps in order, each with its cause, what it needs and its exact commands.
"""

from __future__ import annotations

from srprov.planning.diff import Removal, diff, removal_plan
from srprov.planning.plan import Plan, PlaybookUse, Step

__all__ = ["Plan", "PlaybookUse", "Removal", "Step", "diff", "removal_plan"]
