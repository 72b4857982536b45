import { get, Refused, type Job, type Session, type Stats } from "../api/client";
import { useLoaded } from "../api/useLoaded";
import { bytesText, named, t } from "../i18n";
import { Chip, Failure, Loading } from "../ui/parts";

const TOTALS = [
  ["maps", "overview.maps"],
  ["drawings", "map.drawings"],
  ["scans", "map.scans"],
  ["revisions", "map.revisions"],
] as const;

interface Ready {
  status: string;
  checks: Record<string, string>;
}

async function look() {
  const session = await get<Session>("/v1/session");
  const [ready, stats, api] = await Promise.all([
    get<Ready>("/readyz").catch((cause: unknown) => cause as Refused),
    session.role === "admin" ? get<Stats>("/v1/stats") : null,
    get<{ info: { version: string } }>("/openapi.json"),
  ]);
  return { ready, stats, version: api.info.version };
}

export function System() {
  const { value, error } = useLoaded(look, [], 5000);
  if (!value) return error ? <Failure error={error} /> : <Loading />;
  const { ready, stats } = value;
  return (
    <>
      <div class="title">
        <h1>{t("nav.system")}</h1>
      </div>
      <div class="cards">
        <section class="card">
          <h2>{t("system.health")}</h2>
          {ready instanceof Refused ? (
            <Failure error={ready} />
          ) : (
            <>
              <Chip tone="good">{t("system.ok")}</Chip>
              <dl>
                {Object.entries(ready.checks).map(([name, found]) => [
                  <dt key={name}>{name}</dt>,
                  <dd key={`${name}-found`}>{found}</dd>,
                ])}
              </dl>
            </>
          )}
        </section>
        {stats && (
          <section class="card">
            <h2>{t("nav.jobs")}</h2>
            <dl>
              {(Object.entries(stats.jobs) as [Job["state"], number][]).map(([state, number]) => [
                <dt key={state}>{named("state", state)}</dt>,
                <dd key={`${state}-n`}>{number}</dd>,
              ])}
              <dt>{t("system.queue")}</dt>
              <dd>{Math.round(stats.queue_age_s)} s</dd>
            </dl>
          </section>
        )}
        {stats && (
          <section class="card">
            <h2>{t("system.totals")}</h2>
            <dl>
              {TOTALS.map(([name, words]) => [
                <dt key={name}>{t(words)}</dt>,
                <dd key={`${name}-n`}>{stats.totals[name]}</dd>,
              ])}
              <dt>{t("overview.stored")}</dt>
              <dd>{bytesText(stats.stored_bytes)}</dd>
              <dt>{t("overview.free")}</dt>
              <dd>{bytesText(stats.free_bytes)}</dd>
            </dl>
          </section>
        )}
        <section class="card">
          <h2>{t("system.version")}</h2>
          <p>Groundplan {value.version}</p>
          <p>
            <a href="/docs">{t("system.reference")}</a>
          </p>
        </section>
      </div>
    </>
  );
}
