"""Faults on the wire between a client and its controller: values, and the engine that makes them happen. Pure.

`faulty` puts them on a wire in memory, `simulator.proxy` in front of a real server.
"""

from simulator.wire_faults.bases import Limits, Replies, Reply
from simulator.wire_faults.contents import (
    EchoPart,
    GarbageBefore,
    TruncateAnswer,
    WrongCount,
    WrongEcho,
    WrongFunction,
    WrongTransactionId,
    WrongUnit,
)
from simulator.wire_faults.engine import Answer, Connection, ConnectOutcome, Verdict, WireFaults
from simulator.wire_faults.faults import ORDER, WIRE_FAULTS, WireFault
from simulator.wire_faults.ledger import Exchange, StruckFault
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
from simulator.wire_faults.memory import FaultyAnswer, faulty
from simulator.wire_faults.target import EVERYTHING, Access, Target
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

__all__ = [
    "EVERYTHING",
    "ORDER",
    "WIRE_FAULTS",
    "AcceptAndSayNothing",
    "Access",
    "Answer",
    "AnswerWithException",
    "Bandwidth",
    "ConnectOutcome",
    "Connection",
    "ConnectionLimit",
    "Delay",
    "DropAnswer",
    "DropRequest",
    "DuplicateAnswer",
    "EchoPart",
    "Exchange",
    "FaultyAnswer",
    "GarbageAnswer",
    "GarbageBefore",
    "HalfOpen",
    "LateAnswer",
    "Limits",
    "LongTailedDelay",
    "MergeAnswers",
    "RefuseConnections",
    "ReorderAnswers",
    "Replies",
    "Reply",
    "ResetConnection",
    "SplitAnswer",
    "StruckFault",
    "Target",
    "TruncateAnswer",
    "UniformDelay",
    "Verdict",
    "WireFault",
    "WireFaults",
    "WrongCount",
    "WrongEcho",
    "WrongFunction",
    "WrongTransactionId",
    "WrongUnit",
    "faulty",
]
