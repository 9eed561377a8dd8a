"""Files that are meant to keep srprov busy: each is refused at its line, in seconds and within the memory it has."""

from __future__ import annotations

import contextlib
import os
from collections.abc import Callable, Iterable, Iterator
from pathlib import Path

import pytest

from srprov.cli.problems import render_problems
from srprov.definitions import check_files, checked, hostvars, load_inventory
from srprov.definitions.groups import HostEntry, Variables
from srprov.definitions.host_values import Values
from srprov.errors import DefinitionError, did_you_mean
from srprov.yamldoc.nodes import Findings, Scalar, Source
from tests.bounded import bounded

HEAD = "edf: 1\nname: a\n"
ROWS = range(1000)


def edf(services: str, more: str = "") -> str:
    return f"{HEAD}{more}services:\n{services}"


def service(fields: str) -> str:
    return edf(f"  a: {{image: x, {fields}}}\n")


EDFS = {
    "stop period": (service("stop_grace_period: 9999999h"), ":4:36: error[SRP-108]: '9999999h' is longer than 24h"),
    "interval": (service("healthcheck: {test: x, interval: 9999999h}"), "is longer than 24h"),
    "a number of 400 digits": (service(f"stop_grace_period: {'9' * 400}s"), "is longer than 24h"),
    "replicas": (service("replicas: 99999999"), ":4:27: error[SRP-108]: 99999999 is more than 1000"),
    "retries": (service("healthcheck: {test: x, retries: 1001}"), "1001 is more than 1000"),
    "gpus": (service("gpus: 1000000"), "4:23: error[SRP-108]: '1000000' is more than 999999"),
    "a kernel": (service(f"requires: {{kernel: '>={'9' * 5000}'}}"), "is not a version such as >=5.10"),
    "a range of ports": (service("ports: ['1-65535:1-65535']"), "publishes 65535 ports; 1000 are the most"),
    "ranges of ports": (
        service(f"ports: [{', '.join(f'{one}-{one + 999}' for one in range(1000, 60000, 1000))}]"),
        "more than 1000 ports are published",
    ),
    "a range of exposed ports": (
        edf("".join(f"  s{i}: {{image: x, expose: ['1-65535/tcp', '1-65535/udp']}}\n" for i in range(40))),
        ":4:27: error[SRP-108]: '1-65535/tcp' exposes 65535 ports; 1000 are the most",
    ),
    "ranges of exposed ports": (
        service(f"expose: [{', '.join(f'{one}-{one + 999}' for one in range(1000, 60000, 1000))}]"),
        ":4:37: error[SRP-110]: more than 1000 ports are exposed",
    ),
    "a port of overlays' links": (
        service("ports: ['127.0.0.1:760-770:760-770/udp']"),
        "publishes UDP port 4789, or one from 768 to 1023; overlays have those",
    ),
    "the port of overlays": (service("ports: ['4780-4790:80-90/udp']"), "publishes UDP port 4789, or one"),
    "a size": (service("shm_size: 99999999999999999t"), "is more than any machine has"),
    "a limit": (service(f"ulimits: {{nofile: {10**30}}}"), "expected"),
    "1e999": (service("cost: 1e999"), "expected a number"),
    "10**5000": (service(f"cost: {10**4000}"), "expected a number"),
    "a command": (service(f"command: '{'a' * 1_500_000}'"), "is longer than 100000 characters"),
    "misspelt keys and names": (
        edf("".join(f"  service-{i:04}: {{image: x, depends_on: [servise-{i:04}], cots: 3}}\n" for i in ROWS)),
        "there are more than 100 problems",
    ),
    "a key ninety thousand times": (
        f"srprov: 0.1.0\nservices: {{{'n,' * 90_000}}}\n",
        "there are more than 100 problems",
    ),
    "many services": (edf("".join(f"  s{i}: {{image: x}}\n" for i in range(1001))), "1001 entries; 1000 are the most"),
    "many values": (
        edf("  a: {image: x}\n", f"x-a: [{', '.join(['[' + '1, ' * 999 + '1]'] * 25)}]\n"),
        "the document holds more than 20000 values",
    ),
    "aliases of a long text": (
        edf("  a: {image: x}\n", f"x-a: &a {'a' * 1_000_000}\nx-b: [{'*a, ' * 999}*a]\n"),
        "the aliases stand for more text than files may have",
    ),
    "aliases of aliases": (
        edf("  a: {image: x}\n", f"x-a: &a [{'a' * 100_000}]\nx-b: &b [*a, *a, *a]\nx-c: [{'*b, ' * 99}*b]\n"),
        "the aliases stand for more text than files may have",
    ),
    "directives": (
        "".join(f"%TAG !{i}! x\n" for i in range(120_000)) + "--- {edf: 1}\n",
        "has more than 100 lines that begin with '%', as directives do",
    ),
    "a circle of a thousand": (
        edf("".join(f"  s{i}: {{image: x, depends_on: [s{(i + 1) % 1000}]}}\n" for i in ROWS)),
        "the services wait for each other: s0 -> s1 -> s2 -> s3 -> s4 -> s5 -> s6 -> s7 -> s8 -> s9 -> s10 -> s11",
    ),
    "relations": (
        edf(
            "".join(f"  s{i}: {{image: x}}\n" for i in ROWS),
            f"relations: {{same_robot: [{', '.join(f'[s{i}, s{i + 1}]' for i in range(999))}],\n"
            f" different_robot: [{', '.join(f'[s{i}, s{i + 1}]' for i in range(999))}]}}\n",
        ),
        "must run on different robots",
    ),
}


