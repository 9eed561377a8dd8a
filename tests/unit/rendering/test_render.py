"""Playbooks become resources: every value as it was, every mistake a RenderError with its place."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import msgspec
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from srprov.controller.playbooks import playbooks
from srprov.errors import RenderError
from srprov.modules import MODULES
from srprov.rendering import render
from srprov.resource import Need, Resource
from tests.conftest import examples
from tests.fakes import World
from tests.worlds import CHECK, experiment, plan_for, service

TEXT = st.text(st.characters(exclude_categories=["Cs"]), max_size=40)
HOSTILE = st.sampled_from(
    [
        "yes",
        "0644",
        "1.10",
        "1:30",
        "null",
        "~",
        "a: b",
        "- x",
        "# c",
        "{{ 1 }}",
        "{% raw %}",
        "'",
        '"',
        "\\",
        "\\ud83d\\ude00",
        "\n",
        "\r\n",
        "\x00",
        "\x1b[31m",
        "\x85",
        "\u2028",
        "\ufeff",
        "\ufffe",
        "😀",
        "<<",
        "=",
        '!json "x"',
        "*a",
        "&a",
        "|",
        ">",
        "\t",
        " ",
        "---",
        "...",
        "%YAML",
        "2024-13-45",
    ]
)
JSON = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats(allow_nan=False) | TEXT | HOSTILE,
    lambda inner: st.lists(inner, max_size=4) | st.dictionaries(TEXT | HOSTILE, inner, max_size=4),
    max_leaves=12,
)


class FreeParams(msgspec.Struct, frozen=True, kw_only=True):
    """Parameters of any type."""

    content: Any = None
    also: Any = None
    a: Any = None
    mode: Any = None
    run: Any = None
    blob: bytes = b""


VXLAN = "- vxlan: v\n  instance: i\n  vni: 1\n  local: 192.0.2.1\n  port: 4789\n  bridge: b\n  mtu: 1450\n"
CONTAINER = (
    "- container: c\n  instance: i\n  source: s\n  service: c\n  image: busybox\n  hostname: c\n  job: false\n"
    "  run: {}\n  mounts: []\n  api: '1.41'\n"
)

HOST = CONTAINER + "  network: {mode: host}\n"

FREE: Any = dict.fromkeys(MODULES, SimpleNamespace(params=FreeParams))
"""Every kind, with parameters that may be anything: what a value becomes is no question of its module."""


def rendered(text: str, blobs: dict[str, bytes] | None = None, **context: Any) -> tuple[Resource, ...]:
    """Render one playbook for robot r1."""
    return render({"10-test.yml": text}, "r1", context, modules=FREE, blobs=blobs or {})


def refused(text: str, **context: Any) -> RenderError:
    """Return the error of a playbook that must not render."""
    with pytest.raises(RenderError) as caught:
        rendered(text, **context)
    return caught.value


@settings(max_examples=examples(300), derandomize=True, deadline=None)
@given(JSON)
def test_values_arrive_as_they_were(value: object) -> None:
    """Any JSON value, whatever its text looks like to YAML or Jinja2, is the same behind a playbook."""
    (resource,) = rendered("- file: x\n  content: {{ value }}\n  also: [{{ value }}, {a: {{ value }}}]\n", value=value)
    assert resource.params.content == value
    assert type(resource.params.content) is type(value)
    assert resource.params.also == [value, {"a": value}]


@settings(max_examples=examples(100), derandomize=True, deadline=None)
@given((TEXT.filter(bool) | HOSTILE).filter(lambda text: "\0" not in text))
def test_names_and_needs_arrive_as_they_were(name: str) -> None:
    """A resource's name may be any text, too, that can be a word of a shell."""
    (resource,) = rendered("- file: {{ name }}\n", name=name)
    assert resource.name == name


def test_long_keys_arrive() -> None:
    """A key beyond YAML's limit of 1024 characters is a key all the same."""
    (resource,) = rendered("- file: x\n  run: {{ run }}\n", run={"K" * 5000: "v"})
    assert resource.params.run == {"K" * 5000: "v"}


