"""What a git repository has of an experiment's files: the commit, and which files differ from it.

Takes a `Planned` and its files' contents; asks git for names of objects only, in a repository that has the objects and
nothing else: the settings of this one are a stranger's, and lead git to other files. A file is compared by the name
that git would give to its content. Git's own words are not kept: they may repeat what others wrote.
"""

from __future__ import annotations

import hashlib
import os
from collections.abc import Mapping
from typing import Any

from srprov.controller.input_files import InputFile
from srprov.controller.plan import Planned
from srprov.git import lent, program
from srprov.git.head import checkout_of

_LOOK_S = 2.0
"""A record waits for it."""
_MOST_LISTED = 32 << 20
"""Bytes of a commit's list of files: some 300,000."""
_SHA1_DIGITS = 40


def source_commit(planned: Planned, files: Mapping[str, InputFile]) -> dict[str, Any] | None:
    """Return where the EDF lies as the record has it; None of a plan from a file.

    `changed` are files that differ from the commit, `added` those that it has not. One whose line ends git converts
    counts as changed.
    """
    if planned.definitions is None:
        return None
    experiment = planned.definitions.experiment
    about: dict[str, Any] = {"file": experiment.file}
    checkout = checkout_of(experiment.folder)
    if checkout is None:
        return {**about, "commit": None, "problem": "not a git repository, or none whose commit can be told"}
    top, objects, commit = checkout
    try:
        look = ["ls-tree", "-r", "-z", "--full-tree", commit]
        with lent.repository(commit, objects) as folder:
            listed = program.run(look, repository=folder, most=_MOST_LISTED, seconds=_LOOK_S, memory=program.OF_A_LOOK)
    except (program.GitError, OSError):
        return {**about, "commit": None, "problem": "git cannot list the files of its commit"}
    there = _objects(listed)
    changed, added = list[str](), list[str]()
    for path, one in sorted(files.items()):
        name = os.path.relpath(os.path.realpath(os.path.join(experiment.folder, path)), os.path.realpath(top))
        if one.link is not None or name.startswith(".."):
            continue
        if name not in there:
            added.append(path)
        elif there[name] != _object(one.content, len(there[name])):
            changed.append(path)
    return {**about, "commit": commit, "dirty": bool(changed or added), "changed": changed, "added": added}


def _objects(listed: bytes) -> dict[str, str]:
    """Return path -> the name of its object, from `MODE blob NAME<tab>PATH`."""
    found = {}
    for entry in listed.split(b"\0"):
        about, tab, path = entry.partition(b"\t")
        words = about.split()
        if tab and len(words) == 3 and words[1] == b"blob":
            found[os.fsdecode(path)] = words[2].decode("ascii", "replace")
    return found


def _object(content: bytes, digits: int) -> str:
    """Return the name that git gives to a file's content, which is a hash."""
    data = b"blob %d\0%b" % (len(content), content)
    if digits == _SHA1_DIGITS:
        return hashlib.sha1(data, usedforsecurity=False).hexdigest()
    return hashlib.sha256(data).hexdigest()
