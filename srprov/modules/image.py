"""Images: present on a robot under a tag or digest.

Wanted parameters: `source` is `pull`, `build` (with `blob`, the build context as a tar) or `copy` (with `from`, the
robot that has it). Whether it is right is a question of its name alone: a built image's tag is a hash of all that
went in, and a digest is one by nature. Images are nobody's: they are never removed as orphans.

Source: Docker Engine API 1.41, "Build an image", "Create an image".
"""

from __future__ import annotations

from collections.abc import Sequence

from srprov.modules.module import as_labels, as_list, as_text
from srprov.resource import Action, Change, Observed, Resource, State
from srprov.wire import AnyQuery, Command, CopyImage, EngineCall, EngineQuery, Reply

_LONG_S = 1800.0


class ImageModule:
    """The module of kind `image`."""

    kind = "image"

    def queries(self) -> tuple[AnyQuery, ...]:
        """List all images."""
        return (EngineQuery(path="/images/json"),)

    def parse(self, replies: Sequence[Reply]) -> tuple[Observed, ...]:
        """Return one entry for every tag and every digest."""
        if not replies[0].ok:
            return ()
        found = []
        for item in as_list(replies[0].json()):
            state = {"id": as_text(item.get("Id")), "labels": as_labels(item.get("Labels"))}
            for names in (item.get("RepoTags"), item.get("RepoDigests")):
                for name in names if isinstance(names, list) else ():
                    if "<none>" not in str(name):
                        found.append(Observed(module="image", name=str(name), instance="", state=state))
        return tuple(found)

    def check(self, want: Resource, found: State | None) -> Change | None:
        """Ask only whether it is there."""
        if found is not None:
            return None
        how = {
            "pull": "pulled by the robot",
            "build": "built here",
            "copy": f"copied from {want.params.get('from', '')}",
        }[want.params["source"]]
        note = "; base not pinned" if want.params.get("unpinned") else ""
        return Change(action=Action.CREATE, cause=f"not on the robot; {how}{note}")

    def commands(self, want: Resource, change: Change) -> tuple[Command, ...]:
        """Pull, build, or copy."""
        source = want.params["source"]
        if source == "copy":
            return (CopyImage(image=want.name, source_host=want.params["from"], timeout_s=_LONG_S),)
        if source == "pull":
            name, _, digest = want.name.partition("@")
            repository, _, tag = (name, "", digest) if digest else want.name.rpartition(":")
            params = (("fromImage", repository), ("tag", tag))
            return (EngineCall(method="POST", path="/images/create", params=params, stream=True, timeout_s=_LONG_S),)
        # rm and forcerm: a failed build leaves no container behind
        wishes = (("dockerfile", "Dockerfile"), ("forcerm", "true"), ("rm", "true"), ("t", want.name))
        blob = want.params["blob"]
        return (EngineCall(method="POST", path="/build", params=wishes, blob=blob, stream=True, timeout_s=_LONG_S),)

    def removal(self, found: Observed) -> tuple[Command, ...]:
        """Untag; layers go when nothing else needs them."""
        return (EngineCall(method="DELETE", path=f"/images/{found.name}", accept=(200, 404)),)
