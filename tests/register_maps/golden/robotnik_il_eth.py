"""Golden vectors of robotnik-il-eth, typed from elevator-interfaces 1.6.

Register 0: bits 0 to 2 the car at floor 0 to 2, bit 4 the door closed (0010). Outputs: 384 (0180) bits 0 to 2 call floor 0 to 2;
385 (0181) bit 0 opens the door and bit 3 takes control (0008). Each word is written whole by FC06.
"""

from drivers.model import Command, CommandKind, LiftValues, Proof
from register_maps.words import Door, Mode, Side
from tests.register_maps.golden.vectors import Does, Exchange, Face, Golden, Says


def values(floor: str | None, door: Door, *, unknown: dict[str, int] | None = None) -> LiftValues:
    return LiftValues(floor=floor, mode=Mode.NORMAL, doors={Side.FRONT: door}, unknown=unknown or {})


CLOSED_AT_0 = "00 00 00 05 01 03 02 00 11"
CLOSED_AT_2 = "00 00 00 05 01 03 02 00 14"
NOT_CLOSED_AT_0 = "00 00 00 05 01 03 02 00 01"

SAYS = (
    Says("closed at floor 0", CLOSED_AT_0, values("0", Door.CLOSED)),
    Says("closed at floor 1", "00 00 00 05 01 03 02 00 12", values("1", Door.CLOSED)),
    Says("closed at floor 2", CLOSED_AT_2, values("2", Door.CLOSED)),
    # there is no open contact: not closed may be anything
    Says("not closed at floor 0 is not yet open", NOT_CLOSED_AT_0, values("0", Door.MOVING)),
    Says("between floors", "00 00 00 05 01 03 02 00 10", values(None, Door.CLOSED)),
    Says(
        "at floors 0 and 1 at once",
        "00 00 00 05 01 03 02 00 13",
        values(None, Door.CLOSED, unknown={"car_floor": 3}),
    ),
    Says(
        "bit 3, presence in an older comment, belongs to nobody", "00 00 00 05 01 03 02 00 1A", values("1", Door.CLOSED)
    ),
    Says("nothing but zeros", "00 00 00 05 01 03 02 00 00", values(None, Door.MOVING)),
    Says("nothing but ones", "00 00 00 05 01 03 02 FF FF", values(None, Door.CLOSED, unknown={"car_floor": 7})),
)

CALL_2 = "00 00 00 06 01 06 01 80 00 04"
NO_CALL = "00 00 00 06 01 06 01 80 00 00"
READ_CALLS = "00 00 00 06 01 03 01 80 00 01"
OPEN = "00 00 00 06 01 06 01 81 00 01"
CONTROL = "00 00 00 06 01 06 01 81 00 08"
NOTHING = "00 00 00 06 01 06 01 81 00 00"
READ_OTHERS = "00 00 00 06 01 03 01 81 00 01"
READS_0 = "00 00 00 05 01 03 02 00 00"

DOES = (
    Does(
        "call floor 2",
        Command(CommandKind.GO_TO, "2"),
        CLOSED_AT_0,
        CLOSED_AT_2,
        Proof.EFFECT,
        (
            Exchange(0.0, CALL_2, CALL_2),
            Exchange(0.1, NO_CALL, NO_CALL),
            Exchange(0.1, READ_CALLS, READS_0),
        ),
    ),
    Does(
        "open the door and hold it",
        Command(CommandKind.HOLD_DOOR, side=Side.FRONT),
        NOT_CLOSED_AT_0,
        NOT_CLOSED_AT_0,
        None,
        (
            Exchange(0.0, OPEN, OPEN),
            Exchange(0.0, READ_OTHERS, "00 00 00 05 01 03 02 00 01"),
            Exchange(2.0, READ_OTHERS, "00 00 00 05 01 03 02 00 01"),
            Exchange(2.0, OPEN, OPEN),
            Exchange(3.0, NOTHING, NOTHING),
            Exchange(3.0, READ_OTHERS, READS_0),
        ),
        let_go_s=3.0,
    ),
    Does(
        "take control",
        Command(CommandKind.ROBOT_MODE),
        CLOSED_AT_0,
        CLOSED_AT_0,
        None,
        (
            Exchange(0.0, CONTROL, CONTROL),
            Exchange(0.0, READ_OTHERS, "00 00 00 05 01 03 02 00 08"),
            Exchange(2.0, READ_OTHERS, "00 00 00 05 01 03 02 00 08"),
            Exchange(2.0, CONTROL, CONTROL),
            Exchange(3.0, NOTHING, NOTHING),
            Exchange(3.0, READ_OTHERS, READS_0),
        ),
        let_go_s=3.0,
    ),
    # 0008 + 0001: the other output of the word stays as it is
    Does(
        "open the door while control is taken, in the same word",
        Command(CommandKind.HOLD_DOOR, side=Side.FRONT),
        NOT_CLOSED_AT_0,
        NOT_CLOSED_AT_0,
        None,
        (
            Exchange(0.0, "00 00 00 06 01 06 01 81 00 09", "00 00 00 06 01 06 01 81 00 09"),
            Exchange(0.0, READ_OTHERS, "00 00 00 05 01 03 02 00 09"),
            Exchange(0.4, CONTROL, CONTROL),
            Exchange(0.4, READ_OTHERS, "00 00 00 05 01 03 02 00 08"),
        ),
        let_go_s=0.4,
        before=Command(CommandKind.ROBOT_MODE),
        before_by=((CONTROL, CONTROL), (READ_OTHERS, "00 00 00 05 01 03 02 00 08")),
    ),
)

