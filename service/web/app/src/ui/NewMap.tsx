import { useState } from "preact/hooks";
import { post, type SiteMap } from "../api/client";
import { t } from "../i18n";
import { Dialog, Failure } from "./parts";

export function NewMap({ close }: { close: () => void }) {
  const [error, setError] = useState<unknown>(null);
  const submit = async (event: SubmitEvent) => {
    event.preventDefault();
    const form = new FormData(event.currentTarget as HTMLFormElement);
    try {
      const made = await post<SiteMap>("/v1/maps", { site: form.get("site"), name: form.get("name") });
      location.hash = `#/maps/${made.id}`;
    } catch (cause) {
      setError(cause);
    }
  };
  return (
    <Dialog title={t("overview.newMap")} close={close}>
      <form onSubmit={(event) => void submit(event)}>
        <label>
          {t("map.site")}
          <input name="site" required maxlength={200} autofocus />
        </label>
        <label>
          {t("map.name")}
          <input name="name" required maxlength={200} />
        </label>
        <Failure error={error} />
        <button class="primary" type="submit">
          {t("map.make")}
        </button>
      </form>
    </Dialog>
  );
}
