"""A stand-in for etcd that lasts as long as the process; it passes the same tests as the real one."""

from base64 import b64decode
from collections.abc import Iterator, Sequence
from typing import Any

from lift_manager.cluster.errors import EtcdRefused, EtcdUnavailable
from lift_manager.cluster.etcd import Entry, Etcd, Json, Result


class MemoryEtcd(Etcd):
    """Keys, values and revisions. `lose` decides for each transaction what is lost of it."""

    def __init__(self) -> None:
        super().__init__(["http://127.0.0.1:1"], timeout_s=1.0)
        self.entries: dict[str, Entry] = {}
        self.revision = 1
        self.lose: Iterator[str] = iter(())
        """For each transaction: "" for nothing, "request" or "answer"; once it ends, nothing is lost any more."""
        self.has_majority = True
        """Without one only what the member itself has can be read."""
        self.newest: tuple[Sequence[Json], Sequence[Json]] = ((), ())
        """What the newest transaction compared and wrote, or would have."""

    def transact(self, compare: Sequence[Json], then: Sequence[Json], otherwise: Sequence[Json] = ()) -> Result:
        self.newest = compare, then
        lost = next(self.lose, "")
        if lost == "request":
            raise EtcdUnavailable("the request was lost")
        is_local = not compare and all(one.get("request_range", {}).get("serializable") for one in then)
        if not self.has_majority and not is_local:
            raise EtcdUnavailable("there is no leader")
        if max(len(then), len(otherwise), len(compare)) > 128:
            raise EtcdRefused("too many operations in txn request")
        succeeded = all(self._is_true(comparison) for comparison in compare)
        operations = then if succeeded else otherwise
        if any(name != "request_range" for operation in operations for name in operation):
            self.revision += 1
        ranges = tuple(found for operation in operations if (found := self._carry_out(operation)) is not None)
        if lost == "answer":
            raise EtcdUnavailable("the answer was lost")
        return Result(succeeded, self.revision, ranges)

    def _is_true(self, comparison: Json) -> bool:
        entry = self.entries.get(_text(comparison["key"]))
        if comparison["target"] == "MOD":
            return bool((0 if entry is None else entry.revision) == comparison["mod_revision"])
        return entry is not None and entry.value == b64decode(comparison["value"])

    def _carry_out(self, operation: Json) -> tuple[Entry, ...] | None:
        ((name, request),) = operation.items()
        key = _text(request["key"])
        if name == "request_put":
            self.entries[key] = Entry(key, b64decode(request["value"]), self.revision)
            return None
        found = self._range(key, request)
        if name == "request_range":
            return found[: request.get("limit", len(found))]
        for entry in found:
            del self.entries[entry.key]
        return None

    def _range(self, key: str, request: dict[str, Any]) -> tuple[Entry, ...]:
        if "range_end" not in request:
            return (self.entries[key],) if key in self.entries else ()
        end = _text(request["range_end"])
        return tuple(self.entries[one] for one in sorted(self.entries) if key <= one < end)


def _text(encoded: str) -> str:
    return b64decode(encoded).decode()
