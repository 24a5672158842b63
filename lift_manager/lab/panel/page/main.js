/** The panel of simulated lifts: people, faults, and the registers beside the picture. It uses the REST interface of the panel alone. */

import { html, render } from "../page/vendor/htm-preact.js";
import { loadTexts } from "../page/src/texts.js";
import { get } from "./src/api.js";
import { Panel } from "./src/panel.js";

const texts = await loadTexts(new URL("texts/", import.meta.url));
const [overview, kinds] = await Promise.all([get("lifts"), get("faults")]);
document.title = texts.t("panel.title");
render(html`<${Panel} overview=${overview} kinds=${kinds} texts=${texts} />`, document.body);
