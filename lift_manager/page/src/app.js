/** The page as a whole: what is wrong, every lift, and one of them in detail. */

import { Component, html } from "../vendor/htm-preact.js";
import { Card } from "./card.js";
import { Details } from "./details.js";
import { SIGNS, troubles, worst } from "./facts.js";
import { Languages } from "./languages.js";
import { LiftTable } from "./table.js";

const VIEW = "lift-manager-view";

export class App extends Component {
  state = { open: null, table: new URLSearchParams(location.search).get("view") === "table" || localStorage.getItem(VIEW) === "table" };
  #due = 0;
  #fitted = 0;

  componentDidMount() {
    // once for all that comes within one frame
    if (this.props.fit) {
      addEventListener("resize", () => this.props.fit(this.props.store.order.length));
    }
    this.leave = this.props.store.subscribe(() => {
      this.#due ||= requestAnimationFrame(() => {
        this.#due = 0;
        this.forceUpdate();
      });
    });
  }

  componentDidUpdate() {
    const lifts = this.props.store.order.length;
    if (this.#fitted !== lifts) this.props.fit?.(lifts);
    this.#fitted = lifts;
  }

  componentWillUnmount() {
    this.leave();
  }

  render({ store, api, texts, onAccount, Login, Account, Actions, wall = false }, { open, table }) {
    const { t } = texts;
    const records = store.records();
    const onOpen = wall ? null : (name) => this.setState({ open: name });
    const opened = open === null ? undefined : store.record(open);
    return html`
      <header class="top">
        <h1>${t("title")}</h1>
        ${store.connection !== "login" && html`<${Summary} records=${records} connection=${store.connection} texts=${texts} />`}
        ${!wall && html`<nav aria-label=${t("nav")}>
          <button aria-pressed=${table ? "true" : "false"} onClick=${() => this.#showTable(!table)}>${t("view.table")}</button>
          <${Languages} texts=${texts} />
          <a href="docs">${t("nav.api")}</a>
          ${Account && html`<${Account} api=${api} texts=${texts} connection=${store.connection} onAccount=${onAccount} />`}
        </nav>`}
      </header>
      <main>
        ${store.connection === "login" && html`<${Login} api=${api} texts=${texts} onAccount=${onAccount} />`}
        ${records.length === 0 && store.connection !== "login" && html`<p class="empty">${t(`connection.${store.connection}`)}</p>`}
        ${table && !wall
          ? html`<${LiftTable} records=${records} texts=${texts} onOpen=${onOpen} />`
          : html`<div class=${`cards ${wall ? "big" : ""}`}>${records.map(
              (record) => html`<${Card} key=${record.lift.name} record=${record} shown=${record.shown} outcome=${record.outcome}
                capabilities=${record.capabilities} texts=${texts} onOpen=${onOpen} />`,
            )}</div>`}
      </main>
      ${opened && store.connection !== "login" && html`<${Details} key=${open} record=${opened} store=${store} api=${api} texts=${texts} Actions=${Actions}
        onClose=${() => this.setState({ open: null })} />`}`;
  }

  #showTable(table) {
    localStorage.setItem(VIEW, table ? "table" : "pictures");
    this.setState({ table });
  }
}

/** How many lifts there are and what is wrong with them; read aloud when it changes. */
function Summary({ records, connection, texts }) {
  const { t } = texts;
  const each = records.map(({ shown }) => worst(troubles(shown, texts)));
  const [alarms, warnings] = ["alarm", "warn"].map((tone) => each.filter((one) => one === tone).length);
  const cut = connection === "cut" || records.some(({ shown }) => shown.lost);
  const tone = alarms ? "alarm" : warnings || cut ? "warn" : "plain";
  const parts = [t("summary.lifts", { n: records.length })];
  if (alarms) parts.push(`${SIGNS.alarm} ${t("summary.alarms", { n: alarms })}`);
  if (warnings && !cut) parts.push(`${SIGNS.warn} ${t("summary.warnings", { n: warnings })}`);
  if (cut) parts.push(`${SIGNS.warn} ${t("connection.cut")}`);
  return html`<p class=${`summary ${tone}`} role="status">${parts.join(" · ")}</p>`;
}
