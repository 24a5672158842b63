"""Golden vectors of wago-750, typed from the vendor's tables.

Inputs are discrete 0 and up: door fully open (1), door fully closed (2), car at the lower stop (4), at the upper stop (8), on while
there is no fire (10). Registers 1000 to 1006 are the watchdog: its time in 100 ms first, its state last (0 off, 1 running, 2 run
out). Outputs are written at coil 0 and up and read back 0200 higher: 0 and 1 call the stops, 2 holds the door.
"""

from drivers.model import Command, CommandKind, LiftValues, Proof
from register_maps.words import Door, Mode, Side
from tests.register_maps.golden.vectors import Does, Exchange, Face, Golden, Says


def values(
    floor: str | None,
    door: Door,
    *,
    watchdog_s: float = 0.0,
    tripped: bool = False,
    fire: bool = False,
    unknown: dict[str, int] | None = None,
) -> LiftValues:
    return LiftValues(
        floor=floor,
        mode=Mode.FIRE if fire else Mode.NORMAL,
        doors={Side.FRONT: door},
        flags={"fire": fire, "watchdog_tripped": tripped},
        watchdog_s=watchdog_s,
        unknown=unknown or {},
    )


NO_WATCHDOG = "00 00 00 11 01 03 0E 00 00 00 00 00 00 00 00 FF FF 00 00 00 00"
CLOSED_AT_L1 = ("00 00 00 04 01 02 01 16", NO_WATCHDOG)
OPEN_AT_L1 = ("00 00 00 04 01 02 01 15", NO_WATCHDOG)
CLOSED_AT_L2 = ("00 00 00 04 01 02 01 1A", NO_WATCHDOG)

SAYS = (
    Says("closed at L1, no watchdog", CLOSED_AT_L1, values("L1", Door.CLOSED)),
    Says("open at L1", OPEN_AT_L1, values("L1", Door.OPEN)),
    Says("closed at L2", CLOSED_AT_L2, values("L2", Door.CLOSED)),
    # 30 x 100 ms, state 1
    Says(
        "a watchdog of 3 s is running",
        ("00 00 00 04 01 02 01 16", "00 00 00 11 01 03 0E 00 1E FF FF 00 00 00 05 00 1C 00 00 00 01"),
        values("L1", Door.CLOSED, watchdog_s=3.0),
    ),
    Says(
        "a watchdog of 3 s has run out",
        ("00 00 00 04 01 02 01 16", "00 00 00 11 01 03 0E 00 1E FF FF 00 00 00 05 00 00 00 00 00 02"),
        values("L1", Door.CLOSED, watchdog_s=3.0, tripped=True),
    ),
    Says(
        "fire at L1, or a cut wire",
        ("00 00 00 04 01 02 01 05", NO_WATCHDOG),
        values("L1", Door.OPEN, fire=True),
    ),
    Says(
        "nothing but zeros: fire",
        ("00 00 00 04 01 02 01 00", "00 00 00 11 01 03 0E 00 00 00 00 00 00 00 00 00 00 00 00 00 00"),
        values(None, Door.MOVING, fire=True),
    ),
    Says(
        "nothing but ones",
        ("00 00 00 04 01 02 01 FF", "00 00 00 11 01 03 0E FF FF FF FF FF FF FF FF FF FF FF FF FF FF"),
        values(None, Door.FAULT, watchdog_s=6553.5, tripped=True, unknown={"car_floor": 3}),
    ),
)

CALL_L2 = "00 00 00 06 01 05 00 01 FF 00"
NO_CALL_L1 = "00 00 00 06 01 05 00 00 00 00"
NO_CALL_L2 = "00 00 00 06 01 05 00 01 00 00"
READ_CALLS = "00 00 00 06 01 01 02 00 00 02"
HOLD = "00 00 00 06 01 05 00 02 FF 00"
NO_HOLD = "00 00 00 06 01 05 00 02 00 00"
READ_HOLD = "00 00 00 06 01 01 02 02 00 01"
OFF = "00 00 00 04 01 01 01 00"
ON = "00 00 00 04 01 01 01 01"

DOES = (
    Does(
        "press the button of L2: written at 1, read back at 0201",
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
        "hold the door: written at 2, read back at 0202",
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

READ_INPUTS = "00 00 00 06 01 02 00 00 00 05"

FACE = (
    Face(0.0, "closed at L1, no fire", READ_INPUTS, CLOSED_AT_L1[0]),
    Face(1.0, "the button of L2 is pressed", CALL_L2, CALL_L2),
    Face(1.5, "and let go", NO_CALL_L2, NO_CALL_L2),
    Face(3.0, "two seconds after the press it is between the stops", READ_INPUTS, "00 00 00 04 01 02 01 12"),
    Face(9.5, "then open at L2", READ_INPUTS, "00 00 00 04 01 02 01 19"),
    Face(9.5, "hold the door", HOLD, HOLD),
    Face(60.0, "an output that nobody writes keeps its state", READ_INPUTS, "00 00 00 04 01 02 01 19"),
    Face(60.0, "let go", NO_HOLD, NO_HOLD),
    Face(66.0, "closed", READ_INPUTS, CLOSED_AT_L2[0]),
)

WAGO_750 = Golden(
    map_name="wago-750",
    floors={"L1": 0, "L2": 1},
    poll=(READ_INPUTS, "00 00 00 06 01 03 10 00 00 07"),
    takes_over=((READ_CALLS, OFF), (READ_HOLD, OFF)),
    says=SAYS,
    does=DOES,
    face=FACE,
)
