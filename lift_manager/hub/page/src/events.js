/** The newest events of a site: rows of its journal, gaps in it, and what the hub noticed. They are kept by the hub, and may arrive late. */

import { html } from "../../page/vendor/htm-preact.js";
import { usePoll } from "./poll.js";
import { eventText } from "./words.js";

const SHOWN = 100;
const COLUMNS = ["when", "what", "lift", "who", "text"];

export function Events({ id, api, texts }) {
  const { t } = texts;
  const poll = usePoll(api, { path: `sites/${id}/events?most=${SHOWN}` });
  const events = poll.body?.events ?? [];
  return html`<section aria-labelledby="events-title"><h3 id="events-title">${t("events.title")}</h3>
    <p class="quiet">${t("events.help")}</p>
    ${poll.body !== null && !poll.current && html`<p class="trouble warn">${t("sites.cut")}</p>`}
    ${events.length === 0
      ? html`<p class="empty">${t(poll.body === null ? "loading" : "events.none")}</p>`
      : html`<div class="scroll" tabindex="0" role="region" aria-label=${t("events.title")}><table class="events">
          <thead><tr>${COLUMNS.map((name) => html`<th scope="col" key=${name}>${t(`events.column.${name}`)}</th>`)}</tr></thead>
          <tbody>${events.map((event) => html`<${Row} key=${event.number} event=${event} texts=${texts} />`)}</tbody></table></div>`}
  </section>`;
}

function Row({ event, texts }) {
  const { when, what, lift, who, text, detail } = eventText(event, texts);
  return html`<tr><td class="when">${when}</td><td>${what}</td><td>${lift}</td><td>${who}</td><td>${text}${text && detail && ": "}<span lang="en">${detail}</span></td></tr>`;
}
