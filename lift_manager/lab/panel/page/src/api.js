/** Requests to the panel. All paths are relative, so that they also work behind a proxy that adds a prefix. */

const PATIENCE_MS = 3000;

export function get(path) {
  return answer(path, { cache: "no-store" });
}

export function post(path, body = undefined) {
  return answer(path, {
    method: "POST",
    headers: { "content-type": "application/json" },
    body: body === undefined ? undefined : JSON.stringify(body),
  });
}

/** What was asked of a lift could not be done; the message is the panel's. */
export class Refused extends Error {}

async function answer(path, options) {
  const response = await fetch(path, { ...options, signal: AbortSignal.timeout(PATIENCE_MS) });
  const body = await response.json();
  if (response.ok) return body;
  const { detail } = body;
  throw new Refused(typeof detail === "string" ? detail : detail.map(({ loc, msg }) => `${loc.at(-1)}: ${msg}`).join("; "));
}
