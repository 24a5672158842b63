/** Keeps a store up to date: the event stream for what changes, and a GET a second, mostly answered by 304, for ages. */

import { liftPath, RequestFailed } from "./api.js";
import { EventParser, readEvents } from "./sse.js";

const AGES_EVERY_MS = 1000;
const TICK_MS = 250;
/** After a pause of this length, of this page or of the stream, what waits in a connection may be old: a new one begins. */
const PAUSE_MS = 3000;
const CAPABILITIES_AT_ONCE = 4;

export class Feed {
  #api;
  #store;
  #parser = new EventParser();
  #lastId = "";
  #connection = new AbortController();
  #etag = "";
  /** Grows with each state of the stream: an answer to an earlier GET is not newer than it. */
  #states = 0;
  #asked = new Set();
  /** Of the clock of this computer, which goes on while it sleeps; that of `performance` may not. */
  #tickAt = Date.now();
  #dataAt = performance.now();
  #asking = false;
  #wake = () => {};

  constructor(api, store) {
    this.#api = api;
    this.#store = store;
  }

  /** Run until the page is closed. */
  start() {
    setInterval(() => this.#tick(), TICK_MS);
    setInterval(() => this.#askAges(), AGES_EVERY_MS);
    document.addEventListener("visibilitychange", () => {
      if (!document.hidden) this.reconnect();
    });
    // a page that the browser keeps to go back to would keep its stream as well, of the six connections that a browser has to one host
    addEventListener("pagehide", () => this.#connection.abort());
    addEventListener("pageshow", ({ persisted }) => {
      if (!persisted) return;
      this.#store.distrust(performance.now());
      this.reconnect();
    });
    this.#stream();
  }

  /** Begin again with a snapshot: after a login, a pause, or on request of a person. */
  reconnect() {
    this.#lastId = "";
    this.#etag = "";
    this.#states += 1;
    this.#asked.clear();
    this.#connection.abort();
    this.#wake();
  }

  #tick() {
    const now = performance.now();
    if (this.#hasSlept()) {
      this.#store.distrust(now);
      this.reconnect();
    } else if (this.#store.connection === "open" && now - this.#dataAt > PAUSE_MS) {
      this.reconnect();
    }
    this.#tickAt = Date.now();
    this.#store.refresh(now);
  }

  #hasSlept() {
    return Math.abs(Date.now() - this.#tickAt) > PAUSE_MS;
  }

  async #stream() {
    for (;;) {
      this.#connection = new AbortController();
      try {
        await this.#read(this.#connection.signal);
        this.#store.setConnection("cut");
      } catch (error) {
        this.#store.setConnection(error.status === 401 ? "login" : "cut");
      }
      await new Promise((resolve) => {
        this.#wake = resolve;
        // without a login there is no use in trying again before somebody has logged in
        if (this.#store.connection !== "login") setTimeout(resolve, this.#parser.retryMs);
      });
    }
  }

  async #read(signal) {
    const headers = { Accept: "text/event-stream" };
    if (this.#lastId) headers["Last-Event-ID"] = this.#lastId;
    const response = await fetch(this.#api.url("events"), { headers, signal, cache: "no-store", credentials: "same-origin" });
    if (!response.ok) {
      const problem = await response.json().catch(() => null);
      throw new RequestFailed(response.status, problem?.code ?? "http_error", problem?.detail ?? "");
    }
    this.#store.setConnection("open");
    this.#parser = new EventParser();
    this.#dataAt = performance.now();
    await readEvents(
      response,
      this.#parser,
      () => this.#delivered(performance.now()),
      ({ event, data, id }) => {
        this.#take(event, JSON.parse(data), performance.now());
        if (id) this.#lastId = id;
      },
    );
  }

  #delivered(now) {
    const paused = now - this.#dataAt > PAUSE_MS || this.#hasSlept();
    this.#dataAt = now;
    if (!paused) this.#store.streamDelivered(now);
    else this.reconnect();
  }

  #take(event, data, now) {
    if (this.#connection.signal.aborted) return;
    const store = this.#store;
    if (event === "snapshot") {
      this.#states += 1;
      this.#etag = "";
      store.setLifts(data.lifts, now);
      store.setRides(data.rides);
      this.#askCapabilities();
    } else if (event === "state") {
      this.#states += 1;
      this.#etag = "";
      store.setLift(data.lift, now);
    } else if (event === "ride") {
      store.setRide(data.ride);
    } else if (event === "command") {
      store.addCommand(data, now);
    } else if (event === "request") {
      store.setRequest(data, now);
    }
  }

  async #askAges() {
    if (this.#asking || document.hidden || this.#store.connection === "login") return;
    this.#asking = true;
    const [sentAt, states] = [performance.now(), this.#states];
    const headers = this.#etag ? { "If-None-Match": this.#etag } : {};
    try {
      const answer = await this.#api.send("GET", "lifts", { headers });
      if (this.#states !== states || this.#hasSlept()) return;
      if (answer.status === 304) {
        const most = answer.headers.get("lift-age-s");
        this.#store.confirm(sentAt, most === null ? null : Number(most));
      } else {
        this.#etag = answer.headers.get("etag") ?? "";
        this.#store.setLifts(answer.body.lifts, sentAt);
      }
    } catch (error) {
      if (error.status === 401) {
        this.#store.setConnection("login");
        this.reconnect();
      }
    } finally {
      this.#asking = false;
    }
  }

  /** Once for each lift: they do not change while the manager runs. */
  async #askCapabilities() {
    const names = this.#store.order.filter((name) => !this.#asked.has(name));
    for (const name of names) this.#asked.add(name);
    const next = async () => {
      for (let name = names.shift(); name !== undefined; name = names.shift()) {
        try {
          this.#store.setCapabilities(name, await this.#api.get(liftPath(name, "capabilities")));
        } catch {
          this.#asked.delete(name); // asked again with the next snapshot
        }
      }
    };
    await Promise.all(Array.from({ length: CAPABILITIES_AT_ONCE }, next));
  }
}
