"""Writes a report as one self-contained HTML page for printing on A4: no script, nothing fetched."""

from __future__ import annotations

from base64 import b64encode
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from datetime import datetime
from html import escape
from itertools import groupby
from typing import Any

from lift_manager.commissioning.checkout.record import (
    CALLED,
    Fingerprint,
    Instrument,
    Item,
    Outcome,
    Person,
    Precondition,
    PunchEntry,
    Record,
    Result,
    Role,
    Signature,
    Stage,
    Topic,
    Verdict,
    verdict,
)
from lift_manager.commissioning.checkout.report import charts
from lift_manager.commissioning.checkout.report.difference import (
    Difference,
    address,
    compare,
    fingerprint,
    own_identity,
)
from lift_manager.commissioning.checkout.report.figures import (
    CLOSES,
    OPENS,
    door_times,
    figure_text,
    travel_times,
)
from lift_manager.commissioning.checkout.report.photos import Photo
from lift_manager.commissioning.checkout.report.words import (
    NO_EXAMINATION,
    OPEN,
    OUTCOMES,
    STAGES,
    STANDARDS,
    TOPICS,
    confirmed_by,
    current,
    headline,
    phase,
    title,
    when,
    without_repetitions,
)

_STYLE = """
@page { size: A4; margin: 17mm 13mm 18mm;
  @top-left { content: "TITLE"; font: 7.5pt Arial, Helvetica, sans-serif; color: #444; }
  @top-right { content: "VERDICT"; font: bold 7.5pt Arial, Helvetica, sans-serif; color: #444; }
  @bottom-left { content: "record sha256 HASH"; font: 6.5pt "DejaVu Sans Mono", Consolas, monospace; color: #444; }
  @bottom-right { content: "page " counter(page) " of " counter(pages); font: 7.5pt Arial, Helvetica, sans-serif; color: #444; } }
* { box-sizing: border-box; }
body { font: 9pt/1.35 Arial, Helvetica, sans-serif; color: #1a1a1a; max-width: 184mm; margin: 8mm auto; }
h1 { font-size: 18pt; line-height: 1.15; margin: 0 0 3mm; color: #2b4a6b; }
h2 { font-size: 12.5pt; margin: 8mm 0 2mm; padding-bottom: 1mm; border-bottom: 0.5mm solid #2b4a6b; color: #2b4a6b; break-after: avoid; }
h3 { font-size: 10pt; margin: 4.5mm 0 1.5mm; break-after: avoid; }
p { margin: 0 0 2mm; }
.norm, .small { font-size: 8pt; color: #555; }
.norm, h2 + p, h3 + p { break-after: avoid; }
.hash, .address { font-family: "DejaVu Sans Mono", Consolas, monospace; font-size: 0.86em; overflow-wrap: anywhere; }
table { border-collapse: collapse; width: 100%; margin-bottom: 3mm; }
th, td { border: 0.2mm solid #b4bac2; padding: 1mm 1.4mm; text-align: left; vertical-align: top; overflow-wrap: anywhere; }
th { background: #e9edf2; font-weight: bold; }
thead { display: table-header-group; }
tr { break-inside: avoid; }
tr.item td { border-bottom: 0; }
tr.detail { break-before: avoid; break-inside: auto; }
tr.detail td { border-top: 0; padding-top: 0; font-size: 7.2pt; color: #444; }
table.facts th { width: 42mm; }
table.fixed { table-layout: fixed; font-size: 8pt; }
td.number { text-align: right; }
td.number, .whole { white-space: nowrap; }
td.text { white-space: pre-line; }
.remark { font-weight: normal; color: #1a1a1a; }
.verdict { border: 0.6mm solid; border-left-width: 4mm; padding: 2.5mm 4mm; margin: 4mm 0; break-inside: avoid; }
.verdict b { display: block; font-size: 15pt; letter-spacing: 0.3mm; }
.verdict ul { margin: 1mm 0 0; padding-left: 5mm; }
.verdict.good { border-color: #2e7d4f; } .verdict.fair { border-color: #b7791f; }
.verdict.bad { border-color: #b3261e; } .verdict.open { border-color: #6b7280; }
td.good, td.fair, td.bad, td.open { border-left: 1.2mm solid; font-weight: bold; }
td.good { border-left-color: #2e7d4f; } td.fair { border-left-color: #b7791f; }
td.bad { border-left-color: #b3261e; background: #fbeceb; } td.bad b, td.bad { color: #8f1d17; } td.open { border-left-color: #6b7280; }
.notice { border: 0.2mm solid #b4bac2; background: #f6f7f9; padding: 2mm 3mm; margin: 3mm 0; break-inside: avoid; }
.chart { width: 100%; height: auto; font: 11px Arial, Helvetica, sans-serif; fill: #222; break-inside: avoid; margin-bottom: 3mm; }
.page { break-before: page; }
.signing td { height: 12mm; } .signing { break-inside: avoid; }
.box { display: inline-block; width: 3.4mm; height: 3.4mm; border: 0.3mm solid #222; margin-right: 2mm; vertical-align: -0.4mm; }
ul.plain { list-style: none; padding: 0; margin: 0 0 3mm; } ul.plain li { margin-bottom: 0.6mm; }
figure { display: inline-block; width: 88mm; margin: 0 2mm 4mm 0; vertical-align: top; break-inside: avoid; }
figure img { max-width: 100%; max-height: 90mm; border: 0.2mm solid #b4bac2; }
figcaption { font-size: 7.5pt; color: #444; overflow-wrap: anywhere; }
@media screen { body { padding: 0 4mm; } }
@media print { body { margin: 0; max-width: none; } * { print-color-adjust: exact; } }
"""

