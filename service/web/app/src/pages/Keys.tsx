import { useState } from "preact/hooks";
import { all, post, remove, type Key, type Schemas, type SiteMap } from "../api/client";
import { useLoaded } from "../api/useLoaded";
import { named, t, whenText } from "../i18n";
import { Chip, Dialog, Failure } from "../ui/parts";
import { Rows, type Column } from "../ui/Rows";

function Made({ secret }: { secret: string }) {
  const [copied, setCopied] = useState(false);
  // eslint-disable-next-line @typescript-eslint/no-unnecessary-condition -- there is none on a page without HTTPS
  const copy = () => void navigator.clipboard?.writeText(secret).then(() => setCopied(true));
  return (
    <>
      <p>{t("keys.once")}</p>
      <p>
        <code class="secret">{secret}</code>
      </p>
      <button type="button" onClick={copy}>
        {copied ? t("keys.copied") : t("keys.copy")}
      </button>
    </>
  );
}

function NewKey({ close }: { close: () => void }) {
  const maps = useLoaded(() => all<SiteMap>("/v1/maps"));
  const [secret, setSecret] = useState<string | null>(null);
  const [error, setError] = useState<unknown>(null);
  const submit = async (event: Event) => {
    event.preventDefault();
    const form = new FormData(event.currentTarget as HTMLFormElement);
    const map = form.get("map");
    const body = { name: form.get("name"), role: form.get("role"), map_ids: map ? [map] : null };
    try {
      setSecret((await post<Schemas["NewKeyOut"]>("/v1/keys", body)).key);
    } catch (cause) {
      setError(cause);
    }
  };
  return (
    <Dialog title={t("keys.new")} close={close}>
      {secret ? (
        <Made secret={secret} />
      ) : (
        <form onSubmit={(event) => void submit(event)}>
          <label>
            {t("keys.name")}
            <input name="name" required maxlength={200} autofocus />
          </label>
          <label>
            {t("keys.role")}
            <select name="role">
              {(["tablet", "robot", "admin"] as const).map((role) => (
                <option key={role} value={role}>
                  {named("role", role)}
                </option>
              ))}
            </select>
          </label>
          <label>
            {t("keys.maps")}
            <select name="map">
              <option value="">{t("keys.allMaps")}</option>
              {maps.value?.map((map) => (
                <option key={map.id} value={map.id}>
                  {map.site} · {map.name}
                </option>
              ))}
            </select>
          </label>
          <Failure error={error} />
          <button class="primary" type="submit">
            {t("keys.make")}
          </button>
        </form>
      )}
    </Dialog>
  );
}

export function Keys() {
  const [making, setMaking] = useState(false);
  const [revoking, setRevoking] = useState<Key | null>(null);
  const [round, setRound] = useState(0);
  const [error, setError] = useState<unknown>(null);
  const changed = () => setRound((n) => n + 1);
  const revoke = async (key: Key) => {
    setRevoking(null);
    await remove(`/v1/keys/${key.id}`).then(changed, setError);
  };
  const columns: Column<Key>[] = [
    { name: t("keys.name"), width: "minmax(9rem, 2fr)", show: (key) => key.name },
    { name: t("keys.role"), width: "7rem", show: (key) => named("role", key.role) },
    { name: t("keys.maps"), width: "7rem", show: (key) => key.map_ids?.length ?? t("keys.allMaps") },
    { name: t("keys.made"), width: "11rem", show: (key) => whenText(key.created_at) },
    {
      name: t("keys.state"),
      width: "7rem",
      show: (key) =>
        key.revoked_at ? <Chip tone="bad">{t("keys.revoked")}</Chip> : <Chip tone="good">{t("keys.valid")}</Chip>,
    },
    {
      name: "",
      width: "8rem",
      show: (key) =>
        key.revoked_at ? null : (
          <button type="button" onClick={() => setRevoking(key)}>
            {t("keys.revoke")}
          </button>
        ),
    },
  ];
  return (
    <>
      <div class="title">
        <h1>{t("nav.keys")}</h1>
        <span class="spread" />
        <button class="primary" type="button" onClick={() => setMaking(true)}>
          {t("keys.new")}
        </button>
      </div>
      <Failure error={error} />
      <Rows label={t("nav.keys")} path="/v1/keys" columns={columns} keyOf={(key) => key.id} refresh={round} />
      {making && (
        <NewKey
          close={() => {
            setMaking(false);
            changed();
          }}
        />
      )}
      {revoking && (
        <Dialog title={revoking.name} close={() => setRevoking(null)}>
          <p>{t("keys.sure")}</p>
          <button class="danger" type="button" onClick={() => void revoke(revoking)}>
            {t("keys.revoke")}
          </button>
        </Dialog>
      )}
    </>
  );
}
