/** How large the pictures on a wall are: as large as all lifts fit. Pure, except for `fitWall`. */

const PIXELS = 16;
/** Room for one lift with its gap, in the unit that grows (rem), with all in words or with little; a lift with a warning needs as much. */
const FULL = { wide: 21, high: 20 };
const COMPACT = { wide: 14.5, high: 12.5 };
const HEADER = 4;
/** Smaller than `FEW_WORDS`, few words in larger letters say more from afar. Smaller than `LEAST`, nobody reads it, and the page scrolls. */
const [FEW_WORDS, LEAST, MOST] = [1, 0.6, 4];

/** Returns `{columns, scale, compact}` for so many lifts in a window of this size in pixels. */
export function arrangement(lifts, width, height) {
  const full = largest(lifts, width, height, FULL);
  if (full.scale >= FEW_WORDS) return { ...full, compact: false };
  const compact = largest(lifts, width, height, COMPACT);
  if (compact.scale >= LEAST) return { ...compact, compact: true };
  return { columns: Math.max(1, Math.floor(width / (COMPACT.wide * LEAST * PIXELS))), scale: LEAST, compact: true };
}

function largest(lifts, width, height, { wide, high }) {
  let best = { columns: 1, scale: 0 };
  for (let columns = 1; columns <= lifts; columns += 1) {
    const rows = Math.ceil(lifts / columns);
    const scale = Math.min(width / (columns * wide), height / (rows * high + HEADER), MOST * PIXELS) / PIXELS;
    if (scale > best.scale) best = { columns, scale };
  }
  return best;
}

/** Fit the page, whose sizes are all in rem. */
export function fitWall(lifts) {
  const { columns, scale, compact } = arrangement(lifts, innerWidth, innerHeight);
  const { style, classList } = document.documentElement;
  style.fontSize = `${scale * PIXELS}px`;
  style.setProperty("--columns", columns);
  classList.toggle("compact", compact);
}
