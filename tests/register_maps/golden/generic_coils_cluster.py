"""Golden vectors of generic-coils-cluster, typed from its YAML file as a person reads it.

Seventy discrete inputs from 0, so nine bytes, the first input in the lowest bit of the first byte. Bytes 1 to 3 are those of
generic-coils. Then

    byte 4  as there up to 20, and 40, 80: the two lowest bits of the epoch that was obeyed
    byte 5, 6, 7  the epoch from its bit 2, 10, 18 on
    byte 8  1 to 20: the rest of the epoch; 40, 80: the two lowest bits of its owner
    byte 9  the rest of the owner

Fifty-one coils from 0 take everything, so FC15 with seven bytes:

    byte 1  the calls
    byte 2  1 hold door, 2 close door, 4 robot mode; from 8 on the owner
    byte 3  1, 2, 4: the rest of the owner; from 8 on the epoch, which goes on in bytes 4 to 7

Epoch 37 is 100101: 40 in byte 4 and 09 in byte 5 of the inputs, 28 in byte 3 and 01 in byte 4 of the coils. The driver here has no
cluster, and the controller has obeyed nobody yet: so it claims epoch 1 of machine 0, which is 08 in byte 3. Machine 2 is 80 in byte 8 of
the inputs, and 10 in byte 2 of the coils.
"""

from drivers.model import Command, CommandKind, Proof
from register_maps.words import Door, Mode, Motion, Side
from tests.register_maps.golden.generic_coils import values
from tests.register_maps.golden.vectors import Does, Exchange, Face, Golden, Says

SAYS = (
    Says(
        "idle in the basement, code 0; nobody obeyed yet",
        "00 00 00 0C 01 02 09 01 00 06 3F 00 00 00 00 00",
        values("B1", Motion.STOPPED, Door.CLOSED, Mode.NORMAL, "level", "robots_allowed"),
    ),
    Says(
        "between floors on its way up to L2 for a robot, for machine 2",
        "00 00 00 0C 01 02 09 00 04 8A 7F 09 00 00 80 00",
        values(None, Motion.UP, Door.CLOSED, Mode.ROBOT, "robot_mode_on", "robots_allowed", accepted="L2"),
    ),
    Says(
        "nothing but zeros",
        "00 00 00 0C 01 02 09 00 00 00 00 00 00 00 00 00",
        values(
            None,
            Motion.STOPPED,
            Door.MOVING,
            Mode.INSPECTION,
            *("fire", "inspection", "independent", "out_of_service", "emergency_power"),
        ),
    ),
)

PEOPLE_AT_L1 = "00 00 00 0C 01 02 09 02 00 06 3F 00 00 00 00 00"
ROBOT_AT_L1 = "00 00 00 0C 01 02 09 02 00 86 3F 00 00 00 00 00"
ROBOT_AT_L1_OPEN = "00 00 00 0C 01 02 09 02 00 85 3F 00 00 00 00 00"
CALLED_TO_L2 = "00 00 00 0C 01 02 09 02 04 86 3F 00 00 00 00 00"

READ = "00 00 00 06 01 01 00 00 00 33"
READS_NOTHING = "00 00 00 0A 01 01 07 00 00 00 00 00 00 00"
READS_HOLD = "00 00 00 0A 01 01 07 00 01 00 00 00 00 00"
"""Owner and epoch were taken out."""

WRITTEN = "00 00 00 06 01 0F 00 00 00 33"
"""FC15 echoes address 0 and quantity 51."""
CALL_L2 = "00 00 00 0E 01 0F 00 00 00 33 07 04 00 08 00 00 00 00"
NOTHING = "00 00 00 0E 01 0F 00 00 00 33 07 00 00 08 00 00 00 00"
HOLD = "00 00 00 0E 01 0F 00 00 00 33 07 00 01 08 00 00 00 00"
CLOSE = "00 00 00 0E 01 0F 00 00 00 33 07 00 02 08 00 00 00 00"
MODE = "00 00 00 0E 01 0F 00 00 00 33 07 00 04 08 00 00 00 00"

