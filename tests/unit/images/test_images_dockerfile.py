"""CDF -> Dockerfile: complete, in an order that shares layers, and deaf to hostile values."""

import json
import re
from pathlib import Path
from types import MappingProxyType

import pytest
from hypothesis import given
from hypothesis import strategies as st
from msgspec.structs import replace

from srprov.definitions.containermodel import BuildFile, ContainerDefinition, Repository, Runtime
from srprov.errors import DefinitionError, Location
from srprov.images import quoting
from srprov.images.dockerfile import instruction_lines, render_dockerfile
from tests.bounded import bounded

CDF = ContainerDefinition(name="talker", file="/lab/talker.cdf", folder="/lab", base="debian:bookworm")
FULL = replace(
    CDF,
    apt=("ros-core", "curl=7.88.*"),
    pip=("numpy == 1.26.4", "cyclonedds"),
    npm=("@scope/pkg@^1.2.0",),
    repositories=(
        Repository(url="https://host/driver.git", ref="v1", path="/ws/src/driver", run=("make", "make install")),
        Repository(url="git@host:lab/msgs", ref="", path="/ws/it's"),
    ),
    files=(BuildFile(source="/lab/talker.py", dest="/opt/talker/"), BuildFile(source="/lab/conf", dest="/etc/talker")),
    run=("python3 -m compileall /opt/talker", "echo one\necho two"),
    build_environment=MappingProxyType({"ROS_DISTRO": "debian", "GREETING": 'say "hi" to $USER'}),
    runtime=Runtime(
        command=("talker.py", "--rate", "10"),
        entrypoint=("python3",),
        working_dir="/opt/talker",
        user="1000:1000",
        stop_signal="SIGINT",
    ),
    lines=MappingProxyType(
        {"repositories.0.run.1": 9, "base": 3, "packages": 4, "packages.apt": 5, "run.1": 12, "files": 8}
    ),
)


COMMITS = ("1" * 40, "2" * 40)


def test_a_full_definition() -> None:
    golden = Path(__file__).parents[2] / "golden" / "dockerfile.txt"
    assert render_dockerfile(FULL, COMMITS).text == golden.read_text(encoding="utf-8")


def test_the_smallest_definition() -> None:
    found = render_dockerfile(CDF)
    assert found.text == 'FROM debian:bookworm\nLABEL srprov.cdf="talker"\n'
    assert (found.base, found.pinned) == ("docker.io/library/debian:bookworm", False)


def test_beginning_with_nothing() -> None:
    found = render_dockerfile(replace(CDF, base="scratch"))
    assert found.text.startswith("FROM scratch\n")
    assert found.pinned


def test_a_line_that_the_builder_would_take_for_another_instruction_is_refused() -> None:
    with pytest.raises(DefinitionError) as caught:
        render_dockerfile(replace(CDF, run=("#(nop) COPY dir:0 in /conf ",)))
    (found,) = caught.value.problems
    assert found.path == "run.0" and "#(nop)" in found.message


def test_definitions_with_equal_packages_share_their_first_layers() -> None:
    other = replace(FULL, name="listener", apt=tuple(reversed(FULL.apt)), run=("true",), files=())
    one, two = render_dockerfile(FULL, COMMITS).text.split("\n"), render_dockerfile(other).text.split("\n")
    env = next(i for i, line in enumerate(one) if line.startswith("ENV GREETING"))
    assert one[:env] == two[:env]


def test_shell_lines_are_shell_and_exec_forms_are_json() -> None:
    for line in render_dockerfile(FULL, COMMITS).text.splitlines():
        word, _, rest = line.partition(" ")
        if word in ("COPY", "ENTRYPOINT", "CMD") or rest.startswith("["):
            assert isinstance(json.loads(rest), list)


def test_the_line_map_leads_back_to_the_definition() -> None:
    found = render_dockerfile(FULL, COMMITS)
    at = {line.split(" ")[0] + str(number): number for number, line in enumerate(found.text.splitlines(), 1)}
    assert len(found.lines) == len(found.text.splitlines())
    assert found.lines[1] == Location("/lab/talker.cdf", 3)
    assert found.lines[2] == found.lines[4] == Location("/lab/talker.cdf", 5)
    assert found.lines[at["RUN5"]] == Location("/lab/talker.cdf", 4)  # packages.pip is not in the map, packages is
    assert found.lines[at["RUN22"]] == Location("/lab/talker.cdf", 9)
    assert found.lines[at["COPY25"]] == Location("/lab/talker.cdf", 8)
    assert found.lines[at["RUN28"]] == Location("/lab/talker.cdf", 12)
    assert found.lines[at["USER29"]] == Location("/lab/talker.cdf", 1)


@pytest.mark.parametrize(
    "change",
    [
        {"base": "debian\nRUN evil"},
        {"base": "debian AS x"},
        {"apt": ("curl; evil",)},
        {"apt": ("-o=Dir::Etc=/x",)},
        {"apt": ("curl\nRUN evil",)},
        {"apt": ("curl-",)},
        {"apt": ("/tmp/x.deb",)},
        {"apt": ("$(evil)",)},
        {"pip": ("--index-url=http://evil",)},
        {"pip": ("numpy && evil",)},
        {"pip": ("numpy @ http://evil/x.whl",)},
        {"pip": ("numpy==1.0\\",)},
        {"npm": ("http://evil/x.tgz",)},
        {"npm": ("../x",)},
        {"build_environment": {"A": "x\nRUN evil"}},
        {"build_environment": {"A B": "x"}},
        {"build_environment": {"A=1 B": "x"}},
        {"files": (BuildFile(source="/x", dest="/a\nRUN evil"),)},
        {"files": (BuildFile(source="/x", dest=""),)},
        {"runtime": Runtime(working_dir="/a\nRUN evil")},
        {"runtime": Runtime(user="root\nRUN evil")},
        {"runtime": Runtime(user="$USER")},
        {"runtime": Runtime(stop_signal="SIGINT\nRUN evil")},
        {"name": "x\nRUN evil"},
        {"run": ("x" * 70_000,)},
    ],
    ids=str,
)
def test_hostile_values_are_refused(change: dict[str, object]) -> None:
    with pytest.raises(DefinitionError) as caught:
        render_dockerfile(replace(CDF, **change))
    assert len(caught.value.problems) == 1