_KINDS = {
    Outcome.PASSED: "good",
    Outcome.DOCUMENT: "good",
    Outcome.NOT_APPLICABLE: "open",
    Outcome.SKIPPED: "fair",
    Outcome.FAILED: "bad",
}
_HAND_BACK_CHECKS = (
    "Every output of the lift manager is released; robot mode is off",
    "Nothing is bridged, simulated or disconnected any more",
    "The fire panel is connected again, and its maintenance switch is off",
    "Barriers and notices are removed; the car is empty",
    "The car answered a landing call and a car call; doors and display are normal",
    "The PLC program was backed up after the test",
)


def render(record: Record, against: Record | None = None, photos: Mapping[str, Photo] | None = None) -> bytes:
    """Return the report as UTF-8; `against` is an earlier record of the same lift, `photos` are by their path in the record."""
    found = verdict(record)
    style = (
        _STYLE.replace("TITLE", _css(title(record)))
        .replace("VERDICT", _css(headline(found).lower()))
        .replace("HASH", record.sha256)
    )
    body = "\n".join(_body(record, found, against, photos or {}))
    page = (
        '<!DOCTYPE html>\n<html lang="en">\n<head>\n<meta charset="utf-8">\n'
        '<meta name="viewport" content="width=device-width, initial-scale=1">\n'
        f"<title>{escape(title(record))}</title>\n<style>{style}</style>\n</head>\n<body>\n{body}\n</body>\n</html>\n"
    )
    return page.encode()


def _body(record: Record, found: Verdict, against: Record | None, photos: Mapping[str, Photo]) -> Iterator[str]:
    yield from _title_block(record, found)
    yield from _summary(record)
    yield from _identity(record)
    yield from _conditions(record)
    yield from _tests(record, photos)
    yield from _timing(record)
    yield from _trips(record)
    yield from _punch_list(record)
    yield from _as_built(record)
    if against is not None:
        yield from _difference(compare(against, record))
    if record.stage is not Stage.FAT:
        yield from _hand_back(record)
    yield from _signatures(record, found)
    yield from _annex(record, photos)


def _title_block(record: Record, found: Verdict) -> Iterator[str]:
    yield f"<h1>{STAGES[record.stage]}</h1>"
    floors = ", ".join(f"{name} = {code}" for name, code in record.floors.items())
    yield _facts(
        (
            ("Site", record.site),
            ("Lift", record.lift),
            ("Floors, lowest first", floors),
            ("Begun", when(record.started_at) + " UTC"),
            ("Ended", f"{when(record.ended_at)} UTC" if record.ended_at else "not ended"),
            ("Run by", _person(record.people.run_by)),
        ),
        (("Record (sha256)", record.sha256),),
    )
    kind = "open" if not found.complete else "bad" if not found.passed else "fair" if found.conditionally else "good"
    yield f'<div class="verdict {kind}"><b>{headline(found)}</b>'
    if found.text != headline(found).lower():
        yield f"<p>{escape(_sentence(found.text))}</p>"

    if found.conditions:
        yield "<p>Robots may use the lift only under these conditions:</p>"
        yield f"<ul>{''.join(f'<li>{escape(text)}</li>' for text in found.conditions)}</ul>"
    yield "</div>"
    signed = "signed as it is" if found.is_signed else "not signed as it is"
    back = "" if found.is_handed_back else "not "
    lift = "" if record.stage is Stage.FAT else f"; the lift is {back}handed back to normal service"
    yield f"<p>This record is {signed}{lift}. Times are in UTC.</p>"
    yield f'<div class="notice">{NO_EXAMINATION} {STANDARDS}</div>'


