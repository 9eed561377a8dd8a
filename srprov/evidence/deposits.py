"""What archives ask for when a bundle is deposited: `.zenodo.json` and `datacite.json`. Pure.

Only what the experiment or the inventory says: a DOI and a publisher come with the deposit.

Source: the fields of a Zenodo deposit (https://developers.zenodo.org); DataCite Metadata Schema 4.5, with its code
`:tba` for what will be assigned; PIDINST for instruments (https://docs.pidinst.org).
"""

from __future__ import annotations

import json
import re
from collections.abc import Iterator
from typing import Any

from srprov.evidence.citation import authors, given, is_spdx, title
from srprov.evidence.crate_base import Told, ended_utc
from srprov.untrusted import mapping, string

ZENODO, DATACITE = ".zenodo.json", "datacite.json"
_DOI = re.compile(r"(?:https?://(?:dx\.)?doi\.org/|doi:)?(10\.\d{4,9}/\S+)", re.ASCII)
_HANDLE = re.compile(r"(?:https?://hdl\.handle\.net/|hdl:)?(\d+(?:\.\w+)*/\S+)", re.ASCII)


def zenodo(told: Told) -> bytes:
    """Return `.zenodo.json`."""
    paper, license_ = given(told, "doi"), given(told, "license")
    related = [{"identifier": paper, "relation": "isSupplementTo"}] if paper else []
    found = {
        "title": title(told),
        "upload_type": "dataset",
        "description": _description(told),
        "creators": [{"name": name, **({"orcid": orcid} if orcid else {})} for name, orcid in authors(told)],
        "publication_date": ended_utc(told.story)[:10],
        "keywords": ["robotics", "reproducibility", "srprov"],
        **({"license": license_.lower()} if is_spdx(license_) else {}),
        **({"related_identifiers": related} if related else {}),
    }
    return _written(found)


def datacite(told: Told) -> bytes:
    """Return `datacite.json`."""
    license_, ended = given(told, "license"), ended_utc(told.story)[:10]
    found: dict[str, Any] = {
        "schemaVersion": "http://datacite.org/schema/kernel-4",
        "types": {"resourceTypeGeneral": "Dataset", "resourceType": "Run of trials"},
        "titles": [{"title": title(told)}],
        "creators": [_creator(name, orcid) for name, orcid in authors(told)],
        "publisher": {"name": ":tba"},
        "publicationYear": ended[:4],
        "dates": [{"date": ended, "dateType": "Collected"}],
        "descriptions": [{"description": _description(told), "descriptionType": "Abstract"}],
        "formats": ["application/zip"],
    }
    if license_:
        found["rightsList"] = [_rights(license_)]
    if related := list(_all_related(told)):
        found["relatedIdentifiers"] = related
    return _written(found)


def _rights(license_: str) -> dict[str, str]:
    if not is_spdx(license_):
        return {"rights": license_}
    return {
        "rights": license_,
        "rightsIdentifier": license_,
        "rightsIdentifierScheme": "SPDX",
        "rightsUri": f"https://spdx.org/licenses/{license_}.html",
    }


def instruments(told: Told) -> Iterator[tuple[str, str]]:
    """Return the robots that have a persistent identifier in the inventory, with it."""
    for name, host in sorted(mapping(mapping(told.inventory.get("all")).get("hosts")).items()):
        if pid := string(mapping(host).get("srprov_pid")):
            yield name, pid


def _all_related(told: Told) -> Iterator[dict[str, str]]:
    if paper := given(told, "doi"):
        yield _related(paper, "IsSupplementTo")
    for _, pid in instruments(told):
        yield _related(pid, "IsCollectedBy")


def _related(text: str, relation: str) -> dict[str, str]:
    if doi := _DOI.fullmatch(text):
        kind, name = "DOI", doi[1]
    elif handle := _HANDLE.fullmatch(text):
        kind, name = "Handle", handle[1]
    else:
        kind, name = "URL", text
    return {"relatedIdentifier": name, "relatedIdentifierType": kind, "relationType": relation}


def _creator(name: str, orcid: str) -> dict[str, Any]:
    known = {"nameIdentifier": f"https://orcid.org/{orcid}", "nameIdentifierScheme": "ORCID",
             "schemeUri": "https://orcid.org"}  # fmt: skip
    return {"name": name, **({"nameIdentifiers": [known]} if orcid else {})}


def _description(told: Told) -> str:
    about = told.story.definitions.experiment.description or "The experiment has no description."
    return f"{about} A run of trials by srprov: definitions, robots, every attempt, results, and a hash of each file."


def _written(found: dict[str, Any]) -> bytes:
    return (json.dumps(found, indent=2, ensure_ascii=False) + "\n").encode("utf-8", "replace")
