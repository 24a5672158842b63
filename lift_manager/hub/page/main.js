/** The operator page of a hub: sites, then the lifts of one. It is made of the parts of a site's page. */

import { Api } from "../page/src/api.js";
import { loadTexts } from "../page/src/texts.js";
import { html, render } from "../page/vendor/htm-preact.js";
import { App } from "./src/app.js";

const texts = await loadTexts(new URL("texts/", import.meta.url));
document.querySelector(".starting").remove();
render(html`<${App} api=${new Api()} texts=${texts} />`, document.body);
