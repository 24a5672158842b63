/** What an operator does to a lift. Only the operator page loads this. Whether the key may do it is decided by the manager alone. */

import { html, useEffect, useRef, useState } from "../vendor/htm-preact.js";
import { liftPath } from "./api.js";
import { commandText, isFireOver, occupantWithoutSession } from "./facts.js";
import { close, command, ownSession, resume } from "./sessions.js";

const NAME = "lift-manager-person";

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
  const [outcome, setOutcome] = useState(null);
  const [decision, setDecision] = useState(null);
  const [busy, setBusy] = useState(false);
  const status = useRef(null);
  useEffect(() => resume(api, lift.name), [lift.name]);
  /** Do it, and say what came of it in a sentence. */
  const run = async (what) => {
    if (busy) return;
    setBusy(true);
    setOutcome({ text: t("actions.sent") });
    try {
      setOutcome(await what());
    } catch (error) {
      setOutcome({ failed: true, text: t("refused", { why: "" }), detail: error.message, code: error.status === 0 ? "" : error.code });
    }
    setBusy(false);
  };
  const commands = capabilities?.access === "control";
  const decisions = DECISIONS.filter(({ fits }) => fits(lift));
  return html`<section class="actions"><h3>${t("actions.title")}</h3>
    ${commands && html`<${Calls} lift=${lift} capabilities=${capabilities} api=${api} texts=${texts} run=${run} busy=${busy} />`}
    ${decisions.length > 0 && html`<div class="buttons">${decisions.map((one) => html`<button type="button" key=${one.key}
      aria-expanded=${decision === one.key ? "true" : "false"} onClick=${() => setDecision(decision === one.key ? null : one.key)}>${t(`actions.${one.key}`)}</button>`)}</div>`}
    ${decisions.filter(({ key }) => key === decision).map((one) => html`<${DecisionForm} key=${one.key} decision=${one} lift=${lift} api=${api} texts=${texts}
      run=${run} busy=${busy} onDone=${() => { setDecision(null); status.current.focus(); }} />`)}
    <p ref=${status} tabindex="-1" role="status" class=${outcome?.failed ? "trouble warn" : "outcome"}>${outcome?.text}${outcome?.detail && html` <span lang="en">${outcome.detail}</span>`}
      ${outcome?.code && html` <a href=${`errors#${outcome.code}`} target="_blank" rel="noopener">${t("refused.more")}</a>`}</p>
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

function DecisionForm({ decision, lift, api, texts, run, busy, onDone }) {
  const { t } = texts;
  const [name, reason, stood] = [useRef(null), useRef(null), useRef(null)];
  const submit = (event) => {
    event.preventDefault();
    const body = { by: name.current.value };
    if (decision.reason) body.reason = reason.current.value;
    if (decision.stood) body.stood_at_lift = stood.current.checked;
    localStorage.setItem(NAME, body.by);
    run(async () => {
      const { text = "" } = await api.post(liftPath(lift.name, decision.path), body);
      onDone();
      return { text: t(`actions.${decision.key}.done`), detail: text };
    });
  };
  return html`<form class="decision" onSubmit=${submit}>
    <p>${t(`actions.${decision.key}.help`)}</p>
    <label>${t("actions.name")} <input ref=${name} required maxlength="64" autocomplete="name" defaultValue=${localStorage.getItem(NAME) ?? ""} /></label>
    ${decision.reason && html`<label>${t("actions.reason")} <input ref=${reason} required maxlength="200" /></label>`}
    ${decision.stood && html`<label class="check"><input ref=${stood} type="checkbox" required /> ${t("actions.stood")}</label>`}
    <button type="submit" aria-disabled=${busy ? "true" : "false"}>${t(`actions.${decision.key}`)}</button>
  </form>`;
}
