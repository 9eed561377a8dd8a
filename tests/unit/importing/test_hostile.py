"""Compose files that want to hang us, fill the memory, or read what is not theirs: a clear refusal, and soon."""

from __future__ import annotations

import os
import re
from collections.abc import Iterator
from pathlib import Path

import pytest

from srprov.importing.compose import envfiles
from srprov.importing.normal import Normal, Refused
from srprov.importing.read import normalise
from tests.bounded import bounded, within

SECONDS = 2.0
SERVICE = "services: {a: {image: x}}\n"


@pytest.fixture(autouse=True)
def soon() -> Iterator[None]:
    """Hold each test to two seconds of the processor; what waits for ever ends by the test's own time limit."""
    with within(SECONDS):
        yield


def read(folder: Path, text: str, **more: str) -> Normal:
    """Read a file in a folder, with others beside it (`__` in a name is a slash, `_` before its end a dot)."""
    for name, content in more.items():
        path = folder / name.replace("__", "/").replace("_", ".")
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(content)
    (folder / "compose.yml").write_text(text)
    return normalise([folder / "compose.yml"], project="p")


def refusal(folder: Path, text: str, **more: str) -> str:
    """Return the refusal of a file as text; each problem has file, line and column."""
    with pytest.raises(Refused) as caught:
        read(folder, text, **more)
    for problem in caught.value.problems:
        assert Path(problem.location.file).name
        assert problem.location.line > 0 and problem.location.column > 0
    return "\n".join(f"{one.location}: {one.message}; {one.hint}" for one in caught.value.problems)


def test_anchors_that_stand_for_millions_of_values(tmp_path: Path) -> None:
    lines = ["x-0: &a0 [x, x, x, x, x, x, x, x, x, x]"]
    lines += [f"x-{n}: &a{n} [{', '.join([f'*a{n - 1}'] * 10)}]" for n in range(1, 12)]
    assert "compose.yml:5:" in refusal(tmp_path, "\n".join(lines) + "\n" + SERVICE)


def test_merges_that_stand_for_millions_of_values(tmp_path: Path) -> None:
    lines = ["x-0: &a0 {" + ", ".join(f"k{n}: v" for n in range(50)) + "}"]
    lines += [f"x-{n}: &a{n} {{{', '.join(f'm{m}: *a{n - 1}' for m in range(10))}}}" for n in range(1, 9)]
    assert "values" in refusal(tmp_path, "\n".join(lines) + "\n" + SERVICE)


def test_deep_nesting(tmp_path: Path) -> None:
    assert "nested more than" in refusal(tmp_path, f"x-a: {'[' * 5000}{']' * 5000}\n{SERVICE}")


def test_variables_that_grow_with_each_line(tmp_path: Path) -> None:
    lines = ["A0=" + "x" * 1000, *(f"A{n}=$A{n - 1}$A{n - 1}" for n in range(1, 60))]
    assert "larger than" in refusal(tmp_path, SERVICE, _env="\n".join(lines))


def test_variables_that_are_used_again_and_again(tmp_path: Path) -> None:
    text = "services: {a: {image: x, labels: {a: '" + "$A" * 30_000 + "'}}}\n"
    assert "larger than" in refusal(tmp_path, text, _env="A=" + "y" * 10_000 + "\n")


def test_defaults_within_defaults(tmp_path: Path) -> None:
    text = "services: {a: {image: '" + "${A:-" * 3000 + "x" + "}" * 3000 + "'}}\n"
    assert "nested more than" in refusal(tmp_path, text)


def test_a_text_of_many_variables(tmp_path: Path) -> None:
    text = "services: {a: {image: '" + "${A:-x}" * 9000 + "'}}\n"
    assert len(read(tmp_path, text).document["services"]["a"]["image"]) == 9000
    assert "characters" in refusal(tmp_path, "services: {a: {image: '" + "${A:-x}" * 100_000 + "'}}\n")


@pytest.mark.parametrize("field", ["image: '${HOME}'", "labels: ['a=$PATH']", "hostname: '${SSH_AUTH_SOCK}'"])
def test_nothing_is_taken_from_the_environment(tmp_path: Path, field: str, monkeypatch: pytest.MonkeyPatch) -> None:
    for name in ("HOME", "PATH", "SSH_AUTH_SOCK"):
        monkeypatch.setenv(name, "/canary-of-the-environment")
    said = refusal(tmp_path, f"services: {{a: {{{field}}}}}\n")
    assert "canary" not in said
    assert "--set" in said