def _summary(record: Record) -> Iterator[str]:
    heads = [*OUTCOMES.values(), OPEN]
    yield "<h2>Summary</h2>"
    yield f"<table><thead>{_row('th', ['Group', 'Items', *heads])}</thead><tbody>"
    newest = record.newest
    groups = list(dict.fromkeys(item.group for item in record.items))
    total: Counter[str] = Counter()
    for group in groups:
        counts = Counter(_outcome_text(newest.get(item.id)) for item in record.items if item.group == group)
        total += counts
        yield _counts(group, counts, heads)
    if len(groups) > 1:
        yield _counts("All", total, heads)
    yield "</tbody></table>"


def _counts(label: str, counts: Counter[str], heads: Sequence[str]) -> str:
    cells = "".join(f'<td class="number">{counts[head] or ""}</td>' for head in heads)
    return f'<tr><td>{escape(label)}</td><td class="number">{counts.total()}</td>{cells}</tr>'


def _identity(record: Record) -> Iterator[str]:
    tested, controller = record.map, record.controller
    yield "<h2>What was tested</h2>"
    yield (
        '<p class="small">The record is valid for this map, these settings of the site file and this controller. A controller without an '
        "identity of its own is known by its fingerprint: the addresses that it answers for, and words that never change.</p>"
    )
    yield _facts(
        (
            ("Map", f"{tested.name}: {tested.title}" if tested.title else tested.name),
            ("Controller", address(record)),
            ("Identity", controller.identity or "none given"),
            ("As it says itself", own_identity(record) or "it was not asked, or says nothing"),
            (
                "Versions",
                ", ".join(f"{name} {version}" for name, version in record.versions.items()) or "none recorded",
            ),
        ),
        (
            ("Map (sha256)", tested.sha256),
            ("Settings (sha256)", tested.lift_sha256 or "not recorded"),
            ("Fingerprint (sha256)", fingerprint(record) or "not taken"),
        ),
    )


def _conditions(record: Record) -> Iterator[str]:
    people = record.people
    yield "<h2>People, instruments and preconditions</h2>"
    yield _facts(
        (
            ("Run by", _person(people.run_by)),
            ("Lift technician", _person(people.technician)),
            ("Witness", _person(people.witness)),
            ("Instruments", "; ".join(map(_instrument_text, record.instruments)) or "none named"),
        )
    )
    yield (
        '<p class="small">Only the lift technician disconnects or simulates an input. The safety chain is not touched, and nobody works in the '
        "shaft.</p>"
    )
    answers = current(record.preconditions)
    if not answers:
        yield "<p>No precondition is recorded.</p>"
        return
    yield _head(
        *(("Precondition", 19), ("Asked", 28), ("Answer", 9), ("Number, file or reason", 17), ("Before", 10)),
        ("By, when", 17),
    )
    for one, items in _by_answer(answers):
        given = "; ".join(filter(None, (one.value, one.reason)))
        answer = '<td class="good">Yes</td>' if one.is_met else '<td class="fair">No</td>'
        before = ", ".join(f'<span class="whole">{escape(item)}</span>' for item in items)
        yield (
            f"<tr>{_cells(TOPICS[one.topic], one.text)}{answer}{_cells(given)}<td>{before}</td>{_who(one.by, one.at)}</tr>"
        )
    yield "</tbody></table>"


def _by_answer(answers: Iterable[Precondition]) -> Iterator[tuple[Precondition, list[str]]]:
    """Yield answers that say the same once, the newest, with the items before which they were given."""
    same: dict[tuple[object, ...], list[Precondition]] = {}
    for one in answers:
        same.setdefault((one.topic, one.text, one.is_met, one.value, one.reason, one.by), []).append(one)
    for given in same.values():
        yield given[-1], [one.item or "the test" for one in given]


