/**
 * Reads server-sent events with fetch. EventSource is not used, because it hides the comments that the manager sends every second:
 * they are how this page knows that the connection still delivers.
 */

/** Splits the text of a stream into events `{event, data, id}`; call `take` with each piece as it comes. */
export class EventParser {
  #rest = "";
  #fields = { event: "", data: [], id: undefined };
  /** Milliseconds to wait before reconnecting, as the stream last said. */
  retryMs = 1500;

  /** Returns the events that are complete with this piece. The manager ends lines with \n alone. */
  take(text) {
    const lines = (this.#rest + text).split("\n");
    this.#rest = lines.pop();
    return lines.flatMap((line) => (line === "" ? this.#finish() : this.#field(line)));
  }

  #finish() {
    const { event, data, id } = this.#fields;
    this.#fields = { event: "", data: [], id: undefined };
    return data.length ? [{ event: event || "message", data: data.join("\n"), id }] : [];
  }

  #field(line) {
    const colon = line.indexOf(":");
    const name = colon < 0 ? line : line.slice(0, colon);
    const value = colon < 0 ? "" : line.slice(colon + 1).replace(/^ /, "");
    if (name === "data") this.#fields.data.push(value);
    else if (name === "event" || name === "id") this.#fields[name] = value;
    else if (name === "retry" && /^\d+$/.test(value)) this.retryMs = Number(value);
    return [];
  }
}

/**
 * Reads one response to its end. `onData` is called with each piece that arrives, comments included, before its events go to `onEvent`.
 */
export async function readEvents(response, parser, onData, onEvent) {
  const reader = response.body.pipeThrough(new TextDecoderStream()).getReader();
  for (;;) {
    const { done, value } = await reader.read();
    if (done) return;
    onData();
    for (const event of parser.take(value)) onEvent(event);
  }
}
