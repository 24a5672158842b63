/**
 * When a state may be shown as current. Pure; times are milliseconds of `performance.now()`, and the clock of the manager is never compared
 * with that of this browser: a state has its age with it.
 */

/** A lift of which nothing is known. */
const UNKNOWN = {
  lost: true,
  quality: "offline",
  reason: "",
  floor: null,
  standing: false,
  robot_door: "moving",
  doors: {},
  motion: "unknown",
  mode: "unknown",
  permissions: {},
  destination: null,
  session: null,
  releases_in_s: null,
  waiting: null,
  restrictions: { fire_latched: false, lockout: "", drain: "", maybe_occupied_by: null, distrusted: "", waiting_for: "" },
};

/** Whether the manager has vouched for this state within the lift's `max_age_s`. `vouchedAt` is when it last did. */
export function isCurrent(lift, vouchedAt, now) {
  return now - vouchedAt <= lift.max_age_s * 1000;
}

/** The lift without anything that may have changed since: its name, floors and limits. `lost` says that this page has no news of it. */
export function lost(lift) {
  return { ...lift, ...UNKNOWN };
}

/** Seconds that a value which was `seconds` at the time `at` is now; null stays null. */
export function grown(seconds, at, now) {
  return seconds === null || seconds === undefined ? null : seconds + Math.max(0, now - at) / 1000;
}