def _tests(record: Record, photos: Mapping[str, Photo]) -> Iterator[str]:
    newest = record.newest
    for group, members in groupby(record.items, key=lambda item: item.group):
        items = list(members)
        phases = list(dict.fromkeys(phase(item.kind, record.stage) for item in items))
        yield f"<h2>{escape(group)}</h2>"
        yield f'<p class="norm">{escape("; ".join(phases))}.</p>'
        yield _head(("No.", 7), ("Test", 30), ("Expected", 24), ("Result", 11), ("By, when", 13), ("Note", 15))
        for item in items:
            yield _item(record, item, newest.get(item.id), photos)
        yield "</tbody></table>"


def _item(record: Record, item: Item, result: Result | None, photos: Mapping[str, Photo]) -> str:
    """Return the row of an item, and below it one with its addresses and what was seen."""
    test = f"<b>{escape(item.title)}</b><br>{escape(item.action)}"
    cells = f'<td class="whole">{escape(item.id)}</td><td>{test}</td><td>{escape(item.expected)}</td>'
    if result is None:
        why = "changed since it was tested" if record.changed_since(item) else ""
        outcome, note, seen = f'<td class="open">{OPEN}</td><td></td>', why, []
    else:
        confirmed = confirmed_by(record, result)
        people = result.by + (f", confirmed by {confirmed}" if confirmed else "")
        outcome = f'<td class="{_KINDS[result.outcome]}">{OUTCOMES[result.outcome]}</td>{_who(people, result.at)}'
        photo_lines = [_photo_text(photos.get(path, Photo(path))) for path in result.photos]
        note = "\n".join(filter(None, (result.note, *photo_lines)))
        seen = [figure_text(name, value) for name, value in result.figures.items()]
        seen += without_repetitions(result.evidence)
    detail = [f'<span class="address">{escape(line)}</span>' for line in _addresses(item)]
    detail += [" &middot; ".join(map(escape, seen))] if seen else []
    below = f'<tr class="detail"><td></td><td colspan="5">{"<br>".join(detail)}</td></tr>' if detail else ""
    return f'<tr class="{"item" if detail else ""}">{cells}{outcome}{_cells(note)}</tr>{below}'


def _addresses(item: Item) -> Iterator[str]:
    """Yield the addresses of each signal or command of an item, as printed and on the wire."""
    for name, points in groupby(item.points, key=lambda point: point.name):
        yield f"{name}: {', '.join(f'{point.printed} ({point.wire})' for point in points)}"


def _timing(record: Record) -> Iterator[str]:
    doors = charts.bars(
        "Doors by floor", [("door opens", door_times(record, OPENS)), ("door closes", door_times(record, CLOSES))]
    )
    travel = charts.bars("Travel from floor to floor", [("travel", travel_times(record))])
    taken = record.controller.fingerprint
    latency = None if taken is None else taken.latency
    answers = "" if latency is None else charts.histogram("Answer times of the controller", latency)
    if not (doors or travel or latency is not None):
        return
    yield "<h2>Timing</h2>"
    for heading, chart in (("Doors by floor", doors), ("Travel from floor to floor", travel)):
        if chart:
            yield f"<h3>{heading}</h3>{chart}"
    if latency is not None:
        yield "<h3>Answer times of the controller</h3>"
        many = f" of {len(latency.samples_ms)} answers" if latency.samples_ms else ""
        yield (
            f"<p>Median {latency.p50_ms:g} ms, 99th percentile {latency.p99_ms:g} ms, longest {latency.max_ms:g} ms{many}.</p>{answers}"
        )


def _trips(record: Record) -> Iterator[str]:
    if not record.trips:
        return
    complete = sum(trip.is_complete for trip in record.trips)
    yield f"<h2>Trips</h2><p>{complete} of {len(record.trips)} complete.</p>"
    figures = list(dict.fromkeys(name for trip in record.trips for name in trip.figures))
    heads = [(_figure_head(name), 52 / len(figures)) for name in figures]
    yield _head(("No.", 5), ("Item", 8), ("From, to", 13), ("Result", 22), *heads)
    for trip in record.trips:
        kind, word = ("good", "Complete") if trip.is_complete else ("bad", "Not complete")
        told = f'<br><span class="remark">{escape(trip.text)}</span>' if trip.text else ""
        values = "".join(
            f'<td class="number">{trip.figures[name]:.1f}</td>' if name in trip.figures else "<td></td>"
            for name in figures
        )
        route = f"{trip.from_} → {trip.to}"
        yield f'<tr>{_cells(str(trip.number), trip.item, route)}<td class="{kind}">{word}{told}</td>{values}</tr>'
    yield "</tbody></table>"


