"""The house keeps its order: each room imports only what its line of the table allows, and stays small.

Everything is read with `ast`; nothing of srprov is imported. A new room, or a new import, needs a line here, where
whoever reads the change can judge it.
"""

from __future__ import annotations

import ast
import graphlib
import sys
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path

import pytest

PACKAGE = Path(__file__).resolve().parent.parent / "srprov"

LONGEST_FILE = 250
LONGEST_FUNCTION = 45
LONG_BY_NECESSITY: dict[str, str] = {}
"""File, or `file:function`, that may be longer -> the reason why cutting it would make it worse. Empty is best."""


@dataclass(frozen=True)
class Room:
    """What one room may import besides itself and the standard library."""

    ours: frozenset[str] | None = frozenset()
    """Rooms, modules or names below `srprov.`; None: all of them."""
    foreign: frozenset[str] | None = frozenset()
    """Top-level names of installed libraries; None: any."""


def room(ours: str = "", foreign: str = "") -> Room:
    """Write a line of the table as words."""
    return Room(frozenset(ours.split()), frozenset(foreign.split()))


ROOMS: Mapping[str, Room] = {
    "__init__": room(),
    "__main__": room("cli"),
    # Options, questions and output; a verb may also import the room that it fronts: see FILES.
    "cli": room(
        "believed whose codes errors names private regular_file secret secret_files untrusted wire session controller"
        " definitions.+ definitions.model"
        " record.+",
        "click rich tomli",
    ),
    "controller": room(
        "believed whose codes errors hashing layers regular_file robot_answers wire session container_files resource"
        " led secret secret_files data datasets disk owner private untrusted time_sync sizes image_reference"
        " git_address git linear_regex names definitions transport facts assignment network images rendering modules"
        " planning execution record trials probing plain_tar exporting snapshot yamldoc own_records"
    ),
    "datasets": room("believed private regular_file untrusted"),
    "disk": room("regular_file images.plan"),
    "regular_file": room(),
    "owner": room(),
    "pace": room(),
    "image_reference": room(),
    "published": room(),
    "tree_links": room(),
    "trees": room(),
    "git_address": room(),
    # Runs git on the controller: what it fetches are files of strangers.
    "git": room(
        "believed git_address private regular_file tree_links definitions.program definitions.repository_names"
    ),
    "untrusted": room(),
    "robot_answers": room("codes errors untrusted"),
    "failure": room("wire"),
    "yamldoc": room("codes errors regular_file", "yaml"),
    "definitions": room(
        "believed codes errors names private regular_file untrusted secret data owner whose image_reference git_address"
        " linear_regex own_records secret_files published"
        " yamldoc",
        "jsonschema jinja2",
    ),
    "transport": room(
        "codes errors failure pace believed datasets engine_files led sandbox spool layers private plain_tar"
        " regular_file wire session container_files untrusted secret"
        " definitions.model",
        "paramiko fabric invoke docker requests urllib3 psutil dask distributed",
    ),
    "facts": room(
        "codes errors names wire session container_files untrusted robot_answers resource time_sync modules"
        " definitions.model"
    ),
    "assignment": room("codes errors sizes definitions.containermodel definitions.model facts.model"),
    "network": room("codes errors names untrusted definitions.containermodel definitions.model facts.model"),
    "probing": room("errors names untrusted wire network"),
    # Robots that were set up by hand, as an experiment: questions and parsers, no robot and no file.
    "snapshot": room("git_address image_reference names published redaction sandbox untrusted wire yamldoc.writer"),
    "images": room(
        "codes errors plain_tar wire image_reference definitions.containermodel definitions.dockerfile"
        " definitions.model",
        "jinja2",
    ),
    "rendering": room(
        "believed codes errors private untrusted resource data definitions modules yamldoc", "jinja2 yaml"
    ),
    "modules": room(
        "errors failure hashing led names plain_tar published wire untrusted robot_answers resource secret"
        " image_reference"
        " definitions.model definitions.container_words definitions.containermodel definitions.secretmodel"
    ),
    "planning": room(
        "codes errors hashing names untrusted resource wire secret image_reference modules facts.model"
        " plain_tar definitions.containermodel definitions.dockerfile"
        " definitions.model definitions.secretmodel network.identity"
    ),
    "execution": room(
        "codes errors failure layers led pace sandbox spool plain_tar untrusted robot_answers resource wire session"
        " image_reference linear_regex modules planning probing facts.host owner trials definitions.dockerfile"
        " definitions.trialsmodel"
    ),
    "record": room(
        "believed codes errors data private regular_file untrusted resource secret definitions.model facts planning"
        " execution own_records secret_files"
        " trials definitions.trialsmodel definitions.repository_names transport.tar_stream"
    ),
    # Bundles: reads and checks what a run left, works out again what follows from it, and compares two.
    "evidence": room(
        "believed data whose codes errors names private regular_file untrusted secret linear_regex yamldoc definitions"
        " assignment facts trials record planning.markdown"
        " controller.choice controller.request controller.trial_instances controller.bundling"
        " controller.bundle_images controller.kept_images transport.blob layers image_reference oci"
    ),
    # Pages: what a run left, read as evidence is, and shown.
    "report": room(
        "codes errors names regular_file untrusted trials.judge record.runs evidence.files evidence.story"
        " assignment.report definitions.version_control"
    ),
    # Files of other tools -> experiments: reads what strangers wrote, and reaches no robot.
    "importing": room("codes errors private regular_file untrusted image_reference linear_regex yamldoc definitions"),
    # A Compose project in its normal form -> the folder of an experiment.
    "conversion": room(
        "believed codes errors names own_records private published regular_file tree_links trees yamldoc definitions"
        " importing"
    ),
    # Compose files of an experiment: as values, but for the one file that writes them into a folder.
    "exporting": room(
        "believed codes errors own_records plain_tar tree_links definitions facts.model images network planning.graver"
        " yamldoc"
    ),
    # Images as files of strangers: nothing is opened, nothing of them is run.
    "oci": room("image_reference layers untrusted"),
    "lab": room("codes errors regular_file trees yamldoc", "yaml"),
    "trials": room("codes errors linear_regex untrusted time_sync definitions.trialsmodel definitions.trialpoints"),
    "linear_regex": room(foreign="re2"),
    "time_sync": room("untrusted"),
    "data": room("codes errors"),
    "codes": room(),
    "explaining": room("codes", "yaml"),
    "errors": room("codes"),
    "names": room("codes errors"),
    "private": room(),
    # What is kept and believed: nobody else may have put it there.
    "believed": room("private whose"),
    "whose": room(),
    "secret": room("redaction redaction_lines"),
    "secret_files": room("believed private untrusted"),
    "own_records": room("believed private regular_file untrusted"),
    "redaction": room("redaction_bytes"),
    "redaction_lines": room("redaction"),
    "redaction_bytes": room("linear_regex"),
    "layers": room("untrusted"),
    "plain_tar": room(),
    "sizes": room(),
    "sandbox": room("wire"),
    "spool": room("wire"),
    "engine_files": room("spool wire"),
    "hashing": room(),
    "wire": room("errors hashing untrusted resource"),
    "session": room("errors wire container_files"),
    "container_files": room(),
    "led": room("untrusted"),
    "resource": room("errors wire"),
}


