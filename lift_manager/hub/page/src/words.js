/** What is said of a site in words. Pure. */

import { duration } from "../../page/src/facts.js";

/** A site sends news every two seconds, and is online while there was some in so many (`SILENT_S` of remote_site.py). */
const SILENT_S = 6;
/** More rows than the hub reads at once (`BATCH` of remote_site.py): fewer are on their way, and no sign that the site is behind. */
const BEHIND = 256;

/** A site of which nothing is known but its name; `stale` says that the hub does not reply. */
function unknown(site) {
  return { ...site, stale: true, state: "unknown", news_age_s: null, rows_behind: null, off: null };
}

/** The sites of a reply of the hub; `current` says whether it may be shown as such. */
export function shownSites(body, current) {
  const sites = body?.sites ?? [];
  return current ? sites : sites.map(unknown);
}

/** What is wrong with a site: `{tone, text}` each. */
export function troubles(site, { t }) {
  const warn = (text) => ({ tone: "warn", text });
  if (site.state === "offline") return [warn(t("sites.trouble.offline"))];
  if (site.state === "flooding") return [warn(t("sites.trouble.flooding"))];
  if (site.state === "off") return [warn(t("sites.trouble.off", { by: site.off?.by ?? "?", reason: site.off?.reason ?? "?" }))];
  if (site.state !== "online") return [];
  const found = [];
  if (site.live < site.lifts) found.push(warn(t("sites.trouble.lifts", { n: site.lifts - site.live })));
  if ((site.rows_behind ?? 0) > BEHIND) found.push(warn(t("sites.trouble.behind", { n: site.rows_behind })));
  return found;
}

/** Whether somebody who looks for trouble has to look here: that nothing is known of a site is no trouble, but no sign of health either. */
export function needsLook(site, texts) {
  return site.state === "unknown" || troubles(site, texts).length > 0;
}

/** "Online", "Behind", "Off". */
export function stateWord(site, { t, word }) {
  const isBehind = site.state === "online" && (site.rows_behind ?? 0) > BEHIND;
  return isBehind ? t("sites.behind") : word("sites.state", site.state);
}

/** Its name in the site file, or its id while that is not known. */
export function nameOf(site) {
  return site.name || site.id;
}

/** When the hub last received news of it. Of a site that is online it stays the same text, so that nothing moves while all is well. */
export function newsText(site, { t }) {
  if (site.news_age_s === null) return site.state === "offline" ? t("sites.news.none") : "–";
  if (site.news_age_s < SILENT_S) return t("sites.news.under", { n: SILENT_S });
  return t("time.ago", { time: duration(site.news_age_s, t) });
}

/** How many of its lifts can be read; of a site that is not online, nobody knows. */
export function liftsText(site, { t }) {
  if (site.news_age_s === null) return "–";
  return t("sites.lifts.of", { live: site.state === "online" ? site.live : "–", n: site.lifts });
}

/** Whether the site takes commands, according to its newest news. */
export function commandsText(site, { t }) {
  if (site.news_age_s === null) return "–";
  return t(site.commands ? "site.commands.yes" : "site.commands.no");
}

/** Whether a site is among those that somebody looks for, by its name or id. */
export function matches(site, text) {
  return `${site.id} ${site.name}`.toLowerCase().includes(text.trim().toLowerCase());
}

/** A moment in microseconds since 1970, as the command line prints it; by the time zone of this browser. */
export function momentText(at) {
  return new Date(at / 1000).toLocaleString("sv"); // Swedish: 2026-11-28 15:04:05
}

/** `{when, what, lift, who, text, detail}` of an event of a site; `detail` is a text of a program, in English. */
export function eventText(event, { t, word }) {
  const when = event.at === null ? "–" : momentText(event.at);
  if (event.event === "gap") return { when, what: t("events.gap"), lift: "", who: "", text: t("events.missing", { first: event.first, last: event.last }), detail: "" };
  if (event.event === "update") return { when, what: t("events.update", { n: event.update }), lift: "", who: "", text: word("events.progress", event.progress), detail: event.text };
  if (event.event === "site") return { when, what: t("events.hub"), lift: "", who: "", text: word("sites.state", event.state), detail: event.text };
  return { when, what: word("events.kind", event.kind), lift: event.lift, who: event.caller, text: "", detail: event.text };
}
