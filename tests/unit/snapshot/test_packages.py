"""Debian's packages, archives and Python's packages, from what robots say: right, and with lies in it."""

from __future__ import annotations

import base64
import json

from srprov.snapshot.debian import Package, choose, parse_automatic, parse_packages, parse_policy, policy_query
from srprov.snapshot.notes import Notes
from srprov.snapshot.python import parse_installed
from srprov.snapshot.sources import (
    is_distributions,
    keys_query,
    origins_query,
    parse_keys,
    parse_origins,
    parse_sources,
)
from tests.readonly import shell_violations


def line(
    name: str, *, depends: str = "", essential: str = "", status: str = "ii ", version: str = "1.0-1",
    priority: str = "optional",
) -> str:  # fmt: skip
    return "\t".join([status, name, "amd64", version, essential, priority, "", depends])


def test_only_what_was_installed_by_hand_and_does_not_come_by_itself_is_chosen() -> None:
    """A recommendation, and the second of two alternatives, are asked for by name."""
    listed = [
        line("base-files", essential="yes", depends="libc6 (>= 2.3), awk"),
        line("libc6"),
        line("mawk"),
        line("apt", depends="libc6"),
        line("ros", depends="libros (= 1:2), cron | anacron, mta | exim, libc6:any"),
        line("libros"),
        line("anacron"),
        line("exim"),
        line("docs"),
        line("tzdata", priority="required"),
        line("gone", status="rc "),
        line("hand", status="hi "),
    ]
    notes = Notes()
    packages = parse_packages("\n".join(listed), notes)
    assert len(packages) == 11 and notes.all() == ()
    auto = parse_automatic(
        "".join(f"Package: {n}\nAuto-Installed: 1\n\n" for n in ("libros", "anacron", "exim", "docs", "mawk"))
    )
    chosen = choose(packages, auto)
    assert [one.name for one in chosen.by_hand] == ["hand", "ros"]
    assert [one.name for one in chosen.others] == ["anacron", "docs", "exim", "mawk", "tzdata"]


def test_names_with_syntax_of_a_shell_or_a_dockerfile_are_no_packages() -> None:
    notes = Notes()
    odd = ["a;reboot", "x$(id)", "--option", "../x", "a b", "A", "é", "x\\", "`id`"]
    packages = parse_packages(
        "\n".join([*map(line, odd), line("ok"), line("bad", version="1 && rm"), "x", "\t" * 9]), notes
    )
    assert [one.name for one in packages] == ["ok"]
    assert len(notes.all()) == len(odd) + 1 and all(note.kind == "lost" for note in notes.all())
    many = Notes()
    assert len(parse_packages("\n".join(line(f"p{number}") for number in range(9000)), many)) == 6000
    assert "more than can be listed" in many.all()[0].words


def test_dependencies_in_a_circle_and_without_end_are_no_matter() -> None:
    packages = [Package(name=f"p{n}", version="1", depends=((f"p{(n + 1) % 3000}",),)) for n in range(3000)]
    assert choose(packages, {f"p{n}" for n in range(1, 3000)}).others == ()
    endless = line("xx", depends=", ".join(f"a{n} | b{n}" for n in range(50_000)))
    assert len(parse_packages(endless, Notes())[0].depends) <= 401


