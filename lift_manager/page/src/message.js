/** What people in front of a lift are told about robots. Pure. */

const STOPPED = new Set(["fire", "emergency"]);
const USABLE = new Set(["normal", "robot"]);
/** Rides in the order in which they matter to people at the door: the one that is moving comes first. */
const PHASES = ["alighting", "clearing", "boarding", "riding", "called"];

/** Returns `{key, tone, values}`: a text of `lobby.*` and its values. */
export function message(lift, rides) {
  const { restrictions } = lift;
  if (lift.lost) return said("unknown", "warn");
  if (STOPPED.has(lift.mode) || restrictions.fire_latched) return said("stopped", "alarm");
  if (lift.quality !== "live") return said("unknown", "warn");
  if (!USABLE.has(lift.mode) || restrictions.lockout) return said("not_in_use", "plain");
  const ride = PHASES.flatMap((phase) => rides.filter((one) => one.phase === phase))[0];
  if (ride) return ofRide(ride);
  if (restrictions.maybe_occupied_by) return said("maybe_aboard", "plain");
  return said(lift.session ? "in_use" : "none", "plain");
}

function ofRide(ride) {
  const values = { from: ride.from, to: ride.to };
  if (ride.guidance === "enter") return said("enters", "busy", values);
  if (ride.guidance === "leave") return said("leaves", "busy", values);
  return said(ride.phase, "busy", values);
}

function said(key, tone, values = {}) {
  return { key, tone, values };
}