def test_an_undefined_name_is_an_error() -> None:
    """A name that the context lacks fails with that name, also deep inside a value."""
    for text in ("- file: {{ nobody }}\n", "- file: x\n  a: {{ [1, nobody] }}\n", "- file: {{ {'a': 1}.nobody }}\n"):
        assert "nobody" in refused(text).message


def test_nothing_but_json_can_be_substituted() -> None:
    """A value that is no JSON, such as bytes or a function, is refused by its type."""
    assert "bytes" in refused("- file: x\n  a: {{ raw }}\n", raw=b"x").message
    assert "method" in refused("- file: x\n  a: {{ word.upper }}\n", word="x").message


@pytest.mark.parametrize(
    "expression",
    [
        "''.__class__",
        "''.__class__.__mro__[1].__subclasses__()",
        "render.__globals__",
        "''|attr('__class__')",
        "[].append(1)",
        "d.update({'a': 1})",
        "'{0.__class__}'.format('')",
    ],
)
def test_the_sandbox_holds(expression: str) -> None:
    """No expression reaches Python's attributes or changes a value of the context."""
    context: dict[str, Any] = {"d": {"k": [1]}, "render": render}
    refused("- file: x\n  a: {{ " + expression + " }}\n", **context)
    assert context["d"] == {"k": [1]}


def test_a_playbook_can_include_nothing() -> None:
    """There is no loader: neither files nor other templates can be read."""
    for verb in ("include", "import", "extends"):
        tail = " as x" if verb == "import" else ""
        assert "no loader" in refused(f"{{% {verb} '/etc/passwd'{tail} %}}\n").message


@pytest.mark.parametrize(
    "text",
    [
        "- file: ros-{{ n }}\n",
        "- file: {{ n }}-ros\n",
        "- file: '{{ n }}'\n",
        '- file: "{{ n }}"\n',
        "- file: {{ n }}{{ n }}\n",
        "- file: {{ n }} {{ n }}\n",
        "- file: a/{{ n }}\n",
        "- {{ n }}: x\n",
        "- file: ros{% if true %} {{ n }}{% endif %}\n",
        "- file: {{ n }}{% if true %} x{% endif %}\n",
        "- file: ros\n    {{ n }}\n",
        "- file: x\n  content: |\n    {{ n }}\n",
        "- file: x\n  content: >-\n    say\n    {{ n }}\n",
        "- file: x\n  'a {% if true %}{{ n }}{% endif %}': b\n",
    ],
)
def test_a_part_of_a_value_is_refused(text: str) -> None:
    """A substitution that is only a part of a YAML value is refused, whatever stands in between."""
    assert "whole YAML value" in refused(text, n="x").message or "broken YAML" in refused(text, n="x").message


@pytest.mark.parametrize(
    "text",
    [
        "- file: {{ n }}\n",
        "- file: {{ n }} # why\n",
        "- {file: {{ n }}, mode: {{ n }}}\n",
        "- file: x\n  a: [{{ n }}, {{ n }}]\n",
        "- file: x\n  a: [{{ n }},{{ n }}]\n",
        "- file: {% if n %}{{ n }}{% else %}none{% endif %}\n",
        "- file: x\n  a:\n    - {{ n }}\n    -\n      {{ n }}\n",
        '- file: {{ "ros-" ~ n }}\n',
        "{% for one in [n] %}\n- file: {{ one }}\n{% endfor %}\n",
    ],
)
def test_a_whole_value_is_fine(text: str) -> None:
    """A substitution that is a whole YAML value is fine wherever YAML takes one."""
    (resource,) = rendered(text, n="a: b")
    assert "a: b" in resource.name or "a: b" in str(resource.params)