def test_where_packages_come_from_is_told_by_apt() -> None:
    policy = """\
tree:
  Installed: 2.1.0-1
  Candidate: 2.1.0-1
  Version table:
 *** 2.1.0-1 500
        500 http://deb.debian.org/debian bookworm/main amd64 Packages
        100 /var/lib/dpkg/status
ros-humble-x:
  Installed: 1-0jammy
  Candidate: 2-0jammy
  Version table:
     2-0jammy 500
        500 http://packages.ros.org/ros2/ubuntu jammy/main amd64 Packages
 *** 1-0jammy 100
        100 /var/lib/dpkg/status
nodejs:
  Installed: 20.1-1nodesource1
  Candidate: 20.1-1nodesource1
  Version table:
 *** 20.1-1nodesource1 100
        100 /var/lib/dpkg/status
     18.1 500
        500 http://deb.debian.org/debian bookworm/main amd64 Packages
mine:
  Installed: 1
  Candidate: 1
  Version table:
 *** 1 100
        100 /var/lib/dpkg/status
"""
    found = parse_policy(policy)
    assert found.ahead == {"nodejs"}
    assert found.addresses == {
        "nodejs": ("http://deb.debian.org/debian",),
        "tree": ("http://deb.debian.org/debian",),
        "ros-humble-x": ("http://packages.ros.org/ros2/ubuntu",),
        "mine": (),
    }
    assert shell_violations(policy_query(["tree", "g++"]).command) == []
    assert shell_violations("apt-cache -o Dir::Cache::pkgcache= policy x") != []


def test_archives_beside_the_distributions_are_written_anew() -> None:
    notes = Notes()
    said = """\
/etc/apt/sources.list:deb http://deb.debian.org/debian bookworm main
/etc/apt/sources.list:deb [arch=amd64 signed-by=/usr/share/keyrings/r.gpg] http://packages.ros.org/ros2/ubuntu j main#
/etc/apt/sources.list:# deb http://other/x y z
/etc/apt/sources.list:deb-src http://packages.ros.org/ros2/ubuntu jammy main
/etc/apt/sources.list:deb https://user:hunter2@private.lab/repo ./
/etc/apt/sources.list:deb http://x/$(id) stable main
/etc/apt/sources.list:deb [signed-by=/home/robot/key] http://evil/x stable main
/etc/apt/sources.list.d/a.sources:Types: deb deb-src
/etc/apt/sources.list.d/a.sources:URIs: https://download.docker.com/linux/debian https://nvidia.github.io/x
/etc/apt/sources.list.d/a.sources:Suites: bookworm
/etc/apt/sources.list.d/a.sources:Components: stable
/etc/apt/sources.list.d/a.sources:Signed-By:
/etc/apt/sources.list.d/a.sources: -----BEGIN PGP PUBLIC KEY BLOCK-----
/etc/apt/sources.list.d/a.sources:
/etc/apt/sources.list.d/a.sources:Types: deb
/etc/apt/sources.list.d/a.sources:URIs: http://off/x
/etc/apt/sources.list.d/a.sources:Suites: y
/etc/apt/sources.list.d/a.sources:Enabled: no
/home/robot/x.list:deb http://not/ours stable main
"""
    found = parse_sources(said, notes)
    assert [one.line() for one in found] == [
        "deb http://deb.debian.org/debian bookworm main",
        "deb [arch=amd64 signed-by=/usr/share/keyrings/r.gpg] http://packages.ros.org/ros2/ubuntu j main",
    ]
    kinds = [note.kind for note in notes.all()]
    assert kinds.count("secret") == 1 and "hunter2" not in str(notes.all())
    assert any("a form that is not written again" in note.words for note in notes.all())
    assert any("which is not read" in note.words for note in notes.all())


ORIGINS = """\
Package files:
 100 /var/lib/dpkg/status
     release a=now
 500 http://packages.ros.org/ros2/ubuntu jammy/main amd64 Packages
     release v=,o=ROS,a=jammy,n=jammy,l=,c=main,b=amd64
     origin packages.ros.org
 500 https://cache.lab/x/y bookworm/main amd64 Packages
     release v=12.12,o=Debian,a=oldstable,n=bookworm,l=Debian,c=main,b=amd64
     origin cache.lab
"""


def test_who_signed_an_archive_says_whose_it_is() -> None:
    origins = parse_origins(ORIGINS)
    assert origins == {"http://packages.ros.org/ros2/ubuntu": "ROS", "https://cache.lab/x/y": "Debian"}
    assert is_distributions("https://cache.lab/x/y/", origins) and not is_distributions("https://cache.lab/x/y")
    assert not is_distributions("http://packages.ros.org/ros2/ubuntu", origins)
    assert shell_violations(origins_query().command) == []


