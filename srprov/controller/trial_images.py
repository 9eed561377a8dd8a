"""Which images a run of trials had, on which robots, and which variables: kept by this machine, for a bundle of it.

The folder of a run may come from a stranger, and which image a container has is the word of its robot: either may name
one of another experiment by its id, which records tell. So the machine that runs trials remembers who said what. A run
is known by a secret in its folder, which no bundle holds; what its folder says of images is not believed. Nor is what
it says of variables: by whether there is a bundle, one that nobody gave to the run could be guessed.
"""

from __future__ import annotations

import os
import re
import secrets
from collections.abc import Collection, Mapping
from pathlib import Path

import msgspec

from srprov import private, regular_file
from srprov.controller.built_here import counting
from srprov.controller.trial_plan import TrialPlan
from srprov.controller.trial_sameness import Sameness, containers_of
from srprov.definitions.model import Inventory
from srprov.definitions.secretvalues import used
from srprov.modules.container_params import ContainerParams
from srprov.record.memory import note_ran, who_ran
from srprov.session import Session

_FILE = "token"
_TOKEN = re.compile("[0-9a-f]{32}")
_LONGEST = 100


class Ran(msgspec.Struct, frozen=True):
    """What this machine remembers of one run."""

    token: str
    """Empty: no run of this machine."""

    def robots(self, image: str, names: Collection[str]) -> frozenset[str]:
        """Return the robots, by `identity`, that had an image under one of its names when they ran it."""
        known = who_ran() if self.token else {}
        return frozenset(robot for name in names for robot in known.get(_key(self.token, name, image), ()))

    def counting(self, tags: Collection[str]) -> dict[str, dict[str, frozenset[str]]]:
        """Return content tag -> architecture of who built it -> ids of the images that counted; see `built_here`."""
        known, found = who_ran() if self.token else {}, dict[str, dict[str, frozenset[str]]]()
        for tag in tags:
            begin = _key(self.token, tag, "")
            of = {key.removeprefix(begin): some for key, some in known.items() if key.startswith(begin)}
            found[tag] = {arch: ids for arch, ids in of.items() if ":" not in arch}  # with it, it is an image's id
        return found

    def variables(self) -> frozenset[str]:
        """Return the names of this machine's variables that the user let the run have."""
        return who_ran().get(_variables_of(self.token), frozenset()) if self.token else frozenset()


def ran(folder: Path) -> Ran:
    """Return what is remembered of the run in a folder."""
    try:
        path = os.path.realpath(folder) + f"/{_FILE}"
        content, about = regular_file.read_with_status(path, _LONGEST, real=True)
    except OSError:
        return Ran("")
    if regular_file.has_further_names(about):  # an archive may have made it that of the user's own run
        return Ran("")
    text = content.decode("ascii", "replace")
    return Ran(text.strip() if _TOKEN.fullmatch(text.strip()) else "")


def remember(
    folder: Path, plan: TrialPlan, same: Sameness, sessions: Mapping[str, Session], inventory: Inventory
) -> str:
    """Keep a run's images, which of them count as built, and its variables; return why not, or nothing.

    Raises:
        OSError: The folder cannot be written.
    """
    if not (token := ran(folder).token):
        token = secrets.token_hex(16)
        private.replace_file(folder / _FILE, f"{token}\n")
    had = {f"{token} {key}": ids for key, ids in counting(plan.base, inventory, sessions).items()}
    for one in containers_of(plan):
        assert isinstance(one.params, ContainerParams)
        if (image := same.get(f"{one.service}: image id")) and one.host in sessions:
            had.setdefault(_key(token, one.params.image, image), set()).add(sessions[one.host].identity)
    assert plan.base.definitions is not None  # trials are never run from a plan in a file
    experiment = plan.base.definitions.experiment
    taken = {name for _, name in experiment.environment} | {one.env for one in used(experiment) if one.env}
    return note_ran({**had, _variables_of(token): taken} if taken else had)


def _variables_of(token: str) -> str:
    return f"{token} variables"


def _key(token: str, name: str, image: str) -> str:
    return f"{token} {name} {image}"
