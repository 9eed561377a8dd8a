"""The class of each key of `build`, of `deploy`, and of a Compose file's top level. Values only."""

from __future__ import annotations

from srprov.conversion.kept import APART, Kept, Row, adapted, dropped, exact, refused

_B, _Y, _R = "services.*.build", "services.*.deploy", "services.*.deploy.resources"
_BUILDER = "it concerns the builder that Compose uses"

BUILD: tuple[Row, ...] = (
    adapted(_B, "`cdf`", "a CDF is written; services that are built alike share it"),
    exact(
        f"{_B}.context", "`dockerfile.context`", (Kept.REFUSED, "an address, or a folder outside of the files' folders")
    ),
    exact(
        f"{_B}.dockerfile",
        "`dockerfile.dockerfile`",
        (Kept.REFUSED, "outside of the files' folders, or missing"),
    ),
    adapted(f"{_B}.dockerfile_inline", "`dockerfile`", "it is written to a file"),
    exact(
        f"{_B}.args",
        "`dockerfile.args`",
        (Kept.DROPPED, "no `ARG` of the Dockerfile takes it, or the caller would give its value"),
    ),
    exact(f"{_B}.target", "`dockerfile.target`"),
    exact(f"{_B}.platforms", "`platforms`"),
    *(
        dropped(f"{_B}.{key}", _BUILDER)
        for key in ("cache_from", "cache_to", "no_cache", "pull", "provenance", "sbom", "isolation", "shm_size")
    ),
    Row(f"{_B}.ulimits", Kept.DROPPED, "", _BUILDER, whole=True),
    dropped(f"{_B}.labels", "images carry srprov's own labels"),
    dropped(f"{_B}.tags", "an image is named after its content"),
    dropped(f"{_B}.network", "images are built with the engine's own network"),
    dropped(f"{_B}.extra_hosts", "images are built with the robot's own names"),
    refused(f"{_B}.additional_contexts", "an image is built from one folder"),
    refused(f"{_B}.entitlements", "an image is built without privileges"),
    refused(f"{_B}.privileged", "an image is built without privileges"),
    refused(f"{_B}.ssh", "no key is given to a build"),
    Row(f"{_B}.secrets", Kept.REFUSED, "", "no secret is given to a build", whole=True),
)

DEPLOY: tuple[Row, ...] = (
    adapted(_Y, "the service", "each part by itself", (Kept.EXACT, "")),
    adapted(
        f"{_Y}.mode",
        "`per_robot`, `job`",
        "`global` is one on each robot, `…-job` ends by itself",
        (Kept.EXACT, "`replicated`"),
    ),
    exact(f"{_Y}.replicas", "`replicas`"),
    adapted(_R, "the service", "each part by itself", (Kept.EXACT, "")),
    adapted(f"{_R}.limits", "the service", "each part by itself", (Kept.EXACT, "")),
    adapted(f"{_R}.reservations", "the service", "each part by itself", (Kept.EXACT, "")),
    exact(f"{_R}.limits.cpus", "`cpus`"),
    exact(f"{_R}.limits.memory", "`mem_limit`"),
    exact(f"{_R}.limits.pids", "`pids_limit`"),
    dropped(f"{_R}.reservations.cpus", "Compose itself passes over it; see `requires.cpus`"),
    exact(f"{_R}.reservations.memory", "`mem_reservation`"),
    Row(f"{_R}.reservations.generic_resources", Kept.DROPPED, "", "tags of robots say what they have", whole=True),
    adapted(f"{_R}.reservations.devices", "`gpus`", "`all`, or how many", (Kept.REFUSED, "devices that are no GPUs")),
    adapted(
        f"{_R}.reservations.devices.capabilities", "`gpus`", "a GPU is given with what the engine gives by default"
    ),
    adapted(f"{_R}.reservations.devices.count", "`gpus`", "how many"),
    adapted(f"{_R}.reservations.devices.device_ids", "`gpus`", "as many, but the engine chooses which"),
    adapted(f"{_R}.reservations.devices.driver", "`gpus`", "the engine's driver for GPUs is used"),
    dropped(f"{_R}.reservations.devices.options", "no field says it"),
    adapted(f"{_Y}.restart_policy", "`restart`", "what an engine by itself does", (Kept.DROPPED, "`restart` wins")),
    adapted(
        f"{_Y}.restart_policy.condition", "`restart`", "what an engine by itself does", (Kept.DROPPED, "`restart` wins")
    ),
    adapted(
        f"{_Y}.restart_policy.max_attempts", "`restart`", "`on-failure:N`", (Kept.DROPPED, "with another condition")
    ),
    dropped(f"{_Y}.restart_policy.delay", "the engine waits longer after each failure"),
    dropped(f"{_Y}.restart_policy.window", "the engine counts a start as good after 10 s"),
    adapted(f"{_Y}.placement", "`robot`, `requires`", "each part by itself", (Kept.EXACT, "")),
    adapted(
        f"{_Y}.placement.constraints",
        "`robot`, `requires`",
        "`node.hostname == a` is `robot: a`, `node.labels.b == true` is the tag `b`; architectures",
        (Kept.DROPPED, "any other constraint"),
    ),
    Row(f"{_Y}.placement.preferences", Kept.DROPPED, "", "srprov places by cost", whole=True),
    dropped(f"{_Y}.placement.max_replicas_per_node", "see `relations.different_robot`"),
    dropped(f"{_Y}.endpoint_mode", "only a swarm has it"),
    dropped(f"{_Y}.labels", "only a swarm's services have them"),
    Row(f"{_Y}.rollback_config", Kept.DROPPED, "", "only a swarm has it", whole=True),
    Row(f"{_Y}.update_config", Kept.DROPPED, "", "only a swarm has it", whole=True),
)

