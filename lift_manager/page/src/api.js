/** Requests to /api/v1 of the manager that served this page, also behind a proxy that adds a prefix. */

const BASE = new URL("../../api/v1/", import.meta.url);
const GIVE_UP_MS = 10_000;

/** A request that was refused, or did not reach the manager (`status` 0). */
export class RequestFailed extends Error {
  constructor(status, code, detail) {
    super(detail || code);
    this.status = status;
    this.code = code;
    this.detail = detail;
  }
}

export class Api {
  /** The key that a person typed: in the memory of this page and nowhere else, so that it ends with the page. */
  #key = "";

  setKey(key) {
    this.#key = key;
  }

  get hasKey() {
    return this.#key !== "";
  }

  /** The headers of every request. */
  headers() {
    return this.#key ? { Authorization: `Bearer ${this.#key}` } : {};
  }

  url(path) {
    return new URL(path, BASE);
  }

  /** Returns `{status, body, headers}`; a 304 has no body. Throws RequestFailed. */
  async send(method, path, { body, headers = {}, signal } = {}) {
    const sent = { ...this.headers(), ...headers };
    if (body !== undefined) sent["Content-Type"] = "application/json";
    let response;
    try {
      response = await fetch(this.url(path), {
        method,
        headers: sent,
        body: body === undefined ? undefined : JSON.stringify(body),
        cache: "no-store",
        credentials: "omit",
        signal: signal ?? AbortSignal.timeout(GIVE_UP_MS),
      });
    } catch (error) {
      throw new RequestFailed(0, "unreachable", String(error));
    }
    if (response.status === 304) return { status: 304, body: null, headers: response.headers };
    const answer = await response.json().catch(() => null);
    if (!response.ok || answer === null) {
      throw new RequestFailed(response.status, answer?.code ?? "http_error", answer?.detail ?? response.statusText);
    }
    return { status: response.status, body: answer, headers: response.headers };
  }

  async get(path) {
    return (await this.send("GET", path)).body;
  }

  async post(path, body) {
    return (await this.send("POST", path, { body })).body;
  }
}

export function liftPath(name, rest = "") {
  return `lifts/${encodeURIComponent(name)}${rest && `/${rest}`}`;
}
