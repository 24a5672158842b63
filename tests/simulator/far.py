"""What the tests of faults on the wire share: a device behind them, and one client."""

from collections.abc import Iterable

from register_maps import frames
from register_maps.frames import Request
from register_maps.words import Table
from simulator.wire_faults import (
    Exchange,
    Reply,
    WireFault,
    WireFaults,
)

READ = frames.read(Table.HOLDING, 10, 3)
WORDS = b"\x00\x0a\x00\x0b\x00\x0c"


class Far:
    """A device that answers every request right, and a client's connection to it through faults."""

    def __init__(self, *faults: WireFault, seed: int = 0) -> None:
        self.faults = WireFaults(faults, seed=seed, start=0.0)
        self.exchanges: list[Exchange] = []
        self.faults.on_exchange = self.exchanges.append
        self.heard: list[bytes] = []
        self.connection = self.faults.connection(0.0)
        self.now = 0.0

    def answer(self, frame: bytes) -> list[Reply]:
        self.heard.append(frame)
        return [(0.0, right(frame))]

    def ask(self, request: Request = READ, tid: int = 1, *, at: float = 0.0) -> list[Reply]:
        return self.connection.request(frames.frame(request, tid), at, self.answer)

    @property
    def struck(self) -> list[WireFault]:
        return [struck.fault for struck in self.faults.strikes]


def right(frame: bytes) -> bytes:
    request = frames.parse_request(frame)
    payload = b"" if request.is_write else bytes(range(request.answer_length - 9))
    if request == READ:
        payload = WORDS
    return frames.answer(request, frames.tid_of(frame), payload)


def answer_to(request: Request, tid: int = 1) -> bytes:
    return right(frames.frame(request, tid))


def only(replies: Iterable[Reply]) -> bytes:
    ((delay_s, data),) = replies
    assert delay_s == 0.0
    assert data is not None
    return data
