/** Plays the recording of a moment, where the site has one. Which moments there are is said by the texts of the lobby view. */

const LIST = new URL("../../announcements", import.meta.url);
/** The same moment is not announced again within this time: a ride may waver between two of them. */
const AGAIN_MS = 15_000;

export class Announcements {
  #sounds = new Map();
  #playedAt = new Map();
  #last = "";
  /** Whether the browser refused to play the newest one: it wants a gesture first. */
  silenced = false;

  /** Load the list and the recordings; without a list nothing is announced. */
  async load() {
    const response = await fetch(LIST, { credentials: "same-origin" });
    if (!response.ok) throw new Error(`announcements: ${response.status}`);
    for (const [moment, path] of Object.entries(await response.json())) {
      const sound = new Audio(new URL(path, LIST));
      sound.preload = "auto";
      this.#sounds.set(moment, sound);
    }
  }

  /** What the lobby view shows now; resolves when the recording has begun. */
  async show(moment, now) {
    if (moment === this.#last) return;
    this.#last = moment;
    const sound = this.#sounds.get(moment);
    if (sound === undefined || now - (this.#playedAt.get(moment) ?? -Infinity) < AGAIN_MS) return;
    this.#playedAt.set(moment, now);
    for (const other of this.#sounds.values()) other.pause();
    sound.currentTime = 0;
    try {
      await sound.play();
      this.silenced = false;
    } catch (error) {
      if (error.name === "AbortError") return; // the next announcement came first
      this.silenced = true;
      console.warn(`${moment}: ${error.message}`);
    }
  }
}