def problems(file: Path, text: str) -> str:
    """Return what `validate` prints; it must take no more than it may, and print no more than anybody reads."""
    file.write_text(text)
    told = bounded(lambda: render_problems(checked([file], outside=True)[0]))
    assert len(told) < 100_000
    return told


@pytest.mark.parametrize("case", EDFS)
def test_an_experiment_is_refused_at_its_line(tmp_path: Path, case: str) -> None:
    text, says = EDFS[case]
    told = problems(tmp_path / "a.edf", text)
    assert f"{tmp_path}/a.edf:" in told and says in told


@pytest.mark.parametrize(
    "field",
    [
        'command: ["%s"]', 'entrypoint: ["%s"]', 'environment: {A: "%s"}', 'labels: {a.b: "%s"}',
        'healthcheck: {test: ["CMD", "%s"]}',
    ],
)  # fmt: skip
def test_no_container_s_words_are_longer_than_its_engine_s_answer_may_be(tmp_path: Path, field: str) -> None:
    """A few bytes of YAML are many of JSON, and what is too long to be read was taken for nothing."""
    for text, says in (("a" * 100_000, ""), (r"\a" * 25_000, "take more than 128 KiB together")):
        told = problems(tmp_path / "a.edf", edf(f"  a: {{image: x, {field % text}}}\n"))
        assert (says in told) if says else told == ""


def test_a_chain_of_a_thousand_services_is_no_mistake(tmp_path: Path) -> None:
    chain = "".join(f"  s{i}: {{image: x, depends_on: [s{i + 1}], replicas: 2}}\n" for i in range(999))
    assert problems(tmp_path / "a.edf", edf(f"{chain}  s999: {{image: x}}\n")) == ""


def listed(key: str, entries: Iterable[str]) -> str:
    return f"{key}: [{', '.join(entries)}]"


def services(count: int, fields: Callable[[int], str]) -> str:
    return "".join(f"  s{i}: {{image: x, {fields(i)}}}\n" for i in range(count))


