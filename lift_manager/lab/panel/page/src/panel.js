/** The panel as a whole: which lift, its picture, what people and faults do to it, and its registers. */

import { Component, html } from "../../page/vendor/htm-preact.js";
import { Languages } from "../../page/src/languages.js";
import { Refused, get, post } from "./api.js";
import { Changes } from "./changes.js";
import { Faults } from "./faults.js";
import { People } from "./people.js";
import { Picture } from "./picture.js";
import { Registers } from "./registers.js";

const EVERY_MS = 250;
const LOST_AFTER_MS = 2000;

export class Panel extends Component {
  state = { name: this.#chosen(), lift: null, lost: false, message: "" };
  #changes = new Changes();
  #sent = 0;
  #applied = 0;
  #newsAt = performance.now();

  componentDidMount() {
    this.#poll();
  }

  render({ overview, kinds, texts }, { name, lift, lost, message }) {
    const { t } = texts;
    const act = (path, body) => this.#act(path, body);
    return html`
      <header class="top">
        <h1>${t("panel.title")}</h1>
        ${overview.lifts.length > 1 && html`<div class="tabs" role="group" aria-label=${t("panel.lifts")}>${overview.lifts.map(
          (one) => html`<button key=${one} aria-pressed=${one === name ? "true" : "false"} onClick=${() => this.#choose(one)}>${one}</button>`,
        )}</div>`}
        <nav aria-label=${t("nav")}>
          ${overview.manager && html`<a href=${overview.manager} target="_blank" rel="noopener">${t("panel.manager")}</a>`}
          <a href="docs">${t("nav.api")}</a>
          <${Languages} texts=${texts} />
        </nav>
      </header>
      <main class=${`panel ${lost ? "lost" : ""}`}>
        ${lost && html`<p class="trouble warn wide" role="alert">⚠ ${t("panel.lost")}</p>`}
        ${message && html`<p class="trouble warn wide" role="alert">⚠ ${message} <button onClick=${() => this.setState({ message: "" })}>${t("close")}</button></p>`}
        ${lift === null
          ? html`<p class="empty">${t("loading")}</p>`
          : html`
              <${Picture} key=${name} lift=${lift} lost=${lost} texts=${texts} act=${act} />
              <fieldset class="controls" disabled=${lost}>
                <${People} lift=${lift} texts=${texts} act=${act} />
                <${Faults} key=${name} lift=${lift} kinds=${kinds} texts=${texts} act=${act} />
              </fieldset>
              <${Registers} lift=${lift} lost=${lost} changes=${this.#changes} texts=${texts} />`}
      </main>`;
  }

  /** The lift in the address, or the first one. */
  #chosen() {
    const { lifts } = this.props.overview;
    const wanted = decodeURIComponent(location.hash.slice(1));
    return lifts.includes(wanted) ? wanted : lifts[0];
  }

  #choose(name) {
    location.replace(`#${encodeURIComponent(name)}`);
    this.#changes = new Changes();
    this.setState({ name, lift: null, message: "" });
    this.#read();
  }

  async #poll() {
    for (;;) {
      if (!document.hidden) await this.#read();
      await new Promise((resolve) => setTimeout(resolve, EVERY_MS));
    }
  }

  async #read() {
    const { name } = this.state;
    try {
      await this.#apply(name, get(`lifts/${encodeURIComponent(name)}`));
    } catch {
      if (performance.now() - this.#newsAt > LOST_AFTER_MS) this.setState({ lost: true });
    }
  }

  async #act(path, body) {
    const { name } = this.state;
    try {
      await this.#apply(name, post(`lifts/${encodeURIComponent(name)}/${path}`, body));
      this.setState({ message: "" });
      return true;
    } catch (error) {
      this.setState({ message: error instanceof Refused ? error.message : this.props.texts.t("panel.not_sent") });
      return false;
    }
  }

  /** Show an answer, unless one to a later request was shown already. */
  async #apply(name, request) {
    const number = (this.#sent += 1);
    const lift = await request;
    this.#newsAt = performance.now();
    if (number < this.#applied || name !== this.state.name) return;
    this.#applied = number;
    this.#changes.take(lift.registers, performance.now());
    this.setState({ lift, lost: false });
  }
}
