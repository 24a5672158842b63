"""Maps written down in a test, checked as a file would be."""

from functools import cache
from pathlib import Path
from tempfile import TemporaryDirectory

from register_maps.codec import Codec, compile_map
from register_maps.load import load

HEAD = """\
schema: 1
name: written
title: A map written down in a test
provenance: {trust: template, sources: [this test]}
addressing: {base: 0}
served: {coil: [[0, 1023]], discrete: [[0, 99]], holding: [[0, 999]], input: [[0, 99]]}
at_floor_evidence: {kind: position_stable, for_s: 1.0}
at_same_floor: call
not_visible: {fire: nothing burns in a test}
"""


@cache
def written_map(text: str, head: str = HEAD) -> Codec:
    """Compile a map from its head and the rest, once for all tests of a process; a mistake in it fails the test with every finding."""
    with TemporaryDirectory() as folder:
        path = Path(folder) / "written.yaml"
        path.write_text(head + text, encoding="utf-8")
        return compile_map(load(path).map)
