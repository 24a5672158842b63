/** Asks for a key where the site has keys. The key stays in the memory of this page: a reload asks for it again. */

import { html, useRef, useState } from "../vendor/htm-preact.js";

export function Login({ api, texts, logIn }) {
  const { t } = texts;
  const [failed, setFailed] = useState("");
  const field = useRef(null);
  const submit = async (event) => {
    event.preventDefault();
    const key = field.current.value.trim();
    field.current.value = "";
    try {
      await api.send("GET", "lifts", { headers: { Authorization: `Bearer ${key}` } });
      logIn(key);
    } catch (error) {
      setFailed(error.status === 401 ? t("login.bad_key") : t("refused", { why: error.message }));
    }
  };
  return html`<form class="login" onSubmit=${submit}>
    <h2>${t("login.title")}</h2>
    <p id="login-help">${t("login.help")}</p>
    <label>${t("login.key")} <input ref=${field} type="password" autocomplete="off" required aria-describedby="login-help" /></label>
    <button type="submit">${t("login.submit")}</button>
    ${failed && html`<p role="alert" class="trouble warn">${failed}</p>`}
  </form>`;
}

/** The way out. */
export function Account({ api, texts, logIn }) {
  if (!api.hasKey) return null;
  return html`<button onClick=${() => logIn("")}>${texts.t("login.end")}</button>`;
}
