/** Faults of the machine, the registers, the network and the wire: the usual ones as switches, all of them in a form. */

import { html, useState } from "../../page/vendor/htm-preact.js";
import { Switch } from "./people.js";

/** Faults that most tests begin with, each with the values that it is begun with. */
const USUAL = [
  { name: "delay", values: { seconds: 1 } },
  { name: "drop_request", values: {} },
  { name: "says_wrong_floor", values: {} },
  { name: "frozen_registers", values: {} },
  { name: "ignored_writes", values: {} },
  { name: "stuck_door", values: {} },
  { name: "power_loss", values: {} },
  { name: "reboot", values: {} },
];
const GROUPS = ["machine", "registers", "network", "wire"];
/** Of a fault of the wire, besides its own values. */
const OF_THE_WIRE = {
  times: { anyOf: [{ type: "integer" }, { type: "null" }], default: null },
  probability: { type: "number", default: 1 },
};

export function Faults({ lift, kinds, texts, act }) {
  const { t } = texts;
  const present = (name) => lift.faults.find((fault) => fault.name === name);
  const bare = ({ name, values }) => ({ name, values });
  return html`<section aria-labelledby="faults">
    <h2 id="faults">${t("panel.faults")}</h2>
    <div class="switches">${USUAL.map((usual) => {
      const fault = present(usual.name);
      return html`<${Switch} key=${usual.name} on=${fault !== undefined} label=${t(`usual.${usual.name}`)}
        onClick=${() => act(fault ? "faults/end" : "faults/begin", bare(fault ?? usual))} />`;
    })}</div>
    <h3>${t("panel.present")}</h3>
    ${lift.faults.length === 0 && html`<p class="quiet">${t("panel.no_fault")}</p>`}
    <ul class="present">${lift.faults.map((fault) => html`<li key=${JSON.stringify(bare(fault))}>
      <span><strong>${t(`fault.${fault.name}`)}</strong> <code>${called(fault)}</code>${fault.struck !== null && html` <span class="quiet">${t("panel.struck", { n: fault.struck })}</span>`}</span>
      <button onClick=${() => act("faults/end", bare(fault))} aria-label=${t("panel.end_of", { fault: t(`fault.${fault.name}`) })}>${t("panel.end")}</button>
    </li>`)}</ul>
    <${Chosen} lift=${lift} kinds=${kinds} texts=${texts} act=${act} />
  </section>`;
}

/** A fault as in a test: `wrong_floor, by=1`. */
function called({ name, values }) {
  return [name, ...Object.entries(values).map(([key, value]) => `${key}=${JSON.stringify(value)}`)].join(", ");
}

function Chosen({ lift, kinds, texts, act }) {
  const { t } = texts;
  const [name, setName] = useState("");
  const [typed, setTyped] = useState({});
  const kind = kinds.find((one) => one.name === name);
  const fields = kind === undefined ? {} : { ...kind.values, ...(kind.group === "wire" ? OF_THE_WIRE : {}) };
  const submit = (event) => {
    event.preventDefault();
    const values = Object.entries(typed).filter(([key, value]) => value !== "" && value !== (fields[key].default ?? null));
    act("faults/begin", { name, values: Object.fromEntries(values) });
  };
  const choose = (event) => {
    setName(event.target.value);
    setTyped({});
  };
  return html`<form onSubmit=${submit} class="chosen">
    <label class="field">${t("panel.any_fault")}
      <select value=${name} onChange=${choose}>
        <option value="">${t("panel.choose")}</option>
        ${GROUPS.map((group) => html`<optgroup key=${group} label=${t(`group.${group}`)}>
          ${kinds.filter((one) => one.group === group).map((one) => html`<option key=${one.name} value=${one.name} selected=${one.name === name}>${t(`fault.${one.name}`)}</option>`)}
        </optgroup>`)}
      </select></label>
    ${kind && html`<p class="quiet" lang="en"><code>${kind.name}</code>: ${kind.about}</p>
      ${Object.entries(fields).map(([key, schema]) => html`<${Value} key=${name + key} name=${key} schema=${schema} lift=${lift} needed=${kind.needs.includes(key)}
        onTyped=${(value) => setTyped({ ...typed, [key]: value })} />`)}
      <div class="buttons"><button type="submit">${t("panel.begin")}</button></div>`}
  </form>`;
}

/** A field for one value of a fault; its name is that of the fixtures and of scenario files. */
function Value({ name, schema, lift, needed, onTyped }) {
  const choices = schema.enum ?? choicesOf(name, lift);
  const label = html`<code>${name}</code>`;
  if (choices) {
    return html`<label class="field">${label}<select required=${needed} onChange=${(event) => onTyped(event.target.value)}>
      ${(needed || schema.default === null) && html`<option value=""></option>`}
      ${choices.map((choice) => html`<option key=${choice} value=${choice} selected=${choice === schema.default}>${choice}</option>`)}
    </select></label>`;
  }
  if (schema.type === "boolean") {
    return html`<label class="field check">${label}<input type="checkbox" checked=${schema.default} onChange=${(event) => onTyped(event.target.checked)} /></label>`;
  }
  const numeric = [schema, ...(schema.anyOf ?? [])].some(({ type }) => type === "number" || type === "integer");
  return html`<label class="field">${label}<input type=${numeric ? "number" : "text"} step="any" required=${needed} placeholder=${schema.default ?? ""}
    onInput=${(event) => onTyped(numeric && event.target.value !== "" ? Number(event.target.value) : event.target.value)} /></label>`;
}

/** Values that depend on the lift. */
function choicesOf(name, lift) {
  if (name === "command") return lift.registers.filter((register) => register.is_command).map((register) => register.name);
  if (name === "signal") return lift.registers.filter((register) => !register.is_command).map((register) => register.name);
  if (name === "floor") return lift.floors;
  return name === "endpoint" ? Object.keys(lift.controllers) : undefined;
}
