/** All about one lift, in a dialog: facts, signals, the last commands, rides. `Actions` is given only where people may act. */

import { html, useEffect, useRef, useState } from "../vendor/htm-preact.js";
import { liftPath } from "./api.js";
import { Troubles } from "./card.js";
import { Age, HeldFor, useNow } from "./clock.js";
import { commandText, doorText, duration, failedCommand, holder, holderName, motion, place, troubles } from "./facts.js";
import { grown } from "./freshness.js";
import { Shaft } from "./shaft.js";

const SIGNALS_EVERY_MS = 1000;
/** Signals that say why a car does not leave. */
const REPORTS = ["obstruction", "overload"];

export function Details({ record, store, api, texts, Actions, onClose }) {
  const { t } = texts;
  const { shown: lift, capabilities } = record;
  const signals = useSignals(lift.name, api);
  const dialog = useRef(null);
  useEffect(() => dialog.current.showModal(), []);
  return html`<dialog ref=${dialog} class=${`details ${lift.quality === "live" ? "" : "unknown"}`} aria-labelledby="details-title" onClose=${onClose}>
    <header>
      <h2 id="details-title">${capabilities?.display_name || lift.name}</h2>
      <button type="button" onClick=${() => dialog.current.close()}>${t("close")}</button>
    </header>
    ${capabilities?.simulated && html`<p class="simulated">${t("simulated")}</p>`}
    <${Troubles} found=${troubles(lift, texts)} />
    <div class="overview">
      <${Shaft} record=${record} texts=${texts} />
      <${Facts} record=${record} signals=${signals} texts=${texts} />
    </div>
    ${Actions && html`<${Actions} record=${record} api=${api} texts=${texts} />`}
    <${Rides} rides=${store.ridesOf(lift.name)} waiting=${lift.waiting} texts=${texts} />
    <${Commands} commands=${record.commands} texts=${texts} />
    <${Signals} signals=${signals} texts=${texts} />
  </dialog>`;
}

function Facts({ record, signals, texts }) {
  const { t, word } = texts;
  const { shown: lift, capabilities } = record;
  const rows = [
    ["mode", word("mode", lift.mode)],
    ["place", place(lift, record.lastFloor, texts)],
    ["doors", doorText(lift, texts)],
    ["motion", motion(lift, texts)],
    ["robot_door", lift.quality === "live" ? word("robot_door", lift.robot_door) : t("door.unknown")],
    ["holder", html`${holder(lift, texts)} <${HeldFor} record=${record} texts=${texts} />`],
    ["age", html`<${Age} record=${record} texts=${texts} />`],
  ];
  const reports = signals.filter(({ name, value, old }) => !old && value === true && REPORTS.includes(name.split(".")[0]));
  if (reports.length > 0) rows.push(["reports", reports.map(({ name }) => reportText(name, Object.keys(lift.doors), texts)).join(", ")]);
  if (lift.restrictions.waiting_for) rows.push(["waiting_for", html`<span lang="en">${lift.restrictions.waiting_for}</span>`]);
  const failed = failedCommand(record, texts);
  if (failed) rows.push(["last_command", html`${failed.text} <span lang="en">${failed.detail}</span>`]);
  if (capabilities) {
    rows.push(["access", word("access", capabilities.access)], ["map", `${capabilities.map} (${capabilities.trust})`]);
    if (capabilities.robot_hours) rows.push(["robot_hours", capabilities.robot_hours]);
  }
  for (const [signal, why] of Object.entries(lift.not_visible)) {
    rows.push(["not_visible", html`${signal}: <span lang="en">${why}</span>`]);
  }
  return html`<dl>${rows.map(([key, value]) => html`<div key=${`${key}${value}`}><dt>${t(`facts.${key}`)}</dt><dd>${value}</dd></div>`)}</dl>`;
}

/** `obstruction.rear` in words, with the side where there is another. */
function reportText(signal, sides, { word }) {
  const [name, side] = signal.split(".");
  return sides.length > 1 && side ? `${word("report", name)} (${word("side", side)})` : word("report", name);
}

function Rides({ rides, waiting, texts }) {
  const { t, word } = texts;
  return html`<section><h3>${t("rides.title")}</h3>
    <p>${t("facts.waiting", { n: waiting ?? "–" })}</p>
    ${rides.length > 0 && html`<ul>${rides.map((ride) => html`<li key=${ride.id}>
      <strong>${ride.robot || holderName(ride.caller)}</strong>: ${t("rides.trip", { from: ride.from, to: ride.to })}, ${word("phase", ride.phase)},
      ${" "}${word("guidance", ride.guidance)}${ride.ahead ? `, ${t("rides.ahead", { n: ride.ahead })}` : ""}${ride.reason && html` – <span lang="en">${ride.reason}</span>`}</li>`)}</ul>`}
  </section>`;
}

function Commands({ commands, texts }) {
  const { t, word } = texts;
  const now = useNow();
  return html`<section><h3>${t("commands.title")}</h3>
    ${commands.length === 0 ? html`<p>${t("commands.none")}</p>` : html`<ul>${commands.map((one) => html`<li key=${one.at}>
      <strong>${commandText(one.command, texts)}</strong>${one.holder && ` (${holderName(one.holder)})`}:
      ${" "}${word(`result.${one.result}`, one.proof)} <span lang="en">${one.reason}</span>
      ${" "}<span class="quiet">${t("time.ago", { time: duration(grown(0, one.at, now), t) })}</span></li>`)}</ul>`}
  </section>`;
}

/** The signals of a lift, read every second, each with its `age` in seconds by now and whether that is too `old`. */
function useSignals(lift, api) {
  const [answer, setAnswer] = useState(null);
  const now = useNow();
  useEffect(() => {
    let asking = false;
    const ask = async () => {
      if (asking || document.hidden) return;
      asking = true;
      const at = performance.now();
      try {
        setAnswer({ at, ...(await api.get(liftPath(lift, "signals"))) });
      } catch {
        // what was read last stays, and its age grows
      }
      asking = false;
    };
    ask();
    const timer = setInterval(ask, SIGNALS_EVERY_MS);
    return () => clearInterval(timer);
  }, [lift]);
  return (answer?.signals ?? []).map((signal) => {
    const age = grown(signal.age_s, answer.at, now);
    return { ...signal, age, old: age === null || age > answer.max_age_s + SIGNALS_EVERY_MS / 1000 };
  });
}

function Signals({ signals, texts }) {
  const { t } = texts;
  if (signals.length === 0) return html`<section><h3>${t("signals.title")}</h3><p>${t("loading")}</p></section>`;
  return html`<section><h3>${t("signals.title")}</h3><div class="scroll" tabindex="0" role="region" aria-label=${t("signals.title")}><table>
    <thead><tr>${["name", "value", "raw", "address", "age"].map((key) => html`<th scope="col" key=${key}>${t(`signals.${key}`)}</th>`)}</tr></thead>
    <tbody>${signals.map(({ name, value, raw, addresses, age, old }) => html`<tr key=${name} class=${old ? "unknown" : ""}><th scope="row">${name}</th>
        <td>${value === null ? "–" : String(value)}${old && html` <em>${t("signals.old")}</em>`}</td>
        <td>${raw ?? "–"}</td><td>${addresses.join(", ")}</td>
        <td>${age === null ? t("age.never") : duration(age, t)}</td></tr>`)}</tbody></table></div></section>`;
}
