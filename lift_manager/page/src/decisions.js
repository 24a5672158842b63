/** Decisions of people: a form for each, signed with a name, and what came of it. Whether the caller may decide is up to the server alone. */

import { html, useRef, useState } from "../vendor/htm-preact.js";

const NAME = "lift-manager-person";

/** Returns `{run, busy, outcome}`: `run` does something that returns an outcome `{text, detail}`, and makes one of what it throws. */
export function useOutcome(texts) {
  const { t } = texts;
  const [outcome, setOutcome] = useState(null);
  const [busy, setBusy] = useState(false);
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
  return { run, busy, outcome };
}

/** What came of the last action, in a sentence. */
export function Outcome({ outcome, texts, place }) {
  return html`<p ref=${place} tabindex="-1" role="status" class=${outcome?.failed ? "trouble warn" : "outcome"}>${outcome?.text}${outcome?.detail && html` <span lang="en">${outcome.detail}</span>`}
    ${outcome?.code && html` <a href=${`errors#${outcome.code}`} target="_blank" rel="noopener">${texts.t("refused.more")}</a>`}</p>`;
}

/**
 * A button for each decision, which opens its form. A decision has a `key` in `actions.*`, a `path`, and may ask for a `reason` and whether the
 * person `stood` at the lift. `values` are filled into its texts.
 */
export function Decisions({ decisions, values, api, texts, run, busy, onDone }) {
  const { t } = texts;
  const [open, setOpen] = useState(null);
  const done = () => {
    setOpen(null);
    onDone();
  };
  return html`${decisions.length > 0 && html`<div class="buttons">${decisions.map(({ key }) => html`<button type="button" key=${key}
      aria-expanded=${open === key ? "true" : "false"} onClick=${() => setOpen(open === key ? null : key)}>${t(`actions.${key}`, values)}</button>`)}</div>`}
    ${decisions.filter(({ key }) => key === open).map((one) => html`<${DecisionForm} key=${one.key} decision=${one} values=${values} api=${api} texts=${texts}
      run=${run} busy=${busy} onDone=${done} />`)}`;
}

function DecisionForm({ decision, values, api, texts, run, busy, onDone }) {
  const { t } = texts;
  const [name, reason, stood] = [useRef(null), useRef(null), useRef(null)];
  const submit = (event) => {
    event.preventDefault();
    const body = { by: name.current.value };
    if (decision.reason) body.reason = reason.current.value;
    if (decision.stood) body.stood_at_lift = stood.current.checked;
    localStorage.setItem(NAME, body.by);
    run(async () => {
      const { text = "" } = await api.post(decision.path, body);
      onDone();
      return { text: t(`actions.${decision.key}.done`, values), detail: text };
    });
  };
  return html`<form class="decision" onSubmit=${submit}>
    <p>${t(`actions.${decision.key}.help`, values)}</p>
    <label>${t("actions.name")} <input ref=${name} required maxlength="64" autocomplete="name" defaultValue=${localStorage.getItem(NAME) ?? ""} /></label>
    ${decision.reason && html`<label>${t("actions.reason")} <input ref=${reason} required maxlength="200" /></label>`}
    ${decision.stood && html`<label class="check"><input ref=${stood} type="checkbox" required /> ${t("actions.stood")}</label>`}
    <button type="submit" aria-disabled=${busy ? "true" : "false"}>${t(`actions.${decision.key}`, values)}</button>
  </form>`;
}
