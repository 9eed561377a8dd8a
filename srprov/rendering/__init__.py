"""Playbooks and a context -> Resources, in Jinja2's sandbox. Pure.

A playbook says what should be true on one robot: YAML with Jinja2 in it, no shell. `render` gives the resources of
one robot, `render_all` of all of them, with the playbooks that users add. chain.py puts those in order, user.py renders
one of them; what shipped and what users wrote differs in how mistakes are told.
"""

from __future__ import annotations

from srprov.rendering.chain import render_all
from srprov.rendering.render import render

__all__ = ["render", "render_all"]
