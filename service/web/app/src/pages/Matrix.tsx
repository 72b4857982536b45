/** Robots by revisions: how many of each map run which, and whether it is the one that they should. */
import type { Convergence, Counted } from "../api/client";
import { named, t } from "../i18n";

interface MatrixProps {
  fleet: Convergence;
  nameOf: (mapId: string) => string;
}

const toneOf = (cell: Counted[]) =>
  cell.some((one) => one.progress === "failed")
    ? "bad"
    : cell.every((one) => one.progress === "up-to-date")
      ? "good"
      : "busy";

function Cell({ counted }: { counted: Counted[] }) {
  if (counted.length === 0) return <td />;
  const total = counted.reduce((sum, one) => sum + one.robots, 0);
  const words = counted.map((one) => `${one.robots} ${named("progress", one.progress)}`).join(", ");
  return (
    <td>
      <span class={`chip ${toneOf(counted)}`} title={words}>
        {total}
        <span class="hidden"> {words}</span>
      </span>
    </td>
  );
}

export function Matrix({ fleet, nameOf }: MatrixProps) {
  if (fleet.robots.length === 0) return null;
  const revisions = [...new Set(fleet.robots.map((one) => one.enabled_revision ?? 0))].sort((a, b) => b - a);
  const rows = [...Map.groupBy(fleet.robots, (one) => `${one.map_id}/${one.channel}`).values()];
  const pointed = (one: Counted) =>
    fleet.channels.find((at) => at.map_id === one.map_id && at.channel === one.channel)?.revision;
  return (
    <section class="card" aria-label={t("fleet.matrix")}>
      <h2>{t("fleet.matrix")}</h2>
      <div class="scroll" tabIndex={0}>
        <table class="matrix">
          <thead>
            <tr>
              <th scope="col">{t("fleet.map")}</th>
              <th scope="col">{t("revisions.channel")}</th>
              <th scope="col">{t("fleet.wanted")}</th>
              {revisions.map((n) => (
                <th key={n} scope="col">
                  {n || t("fleet.nothingYet")}
                </th>
              ))}
            </tr>
          </thead>
          <tbody>
            {rows.map((row) => (
              <tr key={row[0]!.map_id + row[0]!.channel}>
                <th scope="row">
                  <a href={`#/maps/${row[0]!.map_id}`}>{nameOf(row[0]!.map_id)}</a>
                </th>
                <td>{row[0]!.channel}</td>
                <td>{pointed(row[0]!) ?? "–"}</td>
                {revisions.map((n) => (
                  <Cell key={n} counted={row.filter((one) => (one.enabled_revision ?? 0) === n)} />
                ))}
              </tr>
            ))}
          </tbody>
        </table>
      </div>
    </section>
  );
}