def _punch_list(record: Record) -> Iterator[str]:
    yield "<h2>Punch list</h2>"
    if not record.punch:
        yield "<p>No point is recorded.</p>"
        return
    yield (
        '<p class="small">A: robots may not use the lift before it is mended. B: to be mended by a date; robots may use the lift meanwhile under '
        "an accepted condition. C: a remark.</p>"
    )
    yield _head(
        ("No.", 5),
        ("Item", 8),
        ("Severity", 10),
        ("Point", 28),
        ("State", 18),
        ("Condition, accepted by", 22),
        ("Due", 12),
    )
    for entry in record.punch:
        kind, state = _punch_state(entry)
        accepted = f"{entry.condition}\n{f'accepted by {entry.accepted_by}' if entry.accepted_by else ''}".strip()
        yield (
            f"<tr>{_cells(str(entry.number), entry.item, entry.severity, entry.text)}"
            f'<td class="{kind} text">{escape(state)}</td>{_cells(accepted, entry.due)}</tr>'
        )
    yield "</tbody></table>"


def _punch_state(entry: PunchEntry) -> tuple[str, str]:
    if not entry.is_open:
        by = f" by {entry.closed_by}" if entry.closed_by else ""
        return "good", f"Closed{by}\n{when(entry.closed_at)}"
    if entry.is_accepted:
        return "fair", "Open, accepted under a condition" if entry.condition else "Open, accepted"
    return "bad", "OPEN, not accepted"


def _as_built(record: Record) -> Iterator[str]:
    yield "<h2>As-built changes</h2>"
    listed = [one.value for one in current(record.preconditions) if one.topic is Topic.IO_LIST and one.value]
    yield f"<p>Against the approved I/O list{f' ({escape(listed[-1])})' if listed else ''}.</p>"
    if not record.as_built:
        yield "<p>No change is recorded.</p>"
        return
    yield _head(("Subject", 18), ("Approved", 22), ("As built", 22), ("Reason", 22), ("By, when", 16))
    for one in record.as_built:
        yield f"<tr>{_cells(one.subject, one.approved, one.as_built, one.reason)}{_who(one.by, one.at)}</tr>"
    yield "</tbody></table>"


def _difference(found: Difference) -> Iterator[str]:
    before, after = found.before.stage.upper(), found.after.stage.upper()
    if before == after:
        before, after = f"{before} {when(found.before.started_at)}", f"{after} {when(found.after.started_at)}"
    yield f"<h2>Difference {before} → {after}</h2>"
    yield (
        f"<p>Earlier record: {STAGES[found.before.stage]}, begun {when(found.before.started_at)}, {headline(verdict(found.before)).lower()}. "
        f"{found.same} items have the same result of the same test in both; {len(found.items)} differ.</p>"
    )
    yield f'<p class="small">sha256 of the earlier record: <span class="hash">{found.before.sha256}</span></p>'
    if found.items:
        yield _head(("No.", 8), ("Test", 30), (before, 14), (after, 14), ("What else differs", 34))
        for item in found.items:
            changes = "\n".join(item.changes)
            yield (f"<tr>{_cells(item.item, item.title, item.before)}{_outcome_cell(item.after)}{_cells(changes)}</tr>")
        yield "</tbody></table>"
    if found.general:
        yield "<h3>What both are about</h3>"
        yield _head(("", 24), (before, 38), (after, 38))
        yield from (f"<tr>{_cells(*row)}</tr>" for row in found.general)
        yield "</tbody></table>"
    if found.figures:
        yield "<h3>Times (medians)</h3>"
        yield _head(("", 40), (f"{before}, s", 20), (f"{after}, s", 20), ("Difference, s", 20))
        for one in found.figures:
            numbers = (
                f"{one.before_s:.1f}",
                f"{one.after_s:.1f}",
                f"{round(one.after_s - one.before_s, 1) + 0.0:+.1f}",
            )
            cells = "".join(f'<td class="number">{number}</td>' for number in numbers)
            yield f"<tr>{_cells(one.what)}{cells}</tr>"
        yield "</tbody></table>"


