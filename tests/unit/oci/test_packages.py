"""What is installed in an image, by the files of its layers."""

from __future__ import annotations

import io
import itertools
import json
import random
import tarfile
from collections.abc import Iterator

import pytest

from srprov.oci import databases, sbom
from srprov.oci.databases import Room, merged
from srprov.oci.packages import Package, System, as_named, packages, system
from srprov.oci.packing import Packer, most_content, unpacked
from tests.bounded import bounded
from tests.unit.evidence.imaged import DEBIAN, NUMPY, layer


def pieces(data: bytes, size: int = 1000) -> Iterator[bytes]:
    return (data[at : at + size] for at in range(0, len(data), size))


def found(*layers: bytes) -> tuple[Package, ...]:
    return packages(merged([databases.read(pieces(one), Room()) for one in layers]))


def test_each_kind_of_package_is_read() -> None:
    apk = "P:musl\nV:1.2.4-r2\nA:x86_64\n\nP:zlib\nV:1.2.13-r1\nA:x86_64\n"
    node = "root/.nvm/v20/lib/node_modules"
    files = {
        **DEBIAN, **NUMPY, "lib/apk/db/installed": apk,
        "opt/venv/lib/python3.11/site-packages/Tool.egg-info/PKG-INFO": "Name: Tool\nVersion: 2.0\n\nName: no\n",
        f"{node}/npm/package.json": '{"name": "npm", "version": "10.1.0"}',
        f"{node}/npm/node_modules/inner/package.json": '{"name": "inner", "version": "1.0.0"}',
        "usr/local/lib/node_modules/@scope/ws/package.json": '{"name": "@scope/ws", "version": "8.18.0"}',
        "ws/install/talker/share/talker/package.xml":
            '<package format="2"><name>talker</name><version compatibility="1">0.3.1</version></package>',
        "var/lib/dpkg/status.d/base": "Package: base-files\nVersion: 12\nArchitecture: all\n",
        "var/lib/dpkg/status.d/base.md5sums": "Package: no\nVersion: 1\n",
    }  # fmt: skip
    assert found(layer(files)) == (
        Package("apk", "musl", "1.2.4-r2", "x86_64"), Package("apk", "zlib", "1.2.13-r1", "x86_64"),
        Package("deb", "base-files", "12", "all"), Package("deb", "curl", "7.88.1-10", "amd64"),
        Package("npm", "@scope/ws", "8.18.0"), Package("npm", "npm", "10.1.0"),
        Package("pypi", "Tool", "2.0"),
        Package("pypi", "numpy", "1.26.4", by="pip"), Package("ros", "talker", "0.3.1"),
    )  # fmt: skip
    assert [as_named(one) for one in found(layer(files))] == [
        "musl@1.2.4-r2", "zlib@1.2.13-r1", "base-files=12", "curl=7.88.1-10", "@scope/ws@8.18.0", "npm@10.1.0",
        "Tool==2.0",
        "numpy==1.26.4", "talker@0.3.1",
    ]  # fmt: skip


def test_a_layer_takes_away_what_is_below_it() -> None:
    base = layer({**DEBIAN, **NUMPY})
    assert [one.name for one in found(base)] == ["curl", "numpy"]
    gone = "usr/lib/python3/dist-packages"
    for name in (f"{gone}/.wh.numpy-1.26.4.dist-info", f"{gone}/.wh..wh..opq", ".wh.usr"):
        assert [one.name for one in found(base, layer({name: ""}))] == ["curl"], name
    again = layer({f"{gone}/.wh..wh..opq": "", f"{gone}/x-1.dist-info/METADATA": "Name: x\nVersion: 1\n"})
    assert [one.name for one in found(base, again)] == ["curl", "x"]
    assert [one.name for one in found(layer({".wh.usr": ""}), base)] == ["curl", "numpy"]
    out = io.BytesIO()
    with tarfile.open(fileobj=out, mode="w") as tar:
        link = tarfile.TarInfo("var/lib/dpkg/status")
        link.type, link.linkname = tarfile.SYMTYPE, "/elsewhere"
        tar.addfile(link)
    assert [one.name for one in found(base, out.getvalue())] == ["numpy"]


