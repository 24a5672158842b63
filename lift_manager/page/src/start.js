/** Starts a view: texts, login, feed. */

import { Api } from "./api.js";
import { Feed } from "./feed.js";
import { Store } from "./store.js";
import { loadTexts } from "./texts.js";

/** Returns `{api, store, texts, logIn}` with the feed running. */
export async function start() {
  const texts = await loadTexts();
  const [api, store] = [new Api(), new Store()];
  const feed = new Feed(api, store);
  feed.start();
  /** Use this key from now on; empty to forget the one in use, and all that was read with it. */
  const logIn = (key) => {
    api.setKey(key);
    store.clear();
    feed.reconnect();
  };
  return { api, store, texts, logIn };
}