DOES = (
    Does(
        "call L2, shown by the accepted call",
        Command(CommandKind.GO_TO, "L2"),
        ROBOT_AT_L1,
        CALLED_TO_L2,
        Proof.LAMP,
        (
            Exchange(0.0, CALL_L2, WRITTEN),
            Exchange(0.5, NOTHING, WRITTEN),
            Exchange(0.5, READ, READS_NOTHING),
        ),
    ),
    Does(
        "hold the door",
        Command(CommandKind.HOLD_DOOR, side=Side.FRONT),
        ROBOT_AT_L1_OPEN,
        ROBOT_AT_L1_OPEN,
        None,
        (
            Exchange(0.0, HOLD, WRITTEN),
            Exchange(0.0, READ, READS_HOLD),
            Exchange(1.0, READ, READS_HOLD),
            Exchange(1.0, HOLD, WRITTEN),
            Exchange(1.5, NOTHING, WRITTEN),
            Exchange(1.5, READ, READS_NOTHING),
        ),
        let_go_s=1.5,
    ),
    Does(
        "ask for robot mode",
        Command(CommandKind.ROBOT_MODE),
        PEOPLE_AT_L1,
        ROBOT_AT_L1,
        None,
        (
            Exchange(0.0, MODE, WRITTEN),
            Exchange(1.0, MODE, WRITTEN),
            Exchange(1.5, NOTHING, WRITTEN),
            Exchange(1.5, READ, READS_NOTHING),
        ),
        let_go_s=1.5,
    ),
    # a closed door ends the press: at the next poll, which is 0.1 s later
    Does(
        "press the close button",
        Command(CommandKind.CLOSE_DOOR, side=Side.FRONT),
        ROBOT_AT_L1_OPEN,
        ROBOT_AT_L1,
        Proof.EFFECT,
        (
            Exchange(0.0, CLOSE, WRITTEN),
            Exchange(0.1, NOTHING, WRITTEN),
            Exchange(0.1, READ, READS_NOTHING),
        ),
    ),
)

POLL = "00 00 00 06 01 02 00 00 00 46"
"""FC02 at 0, seventy inputs."""

MODE_OF_2 = "00 00 00 0E 01 0F 00 00 00 33 07 00 14 28 01 00 00 00"

# Times as in generic-coils. Machine 2 has epoch 37; machine 1 the one before, 36 = 100100, and the one after it, 38 = 100110, which
# are 20 and 30 in byte 3 of the coils.
FACE = (
    Face(
        0.0,
        "idle in the basement, in service for people, and nobody obeyed yet",
        POLL,
        "00 00 00 0C 01 02 09 01 00 06 3F 00 00 00 00 00",
    ),
    Face(0.0, "robot mode is asked for by machine 2", MODE_OF_2, WRITTEN),
    Face(
        1.0,
        "and granted; its epoch and its number are shown",
        POLL,
        "00 00 00 0C 01 02 09 01 00 86 7F 09 00 00 80 00",
    ),
    Face(1.0, "L1 is called", "00 00 00 0E 01 0F 00 00 00 33 07 02 14 28 01 00 00 00", WRITTEN),
    Face(1.5, "the call is let go", MODE_OF_2, WRITTEN),
    Face(
        2.0,
        "what machine 1 wrote in the epoch before arrives late, and would end it all",
        "00 00 00 0E 01 0F 00 00 00 33 07 00 08 20 01 00 00 00",
        WRITTEN,
    ),
    Face(
        2.5,
        "it goes up in robot mode, out of the door zone, for machine 2",
        POLL,
        "00 00 00 0C 01 02 09 00 02 8A 7F 09 00 00 80 00",
    ),
    Face(
        7.0,
        "at L1, level; the door moves and the call is served",
        POLL,
        "00 00 00 0C 01 02 09 02 00 84 7F 09 00 00 80 00",
    ),
    Face(
        7.0,
        "machine 1 takes over in the next epoch, and holds the door",
        "00 00 00 0E 01 0F 00 00 00 33 07 00 0D 30 01 00 00 00",
        WRITTEN,
    ),
    Face(
        7.5,
        "machine 2 claims the same epoch, and wants nothing",
        "00 00 00 0E 01 0F 00 00 00 33 07 00 10 30 01 00 00 00",
        WRITTEN,
    ),
    Face(
        8.0,
        "somebody without an epoch lets the door go",
        "00 00 00 06 01 05 00 08 00 00",
        "00 00 00 06 01 05 00 08 00 00",
    ),
    Face(
        14.9,
        "open; the hold outlasts silence up to 8 s",
        POLL,
        "00 00 00 0C 01 02 09 02 00 85 BF 09 00 00 40 00",
    ),
    Face(
        16.0,
        "after 8 s without a write that it obeys robot mode and hold have fallen; the dwell begins",
        POLL,
        "00 00 00 0C 01 02 09 02 00 05 BF 09 00 00 40 00",
    ),
    Face(
        16.0,
        "the outputs still say what was obeyed, without owner and epoch",
        READ,
        "00 00 00 0A 01 01 07 00 05 00 00 00 00 00",
    ),
    # What it does not serve.
    Face(16.0, "a seventy-first input: exception 02", "00 00 00 06 01 02 00 00 00 47", "00 00 00 03 01 82 02"),
    Face(16.0, "a fifty-second coil", "00 00 00 06 01 05 00 33 FF 00", "00 00 00 03 01 85 02"),
    Face(16.0, "it has no holding registers: exception 01", "00 00 00 06 01 03 00 00 00 01", "00 00 00 03 01 83 01"),
)

GENERIC_COILS_CLUSTER = Golden(
    map_name="generic-coils-cluster",
    floors={"B1": 0, "L1": 1, "L2": 2},
    poll=POLL,
    takes_over=((READ, READS_NOTHING),),
    says=SAYS,
    does=DOES,
    key="normal",
    face=FACE,
)
