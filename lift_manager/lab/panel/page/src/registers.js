/** The registers as a client reads them. What has changed is marked by a sign, by its old value and by a frame, never by colour alone. */

import { html } from "../../page/vendor/htm-preact.js";
import { duration } from "../../page/src/facts.js";

export function Registers({ lift, lost, changes, texts }) {
  const { t } = texts;
  const columns = ["name", "value", "raw", "printed", "wire", "writer"];
  const unknown = lost || !lift.is_on_network;
  return html`<section class="registers" aria-labelledby="registers">
    <h2 id="registers">${t("panel.registers")}</h2>
    ${!lift.is_on_network && html`<p class="trouble warn">⚠ ${t("panel.silent")}</p>`}
    <div class="scroll" tabindex="0" role="region" aria-labelledby="registers"><table>
      <thead><tr>${columns.map((column) => html`<th key=${column} scope="col">${t(`register.${column}`)}</th>`)}</tr></thead>
      <tbody>${lift.registers.map((register) => html`<${Row} key=${register.name} register=${register} unknown=${unknown}
        change=${unknown ? null : changes.of(register.name, performance.now())} texts=${texts} />`)}</tbody>
    </table></div>
    <p class="quiet">${t("register.help")}</p>
  </section>`;
}

function Row({ register, unknown, change, texts }) {
  const { t } = texts;
  const { name, read_back: readBack, written_by: writer } = register;
  const [raw, text] = unknown ? ["?", "?"] : [register.raw.join(" "), register.value];
  const changed = change !== null && !change.counts;
  return html`<tr class=${[unknown ? "unknown" : "", changed ? "changed" : "", register.is_command ? "command" : ""].join(" ")}>
    <th scope="row">${name}</th>
    <td>${changed && html`<span class="sign" aria-hidden="true">◆ </span>`}${change?.counts && html`<span class="quiet" title=${t("register.counts")}>↻ </span>`}${text}
      ${changed && change.before !== null && change.before !== text && html` <span class="was">${t("register.was", { value: change.before })}</span>`}
      ${!unknown && register.is_obeyed === false && html` <span class="was">⚠ ${t("register.not_obeyed")}</span>`}</td>
    <td class="number">${raw}${!unknown && readBack !== null && html` <span class="was">${t("register.reads", { value: readBack.join(" ") })}</span>`}</td>
    <td>${register.addresses.join(", ")}</td>
    <td>${register.wire.replaceAll(/ (?=\d)/g, "\u00a0")}</td>
    <td>${!unknown && writer !== null && html`${writer} <span class="quiet">${t("time.ago", { time: duration(register.written_s, t) })}</span>`}</td>
  </tr>`;
}
