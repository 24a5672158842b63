"""Golden vectors of seer-lps3-two-stop, typed from elevator-interfaces 1.3.

Discrete 1 is the door fully open at floor 1, discrete 3 the same at floor 2; FC02 reads 1 to 3, so they are bits 0 and 2 of the
byte, and bit 1 belongs to nobody. Coils 17 (0011) and 19 (0013) call to floor 1 and 2, coil 18 (0012) says that the robot is in
place; all are levels, written by FC05.
"""

from drivers.model import Command, CommandKind, LiftValues, Proof
from register_maps.words import Door, Mode, Side
from tests.register_maps.golden.vectors import Does, Exchange, Golden, Says


def values(floor: str | None, door: Door, *, unknown: dict[str, int] | None = None) -> LiftValues:
    return LiftValues(floor=floor, mode=Mode.NORMAL, doors={Side.FRONT: door}, unknown=unknown or {})


NOWHERE = "00 00 00 04 01 02 01 00"
OPEN_AT_1 = "00 00 00 04 01 02 01 01"
OPEN_AT_2 = "00 00 00 04 01 02 01 04"

SAYS = (
    Says("open at floor 1", OPEN_AT_1, values("1", Door.OPEN)),
    Says("open at floor 2", OPEN_AT_2, values("2", Door.OPEN)),
    Says("neither: floor unknown and door closed", NOWHERE, values(None, Door.CLOSED)),
    # both floors are the raw value 3 of the two bits
    Says(
        "open at both floors at once",
        "00 00 00 04 01 02 01 05",
        values(None, Door.FAULT, unknown={"car_floor": 3}),
    ),
    Says("an input in between, which belongs to nobody", "00 00 00 04 01 02 01 02", values(None, Door.CLOSED)),
    Says("nothing but ones", "00 00 00 04 01 02 01 FF", values(None, Door.FAULT, unknown={"car_floor": 3})),
)

CALL_1 = "00 00 00 06 01 05 00 11 FF 00"
NO_CALL_1 = "00 00 00 06 01 05 00 11 00 00"
CALL_2 = "00 00 00 06 01 05 00 13 FF 00"
NO_CALL_2 = "00 00 00 06 01 05 00 13 00 00"
IN_PLACE = "00 00 00 06 01 05 00 12 FF 00"
NOT_IN_PLACE = "00 00 00 06 01 05 00 12 00 00"
# FC01 over 17 to 19: bit 0 is the call to floor 1, bit 1 in place, bit 2 the call to floor 2
READ_CALLS = "00 00 00 06 01 01 00 11 00 03"
READ_IN_PLACE = "00 00 00 06 01 01 00 12 00 01"
OFF = "00 00 00 04 01 01 01 00"
ON = "00 00 00 04 01 01 01 01"

DOES = (
    Does(
        "call the empty car to floor 2, by one output of its own",
        Command(CommandKind.CALL, "2"),
        NOWHERE,
        NOWHERE,
        Proof.READBACK,
        (
            Exchange(0.0, NO_CALL_1, NO_CALL_1),
            Exchange(0.0, CALL_2, CALL_2),
            Exchange(0.0, READ_CALLS, "00 00 00 04 01 01 01 04"),
            Exchange(2.0, READ_CALLS, "00 00 00 04 01 01 01 04"),
            Exchange(2.0, NO_CALL_1, NO_CALL_1),
            Exchange(2.0, CALL_2, CALL_2),
            Exchange(3.0, NO_CALL_1, NO_CALL_1),
            Exchange(3.0, NO_CALL_2, NO_CALL_2),
            Exchange(3.0, READ_CALLS, OFF),
        ),
        let_go_s=3.0,
        press=(NO_CALL_1, CALL_2),
    ),
    Does(
        "call it to floor 1",
        Command(CommandKind.CALL, "1"),
        NOWHERE,
        OPEN_AT_1,
        Proof.READBACK,
        (
            Exchange(0.0, NO_CALL_2, NO_CALL_2),
            Exchange(0.0, CALL_1, CALL_1),
            Exchange(0.0, READ_CALLS, ON),
            Exchange(1.0, NO_CALL_1, NO_CALL_1),
            Exchange(1.0, NO_CALL_2, NO_CALL_2),
            Exchange(1.0, READ_CALLS, OFF),
        ),
        let_go_s=1.0,
        press=(NO_CALL_2, CALL_1),
    ),
    # It is a level there: on as long as the car is occupied.
    Does(
        "the robot is in place, until it has left",
        Command(CommandKind.ROBOT_IN_PLACE),
        OPEN_AT_1,
        NOWHERE,
        None,
        (
            Exchange(0.0, IN_PLACE, IN_PLACE),
            Exchange(0.0, READ_IN_PLACE, ON),
            Exchange(2.0, READ_IN_PLACE, ON),
            Exchange(2.0, IN_PLACE, IN_PLACE),
            Exchange(3.0, NOT_IN_PLACE, NOT_IN_PLACE),
            Exchange(3.0, READ_IN_PLACE, OFF),
        ),
        let_go_s=3.0,
    ),
    Does(
        "the robot is in place, which ends the call",
        Command(CommandKind.ROBOT_IN_PLACE),
        OPEN_AT_1,
        NOWHERE,
        None,
        (
            Exchange(0.0, NO_CALL_1, NO_CALL_1),
            Exchange(0.0, NO_CALL_2, NO_CALL_2),
            Exchange(0.0, READ_CALLS, OFF),
            Exchange(0.0, IN_PLACE, IN_PLACE),
            Exchange(0.0, READ_IN_PLACE, ON),
            Exchange(1.0, NOT_IN_PLACE, NOT_IN_PLACE),
            Exchange(1.0, READ_IN_PLACE, OFF),
        ),
        let_go_s=1.0,
        before=Command(CommandKind.CALL, "1"),
        before_by=((NO_CALL_2, NO_CALL_2), (CALL_1, CALL_1), (READ_CALLS, ON)),
        gives_way=True,
    ),
)

SEER_LPS3_TWO_STOP = Golden(
    map_name="seer-lps3-two-stop",
    floors={"1": 0, "2": 1},
    poll="00 00 00 06 01 02 00 01 00 03",
    takes_over=((READ_CALLS, OFF), (READ_IN_PLACE, OFF)),
    says=SAYS,
    does=DOES,
)
