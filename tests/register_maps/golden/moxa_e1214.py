"""Golden vectors of moxa-e1214, typed from the vendor's table: six inputs at discrete 0 to 5, six relays at coils 0 to 5.

The site has wired it in its own way: input 0 door fully closed (1 in the byte), 1 door fully open (2), 3 car at the lower stop
(8), 4 car at the upper stop (10), 5 on while there is no fire (20). Relays 2 and 3 call the stops, relay 5 holds the door; each by FC05.
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


CLOSED_AT_L1 = "00 00 00 04 01 02 01 29"
OPEN_AT_L2 = "00 00 00 04 01 02 01 32"

SAYS = (
    Says("closed at L1", CLOSED_AT_L1, values("L1", Door.CLOSED)),
    Says("open at L2", OPEN_AT_L2, values("L2", Door.OPEN)),
    Says("between the stops", "00 00 00 04 01 02 01 21", values(None, Door.CLOSED)),
    Says("fire at L2, or a cut wire", "00 00 00 04 01 02 01 12", values("L2", Door.OPEN, fire=True)),
    Says("an input that nobody uses", "00 00 00 04 01 02 01 2D", values("L1", Door.CLOSED)),
    Says("both door limits", "00 00 00 04 01 02 01 2B", values("L1", Door.FAULT)),
    Says("nothing but zeros: fire", "00 00 00 04 01 02 01 00", values(None, Door.MOVING, fire=True)),
    Says("nothing but ones", "00 00 00 04 01 02 01 FF", values(None, Door.FAULT, unknown={"car_floor": 3})),
)

CALL_L1 = "00 00 00 06 01 05 00 02 FF 00"
NO_CALL_L1 = "00 00 00 06 01 05 00 02 00 00"
NO_CALL_L2 = "00 00 00 06 01 05 00 03 00 00"
READ_CALLS = "00 00 00 06 01 01 00 02 00 02"
HOLD = "00 00 00 06 01 05 00 05 FF 00"
NO_HOLD = "00 00 00 06 01 05 00 05 00 00"
READ_HOLD = "00 00 00 06 01 01 00 05 00 01"
OFF = "00 00 00 04 01 01 01 00"
ON = "00 00 00 04 01 01 01 01"

DOES = (
    Does(
        "press the button of L1",
        Command(CommandKind.GO_TO, "L1"),
        OPEN_AT_L2,
        CLOSED_AT_L1,
        Proof.EFFECT,
        (
            Exchange(0.0, NO_CALL_L2, NO_CALL_L2),
            Exchange(0.0, CALL_L1, CALL_L1),
            Exchange(0.5, NO_CALL_L1, NO_CALL_L1),
            Exchange(0.5, NO_CALL_L2, NO_CALL_L2),
            Exchange(0.5, READ_CALLS, OFF),
        ),
        press=(NO_CALL_L2, CALL_L1),
    ),
    Does(
        "hold the door-open button, written again every 2 s",
        Command(CommandKind.HOLD_DOOR, side=Side.FRONT),
        OPEN_AT_L2,
        OPEN_AT_L2,
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

POLL = "00 00 00 06 01 02 00 00 00 06"
CALL_L2 = "00 00 00 06 01 05 00 03 FF 00"

FACE = (
    Face(0.0, "closed at L1, no fire", POLL, CLOSED_AT_L1),
    Face(1.0, "the button of L2 is pressed", CALL_L2, CALL_L2),
    Face(1.5, "and let go", NO_CALL_L2, NO_CALL_L2),
    Face(3.0, "two seconds after the press it is between the stops", POLL, "00 00 00 04 01 02 01 21"),
    Face(9.5, "then open at L2", POLL, OPEN_AT_L2),
    Face(9.5, "hold the door", HOLD, HOLD),
    Face(60.0, "a relay that nobody writes keeps its state", POLL, OPEN_AT_L2),
    Face(60.0, "let go", NO_HOLD, NO_HOLD),
    Face(66.0, "closed", POLL, "00 00 00 04 01 02 01 31"),
    Face(66.0, "a seventh input is not served", "00 00 00 06 01 02 00 00 00 07", "00 00 00 03 01 82 02"),
)

MOXA_E1214 = Golden(
    map_name="moxa-e1214",
    floors={"L1": 0, "L2": 1},
    parameters={
        "door_is_open": 1,
        "door_is_closed": 0,
        "first_floor": 3,
        "fire_contact": 5,
        "first_call": 2,
        "door_open": 5,
    },
    poll=POLL,
    takes_over=((READ_CALLS, OFF), (READ_HOLD, OFF)),
    says=SAYS,
    does=DOES,
    face=FACE,
)
