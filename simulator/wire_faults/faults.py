"""Everything that can happen on the wire, as values: `WireFault`.

A value can be compared, printed, drawn from a seed and written in a file. `engine` decides when it strikes. Pure.
"""

from __future__ import annotations

from typing import get_args

from simulator.wire_faults.bases import ShapeFault
from simulator.wire_faults.contents import (
    GarbageBefore,
    TruncateAnswer,
    WrongCount,
    WrongEcho,
    WrongFunction,
    WrongTransactionId,
    WrongUnit,
)
from simulator.wire_faults.losses import (
    AcceptAndSayNothing,
    AnswerWithException,
    ConnectionLimit,
    DropAnswer,
    DropRequest,
    GarbageAnswer,
    HalfOpen,
    RefuseConnections,
    ResetConnection,
)
from simulator.wire_faults.timing import (
    Bandwidth,
    Delay,
    DuplicateAnswer,
    LateAnswer,
    LongTailedDelay,
    MergeAnswers,
    ReorderAnswers,
    SplitAnswer,
    UniformDelay,
)

WireFault = (
    DropRequest
    | DropAnswer
    | AnswerWithException
    | GarbageAnswer
    | ResetConnection
    | HalfOpen
    | WrongTransactionId
    | WrongUnit
    | WrongFunction
    | WrongCount
    | WrongEcho
    | TruncateAnswer
    | GarbageBefore
    | DuplicateAnswer
    | SplitAnswer
    | Delay
    | UniformDelay
    | LongTailedDelay
    | LateAnswer
    | Bandwidth
    | ReorderAnswers
    | MergeAnswers
    | RefuseConnections
    | AcceptAndSayNothing
    | ConnectionLimit
)

WIRE_FAULTS: tuple[type[WireFault], ...] = get_args(WireFault)
"""All their classes, for a loader of files, or to draw from."""

ORDER: tuple[type[ShapeFault], ...] = (
    WrongTransactionId,
    WrongUnit,
    WrongFunction,
    WrongCount,
    WrongEcho,
    TruncateAnswer,
    GarbageBefore,
    DuplicateAnswer,
    SplitAnswer,
    Delay,
    UniformDelay,
    LongTailedDelay,
    LateAnswer,
)
"""In which order faults shape one answer, in whatever order they were added."""