PLAIN = "".join(f"  t{i}: {{image: x, replicas: 2}}\n" for i in range(980))
LARGE = {
    "one port at many addresses": edf(
        services(18, lambda i: listed("ports", (f"'10.{i}.{j >> 8}.{j & 255}:80:80'" for j in ROWS)))
    ),
    "exposed ports": edf(services(1000, lambda i: f"expose: ['{i + 1}-{i + 1000}/udp']")),
    "further names": edf(
        PLAIN + services(16, lambda i: listed("extra_hosts", (f"'x-{i}-{j}:10.0.0.1'" for j in ROWS)))
    ),
    "secrets beside volumes": edf(
        services(8, lambda i: f"{listed('secrets', (f's{j}' for j in ROWS))}, "
                              f"{listed('volumes', (f'v{i}-{j}:/v{j}:ro' for j in ROWS))}"),
        f"secrets: {{{', '.join(f's{j}: {{env: A}}' for j in ROWS)}}}\n",
    ),
    "shared volumes": edf(
        services(1000, lambda i: listed("volumes", (f"v{i // 2}-{j}:/v{j}" for j in range(16)))),
    ),
    "a chain of shared volumes": edf(
        services(1000, lambda i: listed("volumes", (f"v{i + j}:/v{j}" for j in range(16)))),
    ),
    "relations of others": edf(
        "".join(f"  s{i}: {{image: x}}\n" for i in ROWS),
        f"relations: {{same_robot: [{', '.join(['[' + ', '.join(f's{i}' for i in range(500)) + ']'] * 17)}],\n"
        f" different_robot: [{', '.join(['[' + ', '.join(f's{i}' for i in range(500, 1000)) + ']'] * 17)}]}}\n",
    ),
}  # fmt: skip


@pytest.mark.parametrize("case", LARGE)
def test_a_large_experiment_that_is_right_is_read_in_time(tmp_path: Path, case: str) -> None:
    assert problems(tmp_path / "a.edf", LARGE[case]) == ""


def test_aliases_of_several_files_count_together(tmp_path: Path) -> None:
    """Each of the CDFs has 10 KiB, and 1 MiB in a thousand variables."""
    for number in range(100):
        text = f"cdf: 1\nname: a\nimage: x\nx-a: &a {'a' * 10_000}\nenvironment: {{"
        (tmp_path / f"{number}.cdf").write_text(f"{text}{', '.join(f'A{i}: *a' for i in range(100))}}}\n")
    text = edf("".join(f"  s{i}: {{cdf: {i}.cdf}}\n" for i in range(100)))
    assert "the aliases stand for more text than files may have" in problems(tmp_path / "a.edf", text)


def test_a_folder_that_is_named_a_thousand_times_is_walked_through_once(tmp_path: Path) -> None:
    for number in range(18_000):
        parent = tmp_path / f"data/{number // 1000}"
        parent.mkdir(parents=True, exist_ok=True)
        if number % 2:
            os.mknod(parent / str(number))
        else:
            (parent / str(number)).symlink_to("nowhere")
    text = edf(services(3, lambda _: listed("volumes", (f"./data:/d{j}:ro" for j in ROWS))))
    assert problems(tmp_path / "a.edf", text) == ""


def test_folders_have_no_more_files_together_than_are_shipped(tmp_path: Path) -> None:
    for number in range(15_000):
        parent = tmp_path / f"a/b/c/d/{number // 1000}"
        parent.mkdir(parents=True, exist_ok=True)
        os.mknod(parent / str(number))
    text = edf(service("volumes: ['./a:/a', './a/b:/b', './a/b/c:/c', './a/b/c/d:/d']").partition("services:\n")[2])
    assert "'./a/b/c/d' holds, with all else that is shipped, more files than" in problems(tmp_path / "a.edf", text)


def test_files_that_are_not_there_are_not_looked_for_among_thousands_each(tmp_path: Path) -> None:
    for number in range(50_000):
        os.mknod(tmp_path / f"{number}.cdf")
    text = edf("".join(f"  s{i}: {{cdf: no-{i}.cdf}}\n" for i in range(90)))
    assert "the CDF 'no-7.cdf' does not exist" in problems(tmp_path / "a.edf", text)