def cli_file(ours: str, foreign: str = "") -> Room:
    """Write a line of the table for a file of cli: all that cli may, and the rooms that its verb fronts."""
    base = ROOMS["cli"]
    assert base.ours is not None and base.foreign is not None
    return Room(base.ours | frozenset(ours.split()), base.foreign | frozenset(foreign.split()))


# What a small decision never imports.
ARRAYS = room("errors definitions.model facts.model", "numpy")

FILES: Mapping[str, Room] = {
    "assignment/table.py": ARRAYS,
    "assignment/arrays.py": ARRAYS,
    "assignment/rows.py": ARRAYS,
    "assignment/solve_pools.py": ARRAYS,
    "assignment/pool_prices.py": ARRAYS,
    "assignment/conflict.py": ARRAYS,
    "assignment/solve_flow.py": room("codes errors", "numpy ortools"),
    "assignment/solve_lp.py": room("codes errors", "numpy ortools"),
    "cli/apply.py": cli_file("planning execution"),
    "cli/assign.py": cli_file("assignment facts"),
    "cli/assign_plot.py": cli_file("assignment", "matplotlib numpy"),
    "cli/bundle.py": cli_file("evidence"),
    "cli/build.py": cli_file("planning execution"),
    "cli/compare.py": cli_file("evidence definitions.trialsmodel"),
    "cli/completion_words.py": cli_file("data"),
    "cli/diff.py": cli_file("planning"),
    "cli/doctor.py": cli_file("facts robot_answers"),
    "cli/exec.py": cli_file("facts"),
    "cli/explain.py": cli_file("explaining"),
    "cli/execute.py": cli_file("planning execution"),
    "cli/destroy_all.py": cli_file("facts"),
    "cli/cp.py": cli_file("facts"),
    "cli/destroy.py": cli_file("execution facts.model"),
    "cli/export.py": cli_file("exporting facts"),
    "cli/facts.py": cli_file("facts"),
    "cli/facts_ranges.py": cli_file("facts data definitions.schema", "jsonschema"),
    "cli/facts_table.py": cli_file("facts"),
    "cli/fmt.py": cli_file("definitions.formatting"),
    "cli/images.py": cli_file("execution sizes"),
    "cli/images_prune.py": cli_file("execution sizes"),
    "cli/importing.py": cli_file("conversion importing.normal record.memory"),
    "cli/inputs.py": cli_file("lab.written facts.model"),
    "cli/lab.py": cli_file("lab"),
    "cli/lock.py": cli_file("definitions.lockfile"),
    "cli/init.py": cli_file("data definitions.lockfile definitions.starter"),
    "cli/locks.py": cli_file("execution"),
    "cli/logs.py": cli_file("facts"),
    "cli/orders.py": cli_file("execution facts"),
    "cli/plan.py": cli_file("planning"),
    "cli/problems.py": cli_file("explaining"),
    "cli/probe.py": cli_file("facts probing"),
    "cli/progress.py": cli_file("planning execution"),
    "cli/replay.py": cli_file("evidence facts"),
    "cli/replay_lab.py": cli_file("evidence lab", "yaml"),
    "cli/report.py": cli_file("record report"),
    "cli/run.py": cli_file("execution"),
    "cli/runs.py": cli_file("record report.plot trials.judge"),
    "cli/schema.py": cli_file("data"),
    "cli/status.py": cli_file("facts probing"),
    "cli/stored_facts.py": cli_file("facts"),
    "cli/trial_session.py": cli_file("execution facts"),
    "cli/verify.py": cli_file("evidence"),
    "cli/wait.py": cli_file("facts"),
    "cli/worker.py": cli_file("transport.sites.serving"),
}
"""Files whose line differs from their room's."""

