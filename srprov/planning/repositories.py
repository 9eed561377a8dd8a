"""What git fetches on the controller, from wherever a stranger says: words for permissions. Pure."""

from __future__ import annotations

from collections.abc import Iterator

from srprov.definitions.containermodel import ContainerDefinition

_KEYS = "; git takes your SSH keys, so what only these open is given away, your own and other robots' too"


def of_repositories(cdf: ContainerDefinition | None) -> Iterator[str]:
    """Yield what is said of each repository of a CDF."""
    for one in cdf.repositories if cdf else ():
        yield fetched(one.url, one.ref, "its files go into the image")


def fetched(url: str, ref: str, use: str) -> str:
    """Return what is said of a fetch, and of what is fetched."""
    keys = "" if url.startswith(("https:", "file:")) else _KEYS
    return f"{url}, {ref or 'its default branch'}: fetched here, {use}{keys}"
