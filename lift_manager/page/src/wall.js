/** How large the pictures on a wall are: as large as all lifts fit. Pure, except for `fitWall`. */

/** Room for one lift with its gap, in the unit that grows (rem); a lift with a warning needs as much. */
const [WIDE, HIGH] = [21, 18];
const PIXELS = 16;
/** Smaller than this nobody reads from afar, and the page scrolls; larger than this says no more. */
const [LEAST, MOST] = [0.6, 4];

/** Returns `{columns, scale}` for so many lifts in a window of this size in pixels. */
export function arrangement(lifts, width, height) {
  const found = Array.from({ length: lifts }, (_, index) => {
    const columns = index + 1;
    const rows = Math.ceil(lifts / columns);
    return { columns, scale: Math.min(width / (columns * WIDE), height / (rows * HIGH + 3)) / PIXELS };
  });
  const best = found.reduce((one, other) => (other.scale > one.scale ? other : one), { columns: 1, scale: LEAST });
  return { ...best, scale: Math.min(best.scale, MOST) };
}

/** Fit the page, whose sizes are all in rem. */
export function fitWall(lifts) {
  const { columns, scale } = arrangement(lifts, innerWidth, innerHeight);
  const { style } = document.documentElement;
  style.fontSize = `${scale * PIXELS}px`;
  style.setProperty("--columns", columns);
}