PROCESSES_AND_SOCKETS = frozenset(
    {"socket", "socketserver", "subprocess", "asyncio", "multiprocessing", "pty", "http", "ftplib"}
)
PROCESS_CALLS = frozenset({"system", "popen", "fork", "forkpty", "posix_spawn", "posix_spawnp"})
_PROGRAMS = tuple(f"definitions/{name}.py" for name in ("inventory", "script", "program", "secretvalues"))
_CHILD = "rendering/limited.py"
_WORKER = "transport/workers/worker.py"
_SIGNS = "controller/signature.py"
_GIT = "git/program.py"
_RM = "trees.py"
MAY_REACH_OUT = ("transport/", "lab/", *_PROGRAMS, _CHILD, _SIGNS, _GIT, _RM)
"""Where sockets and programs belong; of `definitions`, the inventory that is itself a program, and the command that
prints a secret; the child with limits in which users' playbooks are rendered; ssh-keygen, which signs plan files; git,
which fetches what a user allowed; rm, for folders that are deeper than Python goes."""

MAY_REVEAL = ("transport/", "secret.py")
"""Where the value of a secret is taken out of its wrapping."""

MAY_TALK = ("cli/", "__main__.py")
"""Where the user is spoken to: output, questions, exit codes."""


_FUNCTIONS = (ast.FunctionDef, ast.AsyncFunctionDef)


def room_of(path: str) -> str:
    """Return the room of a file, named as below `srprov/`."""
    return path.split("/", 1)[0].removesuffix(".py")


def imports(tree: ast.AST, path: str) -> Iterator[tuple[int, str]]:
    """Return line and full dotted target of every import, those inside functions and TYPE_CHECKING too."""
    folder = ["srprov", *path.split("/")[:-1]]
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            for alias in node.names:
                yield node.lineno, alias.name
        elif isinstance(node, ast.ImportFrom):
            base = [*folder[: len(folder) - node.level + 1]] if node.level else []
            base += node.module.split(".") if node.module else []
            for alias in node.names:
                yield node.lineno, ".".join([*base, alias.name])