def _hand_back(record: Record) -> Iterator[str]:
    back = record.hand_back
    yield '<section class="page"><h2>Hand-back of the lift</h2>'
    yield f"<p>Lift {escape(record.lift)} of {escape(record.site)} is given back to its passengers.</p>"
    if back is None:
        yield "<p>Not recorded. To be filled in on paper before anybody uses the lift:</p>"
        yield '<ul class="plain">'
        yield from (f'<li><span class="box"></span>{line}</li>' for line in _HAND_BACK_CHECKS)
        yield "</ul>"
        rows = ("In normal service since", "Handed over by", "Taken back by", "Signature")
        yield f'<table class="facts signing">{"".join(f"<tr><th>{label}</th><td></td></tr>" for label in rows)}</table>'
    else:
        service = (
            '<td class="good">Yes</td>'
            if back.in_normal_service
            else '<td class="bad">NO: it stays out of service</td>'
        )
        yield (
            f'<table class="facts"><tr><th>In normal service</th>{service}</tr>{_fact("When", f"{when(back.at)} UTC")}'
            f"{_fact('Handed over by', back.handed_over_by)}{_fact('Taken back by', back.taken_back_by)}{_fact('Note', back.note)}</table>"
        )
        yield '<table class="facts signing"><tr><th>Signature of who takes it back</th><td></td></tr></table>'
    yield "</section>"


def _signatures(record: Record, found: Verdict) -> Iterator[str]:
    yield '<section class="signing"><h2>Signatures</h2>'
    yield f"<p>{headline(found).capitalize()}. {NO_EXAMINATION}</p>"
    yield _head(("Role", 16), ("Name", 24), ("Signature", 36), ("Date", 24))
    people = {
        Role.RUN_BY: record.people.run_by,
        Role.TECHNICIAN: record.people.technician,
        Role.WITNESS: record.people.witness,
    }
    newest = {one.role: one for one in record.signatures}
    for role in Role:
        given = newest.get(role)
        person = people.get(role)
        name = given.name if given is not None else person.name if person is not None else ""
        state, at = ("", "") if given is None else (_signature_state(given, record), f"{when(given.at)} UTC")
        yield f"<tr>{_cells(role.capitalize(), name, state, at)}</tr>"
    yield "</tbody></table></section>"


def _signature_state(given: Signature, record: Record) -> str:
    if given.record_sha256 == record.sha256:
        return "\n".join(filter(None, ("signed in the record, as it is", given.statement)))
    return f"signed an earlier state (sha256 {given.record_sha256[:16]}…); to be signed again"


def _annex(record: Record, photos: Mapping[str, Photo]) -> Iterator[str]:
    yield from _earlier_results(record)
    if record.controller.fingerprint is not None:
        yield from _fingerprint_rows(record.controller.fingerprint)
    if record.baseline is not None:
        yield from _baseline(record.baseline)
    shown = [photo for photo in photos.values() if photo.data]
    if shown:
        items = {path: number for number, result in record.newest.items() for path in result.photos}
        yield "<h2>Annex: photos</h2>"
        for photo in shown:
            source = f"data:{photo.media_type};base64,{b64encode(photo.data).decode()}"
            label = f"{items.get(photo.path, '')}: {photo.path}"
            yield (
                f'<figure><img src="{source}" alt="{escape(label)}"><figcaption>{escape(label)}<br>'
                f'<span class="hash">sha256 {photo.sha256}</span></figcaption></figure>'
            )


def _earlier_results(record: Record) -> Iterator[str]:
    counting = {id(result) for result in record.newest.values()}
    earlier = [result for result in record.results if id(result) not in counting]
    if not earlier:
        return
    yield "<h2>Annex: earlier results</h2>"
    yield "<p>They no longer count: the item was tested again, or has changed since.</p>"
    yield _head(("No.", 9), ("Result", 16), ("By, when", 25), ("Note", 50))
    for result in earlier:
        kind = _KINDS[result.outcome]
        yield (
            f'<tr>{_cells(result.item)}<td class="{kind}">{OUTCOMES[result.outcome]}</td>'
            f"{_who(result.by, result.at)}{_cells(result.note)}</tr>"
        )
    yield "</tbody></table>"