def test_a_small_experiment_that_names_much_is_refused(tmp_path: Path) -> None:
    """A thousand services of one large file each: every file is fine alone."""
    (tmp_path / "a.env").write_text("".join(f"V{i}={'x' * 90}\n" for i in ROWS))
    text = edf("".join(f"  s{i}: {{image: x, env_file: a.env}}\n" for i in ROWS))
    assert "with it, all files that belong together are larger than 2 MiB" in problems(tmp_path / "a.edf", text)


def test_cdfs_cannot_extend_each_other_for_ever(tmp_path: Path) -> None:
    for number in range(2000):
        (tmp_path / f"{number}.cdf").write_text(f"cdf: 1\nextends: {number + 1}.cdf\n")
    told = problems(tmp_path / "a.edf", edf("  a: {cdf: 0.cdf}\n"))
    assert f"{tmp_path}/10.cdf:2:10: error[SRP-110]: more than 10 CDFs extend each other" in told


INVENTORIES = {
    "ranges": ("h.yml", "all:\n  hosts:\n" + "".join(f"    r{i}[0:9999]:\n" for i in ROWS), "more than 10000 hosts"),
    "groups in groups": (
        "h.ini",
        "".join(f"[g{i}:children]\ng{i + 1}\n" for i in range(20_000)) + "[g20000]\nr1\n",
        "",
    ),
    "hosts in groups": (
        "h.ini",
        "[g500]\nr[0:9999]\n" + "".join(f"[g{i}:children]\ng{i + 1}\n" for i in range(500)),
        "h.ini:904:1: error[SRP-110]: hosts are in more than 500000 groups",
    ),
    "a range in each group": (
        "h.ini",
        "".join(f"[g{i}]\nrobot[1:10000]\n" for i in ROWS),
        "h.ini:102:1: error[SRP-110]: hosts are in more than 500000 groups",
    ),
    "a range in each group of YAML": (
        "h.yml",
        "all:\n  children:\n" + "".join(f"    g{i}: {{hosts: {{'robot[1:10000]': }}}}\n" for i in ROWS),
        "h.yml:53:19: error[SRP-110]: hosts are in more than 500000 groups",
    ),
    "a range in each line": ("h.ini", "robot[1:10000]\n" * 60_000, "h.ini:51:1: error[SRP-110]: hosts are in"),
    "another range in each line": (
        "h.ini",
        "".join(f"r{i}-[1:10000]\n" for i in range(50_000)),
        "h.ini:2:1: error[SRP-110]: there are more than 10000 hosts",
    ),
    "a range too many in each line": ("h.ini", "a[1:9999]b[1:2]\n" * 60_000, "stands for more than 10000 names"),
    "a name with a hundred ranges": ("h.ini", f"{'[1:1]' * 99}[1:9999]\n" * 1900, "there are more than 100 problems"),
    "groups of the same groups": (
        "h.ini",
        "".join(f"[c{i}]\nc[1:1000]\n" for i in range(300))
        + "".join(f"[p{i}:children]\n" + "".join(f"c{j}\n" for j in range(300)) for i in range(500)),
        "hosts are in more than 500000 groups",
    ),
    "variables of a range": (
        "h.ini",
        "\nrobot[1:10000] " + " ".join(f"v{i}=1" for i in range(2500)),
        "h.ini:2:1: error[SRP-110]: hosts have more than 500000 variables",
    ),
    "variables of a range in YAML": (
        "h.yml",
        "all:\n  hosts:\n    robot[1:10000]:\n" + "".join(f"      v{i}: 1\n" for i in range(2500)),
        "h.yml:3:5: error[SRP-110]: hosts have more than 500000 variables",
    ),
    "two ways to each group": (
        "h.ini",
        "".join(f"[{a}{i}:children]\n{b}{i + 1}\n" for i in range(500) for a, b in ("aa", "ab", "ba", "bb"))
        + "[a500]\nr1\n",
        "",
    ),
    "a circle": ("h.ini", "".join(f"[g{i}:children]\ng{(i + 1) % 5000}\n" for i in range(5000)), "contains itself"),
    "a line": ("h.ini", "r1 a=" + "x" * 900_000, "h.ini:1:1: error[SRP-110]: the line is longer than 50000 characters"),
    "lines": ("h.ini", "r1\n" * 400_000, "is longer than 1000000 characters"),
    "lists in lists": (
        "h.ini",
        "r1\n[all:vars]\n" + f"a=[{f'{chr(91) * 50}{chr(93) * 50},' * 98}]\n" * 98,
        "h.ini:33:3: error[SRP-110]: lists, maps and quoted values have more than 300000 characters",
    ),
    "a short list in each line": ("h.ini", "r1\n[all:vars]\n" + "a=[]\n" * 190_000, "lists, maps and quoted values"),
    "what is no list in each line": ("h.ini", "r1\n[all:vars]\n" + "a='\n" * 230_000, "lists, maps and quoted values"),
    "short lists of hosts": ("h.ini", ("r1 " + "a=[] " * 9900 + "\n") * 19, "lists, maps and quoted values"),
    "a variable of each": (
        "h.yml",
        "all:\n  vars:\n" + "".join(f"    ansible_x{i}: 1\n" for i in range(25_000)) + "  hosts: {'r[0:999]': }\n",
        "",
    ),
    "a password of each": (
        "h.yml",
        "all:\n  hosts:\n" + "".join(f"    r{i}: {{ansible_password: pass-{i:05}-word}}\n" for i in range(3000)),
        "",
    ),
    "a mistake in each": (
        "h.yml",
        "all:\n  hosts:\n" + "".join(f"    r{i}: {{srprov_slots: x}}\n" for i in range(5000)),
        "there are more than 100 problems",
    ),
    "ssh's arguments": ("h.ini", f"r1 ansible_ssh_common_args='{'a' * 40_000}'", "longer than 10000 characters"),
}


