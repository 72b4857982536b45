import { get } from "../api/client";
import { useLoaded } from "../api/useLoaded";
import { t } from "../i18n";

const EVERY_MS = 15_000;

/** Whether the service takes nothing new for want of room; null while that is not known. */
const look = async () =>
  (await get<{ checks: Record<string, string> }>("/readyz")).checks.storage?.startsWith("storage-full") ?? false;

/** A sentence on every page while uploads and jobs wait for room on the server's disk. */
export function FullStorage() {
  const { value } = useLoaded(look, [], EVERY_MS);
  return value ? (
    <p class="failure" role="alert">
      {t("storage.full")}
    </p>
  ) : null;
}