@pytest.mark.parametrize("format", [tarfile.USTAR_FORMAT, tarfile.GNU_FORMAT, tarfile.PAX_FORMAT])
def test_layers_of_all_tools_are_read(format: int) -> None:
    name = "x" * 90 + "/" + "y" * 60 + "/z-1.dist-info/METADATA"
    tar = layer({name: "Name: z\nVersion: 1\n", "./etc/os-release": "ID=x\n", **DEBIAN}, format=format)
    assert [one.name for one in found(tar)] == ["curl", "z"]
    for size in (1, 511, 513):
        assert databases.read(pieces(tar, size), Room()) == databases.read(pieces(tar), Room())


def hostile() -> dict[str, bytes]:
    long = tarfile.TarInfo("x")
    long.type, long.size = b"L", 1 << 40
    sparse = tarfile.TarInfo("x")
    sparse.type = b"S"
    pax = tarfile.TarInfo("x")
    pax.type, pax.size = tarfile.XHDTYPE, 20
    huge = tarfile.TarInfo("var/lib/dpkg/status")
    huge.size = 1 << 40
    gnu, plain = tarfile.GNU_FORMAT, pax.tobuf(tarfile.USTAR_FORMAT)
    return {
        "a long name": long.tobuf(gnu),
        "a sparse file": sparse.tobuf(gnu),
        "half": layer(DEBIAN)[:-9000],
        "none": b"x" * 4096,
        "a header that lies": plain + b"99999 path=x\n".ljust(512),
        "a huge list": huge.tobuf(gnu) + b"\0" * 1024,
        "headers without end": plain + b"10 path=x\n20 p=x".ljust(512, b"\n"),
    }


@pytest.mark.parametrize("kind", hostile())
def test_what_is_no_layer_is_said_and_read_to_its_end(kind: str) -> None:
    data = iter(pieces(hostile()[kind]))
    assert databases.read(data, Room()).unread
    assert next(data, None) is None


def test_what_gives_a_layer_may_fail() -> None:
    with pytest.raises(ValueError, match="cut off"):
        databases.read(_failing(), Room())


def _failing() -> Iterator[bytes]:
    yield layer(DEBIAN)[:512]
    raise ValueError("it is cut off")


def test_odd_names_and_versions_are_left_out() -> None:
    odd = "Package: a\x1b[2J\nVersion: 1\nStatus: x installed\n\nPackage: b\nVersion: $(x)\nStatus: x installed\n"
    files = {
        "var/lib/dpkg/status": odd,
        "usr/lib/node_modules/x/package.json": "[" * 5000,
        "share/x/package.xml": "<name>",
    }
    assert found(layer(files)) == ()
    assert system({"etc/os-release": b"ID='x\nVERSION_ID=$(x)\nID=debian\n"}) == System("debian", "")


def test_addresses_of_packages_are_written_as_their_specification_has_them() -> None:
    debian = System("debian", "12")
    wanted = {
        Package("deb", "libstdc++6", "1:12.2+deb~1", "amd64"):
            "pkg:deb/debian/libstdc%2B%2B6@1:12.2%2Bdeb~1?arch=amd64&distro=debian-12",
        Package("pypi", "Foo_Bar", "1!2.0+local"): "pkg:pypi/foo-bar@1%212.0%2Blocal",
        Package("npm", "@scope/ws", "8.0.0"): "pkg:npm/%40scope/ws@8.0.0",
        Package("ros", "talker", "0.3.1"): "pkg:generic/ros/talker@0.3.1",
    }  # fmt: skip
    assert {one: sbom.purl(one, debian) for one in wanted} == wanted


