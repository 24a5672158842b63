"""Golden vectors of thingweb-elevator, typed from the demo's server code (elevator-interfaces 1.11).

40001 is 9C41 on the wire and 10001 is 2711: FC02 reads one input there, FC03 two registers. A client that writes floor 12 leaves
0 and 12 in them. Writing the second register (9C42) is what sets the demo off; nothing is written back, and nothing read back.
"""

from drivers.model import Command, CommandKind, LiftValues, Proof
from register_maps.words import Mode, Motion
from tests.register_maps.golden.vectors import Does, Exchange, Golden, Says


def values(floor: str | None, motion: Motion, *, unknown: dict[str, int] | None = None) -> LiftValues:
    return LiftValues(floor=floor, motion=motion, mode=Mode.NORMAL, unknown=unknown or {})


AT_0 = ("00 00 00 04 01 02 01 00", "00 00 00 07 01 03 04 00 00 00 00")
ON_THE_MOVE_12 = ("00 00 00 04 01 02 01 01", "00 00 00 07 01 03 04 00 00 00 0C")
AT_12 = ("00 00 00 04 01 02 01 00", "00 00 00 07 01 03 04 00 00 00 0C")

SAYS = (
    # the demo starts with zeros, and 0 is its lowest floor
    Says("as it starts, all zeros: at floor 0", AT_0, values("0", Motion.STOPPED)),
    Says("on the move; the number is that of the order, and no floor", ON_THE_MOVE_12, values(None, Motion.MOVING)),
    Says("at floor 12", AT_12, values("12", Motion.STOPPED)),
    Says(
        "at floor 15",
        ("00 00 00 04 01 02 01 00", "00 00 00 07 01 03 04 00 00 00 0F"),
        values("15", Motion.STOPPED),
    ),
    # 0 and 16; 1 and 0 would be the sum 1, and are 65536 here
    Says(
        "floor 16, which it does not have",
        ("00 00 00 04 01 02 01 00", "00 00 00 07 01 03 04 00 00 00 10"),
        values(None, Motion.STOPPED, unknown={"car_floor": 16}),
    ),
    Says(
        "something in the first register",
        ("00 00 00 04 01 02 01 00", "00 00 00 07 01 03 04 00 01 00 00"),
        values(None, Motion.STOPPED, unknown={"car_floor": 65536}),
    ),
    Says(
        "nothing but ones",
        ("00 00 00 04 01 02 01 FF", "00 00 00 07 01 03 04 FF FF FF FF"),
        values(None, Motion.MOVING, unknown={"car_floor": 4294967295}),
    ),
)

GO_12 = "00 00 00 06 01 06 9C 42 00 0C"
GO_0 = "00 00 00 06 01 06 9C 42 00 00"

DOES = (
    Does(
        "go to floor 12: one write",
        Command(CommandKind.GO_TO, "12"),
        AT_0,
        AT_12,
        Proof.EFFECT,
        (Exchange(0.0, GO_12, GO_12),),
        lasts_s=5.0,
    ),
    Does(
        "go to floor 0, which is no release here",
        Command(CommandKind.GO_TO, "0"),
        AT_12,
        AT_0,
        Proof.EFFECT,
        (Exchange(0.0, GO_0, GO_0),),
        lasts_s=5.0,
    ),
    # six seconds after the write before, which was a second ago
    Does(
        "go to floor 0, when it has come to rest from going to 12",
        Command(CommandKind.GO_TO, "0"),
        AT_12,
        AT_0,
        Proof.EFFECT,
        (Exchange(5.0, GO_0, GO_0),),
        lasts_s=5.0,
        before=Command(CommandKind.GO_TO, "12"),
        before_s=1.0,
        before_by=((GO_12, GO_12),),
        gives_way=True,
    ),
)

THINGWEB_ELEVATOR = Golden(
    map_name="thingweb-elevator",
    floors={"0": 0, "12": 12, "15": 15},
    poll=("00 00 00 06 01 02 27 11 00 01", "00 00 00 06 01 03 9C 41 00 02"),
    takes_over=(),
    says=SAYS,
    does=DOES,
)
