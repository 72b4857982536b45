import type { AuditEntry } from "../api/client";
import { t, whenText } from "../i18n";
import { Rows, type Column } from "../ui/Rows";

const said = (entry: AuditEntry) => JSON.stringify(entry.after ?? entry.before ?? {});

export function Audit() {
  const columns: Column<AuditEntry>[] = [
    { name: t("audit.when"), width: "12rem", show: (entry) => whenText(entry.at) },
    { name: t("audit.what"), width: "12rem", show: (entry) => entry.action },
    {
      name: t("audit.subject"),
      width: "minmax(8rem, 1fr)",
      show: (entry) => <code title={entry.subject_id}>{entry.subject_id}</code>,
    },
    {
      name: t("audit.who"),
      width: "minmax(8rem, 1fr)",
      show: (entry) => <code title={entry.key_id ?? ""}>{entry.key_id ?? "–"}</code>,
    },
    { name: t("more"), width: "minmax(8rem, 2fr)", show: (entry) => <span title={said(entry)}>{said(entry)}</span> },
  ];
  return (
    <>
      <div class="title">
        <h1>{t("nav.audit")}</h1>
      </div>
      <Rows label={t("nav.audit")} path="/v1/audit" columns={columns} keyOf={(entry) => entry.id} />
    </>
  );
}