def test_a_list_is_read_as_it_was_written() -> None:
    some = found(layer({**DEBIAN, **NUMPY}))
    one = sbom.Sbom(image="sha256:1", name="a:1", architecture="amd64", system=System("debian", "12"), packages=some,
                    unread=("sha256:2: it is no tar",))  # fmt: skip
    assert sbom.read(sbom.text(one)) == one
    assert sbom.text(sbom.read(sbom.text(one))) == sbom.text(one)
    refs = [each["bom-ref"] for each in json.loads(sbom.text(one))["components"]]
    assert len(set(refs)) == len(refs)
    for text in ("[]", "{}", '{"bomFormat": "CycloneDX"}', "[" * 1000):
        with pytest.raises(ValueError, match=r"."):
            sbom.read(text)


def test_packed_layers_are_always_the_same_bytes() -> None:
    data = random.Random(1).randbytes(3000) + b"\0" * 300_000
    made = []
    for size in (100, 70_000, 1 << 20):
        packer = Packer()
        made.append(b"".join([*map(packer.add, pieces(data, size)), packer.finish()]))
        assert (packer.content_size, packer.size) == (len(data), len(made[-1]))
    assert len(set(made)) == 1
    assert b"".join(unpacked(pieces(made[0]), len(data))) == data
    bad = {
        "becomes more": made[0],
        "cut off": made[0][:-1],
        "something follows": made[0] + b"x",
        "not packed": b"x" * 99,
    }
    for why, given in bad.items():
        with pytest.raises(ValueError, match=why):
            list(unpacked(pieces(given), len(data) - (why == "becomes more")))
    assert most_content(0) == 1 << 30


def test_a_layer_that_never_ends_ends() -> None:
    packer = Packer()
    bomb = b"".join([packer.add(b"\0" * (8 << 20)), packer.finish()])
    with pytest.raises(ValueError, match="becomes more than 1 MiB"):
        for _ in unpacked(itertools.repeat(bomb), 1 << 20):
            pass


LONG = {
    "empty lines": ("var/lib/dpkg/status", b"\n" * (30 << 20)),
    "parts of nothing": ("var/lib/dpkg/status", b"a\n\n" * (10 << 20)),
    "lines": ("x.dist-info/METADATA", b"a:\n" * (10 << 20)),
    "blanks": ("x.dist-info/METADATA", b" " * (30 << 20)),
    "parts of Alpine": ("lib/apk/db/installed", b"P:a\n\n" * (6 << 20)),
    "lines of Alpine": ("lib/apk/db/installed", b"P:a\n" * (7 << 20)),
}


@pytest.mark.parametrize("kind", LONG)
def test_a_list_that_is_made_to_cost_much_costs_little(kind: str) -> None:
    """Packed, it has a thousandth of that."""
    name, content = LONG[kind]

    def listed() -> int:
        try:
            return len(packages({name: content}))
        except ValueError as error:
            assert "more than 100000 packages" in str(error)
            return 0

    assert bounded(listed) == 0


def test_what_is_read_of_a_list_are_its_first_fields_and_of_alpines_the_last() -> None:
    status = "\nStatus: x installed\nPackage: a\nPackage: b\nVersion: 1\nDescription: x\n Version: 2\n\t\nVersion: 3\n"
    assert packages({"var/lib/dpkg/status": status.encode()}) == (Package("deb", "a", "1"),)
    assert packages({"lib/apk/db/installed": b"P:a\nV:1\nP:b\nV:2\nX:P:c\n\n\nP:z\nV:3\n"}) == (
        Package("apk", "b", "2"), Package("apk", "z", "3"),
    )  # fmt: skip
    assert packages({"x.egg-info": b"Version: 1\r\nName: \xffx\r\nName: y\r\n\r\nName: z"}) == ()
    assert packages({"x.egg-info": b"Metadata: 1\nName: y\n \nVersion: 2\n"}) == ()


def test_layers_together_keep_no_more_than_a_bundle_needs() -> None:
    """Each may unpack to the most of one."""
    room = Room()
    big = layer({"var/lib/dpkg/status": b" " * (31 << 20)})
    assert [bool(databases.read(pieces(big, 1 << 20), room).unread) for _ in range(5)] == [False] * 4 + [True]
