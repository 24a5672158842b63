"""The settings of a link, and its counters."""

from __future__ import annotations

from dataclasses import dataclass, field

from drivers.modbus.histogram import Histogram
from drivers.modbus.latency import SPARE_S, Latency


@dataclass(frozen=True, slots=True, kw_only=True)
class LinkSettings:
    """How to communicate with one controller. Durations in seconds."""

    timeout_s: float = 0.5
    """Time-out of an answer until round trips are measured; a write never has less. Chosen: controllers answer within 20 to 100 ms, and a
    second try fits into one second of age."""
    timeout_max_s: float | None = None
    """Longest time-out of an answer, however slow the controller is; the default is `most_timeout_s`."""
    connect_timeout_s: float = 1.0
    """Time-out of a connection. Chosen: TCP repeats its request after 1 s, and our next attempt follows soon."""
    min_gap_s: float = 0.0
    """From the end of one transaction to the start of the next. From the controller's manual."""
    reconnect_min_s: float = 0.2
    """From the end of one connection to the next attempt. Chosen: a device with one slot needs time to free it."""
    reconnect_max_s: float = 1.0
    """Longest time from the start of one attempt to that of the next. Chosen: heals within 2 s of the controller's return."""
    max_connections: int | None = None
    """How many clients the device serves at once, if known: a time-out may mean that its slots are taken."""
    tid_echo: bool = True
    """Whether the device answers with the transaction id of the request, as the specification says; some do not."""
    tls: bool = False
    """Whether the wire is Modbus/TCP Security: there an exception may be about the role in our certificate."""
    busy_retries: int = 3
    """How often a read that was answered with busy (06) is repeated. Chosen."""
    busy_pause_s: float = 0.05
    """How long reads wait after a busy answer; commands do not. Chosen: about one poll period."""

    def __post_init__(self) -> None:
        if self.timeout_max_s is not None and self.timeout_max_s < self.timeout_s:
            raise ValueError("timeout_max_s must not be less than timeout_s")
        for name in ("timeout_s", "connect_timeout_s", "reconnect_min_s"):
            if not getattr(self, name) > 0:
                raise ValueError(f"{name} must be more than 0 s")
        if self.min_gap_s < 0 or self.busy_pause_s < 0 or self.busy_retries < 0:
            raise ValueError("min_gap_s, busy_pause_s and busy_retries must not be less than 0")
        if self.max_connections is not None and self.max_connections < 1:
            raise ValueError("max_connections must be 1 or more")
        if self.reconnect_max_s < self.reconnect_min_s:
            raise ValueError("reconnect_max_s must not be less than reconnect_min_s")

    @property
    def most_timeout_s(self) -> float:
        """`timeout_max_s`, else four times `timeout_s` but not beyond 2 s.

        Chosen: four times is enough for a gateway far slower than its map says; and a release, which waits for at most one request,
        waits no longer than between two of its own tries.
        """
        if self.timeout_max_s is not None:
            return self.timeout_max_s
        return max(self.timeout_s, min(4 * self.timeout_s, 2.0))

    def new_latency(self) -> Latency:
        """Return an estimator for a link that has measured nothing yet."""
        # without transaction ids one time-out ends the connection, so waiting longer is cheaper
        spare_s = min(SPARE_S, self.timeout_s) if self.tid_echo else self.timeout_s
        return Latency(self.timeout_s, spare_s=spare_s, most_s=self.most_timeout_s)


@dataclass(slots=True)
class LinkStats:
    """Counters since the link was made."""

    transactions: int = 0
    """Requests sent."""
    timeouts: int = 0
    late: int = 0
    """Discarded answers to requests of ours: too late, or duplicates."""
    desyncs: int = 0
    """Answers that fit no request of ours."""
    recycles: int = 0
    """Connections that we ended because of time-outs or a desync."""
    connects: int = 0
    failed_connects: int = 0
    losses: int = 0
    """Connections that the other side ended, or that carried something other than Modbus/TCP."""
    exceptions: int = 0
    """Exception answers, busy ones included."""
    latencies: dict[int, Latency] = field(default_factory=dict)
    """Round trips and time-out of each unit."""
    silent_units: dict[int, None] = field(default_factory=dict)
    """Units that do not answer while others on this link do."""
    answered_at: float | None = None
    """Loop time of the newest good answer, including exceptions; None before the first."""
    asked_at: float = 0.0
    """When the request left to which that was the answer: it may have waited for other lifts on this link."""
    round_trips: Histogram = field(default_factory=Histogram)
    """From request to good answer, including late ones. Requests without an answer are only in `timeouts`."""
    read_waits: Histogram = field(default_factory=Histogram)
    """How long reads waited for their turn before they left."""
    command_waits: Histogram = field(default_factory=Histogram)
    """The same for the command lane."""

    @property
    def round_trip_s(self) -> float | None:
        """From request to answer, smoothed, of the slowest unit; None before the first answer."""
        known = (self.round_trip_of(unit) for unit in self.latencies)
        return max((took_s for took_s in known if took_s is not None), default=None)

    def round_trip_of(self, unit: int) -> float | None:
        """From request to answer, smoothed; None before the first answer of that unit."""
        latency = self.latencies.get(unit)
        return None if latency is None else latency.round_trip_s
