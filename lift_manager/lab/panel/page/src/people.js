/** What people press, hold and turn: every input of the lift besides the buttons for floors. */

import { html } from "../../page/vendor/htm-preact.js";

const DOOR_INPUTS = ["obstruction", "hold_door", "close_door"];
const SWITCHES = ["overload", "fire", "emergency", "fault", "robot_mode_request"];
const KEYS = ["normal", "independent", "inspection", "out_of_service", "robot"];

export function People({ lift, texts, act }) {
  const { t, word } = texts;
  const { inputs, sides } = lift;
  const set = (changes) => act("inputs", changes);
  const doorSwitch = (input, side) => {
    const on = inputs[input].includes(side);
    const others = inputs[input].filter((one) => one !== side);
    const label = sides.length > 1 ? `${t(`input.${input}`)} (${word("side", side)})` : t(`input.${input}`);
    return html`<${Switch} key=${input + side} on=${on} label=${label} onClick=${() => set({ [input]: on ? others : [...others, side] })} />`;
  };
  return html`<section aria-labelledby="people">
    <h2 id="people">${t("panel.people")}</h2>
    <div class="switches">
      ${DOOR_INPUTS.flatMap((input) => sides.map((side) => doorSwitch(input, side)))}
      ${SWITCHES.map((input) => html`<${Switch} key=${input} on=${inputs[input]} label=${t(`input.${input}`)} onClick=${() => set({ [input]: !inputs[input] })} />`)}
      <${Switch} on=${!inputs.robots_allowed} label=${t("input.robots_allowed")} onClick=${() => set({ robots_allowed: !inputs.robots_allowed })} />
    </div>
    <label class="field">${t("input.key")}
      <select value=${inputs.key} onChange=${(event) => set({ key: event.target.value })}>
        ${KEYS.map((key) => html`<option key=${key} value=${key} selected=${inputs.key === key}>${t(`key.${key}`)}</option>`)}
      </select></label>
    <details>
      <summary>${t("panel.stuck")}</summary>
      ${["landing", "car"].map((button) => html`<fieldset class="floors" key=${button}><legend>${t(`panel.${button}`)}</legend>
        ${lift.floors.map((floor) => {
          const input = `${button}_buttons`;
          const on = inputs[input].includes(floor);
          const others = inputs[input].filter((one) => one !== floor);
          return html`<${Switch} key=${floor} on=${on} label=${floor} onClick=${() => set({ [input]: on ? others : [...others, floor] })} />`;
        })}</fieldset>`)}
    </details>
    <div class="buttons"><button onClick=${() => act("reset")}>${t("panel.reset")}</button></div>
  </section>`;
}

export function Switch({ on, label, onClick }) {
  return html`<button class="switch" aria-pressed=${on ? "true" : "false"} onClick=${onClick}><span class="sign" aria-hidden="true">${on ? "●" : "○"}</span><span>${label}</span></button>`;
}
