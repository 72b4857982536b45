import { useState } from "preact/hooks";
import { put, type Session } from "../api/client";
import { t } from "../i18n";
import { Failure } from "../ui/parts";

export function SignIn({ signedIn }: { signedIn: (session: Session) => void }) {
  const [key, setKey] = useState("");
  const [error, setError] = useState<unknown>(null);
  const [busy, setBusy] = useState(false);
  const submit = async (event: Event) => {
    event.preventDefault();
    setBusy(true);
    try {
      signedIn(await put<Session>("/v1/session", { key: key.trim() }));
    } catch (cause) {
      setError(cause);
    } finally {
      setBusy(false);
    }
  };
  return (
    <main class="narrow">
      <form class="card sign-in" onSubmit={(event) => void submit(event)}>
        <img src="/icon.svg" alt="" width={56} height={56} />
        <h1>Groundplan</h1>
        <label>
          {t("signIn.key")}
          <input
            type="password"
            name="key"
            autocomplete="current-password"
            required
            autofocus
            spellcheck={false}
            placeholder="gp_…"
            value={key}
            onInput={(event) => setKey(event.currentTarget.value)}
          />
        </label>
        <Failure error={error} />
        <button class="primary" type="submit" disabled={busy}>
          {t("signIn.go")}
        </button>
        <p class="quiet">{t("signIn.help")}</p>
      </form>
    </main>
  );
}
