"""A controller's files, in memory."""

from collections.abc import Iterable

from srprov.images.plan import ListedFile


class Disk:
    """Files by absolute path; `x` marks executables, `links` has symbolic links."""

    def __init__(self, files: dict[str, bytes], x: tuple[str, ...] = (), links: dict[str, str] | None = None) -> None:
        self.files, self.x, self.links = files, x, links or {}

    def read(self, path: str) -> bytes:
        if path not in self.files:
            raise FileNotFoundError(2, "No such file or directory", path)
        return self.files[path]

    def listing(self, path: str) -> Iterable[ListedFile]:
        if path in self.files:
            return [ListedFile("", path in self.x)]
        inside = [name for name in self.files if name.startswith(path + "/")]
        if not inside:
            raise FileNotFoundError(2, "No such file or directory", path)
        below = [ListedFile(name[len(path) + 1 :], name in self.x) for name in inside]
        return below + [
            ListedFile(name[len(path) + 1 :], link=to) for name, to in self.links.items() if name.startswith(path)
        ]
