"""Where engines keep what they have, also where no word or file in the usual place says it; in a real shell."""

from __future__ import annotations

import subprocess
from pathlib import Path

import pytest

from srprov.modules.mount_kind import links_refused, mount_kind

SHELLS = (("sh", "-c"), ("busybox", "sh", "-c"))


def tried(shell: tuple[str, ...], path: Path, containerd: Path) -> tuple[int, str]:
    script = links_refused([str(path)]).replace("/etc/containerd/config.toml", str(containerd))
    try:
        done = subprocess.run([*shell, script], capture_output=True, text=True, check=False)
    except FileNotFoundError:
        pytest.skip(f"there is no {shell[0]} here")
    return done.returncode, done.stderr


@pytest.mark.parametrize("shell", SHELLS, ids=lambda shell: shell[0])
@pytest.mark.parametrize(
    "line", ["root = 'NAME'", "  root_path = 'NAME'", '  root_path = "NAME" # on the disk', "root='NAME'"]
)
def test_containerd_s_folder_is_where_its_file_says(tmp_path: Path, shell: tuple[str, ...], line: str) -> None:
    """As `containerd config default` writes it since version 2: between single quotes, with paths of snapshotters."""
    engine, config = tmp_path / "ssd/containerd", tmp_path / "config.toml"
    engine.mkdir(parents=True)
    config.write_text(f"version = 3\nstate = ''\n{line.replace('NAME', str(engine))}\n")
    for path in (tmp_path / "ssd", engine, engine / "io.containerd.snapshotter.v1.overlayfs"):
        code, said = tried(shell, path, config)
        assert code == 1 and f"lies in {engine}" in said, said
    assert tried(shell, tmp_path / "maps", config) == (0, "")


@pytest.mark.parametrize("shell", SHELLS, ids=lambda shell: shell[0])
@pytest.mark.parametrize(
    ("program", "database"),
    [
        ("containerd", "io.containerd.metadata.v1.bolt/meta.db"),
        ("containerd", "metadata.db"),
        ("dockerd", "volumes/metadata.db"),
        ("dockerd", "buildkit/cache.db"),
        ("dockerd", "network/files/local-kv.db"),
    ],
)
def test_an_engine_s_folder_is_where_its_databases_are(
    tmp_path: Path, shell: tuple[str, ...], program: str, database: str
) -> None:
    """A file with another name says where, as with `--config-file`, or one that is imported."""
    engine, none = tmp_path / "ssd/odd place", tmp_path / "none"
    file = engine / database
    file.parent.mkdir(parents=True)
    (tmp_path / program).symlink_to("/bin/sleep")
    with file.open("wb") as opened, subprocess.Popen([tmp_path / program, "60"], pass_fds=[opened.fileno()]) as running:
        try:
            said = [tried(shell, path, none) for path in (tmp_path / "ssd", engine, engine / "rootfs")]
            beside = tried(shell, tmp_path / "maps", none)
        finally:
            running.kill()
    assert all(code == 1 and f"lies in {engine}" in why for code, why in said), said
    assert beside == (0, "")


def test_where_an_engine_mounts_images_is_said() -> None:
    """A container with the robot's /tmp put a link in the place of such a mount, and root made files where it led."""
    for path in ("/tmp", "/tmp/", "//tmp/."):
        kind, why = mount_kind(path)
        assert kind == "host-path" and "as root" in why
        assert "root may run or believe" in why
    assert "as root" not in mount_kind("/tmp/.X11-unix")[1] and mount_kind("/srv/tmp") == ("host-path", "")
