/** The choice of a language. */

import { html } from "../vendor/htm-preact.js";
import { chooseLanguage } from "./texts.js";

export function Languages({ texts }) {
  return html`<label><span class="hidden">${texts.t("language")}</span>
    <select onChange=${(event) => chooseLanguage(event.target.value)}>${Object.entries(texts.names).map(
      ([code, name]) => html`<option key=${code} value=${code} lang=${code} selected=${code === texts.language}>${name}</option>`,
    )}</select></label>`;
}
