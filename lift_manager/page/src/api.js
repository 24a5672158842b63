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
  /** As whom this browser acts: `{key, role, csrf}`, all null where the site has no keys; null while that is not known. */
  account = null;

  /** Exchange a key for a login of this browser. The key is not kept; the cookie that stands for it is out of reach of scripts. */
  async logIn(key) {
    this.account = (await this.send("POST", "login", { headers: { Authorization: `Bearer ${key}` } })).body;
  }

  async logOut() {
    await this.post("logout");
    this.account = null;
  }

  async askAccount() {
    this.account = await this.get("login");
  }

  url(path) {
    return new URL(path, BASE);
  }

  /** Returns `{status, body, headers}`; a 304 has no body. Throws RequestFailed. */
  async send(method, path, { body, headers = {}, signal } = {}) {
    const sent = { ...headers };
    if (body !== undefined) sent["Content-Type"] = "application/json";
    let response;
    try {
      response = await fetch(this.url(path), {
        method,
        headers: sent,
        body: body === undefined ? undefined : JSON.stringify(body),
        cache: "no-store",
        credentials: "same-origin",
        signal: signal ?? AbortSignal.timeout(GIVE_UP_MS),
      });
    } catch (error) {
      throw new RequestFailed(0, "unreachable", String(error));
    }
    if (response.status === 304) return { status: 304, body: null, headers: response.headers };
    if (response.status === 401) this.account = null;
    const answer = await response.json().catch(() => null);
    if (!response.ok || answer === null) {
      throw new RequestFailed(response.status, answer?.code ?? "http_error", answer?.detail ?? response.statusText);
    }
    return { status: response.status, body: answer, headers: response.headers };
  }

  async get(path) {
    return (await this.send("GET", path)).body;
  }

  /** Send a change, with the token of the login. */
  async post(path, body) {
    if (this.account === null) await this.askAccount();
    try {
      return (await this.#change(path, body)).body;
    } catch (error) {
      if (error.code !== "csrf_token") throw error;
      // another tab has logged in, and this browser has its cookie
      await this.askAccount();
      return (await this.#change(path, body)).body;
    }
  }

  #change(path, body) {
    const { csrf } = this.account;
    return this.send("POST", path, { body, headers: csrf === null ? {} : { "x-csrf-token": csrf } });
  }
}

export function liftPath(name, rest = "") {
  return `lifts/${encodeURIComponent(name)}${rest && `/${rest}`}`;
}
