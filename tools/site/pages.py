"""Which page stands where in the navigation; tests/unit/site holds it to the files that there are."""

from __future__ import annotations

GROUPS = {
    "Begin": ("docs/tutorial", "docs/robot", "docs/glossary", "docs/comparison"),
    "Write experiments": (
        "docs/definitions", "docs/images", "docs/assignment", "docs/network", "docs/data",
        "docs/volumes", "docs/secrets", "docs/playbooks", "docs/editors", "inventory/README",
    ),
    "Run them": (
        "docs/errors", "docs/plans", "docs/report",
        "docs/daily-use", "docs/debugging", "docs/configuration", "docs/permissions", "docs/policy", "docs/sharing",
        "docs/registries", "docs/wifi", "docs/scale", "docs/facts", "docs/records", "docs/reliability", "docs/json",
        "docs/ci",
    ),
    "Trials and evidence": ("docs/trials", "docs/evidence"),
    "From and to other tools": (
        "docs/from-ansible", "docs/from-compose", "docs/from-kubernetes", "docs/snapshot", "docs/clusters",
    ),
    "Examples": (
        "docs/lab", "examples/hello/README", "examples/chatter-ros/README", "examples/chatter-dds/README",
        "examples/chatter-fastdds/README", "examples/chatter-zenoh/README", "examples/race/README",
        "examples/search/README",
    ),
    "Reference": ("reference/verbs", "reference/fields", "CHANGELOG"),
    "Behind it": (
        "docs/architecture", "docs/walk", "docs/decisions", "docs/trust", "docs/paper", "CONTRIBUTING", "SECURITY",
        "benchmarks/provisioning/README", "benchmarks/images/README", "benchmarks/transfer/README",
        "benchmarks/network/README", "benchmarks/containers/README", "benchmarks/trials/README",
    ),
}  # fmt: skip
"""Title in the navigation -> its pages, without `.md`."""
REST = "More"
"""The title of pages below docs/, examples/ and benchmarks/ that no group names: they are shown, too."""
HOME = "README"


def arranged(found: set[str]) -> dict[str, list[str]]:
    """Return title -> pages, of those that there are; what no group names stands at the end.

    Args:
        found: All pages, without `.md`.
    """
    groups = {title: [page for page in pages if page in found] for title, pages in GROUPS.items()}
    named = {page for pages in groups.values() for page in pages} | {HOME}
    inner = {page for page in found if page.startswith("reference/") and page.count("/") > 1}
    rest = sorted(page for page in found - named - inner if not is_result(page))
    return {**groups, **({REST: rest} if rest else {})}


def is_result(page: str) -> bool:
    """Return whether a page is a table that a measurement left: it has no title, and no place in the navigation."""
    return page.startswith("benchmarks/") and "/results/" in page
