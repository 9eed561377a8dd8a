"""The rest of the table of `shapes`: deployment, development, and what stands beside services. Pure."""

from __future__ import annotations

from collections.abc import Mapping

from srprov.importing.compose.shapes import AMOUNT, COUNT, FLAG, OPTIONS, PAIRS, TABLES, TEXTS

_UPDATE = {
    "parallelism": COUNT,
    "delay": "text",
    "failure_action": "text",
    "monitor": "text",
    "max_failure_ratio": AMOUNT,
    "order": "text(start-first,stop-first)",
}
_DEVICE = {
    "capabilities": "[text]!",
    "count": COUNT,
    "device_ids": "[text]!",
    "driver": "text",
    "options": PAIRS,
}
_EXTERNAL = "bool|text|@external"
_FILE = {"name": "text", "environment": "text", "file": "text", "external": _EXTERNAL, "labels": PAIRS}

ALL_TABLES: Mapping[str, Mapping[str, str]] = {
    **TABLES,
    "develop": {"watch": "[@watch]"},
    "watch": {
        "ignore": TEXTS,
        "include": TEXTS,
        "path": "text",
        "action": "text(rebuild,sync,restart,sync+restart,sync+exec)",
        "target": "text",
        "exec": "@hook",
        "initial_sync": "bool",
    },
    "deploy": {
        "mode": "text",
        "endpoint_mode": "text",
        "replicas": COUNT,
        "labels": PAIRS,
        "rollback_config": "@update",
        "update_config": "@update",
        "resources": "@resources",
        "restart_policy": "@restart_policy",
        "placement": "@placement",
    },
    "update": _UPDATE,
    "resources": {"limits": "@limits", "reservations": "@reservations"},
    "limits": {"cpus": AMOUNT, "memory": "text", "pids": COUNT},
    "reservations": {
        "cpus": AMOUNT,
        "memory": "text",
        "generic_resources": "[@generic]",
        "devices": "[@device_request]",
    },
    "generic": {"discrete_resource_spec": "@discrete"},
    "discrete": {"kind": "text", "value": AMOUNT},
    "device_request": _DEVICE,
    "gpu": _DEVICE,
    "restart_policy": {"condition": "text", "delay": "text", "max_attempts": COUNT, "window": "text"},
    "placement": {"constraints": "[text]", "preferences": "[@preference]", "max_replicas_per_node": COUNT},
    "preference": {"spread": "text"},
    "network": {
        "name": "text",
        "driver": "text",
        "driver_opts": OPTIONS,
        "ipam": "@ipam",
        "external": _EXTERNAL,
        "internal": FLAG,
        "enable_ipv4": FLAG,
        "enable_ipv6": FLAG,
        "attachable": FLAG,
        "labels": PAIRS,
    },
    "ipam": {"driver": "text", "config": "[@subnet]", "options": "{text}"},
    "subnet": {"subnet": "text", "ip_range": "text", "gateway": "text", "aux_addresses": "{text}"},
    "volume": {"name": "text", "driver": "text", "driver_opts": OPTIONS, "external": _EXTERNAL, "labels": PAIRS},
    "external": {"name": "text"},
    "secret": {**_FILE, "driver": "text", "driver_opts": OPTIONS, "template_driver": "text"},
    "config": {**_FILE, "content": "text", "template_driver": "text"},
    "model": {"name": "text", "model": "text", "context_size": "int", "runtime_flags": "[text]"},
}
REQUIRED: Mapping[str, tuple[str, ...]] = {
    "dependency": ("condition",),
    "device": ("source",),
    "device_request": ("capabilities",),
    "env_file": ("path",),
    "extends": ("service",),
    "hook": ("command",),
    "model": ("model",),
    "mount": ("type",),
    "provider": ("type",),
    "ulimit": ("soft", "hard"),
    "watch": ("path", "action"),
}
CLOSED = frozenset({"include", "blkio", "rate", "weight", "env_file", "extends"})
"""Tables without keys of one's own (`x-…`)."""
PATTERNS: Mapping[str, str] = {
    "services.*.container_name": "[a-zA-Z0-9][a-zA-Z0-9_.-]+",
    "services.*.pull_policy": "always|never|build|if_not_present|missing|refresh|daily|weekly|every_([0-9]+[wdhms])+",
}
"""What a text must have somewhere in it."""