_OVERLAY = "there is one overlay, and srprov sets it up"

TOP: tuple[Row, ...] = (
    dropped("version", "Compose passes over it"),
    adapted("name", "`name`", "in lower case, with `-` for other characters", (Kept.EXACT, "")),
    adapted("include", "`services`", "what is included is a part of the experiment", APART),
    adapted("include.path", "`services`", "as `include`"),
    adapted("include.env_file", "`services`", "as `include`"),
    adapted("include.project_directory", "`services`", "as `include`"),
    adapted("networks", "the experiment's overlay", "all services share one overlay", (Kept.EXACT, "")),
    dropped("networks.*.name", _OVERLAY, (Kept.EXACT, "")),
    dropped("networks.*.driver", _OVERLAY, (Kept.REFUSED, "`macvlan` and `ipvlan`: take `network: host` or `both`")),
    dropped("networks.*.external", "containers outside of the experiment are not reached"),
    dropped("networks.*.external.name", "as `external`"),
    Row("networks.*.ipam", Kept.DROPPED, "", _OVERLAY, whole=True),
    *(
        dropped(f"networks.*.{key}", _OVERLAY)
        for key in ("driver_opts", "internal", "enable_ipv4", "enable_ipv6", "attachable", "labels")
    ),
    exact("volumes", "a bare name in `volumes`"),
    dropped("volumes.*.name", "a volume is named after its instance", (Kept.EXACT, "")),
    exact("volumes.*.driver", "`local`", (Kept.REFUSED, "any other driver")),
    adapted(
        "volumes.*.driver_opts",
        "a path",
        "a bind is mounted as the path that it is of",
        (Kept.REFUSED, "options of other kinds, such as NFS"),
    ),
    adapted("volumes.*.external", "a volume of the experiment", "what it holds already is not taken over"),
    adapted("volumes.*.external.name", "a volume of the experiment", "as `external`"),
    dropped("volumes.*.labels", "volumes carry srprov's own labels"),
    adapted(
        "secrets",
        "`secrets`",
        "a secret's value stays where it is, and is read by plan and apply",
        (Kept.REFUSED, "neither `file` nor `environment`"),
    ),
    dropped("secrets.*.name", "a secret is named as in the files", (Kept.EXACT, "")),
    adapted("secrets.*.file", "`secrets.*.file`", "its value stays in that file"),
    adapted("secrets.*.environment", "`secrets.*.env`", "its value stays in the caller's environment"),
    refused("secrets.*.external", "only a swarm holds secrets"),
    refused("secrets.*.external.name", "only a swarm holds secrets"),
    dropped("secrets.*.labels", "only a swarm's secrets have them"),
    *(refused(f"secrets.*.{key}", "only a swarm has it") for key in ("driver", "driver_opts", "template_driver")),
    adapted(
        "configs",
        "`volumes`",
        "a file of the experiment, shipped read-only",
        (Kept.REFUSED, "no content is here"),
    ),
    dropped("configs.*.name", "a file is named as in the files", (Kept.EXACT, "")),
    adapted("configs.*.file", "`volumes`", "it is copied", (Kept.REFUSED, "outside of the files' folders, or missing")),
    adapted("configs.*.content", "`volumes`", "it is written to a file"),
    adapted("configs.*.environment", "`secrets.*.env`", "its value stays in the caller's environment"),
    refused("configs.*.external", "only a swarm holds configs"),
    refused("configs.*.external.name", "only a swarm holds configs"),
    dropped("configs.*.labels", "only a swarm's configs have them"),
    refused("configs.*.template_driver", "only a swarm has it"),
    Row("models", Kept.REFUSED, "", "no runtime for models is provisioned", whole=True),
)