@pytest.mark.parametrize("case", INVENTORIES)
def test_an_inventory_is_read_or_refused(tmp_path: Path, case: str) -> None:
    name, text, says = INVENTORIES[case]
    told = problems(tmp_path / name, text)
    assert says in told and bool(told) == bool(says)


def test_a_large_lab_is_far_from_the_limits(tmp_path: Path) -> None:
    """Ten thousand robots in thirty groups, with thirty variables each, written in the shortest way there is."""
    own = "ansible_port=2222 srprov_tags=arm " + " ".join(f"v{i}=1" for i in range(28))
    groups = "".join(f"[g{i}]\nrobot[1:10000]\n" for i in range(29))
    (tmp_path / "h.ini").write_text(f"robot[1:10000] {own}\n{groups}")
    counted = bounded(
        lambda: [(one.port, one.tags, len(one.groups)) for one in load_inventory([tmp_path / "h.ini"]).hosts.values()],
        cpu_s=6,
    )
    assert counted == [(2222, ("arm",), 29)] * 10_000


def test_every_robot_of_a_large_lab_may_have_a_list_of_its_own(tmp_path: Path) -> None:
    (tmp_path / "h.ini").write_text("".join(f"r{i} srprov_tags=\"['arm','camera']\"\n" for i in range(10_000)))
    read = bounded(lambda: {one.tags for one in load_inventory([tmp_path / "h.ini"]).hosts.values()}, cpu_s=6)
    assert read == {("arm", "camera")}


def test_every_group_counts_by_its_longest_way_from_all(tmp_path: Path) -> None:
    """The deeper group's variables win; `deep` is a child of `all` by one way, and three levels down by another."""
    (tmp_path / "h.ini").write_text(
        "[deep]\nr1\n[deep:vars]\nansible_user=deep\n[all:children]\ndeep\na\n[a:children]\nb\n[b:children]\ndeep\n"
        "[b:vars]\nansible_user=b\n[a:vars]\nansible_user=a\n"
    )
    inventory = load_inventory([tmp_path / "h.ini"])
    assert inventory.hosts["r1"].user == "deep"
    assert inventory.groups == {name: ("r1",) for name in ("a", "all", "b", "deep")}


