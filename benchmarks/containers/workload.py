"""The workloads, one run of one of them: what a robot's program does, with the time of each of its items.

    python3 workload.py cpu|memory|vision ITEMS

Prints JSON: seconds of each item, and a digest of all that was computed, which is the same wherever it runs. Needs
numpy and OpenCV, and nothing of this repository: it is run in a container and natively from the same files.

`vision` stands in for SLAMBench, whose data set has 881 frames. A frame has the steps that the paper has: acquisition
(a view of a made-up floor, from a camera that moves), pre-processing (a bilateral filter, as KinectFusion's), tracking
(Lucas and Kanade's optical flow of corners, and the motion that fits them), integration (into a map), and rendering
(of the map's part in view).
"""

from __future__ import annotations

import hashlib
import json
import math
import random
import sys
import time
from collections.abc import Callable

import cv2
import numpy as np

SIZE = (320, 240)
_FLOOR = 1024
_CORNERS, _FEWEST = 300, 150


class Cpu:
    """Plain Python, and OpenSSL: hashes, sorting, arithmetic on whole numbers."""

    def __init__(self) -> None:
        self.random = random.Random(1)
        self.block = self.random.randbytes(1 << 20)

    def item(self, number: int) -> str:
        """Do a fixed amount of work; give what came out."""
        numbers = sorted(self.random.random() for _ in range(20_000))
        product = 1
        for factor in range(1, 1500):
            product = product * (factor | 1) % (1 << 521)
        return hashlib.sha256(self.block + repr((numbers[0], numbers[-1], product, number)).encode()).hexdigest()


class Memory:
    """64 MiB, more than caches hold: copied in a row, and read all over the place."""

    def __init__(self) -> None:
        source = np.random.default_rng(1)
        self.cells = source.integers(0, 1 << 62, size=8 << 20, dtype=np.int64)
        self.other = np.empty_like(self.cells)
        self.places = source.integers(0, self.cells.size, size=500_000)

    def item(self, number: int) -> str:
        """Copy all, and sum half a million cells."""
        np.copyto(self.other, self.cells)
        self.cells[number] += 1
        return str(int(np.take(self.other, self.places).sum()))


class Vision:
    """A camera over a floor: where is it, and what has it seen?"""

    def __init__(self) -> None:
        noise = np.random.default_rng(1).integers(0, 256, size=(_FLOOR // 8, _FLOOR // 8), dtype=np.uint8)
        self.floor = cv2.GaussianBlur(cv2.resize(noise, (_FLOOR, _FLOOR), interpolation=cv2.INTER_CUBIC), (0, 0), 1.5)
        self.grain = np.random.default_rng(2).normal(0, 2, size=(SIZE[1], SIZE[0])).astype(np.float32)
        self.map = np.zeros((_FLOOR, _FLOOR), np.float32)
        self.before: np.ndarray | None = None
        self.corners = np.empty((0, 1, 2), np.float32)
        self.pose = self.truth(0)

    def truth(self, number: int) -> np.ndarray:
        """Return where the camera is at a frame: a matrix from its picture to the floor."""
        turn, at = number / 140, 2 * math.pi * number / 881
        center = (_FLOOR / 2 + 250 * math.cos(at), _FLOOR / 2 + 250 * math.sin(at))
        matrix = np.array(
            [[math.cos(turn), -math.sin(turn), 0], [math.sin(turn), math.cos(turn), 0], [0, 0, 1]], np.float64
        )
        middle = matrix[:2, :2] @ np.array([SIZE[0] / 2, SIZE[1] / 2])
        matrix[:2, 2] = center - middle
        return matrix

    def item(self, number: int) -> str:
        """Process one frame; give where the camera is believed to be."""
        flags = cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP
        seen = cv2.warpAffine(self.floor, self.truth(number)[:2], SIZE, flags=flags)
        frame = cv2.bilateralFilter(np.clip(seen + self.grain, 0, 255).astype(np.uint8), 5, 20, 5)
        self.track(frame)
        view = cv2.warpAffine(frame.astype(np.float32), self.pose[:2], (_FLOOR, _FLOOR))
        cv2.accumulateWeighted(view, self.map, 0.2, (view > 0).astype(np.uint8))
        shown = cv2.warpAffine(self.map, self.pose[:2], SIZE, flags=flags)
        return f"{self.pose[0, 2]:.1f} {self.pose[1, 2]:.1f} {float(shown.mean()):.0f}"

    def track(self, frame: np.ndarray) -> None:
        """Follow the corners of the last frame into this one, and move the pose as they moved."""
        if self.before is not None and len(self.corners):
            found, state, _ = cv2.calcOpticalFlowPyrLK(self.before, frame, self.corners, None)
            good = state.ravel() == 1
            step, _ = cv2.estimateAffinePartial2D(found[good], self.corners[good])
            if step is not None:
                self.pose = self.pose @ np.vstack([step, [0, 0, 1]])
            self.corners = found[good]
        if len(self.corners) < _FEWEST:
            new = cv2.goodFeaturesToTrack(frame, _CORNERS, 0.01, 7)
            self.corners = new if new is not None else np.empty((0, 1, 2), np.float32)
        self.before = frame


WORKLOADS: dict[str, Callable[[], Cpu | Memory | Vision]] = {"cpu": Cpu, "memory": Memory, "vision": Vision}


def main() -> None:
    """Run a workload."""
    cv2.setNumThreads(1)
    cv2.setRNGSeed(1)
    work, count, digest = WORKLOADS[sys.argv[1]](), int(sys.argv[2]), hashlib.sha256()
    seconds = []
    for number in range(count):
        begun = time.perf_counter()
        said = work.item(number)
        seconds.append(round(time.perf_counter() - begun, 6))
        digest.update(said.encode())
    versions = {"python": sys.version.split()[0], "numpy": np.__version__, "opencv": cv2.__version__}
    print(json.dumps({"seconds": seconds, "digest": digest.hexdigest(), "last": said, "versions": versions}))


if __name__ == "__main__":
    main()
