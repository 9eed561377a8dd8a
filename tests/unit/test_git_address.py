"""Addresses of repositories: three transports, and nothing that git could take for anything else."""

import pytest

from srprov.git_address import check_ref, is_commit, parse_address


@pytest.mark.parametrize(
    ("text", "scheme"),
    [
        ("https://github.com/lab/driver.git", "https"),
        ("https://git.lab.example:8443/a/b", "https"),
        ("https://[::1]:8443/a", "https"),
        ("ssh://git@git.lab:2222/srv/driver.git", "ssh"),
        ("ssh://git.lab/~ada/driver", "ssh"),
        ("git@github.com:lab/driver.git", "ssh"),
        ("file:///srv/git/driver.git", "file"),
    ],
)
def test_three_transports_are_taken(text: str, scheme: str) -> None:
    assert (parse_address(text).scheme, parse_address(text).url) == (scheme, text)


def test_of_a_file_the_path_is_known() -> None:
    assert parse_address("file:///srv//git/./x/").path == "/srv/git/x"


@pytest.mark.parametrize(
    "text",
    [
        *("", "x", "../x", "/srv/x", "./x", "x.bundle", "host:path", "-x@host:y", "git@-host:y", "git@host:-y"),
        *("--upload-pack=touch /tmp/x", "-oProxyCommand=x", "ext::sh -c x", "https::https://x/y", "fd::7", "git@host:"),
        *(
            "http://host/x",
            "git://host/x",
            "ftp://host/x",
            "rsync://host/x",
            "HTTPS://host/x",
            "ssh://-oProxyCommand=x/y",
        ),
        *(
            "https://user:secret@host/x",
            "https://token@host/x",
            "ssh://git:secret@host/x",
            "https://host",
            "https://host/",
        ),
        *("https://host/x\n", "https://host/x y", "https://host/x?y=1", "https://host/x#y", "https://host/x\\y"),
        *(
            "file:///",
            "file://host/x",
            "file:///a/../etc",
            "file:///a%2e%2e",
            "file://x",
            "file:///a\0",
            f"https://h/{'a' * 1000}",
        ),
    ],
)
def test_everything_else_is_refused(text: str) -> None:
    with pytest.raises(ValueError) as refused:
        parse_address(text)
    assert "secret" not in str(refused.value)


@pytest.mark.parametrize("ref", ["main", "v1.2", "feature/x-1", "refs/heads/main", "1.0", "a" * 40, "humble@1"])
def test_names_of_branches_and_tags(ref: str) -> None:
    assert check_ref(ref) == ref


NO_NAMES = ["-x", "--upload-pack=x", "a..b", "a/", "/a", "a//b", ".a", "a.lock", "a*", "a:b", "a^", "a~1", "HEAD@{1}"]


@pytest.mark.parametrize("ref", ["", "a b", "a\n", "a" * 201, "+main", "refs/heads/*", *NO_NAMES])
def test_what_is_no_name(ref: str) -> None:
    with pytest.raises(ValueError):
        check_ref(ref)


def test_only_a_whole_id_is_a_commit() -> None:
    assert is_commit("a" * 40) and is_commit("0" * 64)
    assert not any(is_commit(one) for one in ("a" * 39, "a" * 41, "A" * 40, "g" * 40, "main"))