def import_graph(package: Mapping[str, str]) -> dict[str, set[str]]:
    """Return file -> files that it imports when it is loaded, or only for types; paths are as below `srprov/`."""
    names = {f"srprov.{path}".removesuffix(".py").removesuffix("/__init__").replace("/", "."): path for path in package}
    graph: dict[str, set[str]] = {}
    for path, source in package.items():
        tree = ast.parse(source, filename=path)
        for node in ast.walk(tree):
            if isinstance(node, _FUNCTIONS):
                node.body = []
        targets = {target for _, target in imports(tree, path)}
        found = {names.get(target, names.get(target.rpartition(".")[0], path)) for target in targets}
        graph[path] = found - {path}
    return graph


def circle(graph: Mapping[str, set[str]]) -> str:
    """Return one circle of a graph of imports as `a -> b -> a`, or nothing."""
    try:
        graphlib.TopologicalSorter(graph).prepare()
    except graphlib.CycleError as error:
        return " -> ".join(reversed(error.args[1]))
    return ""


def of_rooms(graph: Mapping[str, set[str]]) -> dict[str, set[str]]:
    """Return room -> rooms that its files import."""
    rooms: dict[str, set[str]] = {}
    for path, targets in graph.items():
        rooms.setdefault(room_of(path), set()).update({room_of(target) for target in targets} - {room_of(path)})
    return rooms


def allows(allowed: frozenset[str] | None, target: str) -> bool:
    """Return whether a dotted target is one of the allowed names or lies below one; `NAME.+` is a room's face alone."""
    if allowed is None or any(target == name or target.startswith(f"{name}.") for name in allowed):
        return True
    place, _, name = target.rpartition(".")
    return f"{place}.+" in allowed and not any((PACKAGE / place / f"{name}{end}").exists() for end in (".py", ""))


def import_problem(path: str, target: str) -> str:
    """Say what is wrong with one import of one file, or nothing."""
    name = room_of(path)
    rule = FILES.get(path, ROOMS[name])
    top, _, rest = target.partition(".")
    if top == "srprov":
        fine = room_of(rest.replace(".", "/")) in ("", name, "__version__") or allows(rule.ours, rest)
        return "" if fine else f"the room {name} may not import {target}"
    if top in PROCESSES_AND_SOCKETS or target.startswith("urllib.request"):
        fine = path.startswith(MAY_REACH_OUT)
        return "" if fine else f"{top}: only {', '.join(MAY_REACH_OUT)} may open sockets or start programs"
    if top in sys.stdlib_module_names or top == "msgspec":  # what values are made of, in every room
        return ""
    return "" if allows(rule.foreign, top) else f"{path if path in FILES else f'the room {name}'} may not import {top}"


def name_of(node: ast.AST) -> str:
    """Return `a` for a name and `a.b` for an attribute of one."""
    if isinstance(node, ast.Name):
        return node.id
    if isinstance(node, ast.Attribute) and isinstance(node.value, ast.Name):
        return f"{node.value.id}.{node.attr}"
    return ""


def use_problem(path: str, node: ast.AST) -> str:
    """Say what is wrong with one expression or statement, or nothing."""
    called = name_of(node.func) if isinstance(node, ast.Call) else ""
    if isinstance(node, ast.Attribute) and node.attr in ("reveal", "_value") and not path.startswith(MAY_REVEAL):
        return f"{node.attr}: only {', '.join(MAY_REVEAL)} may look into a secret"
    if path.startswith(MAY_TALK) or (path in (_CHILD, _WORKER) and called == "os._exit"):
        return ""
    if called in ("print", "input", "breakpoint", "exit", "quit", "os._exit") or name_of(node) in (
        "sys.exit",
        "sys.stdin",
        "sys.stdout",
        "sys.stderr",
    ):
        return f"{called or name_of(node)}: only cli prints, asks or exits"
    if isinstance(node, ast.Raise) and node.exc is not None:
        raised = node.exc.func if isinstance(node.exc, ast.Call) else node.exc
        if name_of(raised) in ("SystemExit", "KeyboardInterrupt"):
            return f"raise {name_of(raised)}: only cli ends the program"
    if called in ("__import__", "importlib.import_module"):
        return f"{called}: an import that this test cannot read"
    owner, _, attribute = called.partition(".")
    if owner == "os" and (attribute in PROCESS_CALLS or attribute.startswith(("exec", "spawn"))):
        return "" if path.startswith(MAY_REACH_OUT) else f"{called}: only {', '.join(MAY_REACH_OUT)} may start programs"
    return ""


