/** Asks for a key where the site has keys, and exchanges it for a login of this browser. */

import { html, useEffect, useRef, useState } from "../vendor/htm-preact.js";

export function Login({ api, texts, onAccount }) {
  const { t } = texts;
  const [failed, setFailed] = useState("");
  const field = useRef(null);
  useEffect(() => field.current.focus(), []);
  const submit = async (event) => {
    event.preventDefault();
    const key = field.current.value.trim();
    field.current.value = "";
    try {
      await api.logIn(key);
      onAccount();
    } catch (error) {
      setFailed(error.status === 401 ? t("login.bad_key") : t("refused", { why: error.message }));
      field.current.focus();
    }
  };
  return html`<form class="login" onSubmit=${submit}>
    <h2>${t("login.title")}</h2>
    <p id="login-help">${t("login.help")}</p>
    <label>${t("login.key")} <input ref=${field} type="password" autocomplete="off" required aria-describedby="login-help" /></label>
    <button type="submit">${t("login.submit")}</button>
    <div role="alert">${failed && html`<p class="trouble warn">${failed}</p>`}</div>
  </form>`;
}

/** Who is logged in, and the way out. */
export function Account({ api, texts, connection, onAccount }) {
  const { t } = texts;
  const [, draw] = useState(null);
  useEffect(() => {
    // whoever is not logged in gets the form from the feed, and after any other failure the next connection asks again
    if (connection === "open" && api.account === null) api.askAccount().then(draw, () => {});
  }, [connection]);
  if (!api.account?.key) return null;
  const logOut = async () => {
    try {
      await api.logOut();
    } finally {
      onAccount();
    }
  };
  return html`<span class="quiet">${t("login.as", { key: api.account.key })}</span>
    <button type="button" onClick=${logOut}>${t("login.end")}</button>`;
}
