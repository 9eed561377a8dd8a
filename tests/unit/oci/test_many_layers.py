"""Images of hundreds of layers, each of which takes something away: what is left is found at once."""

from __future__ import annotations

from types import SimpleNamespace

from srprov.evidence.checks_images import Images
from srprov.evidence.images import LAYOUT
from srprov.oci.databases import Layer, merged
from srprov.oci.packing import most_content
from tests.bounded import bounded

FOLDER = "/".join("abcd" for _ in range(190))


def test_what_layers_take_away_is_looked_for_once_for_each_file() -> None:
    files = {f"{FOLDER}/{number}.dist-info/METADATA": b"" for number in range(10_000)}
    layers = [Layer(files), *(Layer({}, gone=frozenset({f"other/{number}"})) for number in range(500))]
    assert bounded(lambda: len(merged(layers)), cpu_s=5) == 10_000


def test_a_layer_hides_what_is_below_it_and_not_its_own() -> None:
    below = Layer({"a/x": b"1", "a/b/y": b"1", "c": b"1", "d/z": b"1"})
    middle = Layer({"a/b/y": b"2"}, gone=frozenset({"a/b", "c"}))
    top = Layer({"d/w": b"3"}, emptied=frozenset({"d"}))
    assert merged([below, middle, top]) == {"a/b/y": b"2", "a/x": b"1", "d/w": b"3"}
    assert merged([below, Layer({"e": b""}, emptied=frozenset({""}))]) == {"e": b""}
    assert merged([below, middle, Layer({"c": b"4"})])["c"] == b"4"


def test_a_layer_that_comes_again_is_looked_at_once() -> None:
    """As often as an image may have it, for as many images as a bundle may hold, that would be hours."""
    one = Layer({f"{number}.dist-info/METADATA": b"" for number in range(40_000)})
    layers = [one, Layer({"a": b"1"}), *[one] * 500]
    assert bounded(lambda: len(merged(layers)), cpu_s=0.3) == 40_001
    below, top = Layer({"a/x": b"1", "b": b"1"}), Layer({}, gone=frozenset({"a"}))
    assert merged([below, top, below]) == {"a/x": b"1", "b": b"1"}
    assert merged([top, below, top]) == {"b": b"1"}


def test_all_layers_together_become_no_more_than_one_of_their_size_may() -> None:
    """Else each of hundreds of small ones could become a gigabyte."""
    sizes = {f"{LAYOUT}blobs/sha256/{number:064x}": 1000 for number in range(200)}
    files = SimpleNamespace(sizes=dict(sorted(sizes.items())))
    assert Images(SimpleNamespace(files=files)).left == most_content(200_000)  # type: ignore[arg-type]  # only sizes
