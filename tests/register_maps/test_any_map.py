"""What holds for every map that the checks accept, whatever it says."""

from hypothesis import given
from hypothesis import strategies as st

from drivers.modbus.read_plan import plan_reads
from register_maps.codec import UNLISTED, Block, Codec, SignalCodec, compile_map
from register_maps.schema import RegisterMap
from register_maps.words import BIT_TABLES, Door
from tests.support.any_map import any_map
from tests.support.examples import examples

MOST = 256
"""Raw values that are looked at where there are too many for all of them."""


def raws(signal: SignalCodec, source: RegisterMap) -> set[int]:
    """Every raw value of a narrow signal; of a wide one some, the codes of its tables and both ends among them."""
    most = 1 << signal.width
    spec = source.signals[signal.name]
    codes = {code % most for code in (*(spec.values or {}), *spec.unknown, *spec.none, spec.means_yes, 0, 1, -1)}
    codes |= {signal.encode(code) for code in spec.positions or () if signal.by_position}
    return codes | set(range(0, most, max(1, most // MOST)))


def plan(codec: Codec) -> tuple[Block, ...]:
    link = codec.map.link
    return plan_reads(
        codec.signal_points, codec.served, max_registers=link.max_registers_per_read, max_bits=link.max_bits_per_read
    )


@given(any_map())
@examples(15)
def test_every_value_a_signal_can_say_is_heard_as_it_was_said(source: RegisterMap) -> None:
    codec = compile_map(source)
    for signal in codec.signals.values():
        told = 0
        for raw in raws(signal, source):
            value = signal.decode(raw)
            if value is UNLISTED or value is None:
                continue
            told += 1
            assert signal.decode(signal.encode(value)) == value, (signal.name, raw)
            image = codec.empty_image()
            signal.insert(image, value)
            assert signal.decode(signal.extract(image)) == value
        assert told


@given(any_map(), st.data())
@examples(15)
def test_a_signal_that_is_written_changes_no_other(source: RegisterMap, data: st.DataObject) -> None:
    codec = compile_map(source)
    noise = st.integers(0, 65535)
    image = {
        space: [data.draw(noise) & (1 if space in BIT_TABLES else 0xFFFF) for _ in cells]
        for space, cells in codec.empty_image().items()
    }
    declared = {name: signal for name, signal in codec.signals.items() if name not in source.derived}
    name = data.draw(st.sampled_from(sorted(declared)))
    before = {other: signal.extract(image) for other, signal in declared.items() if other != name}
    value = codec.signals[name].decode(codec.signals[name].extract(image))
    if value is not UNLISTED and value is not None:
        codec.signals[name].insert(image, value)
    assert {other: codec.signals[other].extract(image) for other in before} == before


@given(any_map())
@examples(15)
def test_no_read_leaves_what_is_served_or_asks_for_more_than_is_allowed(source: RegisterMap) -> None:
    codec = compile_map(source)
    blocks = plan(codec)
    for block in blocks:
        assert any(block.start in span and block.start + block.count <= span.stop for span in codec.served[block.table])
        limit = source.link.max_bits_per_read if block.table in BIT_TABLES else source.link.max_registers_per_read
        assert 1 <= block.count <= limit
    for point in codec.signal_points:
        assert sum(block.holds(point) for block in blocks) == 1


@given(any_map())
@examples(15)
def test_a_poll_is_decoded_as_its_registers_are(source: RegisterMap) -> None:
    codec = compile_map(source)
    image = codec.empty_image()
    blocks = plan(codec)
    reader = codec.reader(blocks)
    for door in (Door.OPEN, Door.CLOSED):
        try:
            codec.signals["door.front"].insert(image, door)
        except ValueError:
            continue
        payloads = tuple(_payload(block, image) for block in blocks)
        reader.feed(payloads)
        assert reader.values["door.front"] is door


def _payload(block: Block, image: dict[str, list[int]]) -> bytes:
    cells = image[block.table][block.start : block.start + block.count]
    if block.table in BIT_TABLES:
        return sum(bit << place for place, bit in enumerate(cells)).to_bytes((len(cells) + 7) // 8, "little")
    return b"".join(cell.to_bytes(2, "big") for cell in cells)
