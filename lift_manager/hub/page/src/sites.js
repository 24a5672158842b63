/** All sites as a table. A row is drawn again only when something in it has changed: there may be thousands. */

import { Troubles } from "../../page/src/card.js";
import { SIGNS } from "../../page/src/facts.js";
import { Component, html, useEffect, useRef, useState } from "../../page/vendor/htm-preact.js";
import { liftsText, matches, nameOf, needsLook, newsText, stateWord, troubles } from "./words.js";

const COLUMNS = ["site", "state", "news", "lifts", "rows", "version"];
/** Rows that are drawn at first, and how many more whenever the last of them comes near: a thousand at once take a second. */
const STEP = 100;
const NEAR = "1000px";

/** `left` is the site from which somebody came back: the focus returns to it. */
export function Sites({ sites, filter, onFilter, left, texts }) {
  const { t } = texts;
  const table = useRef(null);
  const [most, setMost] = useState(() => STEP + Math.max(0, sites.findIndex(({ id }) => id === left)));
  useEffect(() => table.current?.querySelector(`[data-site="${left}"]`)?.focus(), []);
  if (sites.length === 0) return html`<p class="empty">${t("sites.none")} <code>lift-manager hub site add</code></p>`;
  const found = sites.filter((site) => matches(site, filter.text) && (!filter.trouble || needsLook(site, texts)));
  const change = (changed) => {
    setMost(STEP);
    onFilter({ ...filter, ...changed });
  };
  return html`
    <form class="filter" role="search" onSubmit=${(event) => event.preventDefault()}>
      <label>${t("sites.find")} <input type="search" value=${filter.text} onInput=${(event) => change({ text: event.target.value })} /></label>
      <label class="check"><input type="checkbox" checked=${filter.trouble} onChange=${(event) => change({ trouble: event.target.checked })} />
        ${" "}${t("sites.only_trouble")}</label>
      <span class="quiet" role="status">${t("sites.found", { n: found.length, all: sites.length })}</span>
    </form>
    <table class="sites" ref=${table} aria-rowcount=${found.length + 1}>
      <caption class="hidden">${t("sites.title")}</caption>
      <thead><tr>${COLUMNS.map((name) => html`<th scope="col" key=${name} class=${name}>${t(`sites.column.${name}`)}</th>`)}</tr></thead>
      <tbody>${found.slice(0, most).map((site) => html`<${Row} key=${site.id} site=${site} texts=${texts} />`)}</tbody>
    </table>
    ${found.length > most && html`<${More} key=${most} n=${found.length - most} texts=${texts} onMore=${() => setMost(most + STEP)} />`}`;
}

/** Shows more rows when it comes near, or is pressed. */
function More({ n, texts, onMore }) {
  const button = useRef(null);
  useEffect(() => {
    const observer = new IntersectionObserver(([{ isIntersecting }]) => isIntersecting && onMore(), { rootMargin: NEAR });
    observer.observe(button.current);
    return () => observer.disconnect();
  }, []);
  return html`<p><button type="button" ref=${button} onClick=${onMore}>${texts.t("sites.more", { n })}</button></p>`;
}

/** What of a site its row shows. */
function factsOf(site, texts) {
  return {
    name: nameOf(site),
    state: stateWord(site, texts),
    found: troubles(site, texts),
    news: newsText(site, texts),
    lifts: liftsText(site, texts),
    rows: site.rows_behind ?? "–",
    version: site.version || "–",
    unknown: site.state === "unknown",
  };
}

class Row extends Component {
  #facts = null;

  shouldComponentUpdate({ site, texts }) {
    return JSON.stringify(factsOf(site, texts)) !== this.#facts;
  }

  render({ site, texts }) {
    const facts = factsOf(site, texts);
    this.#facts = JSON.stringify(facts);
    return html`<tr class=${facts.unknown ? "unknown" : ""}>
      <th scope="row"><a href=${`#/${site.id}`} data-site=${site.id}>${facts.name}</a>${facts.name !== site.id && html` <span class="quiet">${site.id}</span>`}</th>
      <td class="state">${facts.state}<${Troubles} found=${facts.found} /></td>
      <td class="news" data-label=${texts.t("sites.column.news")}>${facts.news}</td>
      <td class="lifts" data-label=${texts.t("sites.column.lifts")}>${facts.lifts}</td>
      <td class="rows">${facts.rows}</td>
      <td class="version">${facts.version}</td>
    </tr>`;
  }
}

/** How many sites there are and how many need attention; read aloud when it changes. */
export function Summary({ sites, connection, texts }) {
  const { t } = texts;
  const parts = [t("sites.summary", { n: sites.length })];
  const wrong = sites.filter((site) => troubles(site, texts).length > 0).length;
  const unknown = sites.filter(({ state }) => state === "unknown").length;
  const isCut = connection === "cut";
  if (isCut) parts.push(`${SIGNS.warn} ${t("sites.cut")}`);
  else if (wrong) parts.push(`${SIGNS.warn} ${t("summary.warnings", { n: wrong })}`);
  if (unknown && !isCut) parts.push(t("sites.summary.unknown", { n: unknown }));
  return html`<p class=${`summary ${wrong || isCut ? "warn" : "plain"}`} role="status">${connection !== "connecting" && parts.join(" · ")}</p>`;
}