def test_the_line_of_a_partial_value_is_named() -> None:
    """The error says in which file and line the substitution stands."""
    assert refused("# one\n# two\n- file: ros-{{ n }}\n", n="x").message.startswith("10-test.yml:3:")


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("- file: {{ n\n", "10-test.yml:"),
        ("{% if %}\n", "10-test.yml:1:"),
        ("{% nonsense %}\n", "nonsense"),
        ("- file: {{ 1 / 0 }}\n", "division by zero"),
        ("- file: {{ '%(a)s'|format(b=1) }}\n", "10-test.yml"),
        ("- file: [unclosed\n", "broken YAML"),
        ("- file: x\n  at: 2024-13-45\n", "broken YAML"),
        ("file: x\n", "a playbook is a list"),
        ("- just text\n", "a playbook is a list"),
        ("- filee: x\n", "'filee' is none"),
        ("- {}\n", "'' is none"),
        ("- mode: '0644'\n  file: x\n", "'mode' is none"),
        ("- [file, x]\n", "a playbook is a list"),
        ("- ? [file]\n  : x\n", "broken YAML"),
        ("- file:\n", "None is no name of a file"),
        ("- file: ''\n", "is no name of a file"),
        ("- file: [a]\n", "is no name of a file"),
        ("- file: x\n- file: x\n", "r1/file:x stands twice"),
        ("- tree: x\n  blob: nope\n", "no blob 'nope'"),
        ("- tree: x\n  blob: [a]\n", 'blob: expected the sha256 of a blob, not ["a"]'),
        ("- file: x\n  needs: network:y\n", "needs is a list"),
        ("- file: x\n  needs: {id: network:y}\n", "needs is a list"),
        ("- file: x\n  needs: [5]\n", "5 is no need"),
        ("- file: x\n  needs: [{id: a:b, condition: alive}]\n", "is no need"),
        ("- file: x\n  needs: [{id: a:b, condition: [healthy]}]\n", "is no need"),
        ("- file: x\n  needs: [{condition: healthy}]\n", "is no need"),
    ],
)
def test_mistakes_are_render_errors(text: str, says: str) -> None:
    """Every mistake of a playbook is a RenderError that names the file and says what is wrong."""
    error = refused(text)
    assert says in error.message
    assert "10-test.yml" in error.message
    assert error.exit_code == 5


def test_one_id_in_two_playbooks_is_an_error() -> None:
    """Two playbooks may not both give one resource."""
    with pytest.raises(RenderError, match=r"20\.yml, item 1: r1/file:x stands twice"):
        render({"10.yml": "- file: x\n", "20.yml": "- file: x\n"}, "r1", {}, modules=FREE, blobs={})


def test_needs_are_of_this_robot_or_of_a_named_one() -> None:
    """A need is text or {id, condition}; without a robot it is about the same one, also when its name holds slashes."""
    (resource,) = rendered(
        "- container: c\n  needs: [file:/var/lib/x, r2/container:web, {id: r2/container:db, condition: healthy}, "
        "{id: image:a/b:c}]\n"
    )
    assert resource.needs == (
        Need("r1/file:/var/lib/x", "present"),
        Need("r2/container:web", "present"),
        Need("r2/container:db", "healthy"),
        Need("r1/image:a/b:c", "present"),
    )
    assert "needs" not in resource.written
    assert resource.source == "10-test.yml, item 1"


def test_a_blob_is_named_by_its_digest() -> None:
    """The parameter `blob` becomes the bytes that the context's caller gave for it."""
    (resource,) = rendered("- tree: /x\n  blob: {{ sha }}\n", blobs={"abc": b"\0tar"}, sha="abc")
    assert resource.params.blob == b"\0tar"
    assert resource.written == {"blob": "abc"}


def test_playbooks_are_read_in_name_order() -> None:
    """The order of files in the mapping says nothing."""
    texts = {"20.yml": "- file: b\n", "10.yml": "- file: a\n", "30.yml": ""}
    names = [r.name for r in render(texts, "r1", {}, modules=FREE, blobs={})]
    assert names == ["a", "b"]


