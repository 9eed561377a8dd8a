"""How a bundle is cited and what may be done with it: CITATION.cff and LICENSE. Pure.

Where the experiment's folder has such a file, it is taken as it is; else it follows from the EDF.

Source: Citation File Format 1.2.0; https://spdx.org/licenses.
"""

from __future__ import annotations

import json
import re

from srprov.evidence.crate_base import Told, ended_utc
from srprov.untrusted import string

CITATION, LICENSE = "CITATION.cff", "LICENSE"
LICENSES = ("LICENSE", "LICENSE.txt", "LICENSE.md", "COPYING")
"""Names that such a file has in the experiment's folder; the first that is there counts."""
_SPDX = frozenset(
    ("0BSD", "AGPL-3.0-only", "AGPL-3.0-or-later", "Apache-2.0", "BSD-2-Clause", "BSD-3-Clause", "CC-BY-3.0",
     "CC-BY-4.0", "CC-BY-NC-4.0", "CC-BY-NC-SA-4.0", "CC-BY-ND-4.0", "CC-BY-SA-4.0", "CC0-1.0", "EPL-2.0",
     "EUPL-1.2", "GPL-2.0-only", "GPL-2.0-or-later", "GPL-3.0-only", "GPL-3.0-or-later", "ISC", "LGPL-2.1-only",
     "LGPL-2.1-or-later", "LGPL-3.0-only", "LGPL-3.0-or-later", "MIT", "MPL-2.0", "ODbL-1.0", "ODC-By-1.0",
     "PDDL-1.0", "Unlicense", "Zlib")
)  # fmt: skip
"""Identifiers of licenses that experiments and data have; another one is told as it stands."""
_ORCID = re.compile(r"\(?\s{0,8}(https://orcid\.org/(\d{4}-\d{4}-\d{4}-\d{3}[\dX]))\s{0,8}\)?", re.ASCII)


def authors(told: Told) -> list[tuple[str, str]]:
    """Return the experiment's authors: name, and ORCID (without its address) or nothing."""
    return [_author(word) for word in told.story.definitions.experiment.authors]


def _author(word: str) -> tuple[str, str]:
    orcid = _ORCID.search(word)
    return _ORCID.sub("", word).partition("<")[0].strip() or "unnamed", orcid[2] if orcid else ""


def given(told: Told, key: str) -> str:
    """Return what the EDF says under a key for readers, or nothing."""
    return string(told.story.definitions.experiment.metadata.get(key))


def is_spdx(name: str) -> bool:
    """Return whether a license's name is a known identifier of SPDX."""
    return name in _SPDX


def title(told: Told) -> str:
    """Return what the bundle is called."""
    return f"{told.story.definitions.experiment.name}: run {told.story.run}"


def citation(told: Told) -> bytes:
    """Return CITATION.cff; JSON texts are YAML."""
    if (own := told.own.get(CITATION)) is not None:
        return own
    people = authors(told) or [("The authors of the experiment", "")]
    lines = [
        "cff-version: 1.2.0",
        "message: If you use these data, please cite them as below.",
        f"title: {_text(title(told))}",
        "type: dataset",
        f"date-released: {ended_utc(told.story)[:10]}",
        "authors:",
    ]
    for name, orcid in people:
        lines += [f"  - name: {_text(name)}", *([f'    orcid: "https://orcid.org/{orcid}"'] if orcid else [])]
    license_, doi = given(told, "license"), given(told, "doi")
    lines += [f"license: {_text(license_)}"] if license_ else []
    if doi:
        lines += ["references:", "  - type: article", f"    doi: {_text(doi)}",
                  f"    title: {_text(told.story.definitions.experiment.name)}", "    authors:"]  # fmt: skip
        lines += [f"      - name: {_text(name)}" for name, _ in people]
    return ("\n".join(lines) + "\n").encode("utf-8", "replace")


def license_text(told: Told) -> bytes:
    """Return LICENSE: the experiment's own file, or what its EDF says."""
    if (own := next((told.own[name] for name in LICENSES if name in told.own), None)) is not None:
        return own
    name = given(told, "license")
    if not name:
        text = """\
The experiment states no license, and there is no file of one in its folder.
Ask its authors before you use these data or definitions.
"""
    elif is_spdx(name):
        text = f"""\
SPDX-License-Identifier: {name}

That is what the experiment's definition (EDF) says of itself; its folder holds no text of the license.
The text: https://spdx.org/licenses/{name}.html
"""
    else:
        text = f"""\
{name}

That is all that the experiment's definition (EDF) says of its license; ask its authors for the text.
"""
    return text.encode("utf-8", "replace")


def _text(text: str) -> str:
    return json.dumps(text, ensure_ascii=False)
