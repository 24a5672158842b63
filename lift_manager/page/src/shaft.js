/** One lift as a picture: its floors, the car where it is known to be, and its doors. */

import { html } from "../vendor/htm-preact.js";
import { sentence } from "./facts.js";

/** Sizes in the units of the drawing. A floor is as high as `ROOM`, and less where all of them would be higher than `HEIGHT`. */
const [ROOM, HEIGHT] = [30, 300];
const CAR_WIDTH = 44;
const LEAST_CAR_HEIGHT = 8;
/** Left of the shaft are the names of the floors: room for the longest, up to `LONGEST_NAME`; a longer one is squeezed. */
const [NAME, LONGEST_NAME, LETTER] = [30, 84, 8.4];
const LINE = 13;
const LEAF = { open: 0.12, closed: 1, opening: 0.55, closing: 0.55, moving: 0.55 };

/** The measures of a shaft with these floors. */
function measured(floors, whole) {
  const floor = whole ? ROOM : Math.min(ROOM, Math.max(4, HEIGHT / floors.length));
  const name = whole ? 18 : Math.min(LONGEST_NAME, Math.max(NAME, ...floors.map((one) => one.length * LETTER)));
  const carHeight = Math.max(LEAST_CAR_HEIGHT, floor - 4);
  return { floor, name, carHeight, carX: name + 14, width: name + CAR_WIDTH + 46, every: Math.ceil(LINE / floor) };
}

/**
 * `label` replaces the sentence about the lift. A lift with a `position`, in floors above the lowest, is drawn exactly there.
 * `whole`: every floor has its full height and no name, for buttons that stand beside it.
 */
export function Shaft({ record, texts, label = null, whole = false }) {
  const { shown: lift, lastFloor } = record;
  const { floors } = lift;
  const sizes = measured(floors, whole);
  const { carX } = sizes;
  const height = floors.length * sizes.floor;
  const floorY = (floor) => (floors.length - 1 - floors.indexOf(floor)) * sizes.floor;
  const here = floors.indexOf(lift.floor);
  const known = lift.quality === "live";
  return html`<svg class=${`shaft ${known ? "" : "unknown"}`} viewBox=${`0 0 ${sizes.width} ${height}`} role="img"
      style=${{ "--width": sizes.width / sizes.floor }} aria-label=${label ?? sentence(lift, lastFloor, texts)}>
    <${Hatching} id=${`hatch-${lift.name}`} />
    <rect class="well" x=${carX - 4} y="1" width=${CAR_WIDTH + 8} height=${height - 2} />
    ${floors.map((floor, index) => {
      const y = floorY(floor);
      const hasName = index === here || (index % sizes.every === 0 && (here < 0 || Math.abs(index - here) >= sizes.every));
      const squeezed = floor.length * LETTER > LONGEST_NAME ? LONGEST_NAME : null;
      return html`<g key=${floor} class=${`floor ${floor === lift.floor ? "here" : ""}`}>
        <line x1=${carX - 4} x2=${carX + CAR_WIDTH + 4} y1=${y + sizes.floor - 1} y2=${y + sizes.floor - 1} />
        ${hasName && !whole && html`<text x=${carX - 10} y=${y + sizes.floor / 2} text-anchor="end" dominant-baseline="central"
          textLength=${squeezed} lengthAdjust="spacingAndGlyphs">${floor}</text>`}
      </g>`;
    })}
    ${known && goal(lift) !== null && html`<path class="goal" d="M0 0 l9 -6 v12 z"
      transform=${`translate(${carX + CAR_WIDTH + 8} ${floorY(goal(lift)) + sizes.floor / 2})`} />`}
    ${known
      ? html`<${Car} lift=${lift} lastFloor=${lastFloor} floorY=${floorY} sizes=${sizes} />`
      : html`<rect class="hatched" x=${carX - 4} y="1" width=${CAR_WIDTH + 8} height=${height - 2} fill=${`url(#hatch-${lift.name})`} />
          <text class="question" x=${carX + CAR_WIDTH / 2} y=${height / 2} text-anchor="middle" dominant-baseline="central">?</text>`}
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
function Car({ lift, lastFloor, floorY, sizes }) {
  const floor = lift.floor ?? lastFloor;
  if (floor === null) return null;
  const between = lift.floor === null;
  const half = { up: -sizes.floor / 2, down: sizes.floor / 2 }[lift.motion] ?? 0;
  const floorTop = lift.position === undefined ? floorY(floor) + (between ? half : 0) : (lift.floors.length - 1 - lift.position) * sizes.floor;
  const y = floorTop + (sizes.floor - sizes.carHeight) / 2 - 1;
  const [front, rear] = [lift.doors.front, lift.doors.rear];
  // behind the front door, a strip of the rear door is to be seen above it
  const behind = sizes.carHeight / 6;
  const top = rear ? 3 + behind : 3;
  return html`<g class=${`car ${between ? "between" : ""}`} style=${{ transform: `translateY(${y}px)` }}>
    <rect class="cabin" x=${sizes.carX} y="0" width=${CAR_WIDTH} height=${sizes.carHeight} rx="2" />
    ${front && html`<${Leaves} door=${front} x=${sizes.carX} y=${top} height=${sizes.carHeight - 3 - top} />`}
    ${rear && html`<${Leaves} door=${rear} x=${sizes.carX} y=${front ? 2 : 3} height=${front ? behind : sizes.carHeight - 6} />`}
    <${Arrow} motion=${lift.motion} x=${sizes.carX + CAR_WIDTH + 11} y=${sizes.carHeight / 2} />
  </g>`;
}

function Leaves({ door, x: carX, y, height }) {
  const share = LEAF[door];
  const wide = CAR_WIDTH / 2 - 3;
  const leaf = (side, x) => html`<rect class=${`leaf ${side} ${share === undefined ? "doubtful" : ""}`} x=${x} y=${y} width=${wide}
    height=${height} style=${{ transform: `scaleX(${share ?? 1})` }} />`;
  return html`${leaf("left", carX + 2.5)}${leaf("right", carX + CAR_WIDTH / 2 + 0.5)}`;
}

function Arrow({ motion, x, y }) {
  const turned = { up: "", down: `rotate(180 ${x} ${y})` }[motion];
  if (turned === undefined) return null;
  return html`<path class="arrow" d=${`M${x} ${y - 7} l6 9 h-3.5 v5 h-5 v-5 h-3.5 z`} transform=${turned} />`;
}