def test_every_variable_that_is_read_is_named_as_such() -> None:
    """A host's variables are picked by this list: one that is not on it would silently be none."""
    asked: set[str] = set()

    class Spy(dict):  # type: ignore[type-arg]
        def get(self, key: str, default: object = None) -> object:
            asked.add(key)
            return super().get(key, default)

        def __contains__(self, key: object) -> bool:
            asked.add(str(key))
            return super().__contains__(key)

    variables: Variables = Spy()
    hostvars.host(HostEntry("r1", Scalar(Source("h"), 1, 1, "r1")), variables, (), Values(), Findings())
    assert asked == hostvars.READ


DOCKERFILES = {
    "continued lines": "FROM a\n" + "RUN x\\\n" * 18_000,
    "options": "FROM a\n" + "FROM " + "--a " * 30_000 + "\n",
    "stages": "FROM a\n" + "FROM x\n" * 18_000,
    "here-documents": "FROM a\nRUN " + "<<A" * 20_000 + "\n" + "A\n" * 30_000,
    "escaped quotes": 'FROM a\nRUN << "' + '\\"' * 60_000 + "\n",
    "escaped quotes that end in an escape": 'FROM a\nRUN << "' + '\\"' * 60_000 + "\\\\\\",
    "variables that do not end": 'FROM a\nRUN "<<" ' + "${" * 60_000 + "\n",
    "an image": "FROM " + "a-" * 60_000,
    "wrong images over two lines": "FROM a\n" + "FROM A\\\nB\n" * 12_000,
    "wrong images": "FROM a\n" + "".join(f"FROM B{i}\n" for i in range(8_000)),
}


