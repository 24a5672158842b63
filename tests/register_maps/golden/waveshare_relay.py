"""Golden vectors of waveshare-relay, typed from elevator-interfaces 2.

FC05 at 0200 + relay with a number of 100 ms instead of FF00 closes that relay for so long: 0005 is half a second. Relays 0 and
1 call the stops, relay 2 (coil 2) holds the door. A second device, unit 2, has four inputs: door fully open (1), door fully closed (2), car
at the lower stop (4), car at the upper stop (8). The door relay is read along: nothing else of the module would show that it is alive.
"""

from drivers.model import Command, CommandKind, LiftValues, Proof
from register_maps.words import Door, Mode, Side
from tests.register_maps.golden.vectors import Does, Exchange, Golden, Says


def values(floor: str | None, door: Door, *, unknown: dict[str, int] | None = None) -> LiftValues:
    return LiftValues(floor=floor, mode=Mode.NORMAL, doors={Side.FRONT: door}, unknown=unknown or {})


QUIET = "00 00 00 04 01 01 01 00"
CLOSED_AT_L1 = (QUIET, "sensor: 00 00 00 04 02 02 01 06")
OPEN_AT_L1 = (QUIET, "sensor: 00 00 00 04 02 02 01 05")
CLOSED_AT_L2 = (QUIET, "sensor: 00 00 00 04 02 02 01 0A")

SAYS = (
    Says("closed at L1", CLOSED_AT_L1, values("L1", Door.CLOSED)),
    Says("open at L1", OPEN_AT_L1, values("L1", Door.OPEN)),
    Says("closed at L2", CLOSED_AT_L2, values("L2", Door.CLOSED)),
    Says("both door limits", (QUIET, "sensor: 00 00 00 04 02 02 01 07"), values("L1", Door.FAULT)),
    Says("nothing but zeros", (QUIET, "sensor: 00 00 00 04 02 02 01 00"), values(None, Door.MOVING)),
    Says(
        "nothing but ones",
        (QUIET, "sensor: 00 00 00 04 02 02 01 FF"),
        values(None, Door.FAULT, unknown={"car_floor": 3}),
    ),
)

PULSE_L1 = "00 00 00 06 01 05 02 00 00 05"
PULSE_L2 = "00 00 00 06 01 05 02 01 00 05"
HOLD = "00 00 00 06 01 05 00 02 FF 00"
NO_HOLD = "00 00 00 06 01 05 00 02 00 00"
READ_HOLD = "00 00 00 06 01 01 00 02 00 01"
OFF = "00 00 00 04 01 01 01 00"
ON = "00 00 00 04 01 01 01 01"

DOES = (
    Does(
        "press the button of L2: one write, which the module ends",
        Command(CommandKind.GO_TO, "L2"),
        CLOSED_AT_L1,
        CLOSED_AT_L2,
        Proof.EFFECT,
        (Exchange(0.0, PULSE_L2, PULSE_L2),),
        lasts_s=0.5,
    ),
    Does(
        "press the button of L1",
        Command(CommandKind.GO_TO, "L1"),
        CLOSED_AT_L2,
        CLOSED_AT_L1,
        Proof.EFFECT,
        (Exchange(0.0, PULSE_L1, PULSE_L1),),
        lasts_s=0.5,
    ),
    Does(
        "hold the door-open button",
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

WAVESHARE_RELAY = Golden(
    map_name="waveshare-relay",
    floors={"L1": 0, "L2": 1},
    override={
        "endpoints": {"sensor": {"unit_id": 2, "served": {"discrete": [[0, 3]]}}},
        "signals": {
            "door.front": {"open_limit": "sensor/discrete:0", "closed_limit": "sensor/discrete:1"},
            "car_floor": {"one_of": ["sensor/discrete:2", "sensor/discrete:3"]},
        },
    },
    poll=(READ_HOLD, "sensor: 00 00 00 06 02 02 00 00 00 04"),
    takes_over=((READ_HOLD, OFF),),
    says=SAYS,
    does=DOES,
)
