/** Starts a view: texts, login, feed. */

import { Api } from "./api.js";
import { Feed } from "./feed.js";
import { Store } from "./store.js";
import { loadTexts } from "./texts.js";

/** Returns `{api, store, texts, onAccount}` with the feed running. */
export async function start() {
  const texts = await loadTexts();
  document.querySelector(".starting").remove();
  const [api, store] = [new Api(), new Store()];
  const feed = new Feed(api, store);
  /** Forget all that was read, and read it again as whoever is logged in now. */
  const onAccount = () => {
    store.clear();
    feed.reconnect();
  };
  feed.start();
  return { api, store, texts, onAccount };
}
