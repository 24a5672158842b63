/** What is said of a lift in words: by picture, table and screen reader alike. Pure. */

const TONES = ["plain", "warn", "alarm"];
const ALARM_MODES = new Set(["fire", "emergency"]);
const QUIET_MODES = new Set(["normal", "robot"]);
const FAILED = new Set(["rejected", "unconfirmed"]);
const MOVES = new Set(["up", "down", "moving"]);
/** The ages of an event are correct within 250 ms, and two events may be that far from each other. */
const INACCURACY_MS = 500;

/** "4 s", "12 min", "3 h": a duration for people. */
export function duration(seconds, t) {
  if (seconds < 10) return t("time.s", { n: seconds.toFixed(1).replace(".", t("time.decimal")) });
  if (seconds < 120) return t("time.s", { n: Math.floor(seconds) });
  if (seconds < 7200) return t("time.min", { n: Math.floor(seconds / 60) });
  return t("time.h", { n: Math.floor(seconds / 3600) });
}

/** What is wrong with a lift: `{tone, text}` each, the worst first. Texts of the manager are English, and marked as such by `detail`. */
export function troubles(lift, { t, word }) {
  const { restrictions } = lift;
  const found = [];
  const add = (tone, text, detail = "") => found.push({ tone, text, detail });
  if (ALARM_MODES.has(lift.mode)) add("alarm", t(`trouble.${lift.mode}`));
  if (isFireOver(lift)) add("alarm", t("trouble.fire_latched"));
  if (lift.lost) add("warn", t("trouble.lost"));
  else if (lift.quality !== "live") add("warn", t("trouble.offline"), lift.reason);
  else if (!ALARM_MODES.has(lift.mode) && !QUIET_MODES.has(lift.mode)) add("warn", t("trouble.mode", { mode: word("mode", lift.mode) }));
  for (const [side, door] of Object.entries(lift.doors)) {
    if (door === "fault") add("warn", t("trouble.door", { side: word("side", side) }));
    if (door === "unknown") add("warn", t("trouble.door_unknown", { side: word("side", side) }));
  }
  if (restrictions.lockout) add("warn", t("trouble.lockout"), restrictions.lockout);
  if (restrictions.drain) add("warn", t("trouble.drain"), restrictions.drain);
  const occupant = occupantWithoutSession(lift);
  if (occupant) add("warn", t("trouble.occupied", { who: occupant }));
  if (restrictions.distrusted) add("warn", t("trouble.distrusted"), restrictions.distrusted);
  return found;
}

/** Whether a person has to acknowledge a fire: only once the lift reports it no more. */
export function isFireOver({ mode, restrictions }) {
  return restrictions.fire_latched && mode !== "fire";
}

/** Whose robot may be in the car without a session; null if nobody's. The robot of a session that goes on is where it should be. */
export function occupantWithoutSession({ restrictions, session }) {
  const occupant = restrictions.maybe_occupied_by;
  return occupant && holderName(occupant) !== session?.name ? holderName(occupant) : null;
}

/** The worst tone of some troubles. */
export function worst(found) {
  return TONES[Math.max(0, ...found.map(({ tone }) => TONES.indexOf(tone)))];
}

/** The sign before a trouble of each tone: characters that a browser has without fonts for emoji. */
export const SIGNS = { warn: "⚠", alarm: "‼" };

/** Where the car is. */
export function place(lift, lastFloor, { t }) {
  if (lift.quality !== "live") return t("place.unknown");
  if (lift.floor !== null) return t(lift.standing ? "place.at" : "place.passing", { floor: lift.floor });
  return lastFloor === null ? t("place.unknown") : t("place.left", { floor: lastFloor });
}

/** What each door does: `[side, word]`, the side empty for a lift with one door. */
export function doors(lift, { t, word }) {
  const found = Object.entries(lift.doors);
  if (!found.length) return [["", t("door.unknown")]];
  return found.map(([side, door]) => [found.length > 1 ? word("side", side) : "", word("door", door)]);
}

export function doorText(lift, texts) {
  return doors(lift, texts)
    .map(([side, door]) => (side ? `${side} ${door}` : door))
    .join(", ");
}

/** The name in `face:name`, with the face only where it says something to people. */
export function holderName(holder) {
  const [face, ...name] = holder.split(":");
  return name.join(":") || face;
}

/** What the car does, and where its holder sends it. */
export function motion(lift, { t, word }) {
  const goes = lift.quality === "live" && lift.session && lift.destination !== null && lift.destination !== lift.floor;
  return goes ? `${word("motion", lift.motion)}, ${t("facts.goal", { floor: lift.destination })}` : word("motion", lift.motion);
}

/** Who holds the lift. */
export function holder(lift, { t }) {
  if (lift.lost) return t("holder.unknown");
  if (!lift.session) return t("holder.nobody");
  return t(lift.session.ending ? "holder.ending" : "holder.held", { who: lift.session.name });
}

/**
 * The last command of the session that holds the lift and what became of it, where it failed and nothing else says why the car stands there;
 * else null. Its `detail` is a text of the manager.
 */
export function failedCommand(record, texts) {
  const { shown: lift, outcome } = record;
  if (!lift.session || lift.session.ending || outcome === null || !FAILED.has(outcome.result) || !isOfSession(outcome, record)) return null;
  if (lift.restrictions.waiting_for || troubles(lift, texts).length || MOVES.has(lift.motion) || lift.robot_door === "open") return null;
  return { text: `${commandText(outcome.command, texts)}: ${texts.word(`result.${outcome.result}`, "none")}`, detail: outcome.reason };
}

function isOfSession(outcome, { lift: { session }, at }) {
  const holder = session.face === session.name ? session.name : `${session.face}:${session.name}`;
  return outcome.holder === holder && outcome.at >= at - session.for_s * 1000 - INACCURACY_MS;
}

/** All of it in one text, for whoever cannot see the picture. */
export function sentence(lift, lastFloor, texts) {
  const parts = [
    texts.word("mode", lift.mode),
    place(lift, lastFloor, texts),
    doorText(lift, texts),
    lift.motion === "unknown" ? "" : motion(lift, texts),
    holder(lift, texts),
    ...troubles(lift, texts).map(({ text }) => text),
  ];
  return `${lift.name}: ${parts.filter(Boolean).join("; ")}`;
}

/** `go_to L2` or `hold_door.front` in words. */
export function commandText(command, { word }) {
  const [whole, ...floor] = command.split(" ");
  const [name, side] = whole.split(".");
  return [word("command", name), floor.join(" "), side && side !== "front" ? `(${word("side", side)})` : ""].filter(Boolean).join(" ");
}