def test_the_shipped_playbooks_render() -> None:
    """The playbooks of the wheel give every kind of resource that an ordinary experiment has."""
    assert sorted(playbooks()) == ["10-images.yml", "20-overlay.yml", "30-files.yml", "40-services.yml"]
    plan = plan_for(World().add("r1"), experiment(service("a", healthcheck=CHECK, command=("{{ 1 }}", "yes", "0x10"))))
    kinds = ["image", "network", "vxlan_filter", "vxlan", "file", "file", "container"]
    assert [step.module for step in plan.steps] == kinds
    wanted = next(step.want for step in plan.steps if step.module == "container")
    assert wanted is not None
    assert wanted.params.run.command == ("{{ 1 }}", "yes", "0x10")
    assert wanted.params.run.healthcheck.interval_s == 1.0


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("- file: x\n", "the parameter 'content' is missing"),
        ("- file: x\n  content: y\n  mod: '0644'\n", "there is no parameter 'mod', only content, blob, mode, in_place"),
        ("- file: x\n  content: 5\n", "content: expected text, not 5"),
        ("- file: x\n  content: y\n  in_place: 1\n", "in_place: expected true or false, not 1"),
        ("- file: x\n  content: y\n  mode: rw\n", "mode: expected octal digits such as 0644, not 'rw'"),
        ("- file: x\n  content: {{ half }}\n", "content holds half a character"),
        ("- file: {{ nul }}\n  content: y\n", "its name holds a NUL"),
        ("- volume: v\n  instance: {{ nul }}\n  source: s\n", "instance holds a NUL"),
        ("- image: i\n  source: steal\n", "source: expected one of pull, build, copy, cache, not 'steal'"),
        ("- image: i\n  source: build\n", "an image that is built needs a 'blob'"),
        ("- image: i\n  source: copy\n", "an image that is copied needs a 'from'"),
        ("- command: c\n  argv: [a]\n", "a command needs 'unless' or 'creates'"),
        ("- command: c\n  creates: /x\n", "a command needs either 'argv' or 'shell'"),
        ("- command: c\n  argv: [a, 5]\n  creates: /x\n", "argv.1: expected text, not 5"),
        ("- command: c\n  argv: [a]\n  creates: /x\n  timeout: true\n", "timeout: expected a whole number, not true"),
        ("- command: c\n  argv: [a]\n  unless: {}\n", "unless: expected text or a list, not {}"),
        (VXLAN + "  fdb: [[a, b, c]]\n", "fdb.0: expected 2 values, not 3"),
        (VXLAN + "  fdb: [a]\n", 'fdb.0: expected a list, not "a"'),
        (CONTAINER + "  network: {}\n", "the parameter 'network.mode' is missing"),
        (CONTAINER + "  network: {mode: overlay}\n", "network: an overlay needs 'name', 'ip' and 'mac'"),
        (
            CONTAINER + "  network: {mode: overlay, name: n, ip: '', mac: ''}\n",
            "network: an overlay needs 'name', 'ip'",
        ),
        (CONTAINER + "  network: {mode: both, ip: ''}\n", "network: both needs 'ip'"),
        (HOST.replace("{}", "{gpus: some}"), "run.gpus: expected 'all' or a number"),
        (HOST.replace("{}", "{restart: 'a:b'}"), "run.restart: expected a policy"),
        (
            CONTAINER.replace("{}", "{mounts: [{kind: a, source: b, target: c}]}") + "  network: {mode: host}\n",
            "beside",
        ),
        (
            CONTAINER.replace("{}", "{ports: [['', 1, 2]]}") + "  network: {mode: host}\n",
            "run.ports.0: expected 4 values",
        ),
        (HOST.replace("[]", "[{}]"), "mounts: each needs 'Type' and 'Target'"),
        (HOST.replace("[]", '[{Type: bind, Target: /x, Source: "a\\0"}]'), "mounts: no path holds a NUL"),
        (HOST.replace("[]", '[{Type: tmpfs, Target: "/x\\0y"}]'), "mounts: no path holds a NUL"),
    ],
)
def test_a_module_refuses_what_it_cannot_take(text: str, says: str) -> None:
    """Parameters that are unknown, missing or of another type are told with the playbook and the item."""
    context = {"half": "\ud800", "nul": "a\0b"}
    with pytest.raises(RenderError) as caught:
        render({"10-test.yml": text}, "r1", context, modules=MODULES, blobs={})
    assert caught.value.message.startswith("10-test.yml, item 1: ")
    assert says in caught.value.message
    assert "srprov schema playbook" in caught.value.hint
