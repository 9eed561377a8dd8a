"""The class of each key of a Compose service, but for those that `table_parts` has. Values only."""

from __future__ import annotations

from srprov.conversion.kept import APART, Kept, Row, adapted, dropped, exact, refused

_S = "services.*"
_ANOTHER = "the namespace of another container cannot be joined"
_WINDOWS = "only engines on Windows know it"
_SCHEDULER = "no field says it; `cpus` and `cpuset` limit processors"

SAME: tuple[str, ...] = (
    *("image", "command", "entrypoint", "working_dir", "user", "stop_signal", "stop_grace_period", "restart"),
    *("privileged", "tty", "stdin_open", "init", "read_only", "cap_add", "cap_drop", "group_add", "security_opt"),
    *("sysctls", "tmpfs", "device_cgroup_rules", "logging", "oom_score_adj", "cpuset", "runtime", "profiles"),
    *("cpus", "mem_limit", "mem_reservation", "shm_size"),
)
"""Keys that an EDF has by the same name and with the same values."""

SERVICE: tuple[Row, ...] = (
    adapted(
        "services",
        "`services`",
        "names are in lower case and have no dots; others are changed",
        (Kept.EXACT, ""),
        (Kept.REFUSED, "there is none"),
    ),
    *(exact(f"{_S}.{key}") for key in SAME if key not in ("image", "logging", "profiles", "security_opt")),
    exact(f"{_S}.image", "", (Kept.DROPPED, "beside `build`: an image that is built is named after its content")),
    exact(f"{_S}.security_opt", "", (Kept.REFUSED, "a profile of seccomp in a file")),
    exact(f"{_S}.profiles", "", (Kept.ADAPTED, "`--profile` chooses services when the files are imported")),
    exact(f"{_S}.logging"),
    exact(f"{_S}.logging.driver", "`logging.driver`"),
    exact(f"{_S}.logging.options", "`logging.options`"),
    exact(
        f"{_S}.environment",
        "",
        (Kept.ADAPTED, "a name without a value is left out unless `--set` gives one; secrets of env files are told"),
    ),
    adapted(f"{_S}.env_file", "`environment`", "its values stand in the service's `environment`"),
    adapted(f"{_S}.env_file.path", "`environment`", "its values stand in the service's `environment`"),
    exact(f"{_S}.env_file.format", "`environment`"),
    exact(f"{_S}.env_file.required", "`environment`"),
    exact(f"{_S}.expose", "", (Kept.DROPPED, "a range or a protocol that an EDF has no form for")),
    exact(f"{_S}.labels", "", (Kept.DROPPED, "those that begin with `srprov.`, `com.docker.` and the like")),
    adapted(f"{_S}.label_file", "`labels`", "its labels stand in the service's `labels`"),
    dropped(f"{_S}.annotations", "they are for other runtimes than Docker's"),
    Row(f"{_S}.ulimits", Kept.EXACT, "`ulimits`", whole=True),
    dropped(f"{_S}.attach", "it concerns what `docker compose up` prints"),
    exact(
        f"{_S}.hostname",
        "",
        (Kept.ADAPTED, "beside a name that others use"),
        (Kept.DROPPED, "with `network: host`, in several replicas, or where another service has the name"),
    ),
    dropped(
        f"{_S}.container_name",
        "containers are named after instance and service",
        (Kept.ADAPTED, "another service uses the name: it becomes `hostname`"),
        (Kept.REFUSED, "another service uses the name, and no `hostname` can be it"),
    ),
    dropped(f"{_S}.domainname", "no field says it"),
    dropped(f"{_S}.mac_address", "the overlay derives addresses by itself"),
    exact(
        f"{_S}.extra_hosts",
        "",
        (Kept.DROPPED, "the name of a service, or an address on a network of the file"),
    ),
    dropped(f"{_S}.dns", "names are found by the hosts file, then as the robot finds them; see `extra_hosts`"),
    dropped(f"{_S}.dns_opt", "as `dns`"),
    dropped(f"{_S}.dns_search", "as `dns`"),
    exact(
        f"{_S}.network_mode",
        "`network`",
        (Kept.ADAPTED, "`bridge` is the overlay"),
        (Kept.REFUSED, f"`service:` and `container:`: {_ANOTHER}"),
    ),
    exact(f"{_S}.pid", "", (Kept.REFUSED, f"`service:` and `container:`: {_ANOTHER}")),
    exact(f"{_S}.ipc", "", (Kept.REFUSED, f"`service:` and `container:`: {_ANOTHER}")),
    dropped(f"{_S}.uts", "with `network: host` a container has the robot's host name anyway"),
    dropped(f"{_S}.userns_mode", "no field says it; engines without remapped users are not concerned"),
    dropped(f"{_S}.cgroup", "no field says it"),
    dropped(f"{_S}.cgroup_parent", "no field says it"),
    exact(f"{_S}.pids_limit", "", (Kept.DROPPED, "no limit is the default")),
    adapted(f"{_S}.cpu_quota", "`cpus`", "`cpu_quota` over `cpu_period` is `cpus`"),
    adapted(f"{_S}.cpu_period", "`cpus`", "as `cpu_quota`"),
    *(dropped(f"{_S}.{key}", _SCHEDULER) for key in ("cpu_shares", "cpu_rt_period", "cpu_rt_runtime")),
    *(dropped(f"{_S}.{key}", _WINDOWS) for key in ("cpu_count", "cpu_percent", "isolation")),
    Row(f"{_S}.credential_spec", Kept.DROPPED, "", _WINDOWS, whole=True),
    dropped(f"{_S}.mem_swappiness", "no field says it"),
    dropped(f"{_S}.memswap_limit", "no field says it; `mem_limit` counts memory without swap"),
    dropped(f"{_S}.oom_kill_disable", "no field says it; see `oom_score_adj`"),
    dropped(f"{_S}.storage_opt", "no field says it"),
    Row(f"{_S}.blkio_config", Kept.DROPPED, "", "no field says it", whole=True),
    adapted(
        f"{_S}.platform",
        "`requires.arch`, or `platforms` of the CDF",
        "the robot must have this architecture",
        (Kept.REFUSED, "a platform that robots cannot have"),
    ),
    exact(
        f"{_S}.pull_policy",
        "",
        (Kept.ADAPTED, "a plan has no clock: `daily`, `weekly` and `every_…` are `always`"),
    ),
    dropped(f"{_S}.pull_refresh_after", "a plan has no clock"),
    exact(f"{_S}.scale", "`replicas`"),
    adapted(
        f"{_S}.links",
        "`depends_on`",
        "all services find each other by name; the order of starting is kept",
        (Kept.REFUSED, "an alias is used, and no `hostname` can be it"),
    ),
    refused(f"{_S}.external_links", "no container outside of the experiment is on its network"),
    refused(f"{_S}.volumes_from", "volumes of another container are not taken over: name them in both services"),
    adapted(f"{_S}.extends", "the service itself", "what is extended is merged into the service", (Kept.EXACT, "")),
    adapted(f"{_S}.extends.service", "the service itself", "as `extends`"),
    adapted(f"{_S}.extends.file", "the service itself", "as `extends`", APART),
    Row(f"{_S}.develop", Kept.DROPPED, "", "containers are not watched while files are edited", whole=True),
    Row(
        f"{_S}.post_start",
        Kept.REFUSED,
        "",
        "no command runs beside a container's own: start it in `command`",
        whole=True,
    ),
    Row(f"{_S}.pre_stop", Kept.REFUSED, "", "no command runs before a stop: trap the signal in `command`", whole=True),
    Row(f"{_S}.provider", Kept.REFUSED, "", "a service is a container", whole=True),
    Row(f"{_S}.models", Kept.REFUSED, "", "no runtime for models is provisioned", whole=True),
    refused(f"{_S}.use_api_socket", "it would give the caller's own credentials to the container"),
)