def test_all_problems_are_said_at_once_and_at_their_lines() -> None:
    bad = replace(
        FULL, apt=("a;b",), pip=("--x",), build_environment={"A": "\n"}, run=("fine",), lines={"packages.apt": 5}
    )
    with pytest.raises(DefinitionError) as caught:
        render_dockerfile(bad)
    assert [problem.path for problem in caught.value.problems] == ["packages.pip.0", "environment.A", "packages.apt.0"]
    assert caught.value.problems[-1].location == Location("/lab/talker.cdf", 5)
    assert "such as 'curl=7.88.*'" in caught.value.problems[-1].message


@pytest.mark.parametrize(
    "script",
    [
        "echo a\nRUN evil",
        "echo a \\",
        "cat <<EOF\nx\nEOF",
        "# comment",
        "--mount=type=ssh x",
        '["a"]',
        "a\r\nUSER root",
        "\x01run.0\x01",
    ],
)
def test_a_run_line_stays_one_instruction(script: str) -> None:
    lines = render_dockerfile(replace(CDF, run=(script,))).text.splitlines()
    assert len(lines) == 3
    assert json.loads(lines[1].removeprefix("RUN ")) == ["/bin/sh", "-ec", script]


any_text = st.text(max_size=30)


@given(value=any_text, dest=any_text, script=any_text, folder=any_text, argument=any_text)
def test_no_value_becomes_an_instruction(value: str, dest: str, script: str, folder: str, argument: str) -> None:
    cdf = replace(
        CDF,
        build_environment={"A": value},
        files=(BuildFile(source="/x", dest="/" + dest),),
        run=(script,),
        runtime=Runtime(working_dir="/" + folder, command=(argument,), entrypoint=(argument, value)),
    )
    try:
        text = render_dockerfile(cdf).text
    except DefinitionError:
        return
    kinds = [line.partition(" ")[0] for line in text.rstrip("\n").split("\n")]
    assert kinds == ["FROM", "ENV", "WORKDIR", "COPY", "RUN", "ENTRYPOINT", "CMD", "LABEL"]


@given(value=st.text(st.characters(blacklist_categories=["Cc", "Cs"]), max_size=40))
def test_variables_keep_their_value(value: str) -> None:
    name, _, quoted = quoting.variable("A", value).partition("=")
    assert name == "A"
    assert re.fullmatch(r'"([^"$\\]|\\["$\\])*"', quoted)
    assert re.sub(r"\\(.)", r"\1", quoted[1:-1]) == value


@pytest.mark.parametrize(
    ("kind", "name", "plain"),
    [
        ("apt", "g++", "g++"),
        ("apt", "libstdc++6:arm64", "libstdc++6:arm64"),
        ("apt", "curl=7.88.1-10+deb12u8", "curl=7.88.1-10+deb12u8"),
        ("apt", "xz=1:2.3~rc1*", "xz=1:2.3~rc1*"),
        ("apt", "git/bookworm-backports", "git/bookworm-backports"),
        ("pip", "numpy", "numpy"),
        ("pip", "uvicorn[standard,x] >= 0.20, < 1", "uvicorn[standard,x]>=0.20,<1"),
        ("pip", "a~=1.4.2", "a~=1.4.2"),
        ("pip", "a==1.0+local.1", "a==1.0+local.1"),
        ("npm", "roslib@1.3.0", "roslib@1.3.0"),
        ("npm", "@scope/pkg", "@scope/pkg"),
        ("npm", "x@>=1.2", "x@>=1.2"),
    ],
)
def test_packages_with_versions(kind: str, name: str, plain: str) -> None:
    assert quoting.package(kind, name) == plain


@pytest.mark.parametrize("value", ["root", "1000", "1000:1000", "www-data:adm", "robot_1"])
def test_users(value: str) -> None:
    assert quoting.user(value) == value


@pytest.mark.parametrize("value", ["SIGINT", "INT", "9", "SIGRTMIN+3", "RTMAX-1"])
def test_signals(value: str) -> None:
    assert quoting.signal(value) == value


def test_instructions_are_counted_as_docker_counts_them() -> None:
    text = "# syntax=x\n\nFROM a\nRUN a \\\n  # in between\n  b \\\n\n  c\n# no\n  COPY x y\n"
    assert list(instruction_lines(text)) == [3, 4, 10]
    assert list(instruction_lines("# escape=`\nFROM a\nRUN a `\n b\\\nUSER x\n")) == [2, 3, 5]


@pytest.mark.parametrize("kind", ["apt", "pip", "npm"])
@pytest.mark.parametrize("name", [f"a{' ' * 500_000}b", "a" * 500_000 + "!", f"a[{'b,' * 200_000}", "a==1" * 200_000])
def test_a_package_of_megabytes_is_refused_at_once(kind: str, name: str) -> None:
    with pytest.raises(ValueError, match="is longer than 200 characters"):
        bounded(lambda: quoting.package(kind, name), cpu_s=0.5)
