"""Judges the points of one lift: whether what its map reads can be a lift at all, and what else it could be. Pure."""

from __future__ import annotations

import itertools
from collections.abc import Iterable, Iterator, Sequence

from drivers.errors import ILLEGAL_ADDRESS, ILLEGAL_FUNCTION
from lift_manager.commissioning.doctor import picture as pictured
from lift_manager.commissioning.doctor.evidence import Evidence, Probe, Purpose
from lift_manager.commissioning.doctor.finding import Finding, Severity
from lift_manager.commissioning.doctor.picture import AS_MAPPED, MOVING, Assumption, Misfit, Oddity, Picture, pictures
from lift_manager.commissioning.doctor.subjects import SIBLING, ExaminedLift
from lift_manager.commissioning.wording import FUNCTIONS, TABLE_NAMES
from register_maps.codec import UNLISTED, CommandCodec, Point
from register_maps.errors import EXCEPTION_NAMES
from register_maps.schema import Kind
from register_maps.signal_codec import swap_bytes
from register_maps.words import BIT_TABLES, READ_FUNCTION, Door, Motion, Table

MOST_NAMED = 4
"""Signals that one line names."""
MOST_LISTED = 8
"""Signals that did not change that are listed; of more only the number is given."""
LEAST_SIGNALS = 3
"""Fewer signals than this show no pattern. Chosen."""
DRIFT_STEPS = 5
"""Changes in one direction that are no noise. Chosen."""
LOW_WORD = 1 << 16
RIDE_S = 120
"""Long enough for a ride by hand through a building, for the advice."""