def test_a_mirror_of_the_distribution_is_the_distributions() -> None:
    assert not is_distributions("http://packages.ros.org/ros2/ubuntu")
    assert not is_distributions("https://download.docker.com/linux/debian")
    assert is_distributions("http://mirror.lab:8080/debian-security/") and is_distributions(
        "http://ports.ubuntu.com/ubuntu-ports"
    )
    assert not is_distributions("http://packages.ros.org/ros2/ubuntu.example") and not is_distributions(
        "http://notdebian.org/x"
    )


def test_keys_are_public_and_whole() -> None:
    coded = base64.b64encode(b"public").decode()
    private = base64.b64encode(b"-----BEGIN PGP PRIVATE KEY BLOCK").decode()
    said = "".join(
        f"{path} {content}\n"
        for path, content in (
            ("/usr/share/keyrings/a.gpg", coded),
            ("/usr/share/keyrings/b.gpg", private),
            ("/etc/shadow", coded),
            ("/usr/share/../x", coded),
        )
    )
    assert parse_keys(said) == {"/usr/share/keyrings/a.gpg": b"public"}
    found = parse_sources("/etc/apt/sources.list:deb http://a/x y z\n", Notes())
    assert [shell_violations(keys_query(found, root=root).command) for root in (True, False)] == [[], []]


def installed(folder: str, name: str, version: str, direct: object = None) -> str:
    return f"dist {folder}\0Name: {name}\nVersion: {version}\n\0{json.dumps(direct) if direct is not None else ''}\0"


def test_pips_packages_keep_the_commit_that_they_came_from() -> None:
    place = "/usr/local/lib/python3.11/dist-packages"
    vcs = {"url": "https://github.com/a/b.git", "vcs_info": {"vcs": "git", "commit_id": "a" * 40}, "subdirectory": "py"}
    notes = Notes()
    found = parse_installed(
        installed(f"{place}/idna-3.7.dist-info", "idna", "3.7")
        + installed(f"{place}/My_Pkg-1.0.dist-info", "my-pkg", "1.0", vcs),
        notes,
    )
    assert [(one.name, one.version, one.git, one.commit, one.subfolder) for one in found] == [
        ("idna", "3.7", "", "", ""),
        ("my-pkg", "1.0", "https://github.com/a/b.git", "a" * 40, "py"),
    ]
    assert notes.all() == ()


def test_metadata_that_lies_is_noted() -> None:
    place = "/usr/local/lib/python3.11/dist-packages"
    git = {"vcs": "git", "commit_id": "a" * 40}
    lies = [
        installed(f"{place}/idna-3.7.dist-info", "requests", "3.7"),
        installed(f"{place}/idna-3.7.dist-info", "idna", "9"),
        installed(f"{place}/x-1.dist-info", "x", "1; rm -rf /"),
        installed(f"{place}/-e-1.dist-info", "-e", "1"),
        installed(f"{place}/edit-1.dist-info", "edit", "1", {"url": "file:///home/a", "dir_info": {"editable": True}}),
        installed(f"{place}/arch-1.dist-info", "arch", "1", {"url": "https://u:hunter2@h/x.zip", "archive_info": {}}),
        installed(
            f"{place}/hg-1.dist-info",
            "hg",
            "1",
            {"url": "https://h/x", "vcs_info": {"vcs": "hg", "commit_id": "a" * 40}},
        ),
        installed(
            f"{place}/short-1.dist-info", "short", "1", {"url": "x", "vcs_info": {"vcs": "git", "commit_id": "main"}}
        ),
        installed(f"{place}/up-1.dist-info", "up", "1", {"url": "x", "vcs_info": git, "subdirectory": "../../etc"}),
        installed(f"{place}/list-1.dist-info", "list", "1", [1, 2]),
    ]
    notes = Notes()
    assert parse_installed("".join(lies), notes) == ()
    assert len(notes.all()) == len(lies) and "hunter2" not in str(notes.all())
    assert parse_installed("dist /x\0Name: cut", Notes()) == () and parse_installed("", Notes()) == ()