def test_names_alone_take_nothing_from_the_environment_and_are_listed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("CANARY", "of-the-environment")
    normal = read(
        tmp_path,
        "services: {a: {image: x, environment: [CANARY], env_file: e.env, build: {args: [CANARY]}, secrets: [s]}}\n"
        "secrets: {s: {environment: CANARY}}\n",
        e_env="CANARY\n",
    )
    assert "of-the-environment" not in repr(normal)
    assert normal.document["services"]["a"]["environment"] == {"CANARY": None}
    assert [(one.name, one.source, one.value) for one in normal.variables if one.name == "CANARY"] == [
        ("CANARY", "unset", "")
    ] * len(normal.variables)
    assert len(normal.variables) >= 3


@pytest.mark.parametrize(
    "text",
    [
        "services: {a: {extends: {file: /etc/passwd, service: root}}}\n",
        "services: {a: {extends: {file: ../outside/base.yml, service: a}}}\n",
        "services: {a: {extends: {file: sub/../../outside/base.yml, service: a}}}\n",
        "services: {a: {extends: {file: link.yml, service: a}}}\n",
        "services: {a: {extends: {file: folder/base.yml, service: a}}}\n",
        "include: [/etc/passwd]\n" + SERVICE,
        "include: [../outside/base.yml]\n" + SERVICE,
        "include: [{path: more.yml, env_file: ../outside/secret.env}]\n" + SERVICE,
        "include: [{path: more.yml, project_directory: ../outside}]\n" + SERVICE,
        "services: {a: {image: x, env_file: /etc/environment}}\n",
        "services: {a: {image: x, env_file: ../outside/secret.env}}\n",
        "services: {a: {image: x, env_file: [{path: ../outside/secret.env, required: false}]}}\n",
        "services: {a: {image: x, env_file: [{path: ../outside/not-there.env, required: false}]}}\n",
        "services: {a: {image: x, label_file: ../outside/secret.env}}\n",
        "services: {a: {image: x, env_file: folder/back.env}}\n",
        "services: {a: {image: x, env_file: '~/secret.env'}}\n",
    ],
)
def test_nothing_outside_of_the_folder_is_read(tmp_path: Path, text: str) -> None:
    project, outside = tmp_path / "project", tmp_path / "outside"
    for folder in (project / "sub", outside):
        folder.mkdir(parents=True)
    (outside / "base.yml").write_text("services: {a: {image: canary}}\n")
    (outside / "secret.env").write_text("A=canary\n")
    (outside / ".env").write_text("A=canary\n")
    (project / "more.yml").write_text("services: {b: {image: x}}\n")
    (project / "link.yml").symlink_to(outside / "base.yml")
    (project / "folder").symlink_to(outside)
    (project / "own.env").write_text("A=canary\n")
    (outside / "back.env").symlink_to(project / "own.env")
    said = refusal(project, text)
    assert "canary" not in said and ("lies outside" in said or "~" in text)
    assert "compose.yml:1:" in said or "compose.yml:2:" in said


def test_a_link_of_env_to_a_file_outside(tmp_path: Path) -> None:
    project = tmp_path / "project"
    project.mkdir()
    (tmp_path / "secret").write_text("A=canary\n")
    (project / ".env").symlink_to(tmp_path / "secret")
    assert "canary" not in refusal(project, SERVICE)


def test_files_that_include_or_extend_one_another(tmp_path: Path) -> None:
    assert "circle" in refusal(
        tmp_path,
        "include: [b.yml]\n" + SERVICE,
        b_yml="include: [c.yml]\n",
        c_yml="include: [compose.yml]\nservices: {c: {image: x}}\n",
    )
    assert "circle" in refusal(
        tmp_path,
        "services: {a: {extends: {file: d.yml, service: a}}}\n",
        d_yml="services: {a: {extends: {file: compose.yml, service: a}}}\n",
    )
    assert "circle" in refusal(tmp_path, "services: {a: {extends: b}, b: {extends: c}, c: {extends: a}}\n")


def test_includes_that_double_with_each_file(tmp_path: Path) -> None:
    for number in range(30):
        (tmp_path / f"f{number}.yml").write_text(f"include: [f{number + 1}.yml, ./f{number + 1}.yml]\n")
    (tmp_path / "f30.yml").write_text(SERVICE)
    assert refusal(tmp_path, "include: [f0.yml]\n")


def test_services_that_grow_with_each_that_they_extend(tmp_path: Path) -> None:
    labels = ", ".join(f"a{n}=1" for n in range(100))
    chain = "\n".join(
        f"  s{n}: {{extends: s{n - 1}, cap_add: [{labels.replace('a', f'b{n}-')}]}}" for n in range(1, 45)
    )
    text = f"services:\n  s0: {{image: x, cap_add: [{labels}]}}\n{chain}\n"
    assert "values" in refusal(tmp_path, text)


def test_a_long_chain_of_services(tmp_path: Path) -> None:
    chain = "\n".join(f"  s{n}: {{extends: s{n - 1}}}" for n in range(1, 3000))
    assert "extend" in refusal(tmp_path, f"services:\n  s0: {{image: x}}\n{chain}\n")


