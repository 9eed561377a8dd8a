"""Users' playbooks, from their files to robots in memory: order, types, permission, checks, and what is told."""

from __future__ import annotations

import os
import re
from inspect import get_annotations
from pathlib import Path
from typing import Any

import msgspec
import pytest
from jsonschema import Draft202012Validator
from msgspec.structs import replace

from srprov.controller import plan
from srprov.controller.playbooks import playbooks
from srprov.controller.render_inputs import RenderInputs
from srprov.data import schema
from srprov.definitions import playbook as reading
from srprov.definitions.playbookmodel import ADDED, AFTER, BEFORE, REPLACES, Playbook
from srprov.definitions.template_check import VARIABLES
from srprov.errors import DefinitionError, RefusedError
from srprov.execution import Outcome
from srprov.modules import MODULES
from srprov.modules.file import FileParams
from srprov.modules.params import AnyText, Mode
from srprov.planning.plan import Plan
from srprov.resource import Action
from srprov.wire import Query
from tests.fakes import World
from tests.worlds import Experiment, apply, experiment, plan_for, removal_for, run, service

ALLOW = frozenset({"playbook"})
MARKER = """\
- command: marker is there
  argv: [touch, /opt/marker]
  unless: test -e /opt/marker
- file: {{ folder ~ "/motd" }}
  content: {{ "hello from " ~ host }}
  mode: 0640
"""


@pytest.fixture
def write(tmp_path: Path) -> Any:
    """Return a function that writes a playbook and reads it as it is read."""

    def _write(text: str, place: str = BEFORE, name: str = "p.yml") -> Playbook:
        (tmp_path / name).write_text(text)
        return reading.read(str(tmp_path / name), name, name, place)

    return _write


def with_playbooks(*playbooks: Playbook, services: tuple[Any, ...] = ()) -> Experiment:
    """Return an experiment with playbooks of its own."""
    return experiment(*(services or (service("a", robot="r1"),)), playbooks=playbooks)


def told(world: World, what: Experiment, **wishes: Any) -> list[str]:
    """Return what a plan that must not be possible says, as `line:column message (hint)`."""
    with pytest.raises(DefinitionError) as caught:
        plan_for(world, what, allowed=ALLOW, **wishes)
    return [f"{p.location.line}:{p.location.column} {p.message} ({p.hint})" for p in caught.value.problems]


def ids(plan: Plan) -> list[str]:
    """Return the steps' addresses, in order."""
    return [step.id for step in plan.steps]


def checks(world: World) -> list[str]:
    """Return the checks of commands that robots were asked."""
    queries = [entry.what for entry in world.log if isinstance(entry.what, Query)]
    return [query.command for query in queries if query.command.startswith("timeout -k 2")]


