"""Plan files that somebody changed: random mutations of a real one, some blind, some by who knows the format well.

Everything that a mutation would make happen beyond the plan leaves a trace with CANARY in its name, or touches what
belongs to the instance `theirs`.
"""

from __future__ import annotations

import base64
import contextlib
import copy
import hashlib
import json
import random
from collections.abc import Callable
from typing import Any

from srprov.controller.authority import asked
from srprov.errors import UsageError
from srprov.modules import MODULES
from srprov.modules.params import read_params
from srprov.planning.planfile import step_out
from srprov.planning.planread import load
from srprov.planning.steps import new_step
from srprov.resource import Resource

CANARY = "srprov-canary"
TRACE = f"/tmp/{CANARY}"
Document = dict[str, Any]
Mutation = Callable[[random.Random, Document], None]


def tampered(text: str, count: int, seed: int = 12) -> list[tuple[str, str]]:
    """Return `count` mutations of a plan file as (name, text), the same for the same seed."""
    found: list[tuple[str, str]] = []
    number = 0
    while len(found) < count:
        rng = random.Random(f"{seed}/{number}")
        mutation = ALL[number % len(ALL)]
        document = json.loads(text)
        mutation(rng, document)
        if (changed := json.dumps(document, indent=2) + "\n") != text:
            found.append((f"{number:03} {mutation.__name__}", changed))
        number += 1
        assert number < 20 * count, "mutations that change nothing"
    return found


def _paths(value: Any, path: tuple[Any, ...] = ()) -> list[tuple[Any, ...]]:
    inner = value.items() if isinstance(value, dict) else enumerate(value) if isinstance(value, list) else ()
    return [one for key, item in inner for one in ((*path, key), *_paths(item, (*path, key)))]


def _pick(rng: random.Random, document: Document, kind: type | tuple[type, ...] = object) -> tuple[Any, Any]:
    """Return a container and a key of a random value of a kind in it."""
    paths = [path for path in _paths({k: v for k, v in document.items() if k not in ("inputs", "blobs")})]
    rng.shuffle(paths)
    for path in paths:
        holder = document
        for key in path[:-1]:
            holder = holder[key]
        if isinstance(holder[path[-1]], kind):
            return holder, path[-1]
    raise AssertionError("there is none")


def _step(rng: random.Random, document: Document, module: str = "") -> dict[str, Any]:
    """Return a random step that wants something of a kind; a real plan has one of each."""
    fits = [step for step in document["steps"] if step["want"] and module in ("", step["module"])]
    one: dict[str, Any] = rng.choice(fits)
    return one


# Blind ones.


def drop(rng: random.Random, document: Document) -> None:
    holder, key = _pick(rng, document)
    del holder[key]


def duplicate(rng: random.Random, document: Document) -> None:
    holder, key = _pick(rng, document, list)
    if holder[key]:
        holder[key].append(copy.deepcopy(rng.choice(holder[key])))


def swap(rng: random.Random, document: Document) -> None:
    holder, key = _pick(rng, document, (str, int))
    other, place = _pick(rng, document, type(holder[key]))
    holder[key], other[place] = other[place], holder[key]


def reorder(rng: random.Random, document: Document) -> None:
    rng.shuffle(document["steps"])


def retype(rng: random.Random, document: Document) -> None:
    holder, key = _pick(rng, document)
    holder[key] = rng.choice([None, True, 1.5, 7, -1, "", "x", [], {}, [holder[key]], {"x": holder[key]}])


def edit(rng: random.Random, document: Document) -> None:
    holder, key = _pick(rng, document, str)
    holder[key] = rng.choice([f"{holder[key]}; touch {TRACE}", TRACE, f"../../../..{TRACE}", "robot2", "theirs"])


def count(rng: random.Random, document: Document) -> None:
    holder, key = _pick(rng, document, (int, float))
    holder[key] = rng.choice([0, 1, -1, 2**63, holder[key] + 1])


# By somebody who knows the format.


def no_permissions(rng: random.Random, document: Document) -> None:
    document["permissions"] = []
    _add(document, _wanted(_host(rng, document), "command", "c", {"argv": ["touch", TRACE], "creates": TRACE}))


