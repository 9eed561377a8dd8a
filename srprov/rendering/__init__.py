"""Playbooks and a context -> Resources, in Jinja2's sandbox. Pure.

A playbook says what should be true on one robot: YAML with Jinja2 in it, no shell. `render` gives the resources of
one robot.
"""

from __future__ import annotations

from srprov.rendering.render import render

__all__ = ["render"]