def test_the_schemas_modules_and_variables_are_those_that_there_are(
    write: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The schema names every module, and the known variables are what playbooks get."""
    assert set(reading.modules()) == set(MODULES)
    seen: list[dict[str, Any]] = []
    made = plan.contexts

    def spy(parts: RenderInputs) -> Any:
        per_host, blobs = made(parts)
        seen.extend(per_host.values())
        return per_host, blobs

    monkeypatch.setattr(plan, "contexts", spy)
    plan_for(World().add("r1"), experiment(service("a")))
    assert tuple(sorted(seen[0])) == VARIABLES


TYPES = {
    "str": {"string"}, "AnyText": {"string"}, "Mode": {"string"}, "bytes": {"string"}, "bool": {"boolean"},
    "int": {"integer"}, "float": {"number"}, "tuple": {"array"}, "Mapping": {"object"},
}  # fmt: skip
"""The type of a field as its module writes it -> what the schema calls it."""


def json_types(written: str) -> set[str]:
    """Return the types of JSON that a field of a module takes."""
    if written.startswith("Literal"):
        return set()  # an enum, which has no type
    options = {one.partition("[")[0] for one in re.split(r" \| (?![^[]*\])", written)} - {"None"}
    return set().union(*(TYPES.get(one, {"object"}) for one in options))


@pytest.mark.parametrize("kind", MODULES)
def test_the_schema_says_what_the_module_takes(kind: str) -> None:
    """The same parameters, required or not, of the same types: what validates can be read, and the other way round."""
    stated = schema("playbook")["$defs"][kind]
    params = MODULES[kind].params
    every = {name: text for one in reversed(params.__mro__) for name, text in get_annotations(one).items()}
    written = {name: text for name, text in every.items() if "NOT_WRITTEN" not in str(text)}
    fields = {one.name.rstrip("_"): one for one in msgspec.structs.fields(params) if one.name in written}
    assert set(stated["properties"]) == {kind, *fields, "needs"}
    must = {name for name, one in fields.items() if one.required}
    assert set(stated["required"]) == {kind, *must}
    for name, field in fields.items():
        rule = stated["properties"][name]
        types = {one["type"] for one in rule.get("anyOf", [rule]) if "type" in one}
        assert types == json_types(written[field.name]), name
        if "enum" in rule:
            assert written[field.name] == f"Literal[{', '.join(map(repr, rule['enum']))}]", name


def test_our_own_playbooks_hold_to_the_schema() -> None:
    """Whoever copies one of them to change it begins with a valid file."""
    for name in playbooks():
        reading.read(str(Path(__file__).parents[3] / "playbooks" / name), name, name, REPLACES)


def test_an_overriding_copy_of_ours_changes_nothing(tmp_path: Path) -> None:
    """Rendered the users' way, ours give the same resources, whatever a service holds."""
    for name, text in playbooks().items():
        (tmp_path / name).write_text(text)
    every = reading.from_folder(str(tmp_path), playbooks())
    assert {one.place for one in every} == {REPLACES}
    hard = service("a", robot="r1", command=("yes", "0644", "a: b", "{{ x }}"), environment={"A": "no", "B": "1.10"})
    world = World().add("r1", "r2")
    what = experiment(hard, service("b", robot="r2", depends_on={"a": "started"}))
    assert apply(world, what).exit_code == 0
    again = plan_for(world, what, playbooks=every)
    assert again.empty, ids(again)
    assert [use.how for use in again.playbooks] == [f"replaces srprov's own, from {one.file}" for one in every]


@pytest.mark.skipif(os.geteuid() != 0, reason="only root can give files away")
@pytest.mark.parametrize("which", ["folder", "file", "owner", "group"])
def test_own_playbooks_that_others_can_write_are_refused(tmp_path: Path, which: str) -> None:
    """They are root on every robot, and nobody is asked: as for the user's configuration."""
    folder, file = tmp_path / "playbooks", tmp_path / "playbooks/a.yml"
    folder.mkdir()
    file.write_text("- command: x\n  argv: [x]\n  creates: /x\n")
    assert reading.from_folder(str(folder), ())
    for path in (folder, file):
        path.chmod(path.stat().st_mode | 0o020)
    assert reading.from_folder(str(folder), ()), "one's own group is nobody else"
    if which in ("folder", "file"):
        (folder if which == "folder" else file).chmod(0o777)
    else:
        os.chown(file, 4711 if which == "owner" else -1, 4711)
    with pytest.raises(DefinitionError, match="1 problem") as refused:
        reading.from_folder(str(folder), ())
    assert "others can write it" in refused.value.problems[0].message


@pytest.mark.skipif(os.geteuid() != 0, reason="only root can give files away")
@pytest.mark.parametrize("which", ["everybody", "group", "owner", "link"])
def test_own_playbooks_in_whose_place_others_can_put_some_are_refused(tmp_path: Path, which: str) -> None:
    """They rename the folder: a repository that the user cloned, which a stranger wrote, takes its place."""
    shared, cloned = tmp_path / "shared", tmp_path / "cloned"
    shared.mkdir()
    cloned.mkdir()
    (cloned / "a.yml").write_text("- command: x\n  argv: [x]\n  creates: /x\n")
    (shared / "playbooks").symlink_to(cloned)
    assert reading.from_folder(str(shared / "playbooks"), ())
    if which == "link":
        os.lchown(shared / "playbooks", 4711, 4711)
    else:
        os.chown(shared, 4711 if which == "owner" else -1, 4711)
        shared.chmod({"everybody": 0o777, "group": 0o775, "owner": 0o755}[which])
    with pytest.raises(DefinitionError) as refused:
        reading.from_folder(str(shared / "playbooks"), ())
    assert "a folder above it" in refused.value.problems[0].message


def test_before_stands_before_and_is_idempotent(write: Any) -> None:
    """A failing playbook before ours would stop ours; one that is right is not done again, and drift is mended."""
    world = World().add("r1", "r2")
    what = with_playbooks(write(MARKER))
    plan = plan_for(world, what, allowed=ALLOW)
    first = [step.number for step in plan.steps if step.name in ("marker is there", "/var/lib/srprov/hello/motd")]
    ours = [step for step in plan.steps if step.host == "r1" and step.number not in first]
    assert first == [1, 2] and ours and all(2 in step.needs for step in ours)
    assert not [step for step in plan.steps if step.host == "r2" and step.module == "command"], "only a witness"

    assert run(world, plan).exit_code == 0

    robot = world.robots["r1"]
    assert robot.disk.marks == {"/opt/marker"}
    assert robot.disk.files["/var/lib/srprov/hello/motd"] == b"hello from r1"
    assert robot.disk.modes["/var/lib/srprov/hello/motd"] == 0o640
    assert plan_for(world, what, allowed=ALLOW).empty
    robot.disk.marks.clear()
    drift = plan_for(world, what, allowed=ALLOW)
    assert [(step.name, step.change.action) for step in drift.steps] == [("marker is there", Action.RUN)]
    assert run(world, drift).exit_code == 0
    assert plan_for(world, what, allowed=ALLOW).empty


def test_a_playbook_is_done_from_top_to_bottom(write: Any) -> None:
    """Neither names nor kinds decide; what follows a failed item is not begun, and needs only look back."""
    text = (
        "- command: b\n  shell: exit 7\n  creates: /opt/b\n- command: a\n  argv: [touch, /opt/a]\n  creates: /opt/a\n"
    )
    text += '- file: {{ folder ~ "/x" }}\n  content: x\n'
    world = World().add("r1")
    plan = plan_for(world, with_playbooks(write(text)), allowed=ALLOW)
    assert [step.name for step in plan.steps][:3] == ["b", "a", "/var/lib/srprov/hello/x"]
    result = run(world, plan)
    assert {one.outcome for one in result.results[1:]} == {Outcome.SKIPPED}
    ahead = text.replace("creates: /opt/b\n", "creates: /opt/b\n  needs: [command:a]\n")
    assert told(world, with_playbooks(write(ahead)))[0].startswith("1:3 needs r1/command:a, which comes later")


def test_after_waits_for_ours_and_added_ones_stand_by_name(write: Any) -> None:
    """Steps of a playbook `after` need the service's container; `35-` stands between the files and the services."""
    last = write("- command: last\n  argv: [touch, /opt/last]\n  creates: /opt/last\n", AFTER, "last.yml")
    between = write("- command: mid\n  argv: [touch, /opt/mid]\n  creates: /opt/mid\n", ADDED, "35-mid.yml")
    plan = plan_for(World().add("r1"), with_playbooks(last), allowed=ALLOW, playbooks=(between,))
    number = {step.id.split("/", 1)[1]: step.number for step in plan.steps}
    needs = {step.id.split("/", 1)[1]: set(step.needs) for step in plan.steps}
    container = "container:srprov.hello.a"
    assert number[container] in needs["command:last"]
    assert number["command:mid"] in needs[container]
    assert number["file:/var/lib/srprov/hello/hosts"] in needs["command:mid"]


def test_nothing_is_asked_without_permission(write: Any) -> None:
    """An experiment's playbook is refused before any robot hears of its check; the user's own need no permission."""
    world = World().add("r1")
    with pytest.raises(RefusedError) as caught:
        plan_for(world, with_playbooks(write(MARKER)))
    assert "p.yml: playbook (states anything on the robots, as root)" in caught.value.message
    assert "p.yml:1: playbook (runs: touch /opt/marker; its check, which plan runs too: test -e /opt/marker)" in str(
        caught.value
    )
    assert caught.value.hint == "if you trust it: --allow playbook"
    assert checks(world) == []
    assert not plan_for(world, with_playbooks(), playbooks=(write(MARKER, ADDED),)).empty
    assert len(checks(world)) == 1


def test_all_checks_of_a_robot_go_in_one_round_trip(write: Any) -> None:
    """Ten commands cost a robot one more round trip, and robots without any none."""
    many = "".join(f"- command: c{n}\n  argv: [touch, /opt/{n}]\n  creates: /opt/{n}\n" for n in range(10))
    plain, world = World().add("r1", "r2"), World().add("r1", "r2")
    plan_for(plain, with_playbooks())
    plan_for(world, with_playbooks(write(many)), allowed=ALLOW)
    cost = {
        name: world.robots[name].traffic.round_trips - one.traffic.round_trips for name, one in plain.robots.items()
    }
    assert cost == {"r1": 1, "r2": 0}


def test_a_command_that_does_not_reach_its_check_failed_and_stops_what_follows(write: Any) -> None:
    """It exits with 0, its check still fails: the step failed with both said, and no container was made."""
    world = World().add("r1")
    text = "- command: lies\n  argv: ['true']\n  unless: [test, -e, /opt/x]\n"
    result = run(world, plan_for(world, with_playbooks(write(text)), allowed=ALLOW))
    by_name = {one.step.name: one for one in result.results}
    assert by_name["lies"].outcome is Outcome.FAILED
    assert by_name["lies"].message == "it ran, and did not converge: its check exits with 1: test -e /opt/x"
    assert by_name["srprov.hello.a"].outcome is Outcome.SKIPPED
    assert result.exit_code == 3
    assert not world.robots["r1"].engine.containers


def test_a_command_that_fails_says_how(write: Any) -> None:
    """Its exit code is in the message."""
    world = World().add("r1")
    text = "- command: breaks\n  shell: exit 7\n  creates: /opt/x\n"
    result = run(world, plan_for(world, with_playbooks(write(text)), allowed=ALLOW))
    assert "exit 7" in next(one.message for one in result.results if one.step.name == "breaks")


def test_a_command_is_asked_again_after_what_it_needs(write: Any) -> None:
    """Its check holds before the file changes; it may not hold after: it is in the plan, and runs only if it is due."""
    text = (
        '- file: {{ folder ~ "/v" }}\n  content: "TEXT"\n'
        "- command: uses it\n  argv: [touch, /opt/used]\n  creates: /opt/used\n"
        '  needs: [{{ "file:" ~ folder ~ "/v" }}]\n'
    )
    world = World().add("r1")
    assert apply_with(world, with_playbooks(write(text.replace("TEXT", "1")))) == 0
    what = with_playbooks(write(text.replace("TEXT", "2")))
    plan = plan_for(world, what, allowed=ALLOW)
    assert [step.name for step in plan.steps] == ["/var/lib/srprov/hello/v", "uses it"]
    assert plan.steps[1].change.cause == "asked again after r1/file:/var/lib/srprov/hello/v, which it needs"
    result = run(world, plan)
    assert [(one.outcome, one.message) for one in result.results][1] == (Outcome.UNCHANGED, "its check holds by now")
    assert plan_for(world, what, allowed=ALLOW).empty


def apply_with(world: World, what: Experiment, **wishes: Any) -> int:
    """Plan with permission and do it."""
    return run(world, plan_for(world, what, allowed=ALLOW, **wishes)).exit_code


def test_what_is_owned_goes_and_commands_stay_done(write: Any) -> None:
    """Without the playbook its file is removed; the command's marker stays; destroy needs no playbook."""
    world = World().add("r1")
    assert apply_with(world, with_playbooks(write(MARKER))) == 0
    plan = plan_for(world, with_playbooks())
    assert [(step.name, step.change.action) for step in plan.steps] == [("/var/lib/srprov/hello/motd", Action.DELETE)]
    assert apply_with(world, with_playbooks(write(MARKER))) == 0
    assert run(world, removal_for(world)).exit_code == 0
    assert world.robots["r1"].disk.marks == {"/opt/marker"}
    assert not world.robots["r1"].disk.files


def test_a_robot_that_goes_while_checks_are_asked_is_unreachable(write: Any) -> None:
    """It is noted like any other robot out of reach."""
    world = World().add("r1")
    robot = world.robots["r1"]
    ask = robot.ask

    def failing(queries: Any) -> Any:
        robot.gone = any(isinstance(q, Query) and q.command.startswith("timeout") for q in queries)
        return ask(queries)

    robot.ask = failing  # type: ignore[method-assign] # one robot of one test
    plan = plan_for(world, with_playbooks(write(MARKER)), allowed=ALLOW)
    assert plan.unreachable == {"r1": "the connection was lost [SRP-310]\n  is the robot up?"}


WRONG = [  # `@` begins a command up to what its check is
    ('- file: /etc/motd\n  content: x\n', "1:3 the file '/etc/motd' is not in the instance's folder"),
    ('- file: {{ folder ~ "/a/b" }}\n  content: x\n', "1:3 the file '/var/lib/srprov/hello/a/b' is not directly in"),
    ('- file: {{ folder ~ "/../x/y" }}\n  content: x\n', "1:3 the file '/var/lib/srprov/hello/../x/y' is not directly"),
    ("- volume: v\n  instance: other\n  source: s\n", "1:3 the volume 'v' would belong to another instance"),
    (
        '- secret: {{ "/run/srprov/" ~ instance ~ "/secrets/x" }}\n  name: x\n  mode: "0400"\n',
        "1:3 no service on this robot uses a secret 'x'",
    ),
    ('- file: {{ folder ~ "/hosts" }}\n  content: x\n', "1:3 file:/var/lib/srprov/hello/hosts stands in 30-files.yml"),
    ("- command: x\n  argv: [a]\n  timeout: {{ host }}\n  unless: b\n", "3:3 expected a whole number, not text"),
    ("- command: x\n  argv: {{ robot }}\n  unless: b\n", "2:3 expected a list, not a map"),
    ("@{{ robot.wheels }}\n", "3:3 for robot r1: 'dict object' has no attribute"),
    ("@b\n  needs: ['file:/nope']\n", "1:3 needs r1/file:/nope, which no playbook"),
    (
        "@b\n  needs: ['container:srprov.hello.b']\n",
        "1:3 needs r1/container:srprov.hello.b, which no playbook states (did you mean 'container:srprov.hello.a'?)",
    ),
    (
        "@b\n  needs: ['container:srprov.hello.a']\n",
        "1:3 needs r1/container:srprov.hello.a, which comes later (a playbook is done from top",
    ),
    ("@b\n@b\n", "4:3 command:x stands in p.yml:1"),
    ("- tree: {{ folder ~ '/trees/x' }}\n  blob: 'y'\n", "2:3 there is no blob 'y'"),
]  # fmt: skip


@pytest.mark.parametrize(("text", "said"), WRONG)
def test_what_renders_to_something_wrong_is_told_at_its_place(write: Any, text: str, said: str) -> None:
    """File, line and column are those of the playbook, whatever it rendered to."""
    whole = text.replace("@", "- command: x\n  argv: [a]\n  unless: ")
    (first, *more) = told(World().add("r1"), with_playbooks(write(whole)))
    assert first.startswith(said)
    assert not more


def test_reading_a_playbook_computes_nothing(write: Any) -> None:
    """A stranger's file is only looked at: what would take for ever, or too much, is not begun."""
    text = "- file: x\n  content: {{ 9**9**9**9 }}\n  mode: {{ 'a' * 10**12 }}\n"
    text += "{% for i in range(10**12) %}\n{% endfor %}\n"
    assert write(text).commands == ()
    with pytest.raises(DefinitionError) as caught:
        write("- file: {{ " + "(" * 5000 + "1" + ")" * 5000 + " }}\n  content: x\n")
    assert "nested too deeply" in caught.value.problems[0].message
    for chain in ("a" + "/a" * 4000, "a" + "|trim" * 4000, "a" + ".b" * 4000, "not " * 900 + "a", "a" + "[0]" * 4000):
        with pytest.raises(DefinitionError) as caught:
            write("- file: x\n  content: '{{ " + chain + " }}'\n")
        assert "nested too deeply" in caught.value.problems[0].message
    with pytest.raises(DefinitionError) as caught:
        write("{{ a }}" * 40_000)
    assert "is longer than" in caught.value.problems[0].message


def test_needs_of_other_robots_are_known_too(write: Any) -> None:
    """What no playbook states there is a mistake; waiting for a file to be healthy is one as well."""
    services = (service("a", robot="r1"), service("b", robot="r2"))
    text = "- command: x\n  argv: [touch, /x]\n  creates: /x\n  needs: [NEED]\n"
    fine = with_playbooks(write(text.replace("NEED", "'r2/container:srprov.hello.b'"), AFTER), services=services)
    world = World().add("r1", "r2")
    assert "r2/container:srprov.hello.c" not in str(plan_for(world, fine, allowed=ALLOW))
    for need, said in (
        ("'r2/container:srprov.hello.c'", "needs r2/container:srprov.hello.c, which no playbook states"),
        ("{id: 'image:busybox:latest', condition: healthy}", "which only a container can be"),
    ):
        what = with_playbooks(write(text.replace("NEED", need), AFTER), services=services)
        assert said in told(world, what)[0]


def test_too_many_blocks_are_an_error_of_the_playbook(write: Any) -> None:
    """Python cannot nest loops as deep as a template can."""
    text = "".join(f"{{% for a{n} in services %}}\n" for n in range(30)) + "{% endfor %}\n" * 30
    assert "too many statically nested" in told(World().add("r1"), with_playbooks(write(text)))[0]


def test_all_that_is_wrong_is_told_at_once(write: Any) -> None:
    """Two playbooks, two robots: each mistake once, in the order of their lines."""
    services = (service("a", robot="r1"), service("b", robot="r2"))
    one = write("- file: /a\n  content: x\n- file: /b\n  content: x\n")
    two = write("- volume: v\n  instance: z\n  source: s\n", AFTER, "q.yml")
    assert len(told(World().add("r1", "r2"), with_playbooks(one, two, services=services))) == 3


def test_values_that_no_schema_can_judge_are_an_error_of_the_playbook(write: Any) -> None:
    """A container without run-time fields is an error with its place, not a crash."""
    text = (
        "- container: c\n  instance: {{ instance }}\n  source: {{ source }}\n  service: c\n  image: busybox\n"
        "  hostname: c\n  job: no\n  run: {}\n  mounts: []\n  network: {}\n  api: {{ api }}\n"
    )
    (problem,) = told(World().add("r1"), with_playbooks(write(text)))
    assert problem.startswith("10:3 the parameter 'network.mode' is missing")


def test_a_field_decides_the_type_of_what_is_written(write: Any) -> None:
    """`0640` and `on` are text where text is wanted, and YAML's words are booleans only where one is wanted."""
    text = '- file: {{ folder ~ "/x" }}\n  content: on\n  mode: 0600\n  in_place: yes\n'
    plan = plan_for(World().add("r1"), with_playbooks(write(text)), allowed=ALLOW)
    params = next(step.want.params for step in plan.steps if step.want and step.name.endswith("/x"))
    assert params == FileParams(content=AnyText("on"), mode=Mode(0o600), in_place=True)


def test_the_manuals_playbooks_work(write: Any) -> None:
    """Each example in docs/playbooks.md can be planned as it stands there, and is true once applied."""
    manual = (Path(__file__).parents[3] / "docs" / "playbooks.md").read_text(encoding="utf-8")
    examples = re.findall(r"```yaml\n(.*?)```", manual, re.DOTALL)
    assert len(examples) == 2
    for text in examples:
        world = World().add("r1")
        plan = plan_for(world, with_playbooks(write(text)), allowed=ALLOW)
        assert "command" in {step.module for step in plan.steps}
    assert all(f"`{name}`" in manual for name in VARIABLES)


def test_every_field_of_a_playbook_is_explained() -> None:
    """For people, and for editors."""
    whole = schema("playbook")
    Draft202012Validator.check_schema(whole)
    for kind, part in whole["$defs"].items():
        assert part["description"] and next(iter(part["properties"])) == kind
        for name, field in part["properties"].items():
            assert field["description"] and field["examples"], f"{kind}.{name}"
            for example in field["examples"]:
                assert Draft202012Validator(field).is_valid(example), f"{kind}.{name}: {example}"


def test_the_plan_shows_playbooks_that_are_not_ours(write: Any) -> None:
    """A line for each, with the file of those that the user's folder gave."""
    from srprov.planning.text import plan_text

    own = replace(write(playbooks()["40-services.yml"], REPLACES, "40-services.yml"), file="/u/4.yml")
    own = replace(own, file="/u/40-services.yml")
    shown = plan_text(plan_for(World().add("r1"), with_playbooks(write(MARKER)), allowed=ALLOW, playbooks=(own,)))
    assert "  40-services.yml  replaces srprov's own, from /u/40-services.yml\n" in shown
    assert "  p.yml            before srprov's own, from the experiment\n" in shown
    assert "  ! playbook       p.yml:1: runs: touch /opt/marker; its check" in shown
