"""Image references in user files -> problems where one is none, with what to write instead.

Takes the text of `image` or `base`, or what stands after FROM; gives problems. Pure: whether a registry has the image
is not asked.
"""

from __future__ import annotations

from srprov.codes import Code
from srprov.image_reference import parse_reference
from srprov.yamldoc.nodes import Findings, Node, Path, Scalar

_EXAMPLES = "for example ros:humble, or registry.example:5000/team/image:1.2"


def check(node: Node | None, findings: Findings, path: Path) -> None:
    """Add an `image` or `base` that is no image reference."""
    if isinstance(node, Scalar) and (wrong := fault(node.text)):
        findings.add(node, wrong, path, hint(node.text), code=Code.IMAGE_NAME)


def fault(text: str) -> str:
    """Return what is wrong with an image reference, or nothing."""
    try:
        parse_reference(text)
    except ValueError as error:
        return str(error)
    return ""


def hint(text: str) -> str:
    """Return what to write instead of a text that is no image reference."""
    if "$" in text or "{{" in text:
        return "no variables are substituted here: write the name out"
    name, at, _ = text.partition("@")
    if at and not fault(name):
        return f"leave the digest out, or write all of it: `docker image inspect {name}` shows it"
    head, slash, last = text.rpartition("/")
    repository, colon, tag = last.partition(":")
    lower = f"{head.lower()}{slash}{repository.lower()}{colon}{tag}"
    return _EXAMPLES if lower == text or fault(lower) else f"did you mean '{lower}'?"
