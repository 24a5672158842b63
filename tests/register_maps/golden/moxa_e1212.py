"""Golden vectors of moxa-e1212, typed from the vendor's table: inputs at discrete 0 and up, outputs at coils 0 to 7.

As the template is wired: input 0 door fully open (1 in the byte), 1 door fully closed (2), 2 car at the lower stop (4), 3 car at
the upper stop (8), 4 on while there is no fire (10). Outputs 0 and 1 call the stops, output 2 holds the door; each by FC05.
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


CLOSED_AT_L1 = "00 00 00 04 01 02 01 16"
OPEN_AT_L1 = "00 00 00 04 01 02 01 15"
CLOSED_AT_L2 = "00 00 00 04 01 02 01 1A"

SAYS = (
    Says("closed at L1", CLOSED_AT_L1, values("L1", Door.CLOSED)),
    Says("open at L1", OPEN_AT_L1, values("L1", Door.OPEN)),
    Says("the door moves at L1", "00 00 00 04 01 02 01 14", values("L1", Door.MOVING)),
    Says("closed at L2", CLOSED_AT_L2, values("L2", Door.CLOSED)),
    Says("between the stops", "00 00 00 04 01 02 01 12", values(None, Door.CLOSED)),
    Says("fire at L1, or a cut wire", "00 00 00 04 01 02 01 05", values("L1", Door.OPEN, fire=True)),
    Says("both door limits", "00 00 00 04 01 02 01 17", values("L1", Door.FAULT)),
    Says("nothing but zeros: fire", "00 00 00 04 01 02 01 00", values(None, Door.MOVING, fire=True)),
    Says("nothing but ones", "00 00 00 04 01 02 01 FF", values(None, Door.FAULT, unknown={"car_floor": 3})),
)

CALL_L2 = "00 00 00 06 01 05 00 01 FF 00"
NO_CALL_L1 = "00 00 00 06 01 05 00 00 00 00"
NO_CALL_L2 = "00 00 00 06 01 05 00 01 00 00"
READ_CALLS = "00 00 00 06 01 01 00 00 00 02"
HOLD = "00 00 00 06 01 05 00 02 FF 00"
NO_HOLD = "00 00 00 06 01 05 00 02 00 00"
READ_HOLD = "00 00 00 06 01 01 00 02 00 01"
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

POLL = "00 00 00 06 01 02 00 00 00 05"

FACE = (
    # 3.2 m at 1 m/s take 5 s, the door opens in 2 s, stays for 3 s, closes in 2.5 s.
    Face(0.0, "closed at L1, no fire", POLL, CLOSED_AT_L1),
    Face(1.0, "the button of L2 is pressed", CALL_L2, CALL_L2),
    Face(1.0, "and reads back", READ_CALLS, "00 00 00 04 01 01 01 02"),
    Face(1.5, "and let go", NO_CALL_L2, NO_CALL_L2),
    Face(3.0, "two seconds after the press it is between the stops", POLL, "00 00 00 04 01 02 01 12"),
    Face(7.0, "then at L2, where the door moves", POLL, "00 00 00 04 01 02 01 18"),
    Face(9.5, "then open", POLL, "00 00 00 04 01 02 01 19"),
    Face(9.5, "hold the door", HOLD, HOLD),
    Face(60.0, "an output that nobody writes keeps its state", POLL, "00 00 00 04 01 02 01 19"),
    Face(60.0, "the output is still on", READ_HOLD, ON),
    Face(60.0, "let go", NO_HOLD, NO_HOLD),
    Face(64.0, "the door closes", POLL, "00 00 00 04 01 02 01 18"),
    Face(66.0, "closed", POLL, CLOSED_AT_L2),
    Face(66.0, "a ninth input is not served", "00 00 00 06 01 02 00 00 00 09", "00 00 00 03 01 82 02"),
)

MOXA_E1212 = Golden(
    map_name="moxa-e1212",
    floors={"L1": 0, "L2": 1},
    poll=POLL,
    takes_over=((READ_CALLS, OFF), (READ_HOLD, OFF)),
    says=SAYS,
    does=DOES,
    face=FACE,
)