def listed_command(rng: random.Random, document: Document) -> None:
    document["permissions"].append({"kind": "secret", "service": "x", "what": "a word"})
    _add(document, _wanted(_host(rng, document), "command", "c", {"shell": f"touch {TRACE}", "unless": "false"}))


def also_wanted_check(rng: random.Random, document: Document) -> None:
    want = {"params": {"shell": ":", "unless": f"touch {TRACE}; true"}, "needs": [], "source": ""}
    document["also_wanted"].append({"robot": _host(rng, document), "module": "command", "name": "c", **want})


def no_fingerprints(rng: random.Random, document: Document) -> None:
    if rng.random() < 0.5:
        document["fingerprints"] = {}
    else:
        del document["fingerprints"][rng.choice(sorted(document["fingerprints"]))]


def other_fingerprint(rng: random.Random, document: Document) -> None:
    host = document["fingerprints"][_host(rng, document)]
    part = rng.choice(["host", "underlay", "resources"])
    host[part] = rng.choice([{}, {"address": "203.0.113.9", "mtu": 1500}, {f"file:{TRACE}": {}}])


def secret_command(rng: random.Random, document: Document) -> None:
    for secret in document["secrets"].values():
        secret.pop("env", None)
        secret |= {"command": ["touch", TRACE], "folder": "/"}


def appended_command(rng: random.Random, document: Document) -> None:
    command = {"run": f"touch {TRACE}", "timeout_s": 60.0}
    rng.choice(document["steps"])["commands"].append(command)


def other_script(rng: random.Random, document: Document) -> None:
    scripts = [one for step in document["steps"] for one in step["commands"] if "run" in one]
    one = rng.choice(scripts)
    one["run"] = rng.choice([f"touch {TRACE}", f"{one['run']}\ntouch {TRACE}"])


def other_robot(rng: random.Random, document: Document) -> None:
    rng.choice(document["steps"])["robot"] = rng.choice([*document["fingerprints"], "elsewhere"])


def other_name(rng: random.Random, document: Document) -> None:
    one = rng.choice(document["steps"])
    one["name"] = rng.choice(["srprov.theirs.web", "/var/lib/srprov/theirs/placement.json", one["name"] + "x"])


def other_instance(rng: random.Random, document: Document) -> None:
    document["instance"] = rng.choice(["theirs", f"../../../../tmp/{CANARY}", "", "x" * 80])


def foreign_removal(rng: random.Random, document: Document) -> None:
    module, name = rng.choice([("container", "srprov.theirs.web"), ("volume", "srprov.theirs.data"), ("file", TRACE)])
    host, instance = _host(rng, document), rng.choice(["theirs", document["instance"]])
    call = {"engine": "DELETE", "path": f"/{module}s/{name}", "params": {"force": "true"}, "timeout_s": 120.0}
    document["steps"].append(
        {
            "number": len(document["steps"]) + 1, "robot": host, "module": module, "name": name, "action": "delete",
            "cause": "no longer needed", "destructive": False, "needs": [], "waits": [],
            "commands": [{**call, "accept": [204, 404], "stream": False}], "before": {}, "want": None,
            "found": {"instance": instance, "state": {"service": "web", "stop_grace": 1}},
        }
    )  # fmt: skip
    _count(document)


def removal_with_other_commands(rng: random.Random, document: Document) -> None:
    one = rng.choice([step for step in document["steps"] if step["action"] == "delete"])
    one["commands"] = [{"run": f"touch {TRACE}", "timeout_s": 60.0}]


def removal_of_other(rng: random.Random, document: Document) -> None:
    one = rng.choice([step for step in document["steps"] if step["action"] == "delete"])
    one["name"] = f"srprov.theirs.{rng.choice(['web', 'data'])}"
    if one["found"]:
        one["found"]["instance"] = rng.choice(["theirs", document["instance"]])


