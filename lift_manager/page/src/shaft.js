/** One lift as a picture: its floors, the car where it is known to be, and its doors. */

import { html } from "../vendor/htm-preact.js";
import { sentence } from "./facts.js";

const FLOOR = 30;
const WIDTH = 120;
const [CAR_X, CAR_WIDTH, CAR_HEIGHT] = [44, 44, 26];
/** With more floors than this, only some of them are labelled. */
const LABELS = 14;
const LEAF = { open: 0.12, closed: 1, opening: 0.55, closing: 0.55, moving: 0.55 };

/** `label` replaces the sentence about the lift. A lift with a `position`, in floors above the lowest, is drawn exactly there. */
export function Shaft({ record, texts, label = null }) {
  const { shown: lift, lastFloor } = record;
  const { floors } = lift;
  const height = floors.length * FLOOR;
  const every = Math.ceil(floors.length / LABELS);
  const floorY = (floor) => (floors.length - 1 - floors.indexOf(floor)) * FLOOR;
  const known = lift.quality === "live";
  return html`<svg class=${`shaft ${known ? "" : "unknown"}`} viewBox=${`0 0 ${WIDTH} ${height}`} role="img"
      aria-label=${label ?? sentence(lift, lastFloor, texts)}>
    <${Hatching} id=${`hatch-${lift.name}`} />
    <rect class="well" x=${CAR_X - 4} y="1" width=${CAR_WIDTH + 8} height=${height - 2} />
    ${floors.map((floor) => {
      const y = floorY(floor);
      const labelled = floors.indexOf(floor) % every === 0 || floor === lift.floor;
      return html`<g key=${floor} class=${`floor ${floor === lift.floor ? "here" : ""}`}>
        <line x1=${CAR_X - 4} x2=${CAR_X + CAR_WIDTH + 4} y1=${y + FLOOR - 1} y2=${y + FLOOR - 1} />
        ${labelled && html`<text x=${CAR_X - 10} y=${y + FLOOR / 2} text-anchor="end" dominant-baseline="central">${floor}</text>`}
      </g>`;
    })}
    ${known && goal(lift) !== null && html`<path class="goal" d="M0 0 l9 -6 v12 z"
      transform=${`translate(${CAR_X + CAR_WIDTH + 8} ${floorY(goal(lift)) + FLOOR / 2})`} />`}
    ${known
      ? html`<${Car} lift=${lift} lastFloor=${lastFloor} floorY=${floorY} />`
      : html`<rect class="hatched" x=${CAR_X - 4} y="1" width=${CAR_WIDTH + 8} height=${height - 2} fill=${`url(#hatch-${lift.name})`} />
          <text class="question" x=${CAR_X + CAR_WIDTH / 2} y=${height / 2} text-anchor="middle" dominant-baseline="central">?</text>`}
  </svg>`;
}

function Hatching({ id }) {
  return html`<defs><pattern id=${id} width="8" height="8" patternUnits="userSpaceOnUse" patternTransform="rotate(45)">
    <line class="stripe" x1="0" y1="0" x2="0" y2="8" /></pattern></defs>`;
}

/** Where the car is going, if it is not there. */
function goal(lift) {
  return lift.destination !== null && lift.destination !== lift.floor && lift.floors.includes(lift.destination)
    ? lift.destination
    : null;
}

/** The car; dashed between floors, where only the floor that it left is known. */
function Car({ lift, lastFloor, floorY }) {
  const floor = lift.floor ?? lastFloor;
  if (floor === null) return null;
  const between = lift.floor === null;
  const half = { up: -FLOOR / 2, down: FLOOR / 2 }[lift.motion] ?? 0;
  const floorTop = lift.position === undefined ? floorY(floor) + (between ? half : 0) : (lift.floors.length - 1 - lift.position) * FLOOR;
  const y = floorTop + (FLOOR - CAR_HEIGHT) / 2 - 1;
  const [front, rear] = [lift.doors.front, lift.doors.rear];
  return html`<g class=${`car ${between ? "between" : ""}`} style=${{ transform: `translateY(${y}px)` }}>
    <rect class="cabin" x=${CAR_X} y="0" width=${CAR_WIDTH} height=${CAR_HEIGHT} rx="2" />
    ${front && html`<${Leaves} door=${front} y=${3} height=${CAR_HEIGHT - 6} />`}
    ${rear && html`<${Leaves} door=${rear} y=${front ? -2 : 3} height=${front ? 4 : CAR_HEIGHT - 6} />`}
    <${Arrow} motion=${lift.motion} />
  </g>`;
}

function Leaves({ door, y, height }) {
  const share = LEAF[door];
  const wide = CAR_WIDTH / 2 - 3;
  const leaf = (side, x) => html`<rect class=${`leaf ${side} ${share === undefined ? "doubtful" : ""}`} x=${x} y=${y} width=${wide}
    height=${height} style=${{ transform: `scaleX(${share ?? 1})` }} />`;
  return html`${leaf("left", CAR_X + 2.5)}${leaf("right", CAR_X + CAR_WIDTH / 2 + 0.5)}`;
}

function Arrow({ motion }) {
  const x = CAR_X + CAR_WIDTH + 11;
  const turned = { up: "", down: `rotate(180 ${x} ${CAR_HEIGHT / 2})` }[motion];
  if (turned === undefined) return null;
  return html`<path class="arrow" d=${`M${x} ${CAR_HEIGHT / 2 - 7} l6 9 h-3.5 v5 h-5 v-5 h-3.5 z`} transform=${turned} />`;
}
