"""The robots of this benchmark: the first one has the images, the next ones shall get them.

Images are made and robots are cleaned through their namespaces; none of that is on the lab's wire.
"""

from __future__ import annotations

import json
import subprocess
import tempfile
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
from pathlib import Path

import yaml

from benchmarks.images import content
from benchmarks.provisioning import measure
from benchmarks.provisioning.robots import SITE, Lab, Trouble
from srprov.lab import lab as labs

CLEAN = "docker image prune -af >/dev/null; rm -f /root/bench*"
BUILDER_CLEAN = (
    "docker images --format '{{.Repository}}:{{.Tag}}' | grep -vE '^(bench/|busybox)' | xargs -r docker rmi >/dev/null;"
    " rm -f /root/bench*"
)
BASE, LOWER, FRESH = "bench/base:1", "bench/lower:1", "bench/robot:fresh"
ABOVE = {"changed": (LOWER, (1000,)), "two": (BASE, (2000, 3000))}
"""Case -> the image below the layers that are new in it, and a seed for each of them."""
_BUILD_S = 600


@dataclass
class Fleet:
    """A builder, the robots that are targets, and the images that the builder has."""

    lab: Lab
    targets: Sequence[tuple[str, str]]
    """Name and address of each."""
    image_mib: int
    made: dict[str, int] = field(default_factory=dict)
    """Image -> compressed bytes of its layers that a robot with the image of the case `fresh` lacks."""

    @property
    def builder(self) -> tuple[str, str]:
        """Name and address of the robot that has the images."""
        return self.lab.robots[0]

    def inventory(self, path: Path) -> Path:
        """Write the lab's inventory with these robots alone."""
        whole = yaml.safe_load(self.lab.inventory.read_text(encoding="utf-8"))["all"]
        names = [name for name, _ in (self.builder, *self.targets)]
        path.write_text(yaml.safe_dump({"all": {**whole, "hosts": {name: whole["hosts"][name] for name in names}}}))
        return path

    def received(self) -> list[int]:
        """Return the bytes that each target has received so far, by its cable's counter."""
        return [measure.counted(self.lab.site.link(name))[0] for name, _ in self.targets]

    def clean(self) -> None:
        """Take containers and images from the targets, and from the builder what a tool made of its images."""
        self.lab.reset()
        with ThreadPoolExecutor(4) as pool:
            list(pool.map(lambda target: self.lab.enter(target[0], CLEAN), self.targets))
        self.lab.enter(self.builder[0], BUILDER_CLEAN)

    def check(self, image: str) -> None:
        """Compare the layers of what runs on every target with those of the builder's image.

        Raises:
            Trouble: They are others, or not one container runs.
        """
        wanted = json.loads(self._ask(self.builder[0], "image", "inspect", image))[0]["RootFS"]["Layers"]
        for name, _ in self.targets:
            running = self._ask(name, "ps", "-q").split()
            if len(running) != 1:
                raise Trouble(f"{name} runs {len(running)} containers, not 1")
            container = json.loads(self._ask(name, "inspect", running[0]))[0]
            if json.loads(self._ask(name, "image", "inspect", container["Image"]))[0]["RootFS"]["Layers"] != wanted:
                raise Trouble(f"{name} runs another image than {image}")

    def _ask(self, robot: str, *words: str) -> str:
        return self.lab.enter(robot, " ".join(["docker", *words]))

    def image(self, case: str, number: int) -> str:
        """Return the image of a case's repetition; made if it is not there."""
        if not self.made:
            self._make_base()
        if case not in ABOVE:
            return FRESH
        under, seeds = ABOVE[case]
        name = f"bench/robot:{case}-{number}"
        if name not in self.made:
            self.made[name] = self._build(name, [f"FROM {under}"], [(self.top_size, seed + number) for seed in seeds])
        return name

    @property
    def top_size(self) -> int:
        """Bytes of each of the two layers above the base."""
        return self.image_mib * content.MIB // content.TOP_SHARE

    def _make_base(self) -> None:
        size = (self.image_mib * content.MIB - 2 * self.top_size) // content.BASE_LAYERS
        base = [(size, seed) for seed in range(content.BASE_LAYERS)]
        whole = self._build(BASE, ["FROM busybox", "STOPSIGNAL SIGKILL", 'CMD ["sleep", "86400"]'], base)
        whole += self._build(LOWER, [f"FROM {BASE}"], [(self.top_size, 100)])
        whole += self._build(FRESH, [f"FROM {LOWER}"], [(self.top_size, 200)])
        self.made[FRESH] = whole

    def _build(self, name: str, dockerfile: Sequence[str], layers: Sequence[tuple[int, int]]) -> int:
        """Build an image on the builder; give the compressed size of its layers."""
        with tempfile.TemporaryDirectory(prefix="srprov-bench-image-") as folder:
            files = [Path(folder, f"{seed}.tar") for _, seed in layers]
            sizes = [content.write_layer(file, size, seed) for file, (size, seed) in zip(files, layers, strict=True)]
            sent = Path(folder, "context")
            content.context(sent, [*dockerfile, *(f"ADD {file.name} /" for file in files)], files)
            with sent.open("rb") as given:
                words = ["docker", "build", "-q", "-t", name, "-"]
                argv = labs.shell(SITE.name, self.builder[0], words)
                done = subprocess.run(argv, stdin=given, capture_output=True, timeout=_BUILD_S, check=False)
        if done.returncode:
            raise Trouble(f"{name} was not built: {done.stderr.decode()[-400:]}")
        return sum(sizes)
