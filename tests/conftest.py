"""How many examples property tests take, in which order two processes take the files, and whose memory they have.

Few examples by default, many with HYPOTHESIS_PROFILE=long, as `make soak` has it.
"""

from __future__ import annotations

import itertools
import os
import signal
from collections.abc import Iterable, Iterator
from pathlib import Path

import pytest
from hypothesis import settings

from srprov.secret import forget

PROFILE = os.environ.get("HYPOTHESIS_PROFILE", "quick")
LEAST = 20


def examples(most: int) -> int:
    """Return how many examples a test takes that takes `most` in the long profile: an eighth, but not too few."""
    return most if PROFILE == "long" else max(min(most, LEAST), most // 8)


# the same examples in each run: red says that something changed; new ones are looked for in the long profile
settings.register_profile("quick", deadline=None, max_examples=examples(100), derandomize=True)
settings.register_profile("long", deadline=None, max_examples=100)
settings.load_profile(PROFILE)

LONGEST = [
    *("lab/test_survival", "lab/test_examples", "lab/test_failures", "lab/test_locks", "lab/test_lab_faults"),
    *("lab/test_secrets", "fuzz/test_fuzz", "integration/test_locks", "integration/test_ssh"),
]
"""Files by how long they take; the others are shorter."""

_COUNT = itertools.count()


def pytest_configure() -> None:
    """Let Ctrl-C be Ctrl-C: whatever is started in the background ignores it, and so do its children."""
    if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
        signal.signal(signal.SIGINT, signal.default_int_handler)


@pytest.fixture(autouse=True)
def no_memory(
    request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Begin every test without the memory of runs before it, or of those in another process beside it.

    Those of the lab share what their own session remembers. The folder is there once something is written to it.
    """
    if not _in_lab(request.path):
        state = tmp_path_factory.getbasetemp() / "states" / str(next(_COUNT))
        monkeypatch.setenv("XDG_STATE_HOME", str(state))


@pytest.fixture(autouse=True, scope="module")
def no_secrets_of_others() -> Iterator[None]:
    """Forget what the tests of a file made a secret, which `redact` would hide in those of the next one."""
    yield
    forget()


def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    """Leave out what is too long for every day, unless SRPROV_SOAK asks for it.

    With pytest-xdist, two processes take files of the lab and others in turn: the lab keeps both processors busy, and
    much of the others' time is waiting.
    """
    long = [] if os.environ.get("SRPROV_SOAK") else [item for item in items if item.get_closest_marker("soak")]
    if long:
        config.hook.pytest_deselected(items=long)
        items[:] = [item for item in items if item not in long]
    if "PYTEST_XDIST_WORKER" in os.environ:
        place = places(dict.fromkeys(item.path for item in items))
        items.sort(key=lambda item: place[item.path])


def places(files: Iterable[Path]) -> dict[Path, float]:
    """Return where each file stands: of both kinds the longest come first, and whoever begins one last waits less."""
    kinds: tuple[list[Path], list[Path]] = ([], [])
    for path in sorted(files, key=_length):
        kinds[_in_lab(path)].append(path)
    return {path: at / len(kind) for kind in kinds for at, path in enumerate(kind)}


def _length(path: Path) -> int:
    name = f"{path.parent.name}/{path.stem}"
    return LONGEST.index(name) if name in LONGEST else len(LONGEST)


def _in_lab(path: Path) -> bool:
    return path.parent.name == "lab" and path.parent.parent.name == "tests"
