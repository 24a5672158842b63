/** The same facts as a table. */

import { html } from "../vendor/htm-preact.js";
import { Age, HeldFor } from "./clock.js";
import { doorText, failedCommand, holder, motion, place, troubles } from "./facts.js";

const COLUMNS = ["lift", "mode", "place", "doors", "motion", "holder", "waiting", "age", "trouble"];

export function LiftTable({ records, texts, onOpen }) {
  const { t } = texts;
  return html`<div class="scroll" tabindex="0" role="region" aria-label=${t("table.caption")}><table class="lifts">
    <caption class="hidden">${t("table.caption")}</caption>
    <thead><tr>${COLUMNS.map((name) => html`<th scope="col" key=${name}>${t(`table.${name}`)}</th>`)}</tr></thead>
    <tbody>${records.map((record) => html`<${Row} key=${record.lift.name} record=${record} texts=${texts} onOpen=${onOpen} />`)}</tbody>
  </table></div>`;
}

function Row({ record, texts, onOpen }) {
  const { shown: lift, capabilities } = record;
  const known = lift.quality === "live";
  const failed = failedCommand(record, texts);
  const title = capabilities?.display_name || lift.name;
  return html`<tr class=${known ? "" : "unknown"}>
    <th scope="row">${onOpen ? html`<button class="link" onClick=${() => onOpen(lift.name)}>${title}</button>` : title}
      ${capabilities?.simulated && html` <span class="badge">${texts.t("simulated")}</span>`}</th>
    <td>${texts.word("mode", lift.mode)}</td>
    <td>${place(lift, record.lastFloor, texts)}</td>
    <td>${doorText(lift, texts)}</td>
    <td>${motion(lift, texts)}</td>
    <td>${holder(lift, texts)} <${HeldFor} record=${record} texts=${texts} /></td>
    <td>${lift.waiting ?? "–"}</td>
    <td><${Age} record=${record} texts=${texts} /></td>
    <td>${troubles(lift, texts).map(({ text, detail }) => html`<div key=${text}>${text} <span lang="en">${detail}</span></div>`)}
      ${failed && html`<div>${texts.t("facts.last_command")}: ${failed.text} <span lang="en">${failed.detail}</span></div>`}</td>
  </tr>`;
}
