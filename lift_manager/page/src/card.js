/** One lift on the page. It is drawn again only when something visible of it has changed. */

import { Component, html } from "../vendor/htm-preact.js";
import { Age, HeldFor } from "./clock.js";
import { SIGNS, doorText, failedCommand, holder, motion, place, troubles, worst } from "./facts.js";
import { Shaft } from "./shaft.js";

export class Card extends Component {
  shouldComponentUpdate(next) {
    return ["shown", "outcome", "capabilities", "texts"].some((name) => next[name] !== this.props[name]);
  }

  render({ record, texts, onOpen }) {
    const { t, word } = texts;
    const { shown: lift, capabilities } = record;
    const found = troubles(lift, texts);
    const known = lift.quality === "live";
    const failed = failedCommand(record, texts);
    const title = capabilities?.display_name || lift.name;
    return html`<article class=${`card tone-${worst(found)} ${known ? "" : "unknown"}`} data-lift=${lift.name}>
      <header>
        <h2>${onOpen ? html`<button class="open" onClick=${() => onOpen(lift.name)}>${title}<span class="hidden"> – ${t("card.open")}</span></button>` : title}</h2>
        <span class="marks">${capabilities?.simulated && html`<span class="badge">${t("simulated")}</span>`}
          <span class=${`mode mode-${lift.mode}`}>${word("mode", lift.mode)}</span></span>
      </header>
      <${Shaft} record=${record} texts=${texts} />
      <div class="facts">
        <p class="place">${known && lift.floor !== null ? lift.floor : "–"}</p>
        <p class="where">${place(lift, record.lastFloor, texts)}</p>
        <p>${t("facts.doors")}: ${doorText(lift, texts)}</p>
        <p>${known ? motion(lift, texts) : ""}</p>
        <p>${holder(lift, texts)} <${HeldFor} record=${record} texts=${texts} /></p>
        ${failed && html`<p class="failed">${t("facts.last_command")}: ${failed.text} <span lang="en">${failed.detail}</span></p>`}
        ${lift.waiting > 0 && html`<p>${t("facts.waiting", { n: lift.waiting })}</p>`}
        <p class="data quiet"><${Age} record=${record} texts=${texts} /></p>
      </div>
      <${Troubles} found=${found} />
      ${capabilities?.simulated && html`<div class="watermark" aria-hidden="true" data-text=${t("simulated")}></div>`}
    </article>`;
  }
}

/** What is wrong, each with a sign and a word, so that colour alone says nothing. */
export function Troubles({ found }) {
  if (!found.length) return null;
  return html`<ul class="troubles">${found.map(({ tone, text, detail }) => html`<li class=${`trouble ${tone}`} key=${text}>
      <span class="sign" aria-hidden="true">${SIGNS[tone]}</span><span><strong>${text}</strong>${detail && html` <span lang="en">${detail}</span>`}</span></li>`)}</ul>`;
}
