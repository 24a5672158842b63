/** What an operator does to a lift. Only the operator page loads this. Whether the key may do it is decided by the manager alone. */

import { html, useEffect, useRef, useState } from "../vendor/htm-preact.js";
import { liftPath } from "./api.js";
import { Decisions, Outcome, useOutcome } from "./decisions.js";
import { commandText, isFireOver, occupantWithoutSession } from "./facts.js";
import { close, command, ownSession, resume } from "./sessions.js";

/** Decisions of people: their path, what is asked for, and when they make sense. `stood`: only who stood at the lift may say so. */
const DECISIONS = [
  { key: "force_release", path: "session/force-release", reason: true, fits: (lift) => lift.session !== null },
  { key: "acknowledge", path: "acknowledge", stood: true, fits: needsAcknowledgement },
  { key: "lockout", path: "lockout", reason: true, stood: true, fits: (lift) => !lift.restrictions.lockout },
  { key: "end_lockout", path: "lockout/end", stood: true, fits: (lift) => lift.restrictions.lockout },
  { key: "drain", path: "drain", reason: true, fits: (lift) => !lift.restrictions.drain },
  { key: "end_drain", path: "drain/end", fits: (lift) => lift.restrictions.drain },
];

function needsAcknowledgement(lift) {
  return isFireOver(lift) || occupantWithoutSession(lift) || lift.restrictions.distrusted;
}

export function Actions({ record, api, texts }) {
  const { t } = texts;
  const { shown: lift, capabilities } = record;
  const { run, busy, outcome } = useOutcome(texts);
  const status = useRef(null);
  useEffect(() => resume(api, lift.name), [lift.name]);
  const commands = capabilities?.access === "control";
  const decisions = DECISIONS.filter(({ fits }) => fits(lift)).map((one) => ({ ...one, path: liftPath(lift.name, one.path) }));
  return html`<section class="actions"><h3>${t("actions.title")}</h3>
    ${commands && html`<${Calls} lift=${lift} capabilities=${capabilities} api=${api} texts=${texts} run=${run} busy=${busy} />`}
    <${Decisions} decisions=${decisions} api=${api} texts=${texts} run=${run} busy=${busy} onDone=${() => status.current.focus()} />
    <${Outcome} outcome=${outcome} texts=${texts} place=${status} />
  </section>`;
}

function Calls({ lift, capabilities, api, texts, run, busy }) {
  const { t, word } = texts;
  const [hold, setHold] = useState(false);
  const send = (body) =>
    run(async () => {
      const { status, proof, reason } = await command(api, lift.name, body);
      const text = `${commandText([body.do, body.floor].join(" "), texts)}: ${word(`result.${status}`, proof)}`;
      return { failed: status !== "confirmed" && status !== "pending", text, detail: reason };
    });
  const mine = ownSession(lift.name) !== null && lift.session !== null;
  const holds = capabilities.commands.some((name) => name.startsWith("hold_door"));
  return html`
    <fieldset class="floors"><legend>${t("actions.call")}</legend>
      ${[...lift.floors].reverse().map((floor) => html`<button type="button" key=${floor} aria-disabled=${busy ? "true" : "false"}
        onClick=${() => send({ do: "go_to", floor, hold_door: hold })}>${floor}</button>`)}
      ${holds && html`<label><input type="checkbox" checked=${hold} onChange=${(event) => setHold(event.target.checked)} /> ${t("actions.and_hold")}</label>`}
    </fieldset>
    <div class="buttons">
      ${mine && holds && html`<button type="button" aria-disabled=${busy ? "true" : "false"} onClick=${() => send({ do: "hold_door" })}>${t("actions.hold")}</button>`}
      ${mine && holds && html`<button type="button" aria-disabled=${busy ? "true" : "false"} onClick=${() => send({ do: "let_go_door" })}>${t("actions.release_door")}</button>`}
      ${mine && html`<button type="button" aria-disabled=${busy ? "true" : "false"}
        onClick=${() => run(async () => { await close(api, lift.name); return { text: t("actions.released") }; })}>${t("actions.release")}</button>`}
    </div>
    ${mine && html`<p class="quiet">${t("actions.mine")}</p>`}`;
}
