/** The operator page. */

import { Actions } from "./src/actions.js";
import { App } from "./src/app.js";
import { Account, Login } from "./src/login.js";
import { start } from "./src/start.js";
import { html, render } from "./vendor/htm-preact.js";

const { api, store, texts, onAccount } = await start();
document.title = texts.t("title");
render(html`<${App} store=${store} api=${api} texts=${texts} onAccount=${onAccount} Login=${Login} Account=${Account} Actions=${Actions} />`, document.body);
