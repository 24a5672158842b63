/**
 * The session of this page on a lift. Its lease is short and renewed only while the page is open: a page that is closed lets go.
 * The id is kept for a reload of this tab alone.
 */

import { liftPath, RequestFailed } from "./api.js";

const LEASE_S = 60;
const RENEW_EVERY_MS = 20_000;
const OUTCOME_WITHIN_S = 8;
const ROBOT = "page";

const timers = new Map();
const keptAs = (lift) => `lift-manager-session-${lift}`;

export function ownSession(lift) {
  return sessionStorage.getItem(keptAs(lift));
}

/**
 * Send a command, in a session that begins if there is none; returns the command with its outcome.
 * A session that begins with a refusal ends again: it would keep robots waiting for nothing.
 */
export async function command(api, lift, body) {
  const session = ownSession(lift);
  if (session !== null) {
    try {
      return await send(api, lift, session, body);
    } catch (error) {
      if (!isOver(error)) throw error;
      forget(lift);
    }
  }
  const begun = await open(api, lift);
  keep(api, lift, begun);
  try {
    return await send(api, lift, begun, body);
  } catch (error) {
    if (error.status !== 0) await close(api, lift);
    throw error;
  }
}

function send(api, lift, session, body) {
  return api.post(liftPath(lift, `sessions/${session}/commands?wait=${OUTCOME_WITHIN_S}`), body);
}

export async function close(api, lift) {
  const session = ownSession(lift);
  forget(lift);
  if (session === null) return;
  try {
    await api.post(liftPath(lift, `sessions/${session}/close`), {});
  } catch (error) {
    if (!isOver(error)) throw error;
  }
}

/** Go on with the session of this tab after a reload. */
export function resume(api, lift) {
  const session = ownSession(lift);
  if (session !== null && !timers.has(lift)) keep(api, lift, session);
}

async function open(api, lift) {
  const session = await api.post(liftPath(lift, "sessions"), { robot: ROBOT, ttl_s: LEASE_S });
  return session.id;
}

function keep(api, lift, session) {
  sessionStorage.setItem(keptAs(lift), session);
  clearInterval(timers.get(lift));
  const renew = async () => {
    try {
      const { over } = await api.post(liftPath(lift, `sessions/${session}/renew`), {});
      if (over !== null && ownSession(lift) === session) forget(lift);
    } catch (error) {
      if (isOver(error) && ownSession(lift) === session) forget(lift);
    }
  };
  timers.set(lift, setInterval(renew, RENEW_EVERY_MS));
}

function forget(lift) {
  sessionStorage.removeItem(keptAs(lift));
  clearInterval(timers.get(lift));
  timers.delete(lift);
}

function isOver(error) {
  return error instanceof RequestFailed && ["no_such_session", "session_over"].includes(error.code);
}
