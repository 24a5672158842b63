"""Golden vectors of moxa-e1211, typed from the vendor's table: outputs at coils 0 to 15, watchdog alarm flag at coil 4144 (1030).

The site has wired the call buttons to outputs 4 and 5 and the door-open button to output 8. A second device, unit 2, has
four inputs: door fully open (1), door fully closed (2), car at the lower stop (4), car at the upper stop (8).
"""

from drivers.model import Command, CommandKind, LiftValues, Proof
from register_maps.words import Door, Mode, Side
from tests.register_maps.golden.vectors import Does, Exchange, Golden, Says


def values(
    floor: str | None, door: Door, *, tripped: bool = False, unknown: dict[str, int] | None = None
) -> LiftValues:
    return LiftValues(
        floor=floor,
        mode=Mode.NORMAL,
        doors={Side.FRONT: door},
        flags={"watchdog_tripped": tripped},
        unknown=unknown or {},
    )


QUIET = "00 00 00 04 01 01 01 00"
CLOSED_AT_L1 = (QUIET, "sensor: 00 00 00 04 02 02 01 06")
OPEN_AT_L1 = (QUIET, "sensor: 00 00 00 04 02 02 01 05")
CLOSED_AT_L2 = (QUIET, "sensor: 00 00 00 04 02 02 01 0A")

SAYS = (
    Says("closed at L1", CLOSED_AT_L1, values("L1", Door.CLOSED)),
    Says("open at L1", OPEN_AT_L1, values("L1", Door.OPEN)),
    Says("closed at L2", CLOSED_AT_L2, values("L2", Door.CLOSED)),
    Says(
        "the module's watchdog has tripped",
        ("00 00 00 04 01 01 01 01", "sensor: 00 00 00 04 02 02 01 06"),
        values("L1", Door.CLOSED, tripped=True),
    ),
    Says("nothing but zeros", (QUIET, "sensor: 00 00 00 04 02 02 01 00"), values(None, Door.MOVING)),
    Says(
        "nothing but ones",
        ("00 00 00 04 01 01 01 FF", "sensor: 00 00 00 04 02 02 01 FF"),
        values(None, Door.FAULT, tripped=True, unknown={"car_floor": 3}),
    ),
)

CALL_L2 = "00 00 00 06 01 05 00 05 FF 00"
NO_CALL_L1 = "00 00 00 06 01 05 00 04 00 00"
NO_CALL_L2 = "00 00 00 06 01 05 00 05 00 00"
READ_CALLS = "00 00 00 06 01 01 00 04 00 02"
HOLD = "00 00 00 06 01 05 00 08 FF 00"
NO_HOLD = "00 00 00 06 01 05 00 08 00 00"
READ_HOLD = "00 00 00 06 01 01 00 08 00 01"
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

MOXA_E1211 = Golden(
    map_name="moxa-e1211",
    floors={"L1": 0, "L2": 1},
    parameters={"first_call": 4, "door_open": 8},
    override={
        "endpoints": {"sensor": {"unit_id": 2, "served": {"discrete": [[0, 3]]}}},
        "signals": {
            "door.front": {"open_limit": "sensor/discrete:0", "closed_limit": "sensor/discrete:1"},
            "car_floor": {"one_of": ["sensor/discrete:2", "sensor/discrete:3"]},
        },
    },
    poll=("00 00 00 06 01 01 10 30 00 01", "sensor: 00 00 00 06 02 02 00 00 00 04"),
    takes_over=((READ_CALLS, OFF), (READ_HOLD, OFF)),
    says=SAYS,
    does=DOES,
)