class LiftJudge:
    """Judges the points of one lift, as its map reads them."""

    def __init__(self, lift: ExaminedLift, evidence: Evidence) -> None:
        self._lift = lift
        self._evidence = evidence
        self._pictures = pictures(lift, evidence)
        self._misfits = pictured.misfits(lift, self._pictures)

    def findings(self) -> Iterator[Finding]:
        if (explained := self._explanation()) is not None:
            yield explained
            return
        yield from self._refused()
        if not self._pictures:
            yield from self._outputs()
            return
        if self._is_dead:
            yield self._all_zero()
            return
        if self._is_wrong_map:
            yield self._wrong_map()
            return
        yield from self._signals()
        yield from self._together()
        yield from self._outputs()
        yield from self._unchanged()

    def _finding(self, severity: Severity, code: str, signal: str, text: str, cure: str = "") -> Finding:
        return Finding(severity, code, self._lift.name, self._printed(signal), text, cure)

    def _printed(self, name: str) -> str:
        return f"{name} at {self._lift.printed(name)}" if name else ""

    # -- addresses that are not served

    def _refused(self) -> Iterator[Finding]:
        """Name the points that were answered with an exception, and blocks that only as a whole were."""
        lift = self._lift
        by_code: dict[tuple[str, Table, int], list[Point]] = {}
        for point, code in pictured.refused_points(lift, self._evidence):
            by_code.setdefault((point.endpoint, point.table, code), []).append(point)
        for (endpoint, table, code), points in by_code.items():
            of_table = {p.cell for p in lift.codec.signal_points if (p.endpoint, p.table) == (endpoint, table)}
            is_all = len({p.cell for p in points}) == len(of_table)
            if code == ILLEGAL_FUNCTION or (code == ILLEGAL_ADDRESS and is_all):
                function = READ_FUNCTION[table]
                name = EXCEPTION_NAMES.get(code, "")
                sibling = TABLE_NAMES[SIBLING[table]]
                yield Finding(
                    Severity.ERROR,
                    "table-refused",
                    lift.name,
                    lift.printed_cell(points[0]),
                    f"the controller refuses all {len(of_table)} {TABLE_NAMES[table]} of the map (function {function},"
                    f" {FUNCTIONS[function]}: exception {code:02X}, {name})",
                    f"Look up in the vendor's table whether they are {sibling}, and from which number it counts"
                    f"{self._try(Probe.TABLE, Probe.OFFSET)}",
                )
                continue
            for cell in dict.fromkeys(p.cell for p in points):
                point = next(p for p in points if p.cell == cell)
                yield Finding(
                    Severity.ERROR,
                    "refused-point",
                    lift.name,
                    lift.printed_cell(point),
                    f"the controller answers exception {code:02X} ({EXCEPTION_NAMES.get(code, 'not in the specification')})",
                    "Compare this address with the vendor's table; a signal that this controller does not have is left out of the map"
                    if code == ILLEGAL_ADDRESS
                    else "Ask the vendor what this answer means; the manager cannot use the point like this",
                )
        yield from self._refused_blocks()
        yield from self._refused_outputs()

    def _refused_blocks(self) -> Iterator[Finding]:
        lift = self._lift
        refused = {p.cell for p, _ in pictured.refused_points(lift, self._evidence)}
        for name, controller in self._evidence.controllers.items():
            for answer in controller.of(Purpose.POLL):
                block = next(
                    (
                        b
                        for b in lift.blocks
                        if (b.table, b.start, b.count) == (answer.table, answer.address, answer.count)
                        and lift.device(b).controller == name
                    ),
                    None,
                )
                if not answer.is_refusal or block is None or block.count == 1 or refused & set(block.cells):
                    continue
                yield Finding(
                    Severity.ERROR,
                    "refused-block",
                    lift.name,
                    f"{block.table} {block.start} to {block.start + block.count - 1} on the wire",
                    f"the controller answers each address, but not these {block.count} in one read (exception {answer.exception:02X})",
                    "Correct `served` of the map where there is a hole, or write a smaller "
                    f"`{'max_bits_per_read' if block.table in BIT_TABLES else 'max_registers_per_read'}` for this controller"
                    f"{self._try(Probe.BLOCK)}",
                )
                break

    def _refused_outputs(self) -> Iterator[Finding]:
        for name, controller in self._evidence.controllers.items():
            refused = next((a for a in controller.of(Purpose.OUTPUTS) if a.is_refusal), None)
            if refused is None:
                continue
            commands = [
                command.name
                for command in self._lift.own_outputs
                if any(
                    (point.table, self._lift.device(point).controller) == (refused.table, name)
                    and refused.address <= point.address < refused.address + refused.count
                    for point in command.read_points
                )
            ]
            if commands:
                yield Finding(
                    Severity.ERROR,
                    "refused-output",
                    self._lift.name,
                    self._printed(commands[0]),
                    f"the outputs {', '.join(commands)} cannot be read back (exception {refused.exception:02X}): the manager could not"
                    " verify that they are released",
                    "Compare these addresses with the vendor's table, and say in the map where they are read back (`read_at`)",
                )

    def _try(self, *probes: Probe) -> str:
        left = [probe for probe in probes if probe not in self._evidence.probes]
        return f"; {' '.join(f'`--probe {probe}`' for probe in left)} tries it" if left else ""

    # -- explanations of everything at once

    @property
    def _is_dead(self) -> bool:
        """Whether everything reads 0, and that is no state of rest: of a few contacts it may be."""
        cells = {point.cell for point in self._lift.codec.signal_points}
        return pictured.is_all_zero(self._pictures) and (bool(self._misfits) or len(cells) > LEAST_SIGNALS)

    def _all_zero(self) -> Finding:
        cells = {point.cell for point in self._lift.codec.signal_points}
        return Finding(
            Severity.ERROR,
            "all-zero",
            self._lift.name,
            "",
            f"all {len(cells)} addresses of the map read 0, all the time",
            "Look whether the controller's program runs, and whether unit id, table and first address are those of the vendor's table"
            f"{self._try(Probe.UNIT, Probe.TABLE, Probe.OFFSET)}",
        )

    def _explanation(self) -> Finding | None:
        """Return the one assumption under which the lift makes sense, if as mapped it does not."""
        if len(self._misfits) < 2 and self._pictures and not self._is_dead:
            return None
        candidates: list[tuple[float, Assumption]] = []
        for assumption, purposes in (
            (Assumption(offset=1), [Purpose.OFFSET]),
            (Assumption(offset=-1), [Purpose.OFFSET]),
            (Assumption(bytes_swapped=True), []),
            (Assumption(other_table=True), [Purpose.TABLE]),
        ):
            if (share := self._odd_share(assumption, purposes)) is not None:
                candidates.append((share, assumption))
        now = self._odd_share(AS_MAPPED, [])
        share, best = min(candidates, key=lambda candidate: candidate[0], default=(1.0, AS_MAPPED))
        return None if share > (1.0 if now is None else now) / 4 else self._explained(best)

    def _odd_share(self, assumption: Assumption, purposes: Sequence[Purpose]) -> float | None:
        """Return which part of the signals makes no sense under an assumption; None if too little was read to tell."""
        found = (
            self._pictures if assumption == AS_MAPPED else pictures(self._lift, self._evidence, assumption, purposes)
        )
        known = {name for picture in found for name in picture.raw}
        enough = max(min(LEAST_SIGNALS, len(self._lift.codec.signals)), 0.6 * len(self._lift.codec.signals))
        if len(known) < enough or pictured.is_all_zero(found):
            return None
        odd = {misfit.signal for misfit in pictured.misfits(self._lift, found)}
        return len(odd) / len(known)

    def _explained(self, best: Assumption) -> Finding:
        odd = self._odd_text()
        codec = self._lift.codec
        tables = sorted({point.table for point in codec.signal_points})
        written = {point.table for command in codec.commands.values() for point in command.points}
        name = self._lift.name
        if best.offset:
            direction = "higher" if best.offset > 0 else "lower"
            offset = ", ".join(
                f"{table}: {best.offset + self._lift.codec.offset.get(table, 0)}"
                for table in sorted({*tables, *written})
            )
            base = (self._lift.codec.map.addressing.base or 0) - best.offset
            in_map = (
                f"write `addressing: {{base: {base}}}` in the map"
                if base in (0, 1)
                else "correct the addresses in the map"
            )
            return Finding(
                Severity.ERROR,
                "off-by-one",
                name,
                "all addresses of the map",
                f"everything makes sense one address {direction}, and not where the map has it ({odd})",
                f"The vendor's table probably counts from another number: compare one address with it, then {in_map}, or write"
                f" `offset: {{{offset}}}` for the lift",
            )
        if best.other_table:
            others = " and ".join(f"{TABLE_NAMES[SIBLING[table]]} for {TABLE_NAMES[table]}" for table in tables)
            return Finding(
                Severity.ERROR,
                "wrong-table",
                name,
                "all addresses of the map",
                f"everything makes sense with {others}, and not as the map has it ({odd})",
                "Correct the table of each address in the map",
            )
        return Finding(
            Severity.ERROR,
            "bytes-swapped",
            name,
            "all registers of the map",
            f"everything makes sense with the two bytes of each register exchanged ({odd})",
            "Switch the byte order in the controller or the gateway, or write `byte_order` for each signal and command in the map",
        )

    def _odd_text(self) -> str:
        """Name some signals that make no sense, with what they read."""
        named = [
            f"{misfit.signal} at {self._lift.printed(misfit.signal)} {_reads(misfit)}"
            for misfit in self._misfits[:MOST_NAMED]
        ]
        more = len(self._misfits) - MOST_NAMED
        if not named:
            return "as mapped every address is refused or reads 0"
        return ", ".join(named) + (f" and {more} more" if more > 0 else "")

    @property
    def _is_wrong_map(self) -> bool:
        """Whether so little makes sense that these are not the registers of this lift."""
        senseless = [misfit for misfit in self._misfits if misfit.oddity is not Oddity.ASSERTED]
        known = {name for picture in self._pictures for name in picture.raw}
        return len(senseless) >= LEAST_SIGNALS and 2 * len(senseless) >= len(known)

    def _wrong_map(self) -> Finding:
        known = {name for picture in self._pictures for name in picture.raw}
        return Finding(
            Severity.ERROR,
            "wrong-map",
            self._lift.name,
            "",
            f"{len(self._misfits)} of {len(known)} signals make no sense ({self._odd_text()}): this is not the controller that the map"
            f" {self._lift.codec.map.name} describes, or its addresses start elsewhere",
            "Compare the model with the map's source (`lift-manager maps show`), and the first address with the vendor's table"
            f"{self._try(Probe.OFFSET, Probe.TABLE)}",
        )

    # -- signal by signal

    def _signals(self) -> Iterator[Finding]:
        for misfit in self._misfits:
            yield self._explain(misfit)
        for name in self._lift.codec.signals:
            if name.startswith("obstruction.") or name == "overload":
                yield from self._never_at_rest(name)
        yield from self._heartbeat_slow()
        yield from self._wide()

    def _explain(self, misfit: Misfit) -> Finding:
        match misfit.oddity:
            case Oddity.ASSERTED:
                return self._asserted(misfit)
            case Oddity.CONTRADICTION:
                return self._contradiction(misfit)
            case Oddity.STILL:
                return self._finding(
                    Severity.ERROR,
                    "heartbeat-still",
                    misfit.signal,
                    f"the alive counter stands at {misfit.raw}: the controller answers, but its program does not run, or it counts elsewhere",
                    "Start the program of the controller, or correct the address of `alive` in the map",
                )
            case Oddity.UNDER_WAY:
                return self._under_way(misfit.signal)
            case Oddity.BETWEEN:
                return self._finding(
                    Severity.WARNING,
                    "door-between",
                    misfit.signal,
                    f"the door is neither open nor shut, all the time ({self._span_s:.0f} s)",
                    "Look at the door; if it is shut, its closed contact is inverted (`active` in the map), not wired, or at another address",
                )
            case Oddity.RESTLESS:
                return self._finding(
                    Severity.ERROR,
                    "restless",
                    misfit.signal,
                    "the floor changes as that of no car does: this address holds something else, such as a counter or a clock",
                    f"Compare the address with the vendor's table{self._try(Probe.OFFSET)}",
                )
            case _:
                return self._unlisted(misfit)

    def _under_way(self, name: str) -> Finding:
        motion = f" ({self._printed('motion')})" if "motion" in self._lift.codec.signals else ""
        if name == "level":
            text, cure = (
                "the car is level while it moves",
                "this contact is inverted (`active` in the map) or another signal",
            )
        else:
            text = "the door is not shut while the car moves"
            cure = (
                "its contact is inverted (`active` in the map), its two limits are exchanged, or it is another signal"
            )
        return self._finding(
            Severity.ERROR,
            "open-under-way",
            name,
            f"{text}{motion}",
            f"Watch the lift: if it stands, correct the motion; otherwise {cure}",
        )

    def _unlisted(self, misfit: Misfit) -> Finding:
        """Explain a value that is in no table: bytes exchanged, a negative number, or nothing known."""
        lift, name, raw = self._lift, misfit.signal, misfit.raw
        signal, spec = lift.codec.signals[name], lift.codec.map.signals[name]
        is_word = signal.points[0].table not in BIT_TABLES and len(signal.points) == 1 and signal.width == 16
        swapped = swap_bytes(raw)
        if is_word and swapped != raw and self._is_known(name, swapped):
            high, low = (swapped, "0") if raw & 0xFF == 0 else (raw >> 8, str(raw & 0xFF))
            order = "high_first" if spec.byte_order == "low_first" else "low_first"
            return self._finding(
                Severity.ERROR,
                "bytes-swapped",
                name,
                f"reads {raw}, which is {high} x 256{f' + {low}' if low != '0' else ''}: with its two bytes exchanged it is {swapped},"
                f" {self._meaning(name, swapped)}",
                f"Write `byte_order: {order}` for this signal in the map, or switch the byte order in the controller",
            )
        negative = raw - 0x10000
        is_named = negative in lift.floors or (not lift.floors and negative >= pictured.LOWEST_FLOOR)
        if is_word and is_named and misfit.oddity is Oddity.NO_SUCH_FLOOR and spec.type == "uint16":
            return self._finding(
                Severity.ERROR,
                "negative-floor",
                name,
                f"reads {raw}, which is {negative} as a signed number{self._named(negative)}",
                "Write `type: int16` for this signal in the map, and for the commands that carry a floor",
            )
        if misfit.oddity is Oddity.NO_SUCH_FLOOR:
            value = self._last(name).values[name]
            floors = ", ".join(f"{floor} = {code}" for code, floor in lift.floors.items()) or "codes from -9 to 99"
            return self._finding(
                Severity.ERROR,
                "no-such-floor",
                name,
                f"reads floor code {value}, and the site has {floors}",
                "Look at which floor the car stands and give that floor this code; if every code is off by the same number, shift them all",
            )
        known = ", ".join(f"{code} = {word}" for code, word in (spec.values or {}).items())
        table = f"; its table has {known}" if known else ""
        often = "" if misfit.is_constant else " at times"
        return self._finding(
            Severity.ERROR,
            "unlisted",
            name,
            f"reads {raw}{often}, which the map does not list{table}",
            "Look at what the lift does right now, and compare address and values with the vendor's table",
        )

    def _is_known(self, name: str, raw: int) -> bool:
        """Whether a raw number would mean something for a signal."""
        signal = self._lift.codec.signals[name]
        value = signal.decode(raw)
        if value is UNLISTED or (signal.kind is Kind.FLOOR and not isinstance(value, int)):
            return False
        return pictured.is_floor(self._lift, signal, value)

    def _meaning(self, name: str, raw: int) -> str:
        value = self._lift.codec.signals[name].decode(raw)
        if isinstance(value, int) and value in self._lift.floors:
            return f"floor {self._lift.floors[value]}"
        return f"floor code {value}" if isinstance(value, int) else str(value)

    def _named(self, code: int) -> str:
        return f", floor {self._lift.floors[code]}" if code in self._lift.floors else ""

    def _last(self, name: str) -> Picture:
        return next(picture for picture in reversed(self._pictures) if name in picture.raw)

    def _asserted(self, misfit: Misfit) -> Finding:
        name = misfit.signal
        signal, spec = self._lift.codec.signals[name], self._lift.codec.map.signals[name]
        value = self._last(name).values[name]
        if signal.kind is Kind.MODE:
            return self._finding(
                Severity.WARNING,
                "in-mode",
                name,
                f"reads {misfit.raw}, {value}: no robot rides in this mode",
                "If the lift is in that mode, put it back into normal service; if it is not, compare the values with the vendor's table",
            )
        active = "high" if spec.active == "low" else "low"
        contact = "open" if spec.active == "low" else "closed"
        return self._finding(
            Severity.WARNING,
            "asserted",
            name,
            f"reports {name.replace('_', ' ')}{'' if misfit.is_constant else ' at times'}: no robot rides",
            f"If that is so, reset it; if the lift is at rest, this is a normally-{contact} contact: write `active: {active}` for it in the map",
        )

    def _contradiction(self, misfit: Misfit) -> Finding:
        """Explain contacts that are made together."""
        name = misfit.signal
        signal, spec = self._lift.codec.signals[name], self._lift.codec.map.signals[name]
        active = "high" if spec.active == "low" else "low"
        often = "all the time" if misfit.is_constant else "at times"
        if signal.kind is Kind.DOOR and spec.open_limit is not None:
            return self._finding(
                Severity.ERROR,
                "door-contradiction",
                name,
                f"the door reads fully open and fully closed at once, {often}",
                "Open and close the door and look at each contact: one of them is inverted or bridged; a normally-closed pair needs"
                f" `active: {active}`",
            )
        made = misfit.raw.bit_count()
        kind = {Kind.FLOOR: "floors", Kind.MOTION: "directions", Kind.DOOR: "floors"}[signal.kind]
        if made == len(signal.points) - 1 and len(signal.points) > 2:
            return self._finding(
                Severity.ERROR,
                "inverted",
                name,
                f"all of its {len(signal.points)} bits but one are made, {often}: they are inverted",
                f"Write `active: {active}` for this signal in the map",
            )
        return self._finding(
            Severity.ERROR,
            "contradiction",
            name,
            f"{made} {kind} at once, {often}",
            f"Look at each contact while the car moves: one is stuck, bridged, or inverted (`active: {active}`)",
        )

    def _never_at_rest(self, name: str) -> Iterator[Finding]:
        if pictured.always(self._pictures, name, True):
            spec = self._lift.codec.map.signals[name]
            active = "high" if spec.active == "low" else "low"
            what = "an overload" if name == "overload" else "something in the doorway"
            yield self._finding(
                Severity.WARNING,
                "asserted",
                name,
                f"reports {what} all the time",
                f"Look whether that is so; if not, it is a normally-closed contact (`active: {active}` in the map), or a dirty sensor",
            )

    def _heartbeat_slow(self) -> Iterator[Finding]:
        alive = self._lift.codec.map.signals.get("alive")
        times = [(p.at_s, p.raw["alive"]) for p in self._pictures if "alive" in p.raw]
        if alive is None or alive.must_change_within_s is None or len(times) < 2:
            return
        since, longest_s = times[0][0], 0.0
        for (_, before), (at_s, raw) in itertools.pairwise(times):
            if raw == before:
                longest_s = max(longest_s, at_s - since)
            else:
                since = at_s
        if len({raw for _, raw in times}) > 1 and longest_s > alive.must_change_within_s:
            yield self._finding(
                Severity.ERROR,
                "heartbeat-slow",
                "alive",
                f"the alive counter stood still for {longest_s:.1f} s, and the map allows {alive.must_change_within_s:g} s",
                "Let the controller count faster, or raise `must_change_within_s` of `alive` in the map: a dead program is noticed as late",
            )

    def _wide(self) -> Iterator[Finding]:
        """Find 32-bit numbers whose words are exchanged: huge as mapped, and plausible the other way round."""
        for name, spec in self._lift.codec.map.signals.items():
            if not spec.is_wide or name not in self._lift.codec.signals:
                continue
            raws = [picture.raw[name] for picture in self._pictures if name in picture.raw]
            swapped = [raw >> 16 | (raw & 0xFFFF) << 16 for raw in raws]
            positions = (spec.positions or {}).values()
            top = max(positions, default=LOW_WORD) * 2
            if raws and any(raws) and min(raws) > top and max(swapped) <= max(top, LOW_WORD):
                order = "low_first" if spec.word_order == "high_first" else "high_first"
                yield self._finding(
                    Severity.ERROR,
                    "words-swapped",
                    name,
                    f"reads {raws[-1]}, which is {swapped[-1]} with its two words exchanged",
                    f"Write `word_order: {order}` for this signal in the map",
                )

    # -- signals that contradict each other

    def _together(self) -> Iterator[Finding]:
        lift, found = self._lift, self._pictures
        odd = {misfit.signal for misfit in self._misfits}
        doors = [name for name in lift.codec.signals if name.startswith("door.") and name not in odd]
        for name in doors:
            if pictured.is_open_between_floors(found, name):
                yield self._under_way(name)
            elif pictured.always(found, name, Door.OPEN) and not self._is_held(name):
                yield self._finding(
                    Severity.WARNING,
                    "door-open",
                    name,
                    f"the door reads open all the time ({self._span_s:.0f} s), and nobody holds it",
                    "Look at the door: if it is shut, its contact is inverted (`active` in the map) or its two limits are exchanged; if it"
                    " really stands open, shut it and run this again",
                )
            if any(
                p.values.get(name) is Door.OPEN
                and p.values.get("level") is False
                and p.values.get("motion") is Motion.STOPPED
                for p in found
            ) and not any(p.values.get("level") is True for p in found):
                yield self._finding(
                    Severity.WARNING,
                    "open-not-level",
                    name,
                    f"the door reads open while the car is not level with any floor ({self._printed('level')})",
                    "Look at both: door and level inputs may be exchanged, or one of them inverted",
                )
        yield from self._standing()
        yield from self._stuck()
        yield from self._drifting()

    @property
    def _span_s(self) -> float:
        return self._pictures[-1].at_s - self._pictures[0].at_s if self._pictures else 0.0

    def _is_held(self, door: str) -> bool:
        command = self._lift.codec.commands.get(f"hold_{door}")
        return command is not None and any(on for _, on in self._states(command))

    def _standing(self) -> Iterator[Finding]:
        """Judge a car that stands all the time: it has to show a floor, and the map's evidence that it stands there."""
        found, signals = self._pictures, self._lift.codec.signals
        moves = any(p.values.get("motion") in MOVING for p in found)
        if moves or any(misfit.signal in ("car_floor", "level", "motion") for misfit in self._misfits):
            return
        needs_door = self._lift.codec.map.at_floor_evidence.kind == "door_limit"
        if "car_floor" in signals and not needs_door and pictured.always(found, "car_floor", None):
            yield self._finding(
                Severity.WARNING,
                "no-floor",
                "car_floor",
                "no floor is reported, all the time",
                "If the car stands at a floor, look at the switch of that floor; a car that lost its position needs a trip to an end floor",
            )
        elif "level" in signals and pictured.always(found, "level", False):
            yield self._finding(
                Severity.WARNING,
                "not-level",
                "level",
                "the car stands, and is never level with a floor: the manager waits for that before it believes an open door",
                "If the car stands level, this contact is inverted (`active` in the map), not wired, or at another address",
            )

    def _stuck(self) -> Iterator[Finding]:
        """Name the signals that did not change while the car changed floors."""
        found, signals = self._pictures, self._lift.codec.signals
        trips = pictured.trips(found)
        if not trips or any(misfit.signal == "car_floor" for misfit in self._misfits):
            return
        for name in signals:
            if (name.startswith("door.") or name in ("motion", "level")) and not pictured.changes(found, name):
                yield self._finding(
                    Severity.WARNING,
                    "stuck",
                    name,
                    f"did not change while the car changed floors {trips} time{'' if trips == 1 else 's'}",
                    "Look at the contact while the lift is ridden with the door used: it is stuck, not wired, or at another address",
                )

    def _drifting(self) -> Iterator[Finding]:
        """Name numbers that go on in one direction although the car stands with its doors shut."""
        lift, found = self._lift, self._pictures
        doors = [name for name in lift.codec.signals if name.startswith("door.")]
        stands = not pictured.trips(found) and not any(pictured.changes(found, name) for name in ("motion", *doors))
        if any(p.values.get("motion") in MOVING for p in found) or not stands:
            return
        for name in ("car_position", "load"):
            numbers = [p.values[name] for p in found if name in p.values]
            steps = [
                b - a for a, b in itertools.pairwise(numbers) if isinstance(a, int) and isinstance(b, int) and a != b
            ]
            if len(steps) >= DRIFT_STEPS and (all(step > 0 for step in steps) or all(step < 0 for step in steps)):
                yield self._finding(
                    Severity.WARNING,
                    "drifts",
                    name,
                    f"went from {numbers[0]} to {numbers[-1]} while the car stood with its doors shut",
                    "Look at the sensor and its shield; what drifts past the tolerance of a floor shows the car somewhere else",
                )

    # -- outputs

    def _outputs(self) -> Iterator[Finding]:
        """Look for another client: outputs that change, or are on, although nothing was written."""
        for command in self._lift.own_outputs:
            states = list(self._states(command))
            if (odd := next((raw for raw, _ in states if not self._can_hold(command, raw)), None)) is not None:
                yield self._finding(
                    Severity.ERROR,
                    "odd-output",
                    command.name,
                    f"reads {' '.join(map(str, odd))}, which no client would write: this address holds something else",
                    f"Compare the address with the vendor's table{self._try(Probe.OFFSET, Probe.TABLE)}",
                )
            elif len({raw for raw, _ in states}) > 1:
                yield self._finding(
                    Severity.ERROR,
                    "second-master",
                    command.name,
                    f"changes between {_listed(' '.join(map(str, raw)) for raw, _ in states)}, and doctor writes nothing: another client commands this lift",
                    "Find and end it (another manager, building management, a test tool, the controller's own web page): two masters"
                    " press against each other",
                )
            elif states and states[-1][1]:
                yield self._finding(
                    Severity.WARNING,
                    "output-on",
                    command.name,
                    f"is on (reads {' '.join(map(str, states[-1][0]))}) although no manager runs here",
                    "Find the other client, or what a test has left behind; the manager releases it when it starts with `access: control`",
                )

    def _can_hold(self, command: CommandCodec, raws: Sequence[int]) -> bool:
        """Whether a client that uses this command would leave these values: rest, a press, or a floor of this lift."""
        codes = self._lift.floors if command.is_call and self._lift.floors else None
        if command.is_call and codes is None and command.spec.one_of is None:
            return True
        presses = [None, *(codes or command.spec.floor_codes or [1])]
        for code in presses:
            try:
                pressed = command.encode(code)
            except ValueError:
                continue
            if list(raws) == [pressed[point] for point in command.points]:
                return True
        return command.spec.payload is not None or len(raws) > 1

    def _states(self, command: CommandCodec) -> Iterator[tuple[tuple[int, ...], bool]]:
        """Yield what the points of a command read, and whether that is another value than its rest."""
        rest = command.encode(None)
        cells: dict[tuple[str, int, Table, int], int] = {}
        for name, controller in self._evidence.controllers.items():
            for answer in controller.of(Purpose.OUTPUTS):
                if answer.values is None:
                    continue
                for place, value in enumerate(answer.values):
                    cells[name, answer.unit, answer.table, answer.address + place] = value
                raws = []
                for point in command.read_points:
                    device = self._lift.device(point)
                    cell = cells.get((device.controller, device.unit_id, point.table, point.address))
                    if cell is None:
                        break
                    raws.append(point.within(cell))
                else:
                    expected = [rest[point] for point in command.points]
                    yield tuple(raws), raws != expected

    # -- what this run could not show

    def _unchanged(self) -> Iterator[Finding]:
        found = self._pictures
        still = [name for name in self._lift.codec.signals if name != "alive" and not pictured.changes(found, name)]
        if still and self._span_s:
            signals = len(self._lift.codec.signals)
            count = f"{len(still)} of {signals} signals" if len(still) < signals else f"all {signals} signals"
            which = ", ".join(still) if len(still) <= MOST_LISTED else count
            yield Finding(
                Severity.NOTE,
                "never-changed",
                self._lift.name,
                "",
                f"{which} did not change in {self._span_s:.0f} s, so nothing is proven about {'it' if len(still) == 1 else 'them'}",
                f"Ride the lift by hand with `--seconds {RIDE_S}`; `checkout` proves them one by one",
            )


def _reads(misfit: Misfit) -> str:
    match misfit.oddity:
        case Oddity.STILL:
            return f"stands at {misfit.raw}"
        case Oddity.RESTLESS:
            return "jumps about"
        case Oddity.ASSERTED:
            return "is on"
        case _:
            return f"reads {misfit.raw}"


def _listed(texts: Iterable[str]) -> str:
    return " and ".join(list(dict.fromkeys(texts))[:MOST_NAMED])