def problems(path: str, source: str) -> list[str]:
    """List, as `file:line: what`, where a file breaks the order of the house; `path` is as below `srprov/`."""
    if room_of(path) not in ROOMS:
        return [f"srprov/{path}:1: the room {room_of(path)} is not in the table of tests/test_rooms.py"]
    tree = ast.parse(source, filename=path)
    found = [(line, import_problem(path, target)) for line, target in imports(tree, path)]
    found += [(getattr(node, "lineno", 1), use_problem(path, node)) for node in ast.walk(tree)]
    return [f"srprov/{path}:{line}: {what}" for line, what in sorted(set(found)) if what]


def size_problems(path: str, source: str, excused: Mapping[str, str] = LONG_BY_NECESSITY) -> list[str]:
    """List what is too long in a file; `path` is as below `srprov/`."""
    found = []
    count = len(source.splitlines())
    if count > LONGEST_FILE and path not in excused:
        found.append(f"srprov/{path}: {count} lines, more than {LONGEST_FILE}: two things live here")
    for node in ast.walk(ast.parse(source, filename=path)):
        if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef):
            length = (node.end_lineno or node.lineno) - node.lineno + 1
            if length > LONGEST_FUNCTION and f"{path}:{node.name}" not in excused:
                what = f"{node.name} has {length} lines, more than {LONGEST_FUNCTION}: split it"
                found.append(f"srprov/{path}:{node.lineno}: {what}")
    return found


def sources() -> dict[str, str]:
    """Read the whole package; keys are paths below `srprov/`."""
    return {file.relative_to(PACKAGE).as_posix(): file.read_text() for file in sorted(PACKAGE.rglob("*.py"))}


def test_the_rooms_import_what_the_table_allows() -> None:
    """Sockets, printing and foreign libraries included."""
    found = [line for path, source in sources().items() for line in problems(path, source)]
    assert not found, "\n".join(found)


def test_nothing_imports_in_a_circle() -> None:
    """Neither files nor rooms, imports for types included: whoever reads one need not know the other first."""
    graph = import_graph(sources())
    assert circle(graph) == ""
    assert circle(of_rooms(graph)) == ""


def test_the_checker_sees_a_circle() -> None:
    """Of files, also by types only, and of rooms whose files have none; an import inside a function is none."""
    typed = "from typing import TYPE_CHECKING\nif TYPE_CHECKING:\n    from srprov.a.one import One\n"
    files = {"a/one.py": "from srprov.b import two\n", "b/two.py": typed, "b/__init__.py": ""}
    assert circle(import_graph(files)) in ("a/one.py -> b/two.py -> a/one.py", "b/two.py -> a/one.py -> b/two.py")
    late = {**files, "b/two.py": "def f():\n    from srprov.a.one import One\n"}
    assert circle(import_graph(late)) == ""
    rooms = {**files, "b/two.py": "", "b/three.py": "from ..a import four\n", "a/four.py": ""}
    assert circle(import_graph(rooms)) == ""
    assert circle(of_rooms(import_graph(rooms))) in ("a -> b -> a", "b -> a -> b")


def test_files_and_functions_are_small() -> None:
    """A function that passes the limit nearly always decides and does."""
    found = [line for path, source in sources().items() for line in size_problems(path, source)]
    assert not found, "\n".join(found)


def test_every_line_of_the_table_is_a_room_that_exists() -> None:
    """A table that names what is gone hides what is new."""
    paths = sources()
    assert sorted(set(ROOMS) - {room_of(path) for path in paths}) == []
    assert sorted(set(FILES) - set(paths)) == []


def test_every_excuse_for_length_has_a_reason_and_a_file() -> None:
    """An excuse ends with the file that it was for."""
    assert [
        key for key, reason in LONG_BY_NECESSITY.items() if not reason or not (PACKAGE / key.split(":")[0]).exists()
    ] == []