def test_a_pipe_a_device_a_folder_and_a_huge_file(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "pipe.yml")
    os.mkfifo(tmp_path / "pipe.env")
    (tmp_path / "folder.yml").mkdir()
    with open(tmp_path / "huge.yml", "wb") as file:
        file.truncate(1 << 40)
    for name in ("pipe.yml", "folder.yml", "huge.yml"):
        said = refusal(tmp_path, f"include: [{name}]\n{SERVICE}")
        assert "compose.yml:1:" in said
        assert refusal(tmp_path, f"services: {{a: {{extends: {{file: {name}, service: a}}}}}}\n")
        with pytest.raises(Refused):
            normalise([tmp_path / name])
    assert "pipe" in refusal(tmp_path, "services: {a: {image: x, env_file: pipe.env}}\n")
    with pytest.raises(Refused):
        normalise([tmp_path / "compose.yml"], env_files=[Path("/dev/zero")])


def test_a_file_of_variables_with_a_million_lines(tmp_path: Path) -> None:
    assert "lines" in refusal(tmp_path, SERVICE, _env="A=$$x\n" * 300_000)


def test_one_long_line_of_quotes_in_a_command(tmp_path: Path) -> None:
    normal = read(tmp_path, "services: {a: {image: x, command: '" + '"" ' * 100_000 + "'}}\n")
    assert len(normal.document["services"]["a"]["command"]) == 100_000


@pytest.mark.parametrize(
    "text", ["a" * 3_000_000, '"' * 100_000, "- " * 200_000, "{" * 100_000, "\x00", "\ud800", "&a *a"]
)
def test_nonsense(tmp_path: Path, text: str) -> None:
    (tmp_path / "compose.yml").write_bytes(text.encode("utf-8", "surrogatepass"))
    with pytest.raises(Refused):
        normalise([tmp_path / "compose.yml"])


def test_ranges_of_ports_are_bounded(tmp_path: Path) -> None:
    ranges = ", ".join([f"'{n}000-{n}999'" for n in range(1, 65)])
    assert "too many ports" in refusal(tmp_path, f"services: {{a: {{image: x, ports: [{ranges}]}}}}\n")
    normal = read(tmp_path, "services: {a: {image: x, ports: ['7400-8400:7400-8400/udp']}}\n")
    assert len(normal.document["services"]["a"]["ports"]) == 1001


def test_numbers_with_a_thousand_digits(tmp_path: Path) -> None:
    digits = "9" * 5000
    assert refusal(tmp_path, f"services: {{a: {{image: x, scale: {digits}}}}}\n")
    assert refusal(tmp_path, f"services: {{a: {{image: x, stop_grace_period: {digits}s}}}}\n")
    assert refusal(tmp_path, f"services: {{a: {{image: x, mem_limit: '{digits}'}}}}\n")
    assert refusal(tmp_path, f"services: {{a: {{image: x, ports: ['{digits}']}}}}\n")


def test_at_most_a_screenful_of_problems(tmp_path: Path) -> None:
    lines = "\n".join(f"  s{n}: {{image: $V{n}, bad: 1}}" for n in range(2000))
    with pytest.raises(Refused) as caught:
        read(tmp_path, f"services:\n{lines}\n")
    assert len(caught.value.problems) <= 100


def test_a_large_file_that_thousands_extend(tmp_path: Path) -> None:
    base = (
        "services:\n  b: {image: x}\n  big: {image: x, labels: {" + ", ".join(f"l{n}: $$" for n in range(9000)) + "}}\n"
    )
    services = "\n".join(f"  s{n}: {{extends: {{file: base.yml, service: b}}}}" for n in range(2500))
    normal = read(tmp_path, f"services:\n{services}\n", base_yml=base)
    assert len(normal.document["services"]) == 2500


@pytest.mark.parametrize("text", ["${a-" * 16_000, "${a-}" * 6000 + "x" * 35_000, "${a" * 20_000, "$${a-}" * 10_000])
def test_variables_that_do_not_end_in_many_long_texts(tmp_path: Path, text: str) -> None:
    """Each is looked for to the end of its line."""
    lines = "".join(f'    - "{text}"\n' for _ in range(50))
    assert refusal(tmp_path, f"services:\n  a:\n    image: x\n    command:\n{lines}")


@pytest.mark.parametrize("text", ["x" * 65_300, "{}" * 32_650, "{a}" * 21_766])
def test_defaults_within_defaults_of_many_long_texts(tmp_path: Path, text: str) -> None:
    """Where each ends is found once for a text, and braces are counted."""
    lines = "".join(f'    - "{"${A:+" * 19}{text}{"}" * 19}"\n' for _ in range(100))
    try:
        normal = read(tmp_path, f"services:\n  a:\n    image: x\n    command:\n{lines}")
    except Refused as error:
        assert "braces" in str(error.problems[0])
    else:
        assert normal.document["services"]["a"]["command"] == [""] * 100


