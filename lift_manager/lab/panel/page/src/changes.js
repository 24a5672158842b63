/** Which registers have changed lately. Pure. */

const SHOWN_MS = 5000;
const COUNTING = 4;

/** Takes the registers of one lift, one reading after the other. */
export class Changes {
  #rows = new Map();

  take(registers, now) {
    for (const { name, raw, value } of registers) {
      const known = this.#rows.get(name);
      const text = raw === null ? null : raw.join(" ");
      if (known === undefined) {
        this.#rows.set(name, { text, value, before: null, times: [] });
      } else if (known.text !== text && text !== null) {
        const times = [...known.times.filter((time) => now - time < SHOWN_MS), now];
        this.#rows.set(name, { text, value, before: known.text === null ? null : known.value, times });
      } else if (text === null) {
        known.text = null;
      }
    }
  }

  /** `{before}` of a register that has changed within the last seconds, `{counts: true}` of one that always does; else null. */
  of(name, now) {
    const known = this.#rows.get(name);
    const recent = known?.times.filter((time) => now - time < SHOWN_MS).length ?? 0;
    if (recent === 0) return null;
    return recent >= COUNTING ? { counts: true } : { counts: false, before: known.before };
  }
}
