/** The page as a whole: all sites, or one of them. Which one is in the address, so that one can go back and send a link. */

import { Account, Login } from "../../page/src/login.js";
import { Languages } from "../../page/src/languages.js";
import { html, useEffect, useState } from "../../page/vendor/htm-preact.js";
import { usePoll } from "./poll.js";
import { Site } from "./site.js";
import { Sites, Summary } from "./sites.js";
import { shownSites } from "./words.js";

/** Begins again as whoever is logged in now. */
export function App({ api, texts }) {
  const [logins, setLogins] = useState(0);
  return html`<${Page} key=${logins} api=${api} texts=${texts} onAccount=${() => setLogins(logins + 1)} />`;
}

function Page({ api, texts, onAccount }) {
  const { t } = texts;
  const poll = usePoll(api, { path: "sites" });
  const open = useOpenSite();
  const [filter, setFilter] = useState({ text: "", trouble: false });
  const [left, setLeft] = useState(null);
  useEffect(() => {
    if (open !== null) setLeft(open);
  }, [open]);
  const connection = connectionOf(poll);
  const sites = shownSites(poll.body, poll.current);
  const site = sites.find(({ id }) => id === open);
  useEffect(() => {
    document.title = open === null ? t("sites.title") : `${open} – ${t("sites.title")}`;
  }, [open]);
  return html`
    <header class="top">
      <h1>${t("sites.title")}</h1>
      ${connection !== "login" && html`<${Summary} sites=${sites} connection=${connection} texts=${texts} />`}
      <nav aria-label=${t("nav")}>
        <${Languages} texts=${texts} />
        <a href="docs">${t("nav.api")}</a>
        <${Account} api=${api} texts=${texts} connection=${connection} onAccount=${onAccount} />
      </nav>
    </header>
    <main>
      ${connection === "login" && html`<${Login} api=${api} texts=${texts} onAccount=${onAccount} />`}
      ${connection === "connecting" && html`<p class="empty">${t("sites.connecting")}</p>`}
      ${poll.body !== null && connection !== "login" && (open === null
        ? html`<${Sites} sites=${sites} filter=${filter} onFilter=${setFilter} left=${left} texts=${texts} />`
        : html`<${Site} key=${open} id=${open} site=${site} api=${api} texts=${texts} onSwitched=${poll.again} />`)}
    </main>`;
}

function connectionOf(poll) {
  if (poll.error?.status === 401) return "login";
  if (poll.current) return "open";
  return poll.body === null && poll.error === null ? "connecting" : "cut";
}

/** The site in the address, as in `#/berlin`; null for all of them. */
function useOpenSite() {
  const [open, setOpen] = useState(inAddress);
  useEffect(() => {
    const changed = () => setOpen(inAddress());
    addEventListener("hashchange", changed);
    return () => removeEventListener("hashchange", changed);
  }, []);
  return open;
}

function inAddress() {
  return /^#\/([a-z0-9-]+)$/.exec(location.hash)?.[1] ?? null;
}
