/** The words of the page, from one file per language in `texts/`. */

const FOLDER = new URL("../texts/", import.meta.url);
const KEPT = "lift-manager-language";
const GIVE_UP_MS = 10_000;
const AGAIN_MS = 2000;

/**
 * Returns `{language, names, t, word}` for the language in the address, the one chosen before, or the browser's.
 * `folders` have further texts, in files of the same names.
 */
export async function loadTexts(...folders) {
  const names = await load("languages");
  const language = wanted().find((code) => code in names) ?? "en";
  const texts = Object.assign({}, ...(await Promise.all([FOLDER, ...folders].map((folder) => load(language, folder)))));
  document.documentElement.lang = language;
  return { language, names, t: (key, values) => filled(texts[key] ?? key, values), word: wordOf(texts) };
}

export function chooseLanguage(code) {
  localStorage.setItem(KEPT, code);
  const address = new URL(location.href);
  address.searchParams.delete("lang");
  location.replace(address);
}

/** The word for a value of the API; a value that a newer manager has and this file has not stays as it is. */
function wordOf(texts) {
  return (kind, value) => texts[`${kind}.${value}`] ?? String(value);
}

function wanted() {
  const inAddress = new URLSearchParams(location.search).get("lang");
  const chosen = [inAddress, localStorage.getItem(KEPT), ...navigator.languages];
  return chosen.filter(Boolean).map((code) => code.slice(0, 2).toLowerCase());
}

/** Until it comes: nobody reloads the page of a kiosk. */
async function load(name, folder = FOLDER) {
  for (;;) {
    try {
      const response = await fetch(new URL(`${name}.json`, folder), { signal: AbortSignal.timeout(GIVE_UP_MS) });
      if (response.ok) return await response.json();
      console.warn(`${name}.json: ${response.status}`);
    } catch (error) {
      console.warn(`${name}.json: ${error.message}`);
    }
    await new Promise((resolve) => setTimeout(resolve, AGAIN_MS));
  }
}

function filled(text, values = {}) {
  return text.replace(/\{(\w+)\}/g, (whole, name) => (name in values ? String(values[name]) : whole));
}