def root_container(rng: random.Random, document: Document) -> None:
    """Ask for more, with the very commands that srprov would derive."""
    bind = {"Type": "bind", "Source": "/", "Target": "/host", "ReadOnly": False}
    volume = {"Type": "volume", "Source": f"srprov.{document['instance']}.v", "Target": "/host", "ReadOnly": False}
    driver = {"DriverConfig": {"Name": "local", "Options": {"type": "none", "o": "bind", "device": "/"}}}
    step = _step(rng, document, "container")
    params = step["want"]["params"]
    params["run"]["command"] = ["touch", f"/host{TRACE}"]
    change = rng.randrange(4)
    if change == 0:
        params["run"]["privileged"] = True
    params["mounts"].append(
        [bind, bind, {**volume, "VolumeOptions": driver}, {**bind, "Source": _escape(document)}][change]
    )
    _redone(document, step)


def other_file(rng: random.Random, document: Document) -> None:
    step = _step(rng, document, "file")
    step["name"] = rng.choice([TRACE, "/var/lib/srprov/theirs/placement.json", f"{step['name']}-{CANARY}"])
    step["want"]["params"] |= {"content": CANARY, "mode": "4755"}
    _redone(document, step)


def other_bridge(rng: random.Random, document: Document) -> None:
    step = _step(rng, document, rng.choice(["vxlan", "network"]))
    step["want"]["params"]["bridge"] = rng.choice(["docker0", "eth0"])
    _redone(document, step)


def other_subnet(rng: random.Random, document: Document) -> None:
    for step in document["steps"]:
        if step["module"] == "network" and step["want"]:
            step["want"]["params"] |= {"subnet": "0.0.0.0/0", "gateway": "0.0.0.1"}
            _redone(document, step)


def other_vtep(rng: random.Random, document: Document) -> None:
    step = _step(rng, document, "vxlan")
    step["want"]["params"]["fdb"] = [["00:00:00:00:00:00", "203.0.113.9"]]
    _redone(document, step)


def other_peer(rng: random.Random, document: Document) -> None:
    """Let somebody else into the overlay, or close another one."""
    step = _step(rng, document, "vxlan_filter")
    step["want"]["params"] |= rng.choice([{"peers": ["203.0.113.9"]}, {"vni": 4096}, {"instance": "theirs"}])
    _redone(document, step)


def poisoned_image(rng: random.Random, document: Document) -> None:
    context = b"FROM busybox\nRUN touch /srprov-canary\n"
    digest = hashlib.sha256(context).hexdigest()
    document["blobs"][digest] = base64.b64encode(context).decode()
    want = _wanted(_host(rng, document), "image", "srprov/base:0123456789abcdef", {"source": "build", "blob": digest})
    _add(document, want, {digest: context})


def other_blob(rng: random.Random, document: Document) -> None:
    if document["blobs"]:
        digest = rng.choice(sorted(document["blobs"]))
        document["blobs"][digest] = base64.b64encode(CANARY.encode()).decode()


def outside_inputs(rng: random.Random, document: Document) -> None:
    document["inputs"] = {f"../../../../../../..{TRACE}": CANARY, TRACE: CANARY}


def cause(rng: random.Random, document: Document) -> None:
    rng.choice(document["steps"])["cause"] = rng.choice(["nothing\n  + #9 container x", "\x1b[2J", "all is well"])


def notes(rng: random.Random, document: Document) -> None:
    """Change what is only words: this may be applied, and does nothing else than the plan."""
    document["notes"] = ["nothing is changed by this plan"]


def honest_command(rng: random.Random, document: Document) -> None:
    no_permissions(rng, document)
    _list_permissions(document)


def honest_container(rng: random.Random, document: Document) -> None:
    root_container(rng, document)
    _list_permissions(document)


def honest_check(rng: random.Random, document: Document) -> None:
    also_wanted_check(rng, document)
    _list_permissions(document)


def foreign_record(rng: random.Random, document: Document) -> None:
    """Claim a placement of another experiment in a file of one's own, and list what that needs."""
    step = _step(rng, document, "file")
    forged = {"instance": "theirs", "serial": 999_999, "services": {}, "robots": {"robot1": {"vtep": "203.0.113.9"}}}
    step["want"]["params"]["content"] += json.dumps(forged) + "\n"
    _redone(document, step)
    if rng.random() < 0.5:
        _list_permissions(document)


