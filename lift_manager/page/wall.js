/** The wall view: every lift, for people who pass by. It has no controls, and loads none. */

import { App } from "./src/app.js";
import { start } from "./src/start.js";
import { Login } from "./src/login.js";
import { fitWall } from "./src/wall.js";
import { html, render } from "./vendor/htm-preact.js";

const { api, store, texts, onAccount } = await start();
document.title = texts.t("title");
render(html`<${App} store=${store} api=${api} texts=${texts} onAccount=${onAccount} Login=${Login} fit=${fitWall} wall />`, document.body);