CONTROL_BY_4 = "00 00 00 06 01 06 01 80 00 08"
CALL_1_IN_CONTROL = "00 00 00 06 01 06 01 80 00 0A"

DOES_BY_OUTPUT_4 = (
    # 0008 + 0002
    Does(
        "call floor 1 while control is taken, in the same word",
        Command(CommandKind.GO_TO, "1"),
        CLOSED_AT_0,
        "00 00 00 05 01 03 02 00 12",
        Proof.EFFECT,
        (
            Exchange(0.0, CALL_1_IN_CONTROL, CALL_1_IN_CONTROL),
            Exchange(0.1, CONTROL_BY_4, CONTROL_BY_4),
            Exchange(0.1, READ_CALLS, "00 00 00 05 01 03 02 00 08"),
        ),
        before=Command(CommandKind.ROBOT_MODE),
        before_by=((CONTROL_BY_4, CONTROL_BY_4), (READ_CALLS, "00 00 00 05 01 03 02 00 08")),
    ),
)

POLL = "00 00 00 06 01 03 00 00 00 01"
CALL_1 = "00 00 00 06 01 06 01 80 00 02"

FACE = (
    # 3.2 m at 1 m/s take 5 s, the door opens in 2 s, stays for 3 s, closes in 2.5 s.
    Face(0.0, "closed at floor 0", POLL, CLOSED_AT_0),
    Face(1.0, "call floor 1", CALL_1, CALL_1),
    Face(1.1, "and clear the call", NO_CALL, NO_CALL),
    Face(3.0, "between floors", POLL, "00 00 00 05 01 03 02 00 10"),
    Face(9.5, "not closed at floor 1", POLL, "00 00 00 05 01 03 02 00 02"),
    Face(9.5, "hold the door", OPEN, OPEN),
    Face(9.5, "the word reads back", READ_OTHERS, "00 00 00 05 01 03 02 00 01"),
    Face(40.0, "it stays", POLL, "00 00 00 05 01 03 02 00 02"),
    Face(40.0, "let go", NOTHING, NOTHING),
    Face(46.0, "closed at floor 1", POLL, "00 00 00 05 01 03 02 00 12"),
)

ROBOTNIK_IL_ETH = Golden(
    map_name="robotnik-il-eth",
    floors={"0": 0, "1": 1, "2": 2},
    poll=POLL,
    takes_over=((READ_CALLS, READS_0), (READ_OTHERS, READS_0)),
    says=SAYS,
    does=DOES,
    face=FACE,
)

ROBOTNIK_IL_ETH_OUTPUT_4 = Golden(
    map_name="robotnik-il-eth",
    site="control by output 4",
    parameters={"control_output": "holding:384.3", "not_closed": "open"},
    floors={"0": 0, "1": 1, "2": 2},
    poll=POLL,
    takes_over=((READ_CALLS, READS_0), (READ_OTHERS, READS_0)),
    says=(
        Says("closed at floor 0", CLOSED_AT_0, values("0", Door.CLOSED)),
        Says("not closed counts as open where the site says so", NOT_CLOSED_AT_0, values("0", Door.OPEN)),
    ),
    does=DOES_BY_OUTPUT_4,
)
