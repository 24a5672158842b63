"""Golden vectors of adam-io, typed from the vendor's tables, which count from 1.

Inputs are coils 00001 and up, so FC01 from 0: door fully open (1 in the byte), door fully closed (2), car at the lower stop (4), at
the upper stop (8), on while there is no fire (10). Outputs are coils 00017 and up: 00017 and 00018 (0010 and 0011) call the
stops, 00019 (0012) holds the door; each by FC05.
"""

from drivers.model import Command, CommandKind, LiftValues, Proof
from register_maps.words import Door, Mode, Side
from tests.register_maps.golden.vectors import Does, Exchange, Face, Golden, Says


def values(floor: str | None, door: Door, *, fire: bool = False, unknown: dict[str, int] | None = None) -> LiftValues:
    return LiftValues(
        floor=floor,
        mode=Mode.FIRE if fire else Mode.NORMAL,
        doors={Side.FRONT: door},
        flags={"fire": fire},
        unknown=unknown or {},
    )


CLOSED_AT_L1 = "00 00 00 04 01 01 01 16"
OPEN_AT_L1 = "00 00 00 04 01 01 01 15"
CLOSED_AT_L2 = "00 00 00 04 01 01 01 1A"

SAYS = (
    Says("closed at L1", CLOSED_AT_L1, values("L1", Door.CLOSED)),
    Says("open at L1", OPEN_AT_L1, values("L1", Door.OPEN)),
    Says("closed at L2", CLOSED_AT_L2, values("L2", Door.CLOSED)),
    Says("between the stops", "00 00 00 04 01 01 01 12", values(None, Door.CLOSED)),
    Says("fire at L1, or a cut wire", "00 00 00 04 01 01 01 05", values("L1", Door.OPEN, fire=True)),
    Says("both door limits", "00 00 00 04 01 01 01 17", values("L1", Door.FAULT)),
    Says("nothing but zeros: fire", "00 00 00 04 01 01 01 00", values(None, Door.MOVING, fire=True)),
    Says("nothing but ones", "00 00 00 04 01 01 01 FF", values(None, Door.FAULT, unknown={"car_floor": 3})),
)

CALL_L2 = "00 00 00 06 01 05 00 11 FF 00"
NO_CALL_L1 = "00 00 00 06 01 05 00 10 00 00"
NO_CALL_L2 = "00 00 00 06 01 05 00 11 00 00"
READ_CALLS = "00 00 00 06 01 01 00 10 00 02"
HOLD = "00 00 00 06 01 05 00 12 FF 00"
NO_HOLD = "00 00 00 06 01 05 00 12 00 00"
READ_HOLD = "00 00 00 06 01 01 00 12 00 01"
OFF = "00 00 00 04 01 01 01 00"
ON = "00 00 00 04 01 01 01 01"

DOES = (
    Does(
        "press the button of L2",
        Command(CommandKind.GO_TO, "L2"),
        CLOSED_AT_L1,
        CLOSED_AT_L2,
        Proof.EFFECT,
        (
            Exchange(0.0, NO_CALL_L1, NO_CALL_L1),
            Exchange(0.0, CALL_L2, CALL_L2),
            Exchange(0.5, NO_CALL_L1, NO_CALL_L1),
            Exchange(0.5, NO_CALL_L2, NO_CALL_L2),
            Exchange(0.5, READ_CALLS, OFF),
        ),
        press=(NO_CALL_L1, CALL_L2),
    ),
    Does(
        "hold the door-open button, written again every 2 s",
        Command(CommandKind.HOLD_DOOR, side=Side.FRONT),
        OPEN_AT_L1,
        OPEN_AT_L1,
        None,
        (
            Exchange(0.0, HOLD, HOLD),
            Exchange(0.0, READ_HOLD, ON),
            Exchange(2.0, READ_HOLD, ON),
            Exchange(2.0, HOLD, HOLD),
            Exchange(3.0, NO_HOLD, NO_HOLD),
            Exchange(3.0, READ_HOLD, OFF),
        ),
        let_go_s=3.0,
    ),
)

POLL = "00 00 00 06 01 01 00 00 00 05"

FACE = (
    Face(0.0, "closed at L1, no fire", POLL, CLOSED_AT_L1),
    Face(1.0, "the button of L2 is pressed", CALL_L2, CALL_L2),
    Face(1.5, "and let go", NO_CALL_L2, NO_CALL_L2),
    Face(3.0, "two seconds after the press it is between the stops", POLL, "00 00 00 04 01 01 01 12"),
    Face(9.5, "then open at L2", POLL, "00 00 00 04 01 01 01 19"),
    Face(9.5, "hold the door", HOLD, HOLD),
    Face(60.0, "an output that nobody writes keeps its state", POLL, "00 00 00 04 01 01 01 19"),
    Face(60.0, "let go", NO_HOLD, NO_HOLD),
    Face(66.0, "closed", POLL, CLOSED_AT_L2),
    Face(66.0, "there is nothing between inputs and outputs", "00 00 00 06 01 01 00 06 00 01", "00 00 00 03 01 81 02"),
)

ADAM_IO = Golden(
    map_name="adam-io",
    floors={"L1": 0, "L2": 1},
    poll=POLL,
    takes_over=((READ_CALLS, OFF), (READ_HOLD, OFF)),
    says=SAYS,
    does=DOES,
    face=FACE,
)
