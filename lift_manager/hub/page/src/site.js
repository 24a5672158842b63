/** One site: its state, its lifts as it replies about them at this moment, its newest events, and the off switch. */

import { Card, Troubles } from "../../page/src/card.js";
import { Decisions, Outcome, useOutcome } from "../../page/src/decisions.js";
import { duration } from "../../page/src/facts.js";
import { Store } from "../../page/src/store.js";
import { LiftTable } from "../../page/src/table.js";
import { html, useEffect, useRef, useState } from "../../page/vendor/htm-preact.js";
import { Events } from "./events.js";
import { usePoll } from "./poll.js";
import { commandsText, liftsText, momentText, nameOf, newsText, stateWord, troubles } from "./words.js";

/** Replies within the time for which the reading of a lift is good, its `max_age_s`: one may be lost. */
const REPLIES = 2.5;
const [OFTEN_MS, SELDOM_MS] = [250, 2000];
/** As long as a reply is waited for by the hub; shorter limits are those of the lifts. */
const CURRENT_MS = 2000;
const REFRESH_MS = 250;
/** What is said instead of the lifts, by the code of the error. */
const WHY_NO_LIFTS = { unreachable: "sites.cut", site_silent: "site.cut" };
/** Roles that may switch a site off. The hub decides; the page only leaves out a switch that would do nothing. */
const OPERATING = ["operator", "commissioner"];

/** `onSwitched()` is called once the site was switched off or on. */
export function Site({ id, site, api, texts, onSwitched }) {
  const { t } = texts;
  const heading = useRef(null);
  useEffect(() => heading.current.focus(), []);
  return html`<p><a href="#/">${t("site.all")}</a></p>
    <h2 ref=${heading} tabindex="-1" class="site-name">${site ? nameOf(site) : id}${site && nameOf(site) !== id && html` <span class="quiet">${id}</span>`}</h2>
    ${site === undefined ? html`<p class="empty">${t("site.none", { id })}</p>` : html`
      <${Troubles} found=${troubles(site, texts)} />
      <${Facts} site=${site} texts=${texts} />
      <section aria-labelledby="lifts-title"><h3 id="lifts-title">${t("site.lifts")}</h3>
        ${site.state === "off" ? html`<p>${t("site.off")}</p>` : html`<${Lifts} id=${id} api=${api} texts=${texts} />`}</section>
      <${OffSwitch} site=${site} api=${api} texts=${texts} onSwitched=${onSwitched} />
      <${Events} id=${id} api=${api} texts=${texts} />`}`;
}

function Facts({ site, texts }) {
  const { t } = texts;
  const rows = [
    ["state", stateWord(site, texts)],
    ["news", newsText(site, texts)],
    ["lifts", liftsText(site, texts)],
    ["rows", site.rows_behind ?? "–"],
    ["version", site.version || "–"],
    ["commands", commandsText(site, texts)],
  ];
  if (site.off) rows.push(["off", `${site.off.by}, ${momentText(Date.parse(site.off.at) * 1000)}`]);
  return html`<dl class="site-facts">${rows.map(([key, value]) => html`<div key=${key}><dt>${t(`sites.column.${key}`)}</dt><dd>${value}</dd></div>`)}</dl>`;
}

/** The lifts, requested from the site again and again. What it does not confirm within `max_age_s` is not known. */
function Lifts({ id, api, texts }) {
  const { t } = texts;
  const [store] = useState(() => new Store());
  const [, draw] = useState(0);
  const [table, setTable] = useState(false);
  const options = { path: `sites/${id}/lifts`, everyMs: () => (poll.error === null ? periodOf(store) : SELDOM_MS), currentMs: CURRENT_MS };
  const poll = usePoll(api, options, ({ body, sentAt, error, current }) => {
    if (error === null && current) store.setLifts(body.lifts, sentAt);
    else store.distrust(performance.now());
  });
  useEffect(() => {
    const leave = store.subscribe(() => draw((count) => count + 1));
    const timer = setInterval(() => store.refresh(performance.now()), REFRESH_MS);
    return () => {
      leave();
      clearInterval(timer);
    };
  }, []);
  const records = store.records();
  const isLive = poll.error === null && poll.current;
  const cut = poll.error && { tone: "warn", text: t(WHY_NO_LIFTS[poll.error.code] ?? "site.no_lifts"), detail: poll.error.detail };
  return html`
    <div role="alert">${cut && html`<${Troubles} found=${[cut]} />`}</div>
    ${records.length > 0 && html`<div class="buttons">
      <button type="button" aria-pressed=${table ? "true" : "false"} onClick=${() => setTable(!table)}>${t("view.table")}</button>
      ${isLive && html`<span class="quiet">${t("site.live", { trip: tripText(poll.body.round_trip_s, texts) })}</span>`}</div>`}
    ${poll.body === null && poll.error === null && html`<p class="empty">${t("loading")}</p>`}
    ${records.length > 0 && (table
      ? html`<${LiftTable} records=${records} texts=${texts} />`
      : html`<div class="cards">${records.map((record) => html`<${Card} key=${record.lift.name} record=${record} shown=${record.shown} outcome=${record.outcome}
          capabilities=${null} texts=${texts} />`)}</div>`)}`;
}

/** How long request and reply took. */
function tripText(seconds, { t }) {
  return seconds < 1 ? t("time.ms", { n: Math.max(1, Math.round(seconds * 1000)) }) : duration(seconds, t);
}

function periodOf(store) {
  const shortest = Math.min(...store.records().map(({ lift }) => lift.max_age_s));
  return Math.min(SELDOM_MS, Math.max(OFTEN_MS, (shortest * 1000) / REPLIES));
}

function OffSwitch({ site, api, texts, onSwitched }) {
  const { t } = texts;
  const { run, busy, outcome } = useOutcome(texts);
  const place = useRef(null);
  // the form stays as it is while the hub does not reply
  const isOff = useRef(null);
  if (!site.stale) isOff.current = site.off !== null;
  const role = api.account?.role ?? null;
  if (isOff.current === null || (role !== null && !OPERATING.includes(role))) return null;
  const done = () => {
    place.current.focus();
    onSwitched();
  };
  const decision = isOff.current ? { key: "site_on", path: `sites/${site.id}/on` } : { key: "site_off", path: `sites/${site.id}/off`, reason: true };
  return html`<section class="actions" aria-labelledby="off-title"><h3 id="off-title">${t("site.switch")}</h3>
    <${Decisions} decisions=${[decision]} values=${{ site: site.id }} api=${api} texts=${texts} run=${run} busy=${busy} onDone=${done} />
    <${Outcome} outcome=${outcome} texts=${texts} place=${place} />
  </section>`;
}
