/** A GET that is repeated while the page can be seen. There is no connection that has to be kept, so there is none that can be lost. */

import { useEffect, useState } from "../../page/vendor/htm-preact.js";

/** As often as a site sends news; a site without news for three times as long is offline, and a hub without a reply lost. */
const EVERY_MS = 2000;
const CURRENT_MS = 3 * EVERY_MS;
const TICK_MS = 250;

export class Poll {
  /** The newest reply; null before the first. */
  body = null;
  /** When the request for it was sent, in milliseconds of `performance.now()`: what it says was true then or later. */
  sentAt = 0;
  /** Why the newest request failed, a RequestFailed; null if it did not. */
  error = null;
  /** `sentAt` by the clock of the day, which goes on while this computer sleeps; that of `performance` may not. */
  #sentOnDay = -Infinity;
  #api;
  #options;
  #timer = null;
  #ticking = null;
  /** Grows with each request: the reply to an earlier one counts no more. */
  #turn = 0;
  #wasCurrent = false;

  /**
   * `path` is requested every `everyMs()` milliseconds; a reply is current for `currentMs`. `onChange()` is called after each reply, and when
   * the newest one is current no more.
   */
  constructor(api, { path, everyMs = () => EVERY_MS, currentMs = CURRENT_MS, onChange }) {
    this.#api = api;
    this.#options = { path, everyMs, currentMs, onChange };
  }

  start() {
    document.addEventListener("visibilitychange", this.again);
    this.#ticking = setInterval(() => this.current !== this.#wasCurrent && this.#change(), TICK_MS);
    this.again();
  }

  stop() {
    document.removeEventListener("visibilitychange", this.again);
    clearInterval(this.#ticking);
    clearTimeout(this.#timer);
    this.#turn += 1;
  }

  /** Whether the newest reply may be shown as current. A clock that was set counts as sleep: it is over with the next reply. */
  get current() {
    return this.body !== null && Math.abs(Date.now() - this.#sentOnDay) <= this.#options.currentMs;
  }

  /** Request it now, such as after a change. */
  again = async () => {
    clearTimeout(this.#timer);
    if (document.hidden) return;
    this.#turn += 1;
    const turn = this.#turn;
    const [sentAt, sentOnDay] = [performance.now(), Date.now()];
    let [body, error] = [null, null];
    try {
      body = await this.#api.get(this.#options.path);
    } catch (failed) {
      error = failed;
    }
    if (turn !== this.#turn) return;
    this.error = error;
    if (error === null) {
      Object.assign(this, { body, sentAt });
      this.#sentOnDay = sentOnDay;
    }
    this.#change();
    // whoever is not logged in gets nothing before there is a login, which begins a new poll
    if (error?.status !== 401) this.#timer = setTimeout(this.again, Math.max(0, this.#options.everyMs() - (performance.now() - sentAt)));
  };

  #change() {
    this.#wasCurrent = this.current;
    this.#options.onChange();
  }
}

/** Poll while the calling component is shown, and draw it after each change. `onReply(poll)` is called before that. */
export function usePoll(api, options, onReply = () => {}) {
  const [, draw] = useState(0);
  const [poll] = useState(() => new Poll(api, { ...options, onChange }));
  function onChange() {
    onReply(poll);
    draw((count) => count + 1);
  }
  useEffect(() => {
    poll.start();
    return () => poll.stop();
  }, []);
  return poll;
}
