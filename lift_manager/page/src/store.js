/** What this page knows of the lifts and rides, and since when. */

import { isCurrent, lost } from "./freshness.js";

const COMMANDS_KEPT = 20;
const TIMES = new Set(["age_s", "for_s", "releases_in_s"]);
const OVER = new Set(["done", "cancelled", "gave_up"]);

/**
 * One lift: `lift` as the manager sent it, `at` when that came, `ageS` its age at `ageAt`, `vouchedAt` when the manager last confirmed it,
 * and `shown` what may be shown of it now. `shown` is another object only if something visible changed. `outcome` is what became of the last
 * press or request of a session, as far as this page has seen it: the manager sends that once.
 */
function newRecord() {
  return {
    lift: null,
    at: 0,
    ageS: null,
    ageAt: 0,
    vouchedAt: -Infinity,
    visible: "",
    shown: null,
    shownOf: null,
    current: false,
    lastFloor: null,
    capabilities: null,
    commands: [],
    outcome: null,
  };
}

/** What of a lift is visible besides times, which the page counts on by itself. */
function withoutTimes(lift) {
  return JSON.stringify(lift, (key, value) => (TIMES.has(key) ? undefined : value));
}

export class Store {
  /** "connecting", "open", "cut" (no stream), or "login" (a key is needed). */
  connection = "connecting";
  /** Names in the order of the site file. */
  order = [];
  rides = new Map();
  #records = new Map();
  #streamAt = -Infinity;
  #listeners = new Set();

  subscribe(listener) {
    this.#listeners.add(listener);
    return () => this.#listeners.delete(listener);
  }

  record(name) {
    return this.#records.get(name);
  }

  records() {
    return this.order.map((name) => this.#records.get(name));
  }

  ridesOf(name) {
    return [...this.rides.values()].filter((ride) => ride.lift === name && !OVER.has(ride.phase));
  }

  setConnection(connection) {
    if (this.connection === connection) return;
    this.connection = connection;
    this.#changed();
  }

  /** The stream has delivered something: what it said before still holds. */
  streamDelivered(now) {
    this.#streamAt = now;
  }

  /** Nothing that came before counts any more: this computer slept, or a new connection begins. */
  distrust(now) {
    this.#streamAt = -Infinity;
    for (const record of this.#records.values()) record.vouchedAt = -Infinity;
    this.refresh(now);
  }

  /** Forget everything. */
  clear() {
    this.#records.clear();
    this.rides.clear();
    this.order = [];
    this.#streamAt = -Infinity;
    this.connection = "connecting";
    this.#changed();
  }

  /** Every lift, from a snapshot or the answer to a GET that was sent at `now`. */
  setLifts(lifts, now) {
    this.order = lifts.map((lift) => lift.name);
    for (const lift of lifts) this.#set(lift, now);
    this.refresh(now);
  }

  setLift(lift, now) {
    if (!this.order.includes(lift.name)) this.order = [...this.order, lift.name];
    this.#set(lift, now);
    this.refresh(now);
  }

  setRides(rides) {
    this.rides = new Map(rides.map((ride) => [ride.id, ride]));
    this.#changed();
  }

  setRide(ride) {
    this.rides.set(ride.id, ride);
    if (OVER.has(ride.phase)) this.rides.delete(ride.id);
    this.#changed();
  }

  setCapabilities(name, capabilities) {
    const record = this.#records.get(name);
    if (!record) return;
    record.capabilities = capabilities;
    this.#changed();
  }

  addCommand(event, now) {
    const record = this.#records.get(event.lift);
    if (!record) return;
    record.commands = [{ ...event, at: now }, ...record.commands].slice(0, COMMANDS_KEPT);
    this.#setOutcome(record, event, now);
  }

  /** A command of a session was accepted, or has ended, whether or not anything was pressed for it. */
  setRequest({ lift, holder, do: name, floor, status, reason }, now) {
    const record = this.#records.get(lift);
    if (record) this.#setOutcome(record, { holder, command: [name, floor].filter(Boolean).join(" "), result: status, reason }, now);
  }

  #setOutcome(record, { holder, command, result, reason }, now) {
    if (holder !== null) record.outcome = { holder, command, result, reason, at: now };
    this.#changed();
  }

  /** The manager confirmed, to a request sent at `sentAt`, that nothing but ages has changed; no live lift is older than `mostS`. */
  confirm(sentAt, mostS) {
    for (const record of this.#records.values()) {
      record.vouchedAt = sentAt;
      if (record.lift.quality !== "live" || mostS === null) continue;
      record.ageS = mostS;
      record.ageAt = sentAt;
    }
    this.refresh(sentAt);
  }

  /** Work out what may be shown now; listeners are called only if that has changed. */
  refresh(now) {
    let changed = false;
    for (const record of this.#records.values()) {
      const current = isCurrent(record.lift, Math.max(this.#streamAt, record.vouchedAt), now);
      if (record.shown !== null && record.visible === record.shownOf && record.current === current) continue;
      record.current = current;
      record.shownOf = record.visible;
      record.shown = current ? record.lift : lost(record.lift);
      record.lastFloor = record.shown.quality === "live" ? (record.shown.floor ?? record.lastFloor) : null;
      changed = true;
    }
    if (changed) this.#changed();
  }

  #set(lift, now) {
    const record = this.#records.get(lift.name) ?? newRecord();
    Object.assign(record, { lift, at: now, ageS: lift.age_s, ageAt: now, vouchedAt: now, visible: withoutTimes(lift) });
    if (lift.session === null) record.outcome = null;
    this.#records.set(lift.name, record);
  }

  #changed() {
    for (const listener of this.#listeners) listener();
  }
}
