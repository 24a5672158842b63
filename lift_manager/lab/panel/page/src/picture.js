/** The shaft with a landing button and a button in the car for each floor, and the same facts in words. */

import { html } from "../../page/vendor/htm-preact.js";
import { Shaft } from "../../page/src/shaft.js";

export function Picture({ lift, lost, texts, act }) {
  const { t } = texts;
  const facts = lost ? [[t("facts.place"), t("place.unknown")]] : factsOf(lift, texts);
  const shown = {
    ...lift.car,
    name: lift.name,
    floors: lift.floors,
    floor: lost ? null : lift.car.last_floor,
    quality: lost ? "offline" : "live",
    position: lift.car.position,
  };
  const downwards = [...lift.floors].reverse();
  const buttons = (button, calls) => html`<div class="buttons-of" role="group" aria-label=${t(`panel.${button}`)}>
    <span class="heading" aria-hidden="true">${t(`panel.${button}`)}</span>
    ${downwards.map((floor) => {
      const lit = !lost && calls.includes(floor);
      return html`<button key=${floor} disabled=${lost} class=${`call ${lit ? "lit" : ""}`} onClick=${() => act("press", { button, floor })}
        aria-label=${t(lit ? `panel.${button}.lit` : `panel.${button}.press`, { floor })}>${floor}${lit ? " ●" : ""}</button>`;
    })}</div>`;
  return html`<section class="picture" style=${{ "--floors": lift.floors.length }} aria-label=${t("panel.picture")}>
    <div class="shaft-row">
      ${buttons("landing", lift.car.landing_calls)}
      <div><span class="heading" aria-hidden="true">${lift.name}</span><${Shaft} record=${{ shown, lastFloor: lift.car.last_floor }} texts=${texts} whole label=${`${lift.name}: ${facts.map(([, text]) => text).join("; ")}`} /></div>
      ${buttons("car", lift.car.car_calls)}
    </div>
    <dl>${facts.map(([name, text]) => html`<div key=${name}><dt>${name}</dt><dd>${text}</dd></div>`)}</dl>
    <p class="quiet">${lift.map}: ${Object.entries(lift.controllers).map(([name, { host, port, unit }]) =>
      t("panel.address", { name: name ? `${name} ` : "", address: `${host}:${port}`, unit })).join(", ")}</p>
  </section>`;
}

function factsOf({ car, is_on_network }, { t, word }) {
  const doors = Object.entries(car.doors);
  const marks = [["is_nudging", "panel.nudging"], ["is_watchdog_tripped", "panel.watchdog"]].filter(([key]) => car[key]);
  return [
    [t("facts.mode"), [word("mode", car.mode), ...marks.map(([, key]) => t(key))].join(", ")],
    [t("facts.place"), car.floor === null ? t("place.left", { floor: car.last_floor }) : t(car.is_level ? "place.at" : "panel.near", { floor: car.floor })],
    [t("facts.doors"), doors.map(([side, door]) => (doors.length > 1 ? `${word("side", side)} ${word("door", door)}` : word("door", door))).join(", ")],
    [t("facts.motion"), car.destination === null || car.destination === car.floor ? word("motion", car.motion) : `${word("motion", car.motion)}, ${t("facts.goal", { floor: car.destination })}`],
    [t("panel.controller"), t(is_on_network ? "panel.answers" : "panel.silent")],
  ];
}