@pytest.mark.parametrize("case", DOCKERFILES)
def test_a_dockerfile_is_read_in_time(tmp_path: Path, case: str) -> None:
    problems(tmp_path / "Dockerfile", DOCKERFILES[case])


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("FROM a\n" * 1001, "no more than 1000 instructions"),
        ("FROM a\n" + "#\n" * 5001, "no more than 5000 are read"),
        ("FROM a\nRUN " + "x \\\n" * 5001 + "y\n", "no more than 5000 are read"),
    ],
)
def test_a_dockerfile_is_read_or_refused(tmp_path: Path, text: str, said: str) -> None:
    assert said in problems(tmp_path / "Dockerfile", text)
    assert problems(tmp_path / "Dockerfile", text[: len(text) // 2].rpartition("\n")[0] + " x\n") == ""


def test_many_dockerfiles_count_by_how_often_they_are_gone_through(tmp_path: Path) -> None:
    for name in "abcdef":
        (tmp_path / f"{name}.cdf").write_text(f"cdf: 1\nname: {name}\ndockerfile: {name}.dockerfile\n")
        (tmp_path / f"{name}.dockerfile").write_text("FROM a\n" * 500 + "RUN " + "a " * 60_000 + "\n")
    services = "".join(f"  {name}: {{cdf: {name}.cdf}}\n" for name in "abcdef")
    assert "larger than 2 MiB, where it counts 4 times" in problems(
        tmp_path / "e.edf", f"edf: 1\nname: e\nservices:\n{services}"
    )


LINE = " ".join(f"{number:x}=" for number in range(8000))
LONG_INVENTORIES = {
    "hosts.yml": f"all: {{hosts: {{? '{'a' * 100_000}[1:10000]' : {{}}}}}}\n",
    "hosts": f"{'a' * 40_000}[1:10000]\nb[{'0' * 400}1:{'9' * 401}]\n",
    "hosts.ini": "".join(f"r{number} {LINE}\n" for number in range(20)),
    "quoted.ini": "".join(f"r{number} {LINE.replace('=', chr(34) * 2 + '=')}\n" for number in range(15)),
}


@pytest.mark.parametrize("name", LONG_INVENTORIES)
def test_an_inventory_with_long_names_and_lines_is_read_in_time(tmp_path: Path, name: str) -> None:
    (tmp_path / name).write_text(LONG_INVENTORIES[name])
    with contextlib.suppress(DefinitionError):
        bounded(lambda: len(load_inventory([tmp_path / name]).hosts), cpu_s=4)


def test_a_dockerfile_of_megabytes_is_refused(tmp_path: Path) -> None:
    assert "cannot be read: it is larger than 128 KiB" in problems(tmp_path / "Dockerfile", "FROM a\n" * 100_000)


def nothing_of_use(folder: Path) -> Iterator[str]:
    """Make what is no file, each with a name; give the names."""
    os.mkfifo(folder / "pipe")
    yield "pipe"
    with open(folder / "sparse", "wb") as stream:
        stream.truncate(10**12)
    yield "sparse"
    os.symlink("/dev/zero", folder / "zero")
    yield "zero"
    (folder / "folder").mkdir()
    yield "folder"
    (folder / "binary").write_bytes(bytes(range(256)))
    yield "binary"


FIELDS = {
    "env_file": "  a: {image: x, env_file: NAME}\n",
    "CDF": "  a: {cdf: NAME}\n",
    "volume": "  a: {image: x, volumes: ['./NAME:/data:ro']}\n",
}


@pytest.mark.parametrize("field", FIELDS)
@pytest.mark.parametrize("name", ["pipe", "sparse", "zero"])
def test_what_is_no_file_is_told_where_it_is_named(tmp_path: Path, field: str, name: str) -> None:
    """A pipe, a file larger than memory, a device (which lies outside, so that this is what is told of it)."""
    assert name in list(nothing_of_use(tmp_path))
    told = problems(tmp_path / "a.edf", edf(FIELDS[field].replace("NAME", name)))
    assert "error[SRP-1" in told and tmp_path.as_posix() in told


@pytest.mark.parametrize("kind", ["a.edf", "a.cdf", "Dockerfile", "hosts", "hosts.yml"])
def test_what_is_no_file_is_refused_as_any_document(tmp_path: Path, kind: str) -> None:
    for name in [one for one in nothing_of_use(tmp_path) if one != "folder"]:
        place = tmp_path / name / kind if (tmp_path / name).is_dir() else tmp_path / kind
        place.unlink(missing_ok=True)
        os.symlink(tmp_path / name, place)
        assert bounded(lambda place=place: checked([place], outside=True)[0]), name


def test_a_folder_of_too_many_files_is_not_shipped(tmp_path: Path) -> None:
    (tmp_path / "data").mkdir()
    for number in range(20_001):
        os.mknod(tmp_path / "data" / str(number))
    told = problems(tmp_path / "a.edf", edf("  a: {image: x, volumes: ['./data:/data:ro']}\n"))
    assert "a.edf:4:27: error[SRP-112]: './data' holds more than 20000 files" in told


def test_a_folder_with_a_pipe_in_it_is_not_shipped(tmp_path: Path) -> None:
    (tmp_path / "data").mkdir()
    os.mkfifo(tmp_path / "data" / "pipe")
    told = problems(tmp_path / "a.edf", edf("  a: {image: x, volumes: ['./data:/data:ro']}\n"))
    assert "'./data' holds what is no file, folder or link: pipe" in told


def test_the_nearest_of_many_names_is_still_found() -> None:
    known = [f"service-{number:04}" for number in range(1000)]
    assert did_you_mean("servise-0500", known) == "did you mean 'service-0500'?"
    assert did_you_mean("x" * 10_000, known) == ""


ENV_FILES = {
    "variables": "".join(f"V{number}=b\n" for number in range(25_000)),
    "a quote over many lines": "A='\n" + "x\n" * 120_000,
    "quotes that do not end": "A='x\n" * 40_000,
    "no variables": "=\n" * 120_000,
    "blanks": "A=" + " " * 250_000 + "x",
}


@pytest.mark.parametrize("case", ENV_FILES)
def test_an_env_file_is_read_in_time(tmp_path: Path, case: str) -> None:
    (tmp_path / "a.env").write_text(ENV_FILES[case])
    problems(tmp_path / "a.edf", service("env_file: a.env"))


def test_an_env_file_of_megabytes_is_refused(tmp_path: Path) -> None:
    (tmp_path / "a.env").write_text("A=b\n" * 100_000)
    assert "cannot be read: it is larger than 256 KiB" in problems(tmp_path / "a.edf", service("env_file: a.env"))


PLAYBOOKS = {
    "substitutions": f"- file: /a\n  content: [{'{{ host }}, ' * 4000}]\n",
    "items": "".join(f"- file: /a{number}\n  content: b\n" for number in range(1700)),
    "unknown modules": "".join(f"- fil: /a{number}\n" for number in range(3000)),
    "branches": "{% if host %}\n" + "{% elif host %}\n- file: /a\n  content: b\n" * 1100 + "{% endif %}\n",
    "blocks": "{% for a in b %}\n" * 1500 + "{% endfor %}\n" * 1500,
    "parentheses": "- file: {{ " + "(" * 40_000 + " }}\n",
    "a comment that does not end": "[]\n{#\n",
    "a number": "- file: {{ " + "9" * 5000 + " }}\n",
    "a tag that does not end": "{{ '" * 12_000,
    "a filter that there is not": "- file: [" + "{{host|lengthy}}," * 3000 + "]\n",
    "a variable that there is not": "- file: [" + "{{serviced}}," * 3800 + "]\n",
}


@pytest.mark.parametrize("case", PLAYBOOKS)
def test_a_playbook_is_read_in_time(tmp_path: Path, case: str) -> None:
    (tmp_path / "p.yml").write_text(PLAYBOOKS[case])
    problems(tmp_path / "a.edf", edf("  a: {image: x}\n", "playbooks: {before: [p.yml]}\n"))


def test_a_playbook_of_megabytes_is_refused(tmp_path: Path) -> None:
    for size, says in ((50_001, "is longer than 50000 characters"), (10_000_000, "it is larger than 1000000 bytes")):
        (tmp_path / "p.yml").write_text("#" * size)
        assert says in problems(tmp_path / "a.edf", edf("  a: {image: x}\n", "playbooks: {before: [p.yml]}\n"))


@pytest.mark.parametrize("pattern", [r"(\pL{1,52})", r"(\pL{1,250})", r"(\pL{1,900})", r"((?i:\pL){1,9})"])
def test_patterns_of_metrics_are_checked_in_time(tmp_path: Path, pattern: str) -> None:
    """Each has twenty characters; two hundred of them took half a minute and half a gigabyte."""
    metrics = "".join(f"  m{number}: {{service: a, log: '{pattern}{number}'}}\n" for number in range(200))
    trials = "trials: {order: listed, timeout: 5s}\nmetrics:\n"
    told = problems(tmp_path / "a.edf", edf("  a: {image: x}\n", f"{trials}{metrics}"))
    assert "all patterns together are too large: write them shorter" in told


def test_as_many_patterns_of_the_usual_kind_are_no_problem(tmp_path: Path) -> None:
    usual = r"(?i)^\[INFO\].{0,200} distance: ([-+]?\d+(\.\d+)?([eE][-+]?\d+)?)"
    metrics = "".join(f"  m{number}: {{service: a, log: '{usual} m{number}'}}\n" for number in range(90))
    metrics += "  letters: {service: a, log: '\\pL{1,20} (\\d+)'}\n"
    path = tmp_path / "a.edf"
    path.write_text(edf("  a: {image: x}\n", f"trials: {{order: listed, timeout: 5s}}\nmetrics:\n{metrics}"))
    assert check_files([path]) == []
