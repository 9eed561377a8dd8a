"""The class of each key of the larger parts of a Compose service: mounts, network, order, resources. Values only."""

from __future__ import annotations

from srprov.conversion.kept import Kept, Row, adapted, dropped, exact, refused

_V, _P, _N = "services.*.volumes", "services.*.ports", "services.*.networks"
_H, _D = "services.*.healthcheck", "services.*.depends_on"

MOUNTS: tuple[Row, ...] = (
    exact(
        _V,
        "`volumes`",
        (
            Kept.ADAPTED,
            "a relative folder that may be written is a volume that begins with its content; a file is"
            " read-only; `~` is the home of a user of the robot",
        ),
        (Kept.REFUSED, "what lies outside of the files' folders, or is missing"),
    ),
    exact(f"{_V}.type", "`type`", (Kept.REFUSED, "`npipe`, `cluster` and `image`")),
    exact(f"{_V}.source", "`source`"),
    exact(f"{_V}.target", "`target`"),
    exact(f"{_V}.read_only", "`:ro`"),
    dropped(f"{_V}.consistency", "Linux has one"),
    exact(f"{_V}.bind", "the volume"),
    exact(
        f"{_V}.bind.create_host_path",
        "`bind.create_host_path`",
        (Kept.ADAPTED, "what lies in a folder of the system must be there"),
    ),
    dropped(f"{_V}.bind.propagation", "mounts that are made later are not seen through it"),
    dropped(f"{_V}.bind.recursive", "no field says it"),
    dropped(f"{_V}.bind.selinux", "no field says it"),
    exact(f"{_V}.volume", "the volume"),
    dropped(
        f"{_V}.volume.nocopy",
        "a new volume that may be written begins with what the image has there",
        (Kept.EXACT, "with `read_only`"),
    ),
    dropped(f"{_V}.volume.labels", "volumes carry srprov's own labels"),
    refused(f"{_V}.volume.subpath", "a volume is mounted as a whole"),
    exact(f"{_V}.tmpfs", "`tmpfs`"),
    exact(f"{_V}.tmpfs.size", "`tmpfs.size`"),
    exact(f"{_V}.tmpfs.mode", "`tmpfs.mode`"),
    Row(f"{_V}.image", Kept.REFUSED, "", "an image is not mounted: copy its files in a CDF", whole=True),
    exact("services.*.devices", "`devices`", (Kept.REFUSED, "names of CDI, which are no paths")),
    exact("services.*.devices.source", "`devices`"),
    exact("services.*.devices.target", "`devices`"),
    exact("services.*.devices.permissions", "`devices`"),
    adapted("services.*.gpus", "`gpus`", "`all`, or how many", (Kept.EXACT, "`all`")),
    adapted("services.*.gpus.count", "`gpus`", "how many", (Kept.EXACT, "")),
    adapted("services.*.gpus.device_ids", "`gpus`", "as many, but the engine chooses which"),
    adapted("services.*.gpus.driver", "`gpus`", "the engine's driver for GPUs is used"),
    adapted("services.*.gpus.capabilities", "`gpus`", "a GPU is given with what the engine gives by default"),
    dropped("services.*.gpus.options", "no field says it"),
)

NETWORK: tuple[Row, ...] = (
    exact(
        _P,
        "`ports`",
        (Kept.ADAPTED, "with `network: host` they are declared by `expose`"),
        (Kept.DROPPED, "with `network: none`"),
        (Kept.REFUSED, "a protocol other than tcp and udp"),
    ),
    exact(f"{_P}.target", "`ports`"),
    exact(f"{_P}.published", "`ports`", (Kept.ADAPTED, "left out: the same number; a choice: its first")),
    exact(
        f"{_P}.host_ip",
        "`ports`",
        (Kept.ADAPTED, "`::1` is `127.0.0.1`, and `::` all addresses: nothing is published at IPv6 alone"),
        (Kept.REFUSED, "other addresses of IPv6"),
    ),
    exact(f"{_P}.protocol", "`ports`", (Kept.REFUSED, "other than tcp and udp")),
    dropped(f"{_P}.mode", "a robot publishes its own containers' ports", (Kept.EXACT, "")),
    dropped(f"{_P}.name", "it is a word for people"),
    dropped(f"{_P}.app_protocol", "it is a word for people"),
    adapted(_N, "the experiment's overlay", "all services share one overlay, and see each other", (Kept.EXACT, "")),
    dropped(
        f"{_N}.*.aliases",
        "nothing in the files uses it",
        (Kept.ADAPTED, "another service uses the name: it becomes `hostname`"),
        (Kept.REFUSED, "another service uses the name, and no `hostname` can be it"),
    ),
    dropped(
        f"{_N}.*.ipv4_address",
        "the overlay derives addresses by itself",
        (Kept.REFUSED, "the address is used in the files"),
    ),
    dropped(
        f"{_N}.*.ipv6_address",
        "the overlay derives addresses by itself",
        (Kept.REFUSED, "the address is used in the files"),
    ),
    *(
        dropped(f"{_N}.*.{key}", "there is one overlay, and srprov sets it up")
        for key in ("interface_name", "link_local_ips", "mac_address", "driver_opts", "priority", "gw_priority")
    ),
)

ORDER: tuple[Row, ...] = (
    exact(
        _D,
        "`depends_on`",
        (Kept.DROPPED, "a service that is not wanted, and not required"),
        (Kept.REFUSED, "a service that is not there"),
    ),
    exact(f"{_D}.*.condition", "`depends_on.*.condition`"),
    dropped(f"{_D}.*.restart", "a service that is made anew restarts no other"),
    dropped(f"{_D}.*.required", "what is waited for must be wanted", (Kept.EXACT, "")),
    exact(_H, "`healthcheck`", (Kept.ADAPTED, "without a test: that of the image")),
    exact(f"{_H}.test", "`healthcheck.test`"),
    *(
        exact(f"{_H}.{key}", f"`healthcheck.{key}`")
        for key in ("interval", "timeout", "retries", "start_period", "disable")
    ),
    dropped(f"{_H}.start_interval", "engines before 25 do not know it"),
)


def _granted(kind: str, what: str) -> tuple[Row, ...]:
    path = f"services.*.{kind}"
    return (
        adapted(path, what, "the container has it as a read-only file"),
        exact(f"{path}.source", what),
        exact(f"{path}.target", what),
        exact(f"{path}.mode", what),
        dropped(f"{path}.uid", "the file is root's"),
        dropped(f"{path}.gid", "the file is root's"),
    )


GRANTED: tuple[Row, ...] = (
    *_granted("secrets", "`secrets`"),
    *_granted("configs", "`volumes`"),
)