def test_blanks_in_a_file_of_variables(tmp_path: Path) -> None:
    """It takes a fifth of what is allowed here."""
    text = f"A={' ' * 3_900_000}#x\nB{' ' * 3_900_000}=1\n"
    assert bounded(lambda: "services" in read(tmp_path, SERVICE, _env=text).document, cpu_s=0.5)


@pytest.mark.parametrize(
    ("text", "most"),
    [
        ("A='x'" * 1_000_000, "variables"),
        ('A="' + '\\"' * 3_000_000 + '"', "backslashes"),
        ("#\n" * 3_000_000, "lines"),
    ],
)
def test_many_variables_and_escapes_in_one_line(tmp_path: Path, text: str, most: str) -> None:
    assert f"more than {most}" in re.sub(r"\d+ ", "", bounded(lambda: refusal(tmp_path, SERVICE, _env=text)))


def _subnets(second: int, first: int, field: str = "") -> str:
    entries = ", ".join(f"{{subnet: 10.{first}.{n // 256}.{n % 256}/32{field}}}" for n in range(second))
    return f"services: {{a: {{image: x}}}}\nnetworks: {{n: {{ipam: {{config: [{entries}]}}}}}}\n"


@pytest.mark.parametrize(
    ("one", "other"),
    [
        (_subnets(400, 1), _subnets(400, 2)),
        (_subnets(2000, 1), _subnets(20, 2)),
        (_subnets(1, 1, f", aux_addresses: {{{', '.join(f'h{n}: 10.1.1.1' for n in range(3000))}}}"), _subnets(500, 2)),
    ],
)
def test_each_subnet_of_a_file_over_each_of_another(tmp_path: Path, one: str, other: str) -> None:
    said = bounded(lambda: refusal(tmp_path, "include: [{path: [a.yml, b.yml]}]\n" + SERVICE, a_yml=one, b_yml=other))
    assert "more subnets than a network has" in said


def test_subnets_that_people_write_unite(tmp_path: Path) -> None:
    over = _subnets(30, 1, ", gateway: 10.1.0.1").replace("services: {a: {image: x}}\n", "")
    found = read(
        tmp_path, "include: [{path: [a.yml, b.yml]}]\n" + SERVICE.replace("a:", "b:"), a_yml=_used(30), b_yml=over
    )
    config = found.document["networks"]["n"]["ipam"]["config"]
    assert len(config) == 30
    assert all(one["gateway"] == "10.1.0.1" for one in config)


def _used(count: int) -> str:
    return _subnets(count, 1).replace("image: x", "image: x, networks: [n]")


def test_what_is_no_subnet_is_told(tmp_path: Path) -> None:
    other = "networks: {n: {ipam: {config: [foo]}}}\n"
    said = refusal(tmp_path, "include: [{path: [a.yml, b.yml]}]\n" + SERVICE, a_yml=_used(2), b_yml=other)
    assert "this is a map with a subnet" in said


@pytest.mark.parametrize("form", ["", ", format: raw"])
def test_a_file_of_variables_that_many_services_name(
    tmp_path: Path, form: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Each of them has all that it says."""
    read_in: list[str] = []
    values = envfiles.values
    monkeypatch.setattr(envfiles, "values", lambda *given, **more: read_in.append("") or values(*given, **more))
    lines = "".join(f"A{n}=1\n" for n in range(1000))
    service = f"{{image: x, env_file: [{{path: l.env{form}}}]}}"
    few = "services: {" + ", ".join(f"s{n}: {service}" for n in range(20)) + "}\n"
    assert len(read(tmp_path, few, l_env=lines).document["services"]["s19"]["environment"]) == 1000
    read_in.clear()
    many = "services: {" + ", ".join(f"s{n}: {service}" for n in range(1000)) + "}\n"
    assert "as often as services name them" in refusal(tmp_path, many, l_env=lines)
    assert len(read_in) < 100


def test_a_file_of_labels_that_is_named_again_and_again(tmp_path: Path) -> None:
    many = f"services: {{a: {{image: x, label_file: [{', '.join(['l.env'] * 1000)}]}}}}\n"
    said = refusal(tmp_path, many, l_env="".join(f"A{n}=1\n" for n in range(1000)))
    assert "as often as services name them" in said


def test_a_raw_file_of_variables_has_no_more_lines_than_another(tmp_path: Path) -> None:
    text = "services: {a: {image: x, env_file: [{path: l.env, format: raw}]}}\n"
    assert "more than 10000 lines" in refusal(tmp_path, text, l_env="A=1\n" * 10_001)