def _fingerprint_rows(taken: Fingerprint) -> Iterator[str]:
    yield "<h2>Annex: fingerprint of the controller</h2>"
    yield f"<p>Taken {when(taken.taken_at)} UTC. Addresses are those on the wire.</p>"
    served = "; ".join(f"{one.table} {one.first} to {one.last} (unit {one.unit})" for one in taken.served)
    words = "; ".join(f"{one.table} {one.address} = {one.value} (unit {one.unit})" for one in taken.constants)
    yield _facts((("Served", served or "not determined"), ("Never changes", words or "nothing found")))


def _baseline(baseline: Mapping[str, Any]) -> Iterator[str]:
    yield "<h2>Annex: as-left baseline</h2>"
    yield (
        "<p>What the doctor found when the lift was left; a later run is compared with it. The record has all of it.</p>"
    )
    listed = baseline.get("findings")
    findings = [one for one in listed if isinstance(one, dict)] if isinstance(listed, list) else []
    if not findings:
        yield "<p>It has no findings.</p>"
        return
    yield _head(("About", 16), ("Where", 22), ("Finding", 62))
    for one in findings:
        yield f"<tr>{_cells(*(str(one.get(key, '')) for key in ('subject', 'where', 'text')))}</tr>"
    yield "</tbody></table>"


def _outcome_text(result: Result | None) -> str:
    return OPEN if result is None else OUTCOMES[result.outcome]


def _outcome_cell(words: str) -> str:
    kind = next((kind for outcome, kind in _KINDS.items() if outcome.value == words), "open")
    return f'<td class="{kind}">{escape(words)}</td>'


def _photo_text(photo: Photo) -> str:
    if photo.problem:
        return f"photo {photo.path}: {photo.problem}"
    return f"photo {photo.path}" + (", see annex" if photo.data else "")


def _person(person: Person | None) -> str:
    if person is None:
        return "nobody"
    return f"{person.name}, {person.company}" if person.company else person.name


def _instrument_text(one: Instrument) -> str:
    serial = f" no. {one.serial}" if one.serial else ""
    return f"{one.name}{serial}{f', calibrated {one.calibrated}' if one.calibrated else ''}"


def _figure_head(name: str) -> str:
    if name == CALLED:
        return "car there after, s"
    words, _, unit = name.rpartition("_")
    return f"{words.replace('_', ' ')}, {unit}" if words else name


def _sentence(text: str) -> str:
    return f"{text[:1].upper()}{text[1:]}."


def _facts(facts: Iterable[tuple[str, str]], hashes: Iterable[tuple[str, str]] = ()) -> str:
    rows = "".join(_fact(label, text) for label, text in facts)
    rows += "".join(f'<tr><th>{escape(label)}</th><td class="hash">{escape(text)}</td></tr>' for label, text in hashes)
    return f'<table class="facts">{rows}</table>'


def _fact(label: str, text: str) -> str:
    return f'<tr><th>{escape(label)}</th><td class="text">{escape(text)}</td></tr>'


def _head(*columns: tuple[str, float]) -> str:
    """Begin a table with these headings and widths in per cent."""
    whole = sum(share for _, share in columns)
    widths = "".join(f'<col style="width:{100 * share / whole:.2f}%">' for _, share in columns)
    return f'<table class="fixed">{widths}<thead>{_row("th", [heading for heading, _ in columns])}</thead><tbody>'


def _who(by: str, at: datetime) -> str:
    """Return a cell with a name and a time that only breaks between date and hour."""
    date, _, hour = when(at).partition(" ")
    return f'<td>{escape(by)}<br><span class="whole">{date}</span> {hour}</td>'


def _row(cell: str, texts: Iterable[str]) -> str:
    return f"<tr>{''.join(f'<{cell}>{escape(text)}</{cell}>' for text in texts)}</tr>"


def _cells(*texts: str) -> str:
    return "".join(f'<td class="text">{escape(text)}</td>' for text in texts)


def _css(text: str) -> str:
    """Return text for a CSS string: everything but letters, digits and blanks as an escape, so that nothing can end it."""
    return "".join(
        letter if letter.isascii() and (letter.isalnum() or letter == " ") else f"\\{ord(letter):x} " for letter in text
    )