BROKEN = [
    ("planning/plan.py", "from srprov.transport import pool", "the room planning may not import srprov.transport.pool"),
    ("planning/plan.py", "from srprov import transport", "the room planning may not import srprov.transport"),
    ("planning/plan.py", "import srprov.cli.main", "the room planning may not import srprov.cli.main"),
    ("planning/plan.py", "from ..execution import run", "the room planning may not import srprov.execution.run"),
    ("controller.py", "from srprov.cli import output", "the room controller may not import srprov.cli.output"),
    ("facts/gather.py", "def f():\n    import paramiko", "the room facts may not import paramiko"),
    (
        "network/layout.py",
        "from srprov.facts.gather import gather",
        "the room network may not import srprov.facts.gather.gather",
    ),
    ("definitions/load.py", "from srprov.wire import Run", "the room definitions may not import srprov.wire.Run"),
    (
        "assignment/cost.py",
        "from ortools.graph.python import min_cost_flow",
        "the room assignment may not import ortools",
    ),
    ("assignment/solve_small.py", "import numpy", "the room assignment may not import numpy"),
    ("assignment/solve_lp.py", "import scipy", "assignment/solve_lp.py may not import scipy"),
    ("execution/run.py", "import subprocess", "subprocess: only transport/"),
    ("yamldoc/loader.py", "import socket", "socket: only transport/"),
    ("facts/host.py", "from urllib.request import urlopen", "urllib: only transport/"),
    ("modules/file.py", "import os\nos.system('true')", "os.system: only transport/"),
    ("rendering/render.py", "print('x')", "print: only cli"),
    ("lab/lab.py", "import sys\nsys.exit(1)", "sys.exit: only cli"),
    ("execution/run.py", "import sys\nsys.stdout.write('x')", "sys.stdout: only cli"),
    ("facts/host.py", "raise SystemExit(1)", "raise SystemExit: only cli"),
    (
        "modules/registry.py",
        "import importlib\nimportlib.import_module('docker')",
        "importlib.import_module: an import that",
    ),
    ("execution/ask.py", "import click", "the room execution may not import click"),
    ("attic/old.py", "", "the room attic is not in the table"),
    ("cli/apply.py", "show(password.reveal())", "reveal: only transport/, secret.py may look into a secret"),
    ("modules/secret.py", "value = want._value", "_value: only transport/, secret.py may look into a secret"),
]


@pytest.mark.parametrize(("path", "source", "said"), BROKEN)
def test_the_checker_sees_a_violation(path: str, source: str, said: str) -> None:
    """The law is only as good as the eye that watches it."""
    found = problems(path, source)
    assert len(found) == 1, found
    assert said in found[0]


ORDERLY = [
    ("transport/ssh_session.py", "import socket, subprocess, paramiko\nfrom srprov.wire import Reader"),
    ("transport/openssh/auth.py", "password.reveal()"),
    ("assignment/solve_flow.py", "def f():\n    from ortools.graph.python import min_cost_flow"),
    ("assignment/solve.py", "from srprov.assignment.problem import Problem"),
    ("definitions/load.py", "import jsonschema\nfrom srprov.secret import Secret\nfrom . import model"),
    ("cli/plan.py", "import click, rich, sys\nfrom srprov import controller\nprint('x')\nsys.exit(0)"),
    ("network/layout.py", "from srprov.facts.model import HostFacts\nfrom srprov.facts import model"),
    ("definitions/inventory.py", "import subprocess"),
    ("cli/version.py", "from srprov import __version__"),
    ("execution/run.py", "import sys\nraise ValueError(sys.version)"),
]


@pytest.mark.parametrize(("path", "source"), ORDERLY)
def test_the_checker_lets_the_orderly_pass(path: str, source: str) -> None:
    """It finds fault with nothing that the table allows."""
    assert problems(path, source) == []


def test_the_checker_sees_what_is_too_long() -> None:
    """And takes an excuse only for the one thing that it names."""
    function = "def f():\n" + "    pass\n" * LONGEST_FUNCTION
    assert len(size_problems("data.py", function)) == 1
    assert size_problems("data.py", function, {"data.py:f": "one table"}) == []
    assert size_problems("data.py", "def f():\n" + "    pass\n" * (LONGEST_FUNCTION - 1)) == []
    assert len(size_problems("data.py", "x = 1\n" * (LONGEST_FILE + 1))) == 1
    assert size_problems("data.py", "x = 1\n" * LONGEST_FILE) == []
