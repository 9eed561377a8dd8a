"""EDF -> what of it validates but is not built yet.

Takes the root of an EDF; adds one problem per use, at its line. Pure. `srprov validate` accepts these, whatever would
act refuses them: nothing is accepted and ignored.
"""

from __future__ import annotations

from srprov.yamldoc.nodes import Findings, Map, Path, Scalar


def note_unsupported(root: Map, findings: Findings) -> None:
    """Add every use of what is not built yet."""
    services = root.entries.get("services")
    for name, entry in services.entries.items() if isinstance(services, Map) else ():
        if isinstance(entry, Map):
            _service(entry, ("services", name), findings)
    network = root.entries.get("network")
    for key, built in (("encryption", "none"), ("discovery", "multicast")):
        wanted = network.entries.get(key) if isinstance(network, Map) else None
        if isinstance(wanted, Scalar) and wanted.text != built:
            findings.add(wanted, f"'{key}: {wanted.text}' is not supported yet", ("network", key), f"only {built} is")


def _service(entry: Map, path: Path, findings: Findings) -> None:
    get = entry.entries.get
    network = get("network")
    if isinstance(network, Scalar) and network.text == "both":
        findings.add(network, "'network: both' is not supported yet", (*path, "network"), "use overlay or host")