def foreign_vni(rng: random.Random, document: Document) -> None:
    step = _step(rng, document, "vxlan")
    step["want"]["params"]["vni"] = rng.choice([1, 4096])
    _redone(document, step)


def foreign_instance(rng: random.Random, document: Document) -> None:
    """Say that all of it is about the other experiment."""
    whole = json.loads(json.dumps(document).replace("srprov.ours", "srprov.theirs").replace("/ours/", "/theirs/"))
    document |= whole
    document["instance"] = "theirs"


def honest_removal(rng: random.Random, document: Document) -> None:
    """Leave a service out of what is wanted, so that what runs of it counts as no longer wanted."""
    one = rng.choice(document["also_wanted"])
    document["also_wanted"].remove(one)


ALL: tuple[Mutation, ...] = (
    drop, no_permissions, duplicate, root_container, swap, no_fingerprints, edit, foreign_removal, retype,
    other_script, count, secret_command, reorder, listed_command, drop, removal_with_other_commands, swap,
    other_file, edit, other_robot, retype, other_bridge, cause, other_name, also_wanted_check, duplicate,
    removal_of_other, other_vtep, other_peer, foreign_record, foreign_vni, foreign_instance, honest_command,
    honest_container, honest_check, honest_removal, notes, edit, appended_command, other_subnet, count, other_instance,
    poisoned_image, retype, outside_inputs, other_blob, edit, other_fingerprint, drop,
)  # fmt: skip


def _list_permissions(document: Document) -> None:
    """List what the changed plan needs, as `plan -o` does; who may apply it is then up to the user."""
    document["permissions"] = []
    with contextlib.suppress(UsageError):
        needed = asked(load(json.dumps(document, indent=2) + "\n", "plan.json"))
        document["permissions"] = [{"kind": one.kind, "service": one.service, "what": one.what} for one in needed]


def _host(rng: random.Random, document: Document) -> str:
    return rng.choice(sorted(document["fingerprints"]))


def _escape(document: Document) -> str:
    return f"/var/lib/srprov/{document['instance']}/trees/{'0' * 24}/../../../../.."


def _wanted(host: str, module: str, name: str, params: dict[str, Any]) -> dict[str, Any]:
    return {"robot": host, "module": module, "name": name, "want": {"params": params, "needs": [], "source": "x:1:1"}}


def _add(document: Document, stated: dict[str, Any], blobs: dict[str, bytes] | None = None) -> None:
    """Add a step with the commands that srprov would derive from it."""
    stated["number"] = len(document["steps"]) + 1
    document["steps"].append(_derived(stated, blobs or {}))
    _count(document)


def _redone(document: Document, step: dict[str, Any]) -> None:
    """Give a step the commands that follow from its changed parameters, so that the file agrees with itself."""
    blobs = {sha: base64.b64decode(data) for sha, data in document["blobs"].items()}
    old = [command["sha256"] for command in step["commands"] if "sha256" in command]
    step["commands"] = [*step["commands"][:-2], *_derived(step, blobs)["commands"]][-max(2, len(step["commands"])) :]
    if "content" in step["want"]["params"]:
        content = step["want"]["params"]["content"].encode()
        document["blobs"][hashlib.sha256(content).hexdigest()] = base64.b64encode(content).decode()
        for digest in old:
            document["blobs"].pop(digest, None)
    document["blobs"] = dict(sorted(document["blobs"].items()))


def _derived(stated: dict[str, Any], blobs: dict[str, bytes]) -> dict[str, Any]:
    want, module = stated["want"], stated["module"]
    params = read_params(MODULES[module].params, want["params"], blobs)
    resource = Resource(
        host=stated["robot"], module=module, name=stated["name"], params=params, written=want["params"], source="x:1:1"
    )
    made = step_out(new_step(resource, "not there"), {})
    return {**made, "number": stated["number"]}


def _count(document: Document) -> None:
    actions = [step["action"] for step in document["steps"]]
    document["counts"] = {name: actions.count(name) for name in document["counts"]}
