/** Texts that change with time alone; they are drawn again by themselves, so that nothing else has to be. */

import { html, useEffect, useState } from "../vendor/htm-preact.js";
import { duration } from "./facts.js";
import { grown } from "./freshness.js";

const EVERY_MS = 500;
const drawers = new Set();
setInterval(() => {
  if (!document.hidden) for (const draw of drawers) draw();
}, EVERY_MS);

/** Draw the calling component every half second; returns the time. */
export function useNow() {
  const [now, setNow] = useState(performance.now());
  useEffect(() => {
    const draw = () => setNow(performance.now());
    drawers.add(draw);
    return () => drawers.delete(draw);
  }, []);
  return now;
}

/** How old the data of a lift are. */
export function Age({ record, texts }) {
  const age = grown(record.ageS, record.ageAt, useNow());
  const key = record.shown.quality === "live" ? "age.live" : "age.old";
  return html`<span class="age">${age === null ? texts.t("age.never") : texts.t(key, { age: duration(age, texts.t) })}</span>`;
}

/** For how long the lift has been held; nothing while nobody holds it. */
export function HeldFor({ record, texts }) {
  const now = useNow();
  if (!record.shown.session || !record.lift.session) return null;
  const { session } = record.lift;
  return html`<span class="since">${texts.t("holder.for", { time: duration(grown(session.for_s, record.at, now), texts.t) })}</span>`;
}
