/** The lobby view: for people who wait for one lift. No controls, and never an instruction to passengers. */

import { Announcements } from "./src/announcements.js";
import { message } from "./src/message.js";
import { Login } from "./src/login.js";
import { start } from "./src/start.js";
import { Component, html, render } from "./vendor/htm-preact.js";

class Lobby extends Component {
  state = { silenced: false };

  componentDidMount() {
    this.props.store.subscribe(() => this.forceUpdate());
  }

  async componentDidUpdate() {
    const { store, name, announcements } = this.props;
    const record = store.record(name);
    if (record === undefined) return;
    await announcements.show(message(record.shown, store.ridesOf(name)).key, performance.now());
    if (announcements.silenced !== this.state.silenced) this.setState({ silenced: announcements.silenced });
  }

  render({ store, api, texts, onAccount, name }, { silenced }) {
    const { t } = texts;
    const record = store.record(name);
    if (store.connection === "login") return html`<main><${Login} api=${api} texts=${texts} onAccount=${onAccount} /></main>`;
    if (record === undefined) return html`<main class="unknown"><p class="message">${store.order.length ? t("lobby.no_such_lift") : t("lobby.unknown")}</p></main>`;
    const { shown: lift, capabilities } = record;
    const { key, tone, values } = message(lift, store.ridesOf(name));
    return html`<main class=${`tone-${tone} ${key === "unknown" ? "unknown" : ""}`} data-message=${key}>
      <h1>${capabilities?.display_name || lift.name}</h1>
      <p class="floor" style=${{ "--letters": (lift.floor ?? "").length || 1 }} aria-label=${t("place.at", { floor: lift.floor ?? "?" })}>${lift.floor ?? "–"}</p>
      <p class="message" role="status">${t(`lobby.${key}`, values)}</p>
      ${silenced && html`<p class="mute"><svg viewBox="0 0 24 24" role="img" aria-label=${t("lobby.mute")}><path d="M3 9v6h4l5 5V4L7 9zM15 9l6 6m0-6l-6 6" /></svg></p>`}
      ${capabilities?.simulated && html`<p class="simulated">${t("simulated")}</p>`}
    </main>`;
  }
}

const { api, store, texts, onAccount } = await start();
const name = decodeURIComponent(location.pathname.replace(/\/$/, "").split("/").pop());
const announcements = new Announcements();
announcements.load().catch((error) => console.warn(error.message));
document.title = `${texts.t("title")}: ${name}`;
render(html`<${Lobby} store=${store} api=${api} texts=${texts} onAccount=${onAccount} name=${name} announcements=${announcements} />`, document.body);
