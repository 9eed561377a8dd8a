"""Image references: one image, one form."""

import pytest

from srprov.image_reference import parse_reference, pull_parameters

DIGEST = "sha256:" + "ab" * 32


@pytest.mark.parametrize(
    ("text", "canonical", "familiar"),
    [
        ("debian", "docker.io/library/debian:latest", "debian:latest"),
        ("debian:bookworm", "docker.io/library/debian:bookworm", "debian:bookworm"),
        ("library/debian", "docker.io/library/debian:latest", "debian:latest"),
        ("docker.io/debian", "docker.io/library/debian:latest", "debian:latest"),
        ("index.docker.io/library/debian:12", "docker.io/library/debian:12", "debian:12"),
        ("registry-1.docker.io/library/debian:12", "docker.io/library/debian:12", "debian:12"),
        ("osrf/ros:humble-desktop", "docker.io/osrf/ros:humble-desktop", "osrf/ros:humble-desktop"),
        ("docker.io/osrf/ros:humble", "docker.io/osrf/ros:humble", "osrf/ros:humble"),
        ("ghcr.io/a/b/c", "ghcr.io/a/b/c:latest", "ghcr.io/a/b/c:latest"),
        ("localhost/x", "localhost/x:latest", "localhost/x:latest"),
        ("localhost:5000/x:1", "localhost:5000/x:1", "localhost:5000/x:1"),
        ("registry:5000/x", "registry:5000/x:latest", "registry:5000/x:latest"),
        ("[::1]:5000/x:1", "[::1]:5000/x:1", "[::1]:5000/x:1"),
        (
            "10.213.0.1:5000/a-b/c__d.e:V_1.0-x",
            "10.213.0.1:5000/a-b/c__d.e:V_1.0-x",
            "10.213.0.1:5000/a-b/c__d.e:V_1.0-x",
        ),
        (f"debian@{DIGEST}", f"docker.io/library/debian@{DIGEST}", f"debian@{DIGEST}"),
        (f"debian:12@{DIGEST}", f"docker.io/library/debian@{DIGEST}", f"debian:12@{DIGEST}"),
    ],
)
def test_forms(text: str, canonical: str, familiar: str) -> None:
    reference = parse_reference(text)
    assert (reference.canonical, reference.familiar) == (canonical, familiar)
    assert reference.pinned is ("@" in text)
    assert parse_reference(canonical).canonical == canonical
    assert parse_reference(familiar) == reference


@pytest.mark.parametrize(
    ("text", "reason"),
    [
        ("", "name"),
        (":12", "name"),
        ("Debian", "lower case"),
        ("a//b", "name"),
        ("a/", "name"),
        ("a:", "tag"),
        ("a:b c", "tag"),
        ("a:" + "x" * 129, "tag"),
        ("a@sha256:12", "digest"),
        ("a@md5:" + "0" * 32, "digest"),
        ("debian\nRUN rm -rf /", "name"),
        ("debian AS x", "name"),
        ("--platform=linux/arm64 debian", "name"),
        ("$BASE", "name"),
        ("-bad.io/x", "registry"),
        ("x" * 300, "name"),
        # what an engine is given is the short form, which would be an id, or a name of another registry
        ("sha256:9", "an id"),
        ("moby-dangling@sha256:" + "ab" * 32, "an id"),
        ("library/sha256:9", "an id"),
        ("docker.io/library/sha256:" + "ab" * 32, "an id"),
        ("index.docker.io/sha256:9", "an id"),
        ("docker.io/127.0.0.1/x", "behind Docker Hub's"),
        ("docker.io/localhost/x", "behind Docker Hub's"),
        ("docker.io/docker.io/srprov/camera:1", "behind Docker Hub's"),
        ("registry-1.docker.io/index.docker.io/srprov/camera:1", "behind Docker Hub's"),
    ],
)
def test_no_reference(text: str, reason: str) -> None:
    with pytest.raises(ValueError, match=reason):
        parse_reference(text)


@pytest.mark.parametrize(
    ("name", "repository", "tag"),
    [
        ("debian", "debian", "latest"),
        ("debian:12", "debian", "12"),
        ("lab:5000/ros/base", "lab:5000/ros/base", "latest"),
        ("lab:5000/ros/base:noetic", "lab:5000/ros/base", "noetic"),
        (f"lab:5000/base@{DIGEST}", "lab:5000/base", DIGEST),
        # no images: the engine says so, and does not take them for an archive to import, as it does without a name
        (":12", ":12", "12"),
        ("debian:", "debian", "latest"),
    ],
)
def test_an_engine_pulls_one_image_by_its_tag_or_digest(name: str, repository: str, tag: str) -> None:
    """Never all tags of a repository, which is what an engine takes no tag for."""
    assert pull_parameters(name) == (("fromImage", repository), ("tag", tag))
