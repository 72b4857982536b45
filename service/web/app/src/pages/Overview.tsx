import { useState } from "preact/hooks";
import {
  all,
  get,
  type Convergence,
  type Counted,
  type Drawing,
  type Job,
  type Page,
  type Placement,
  type Proposal,
  type Schemas,
  type Session,
  type SiteMap,
  type Stats,
} from "../api/client";
import { useFleetEvents } from "../api/useFleetEvents";
import { useLoaded } from "../api/useLoaded";
import { bytesText, named, t } from "../i18n";
import { NewMap } from "../ui/NewMap";
import { Chip, Failure, Loading, Progress } from "../ui/parts";

interface Waiting {
  id: string;
  map_id: string;
  why: string;
  detail: string;
  href: string;
}

interface Glance {
  maps: SiteMap[];
  published: Map<string, number>;
  latest: Map<string, number>;
  robots: Map<string, Counted[]>;
  running: Job[];
  waiting: Waiting[];
  stats: Stats | null;
}

const by = <T extends { map_id: string }>(rows: T[]) => Map.groupBy(rows, (row) => row.map_id);

interface Open {
  placements: Placement[];
  newest: Map<string, string>;
  proposals: Proposal[];
  drawings: Drawing[];
  failed: Job[];
}

function waitingOf({ placements, newest, proposals, drawings, failed }: Open): Waiting[] {
  const codes = (drawing: Drawing) => (drawing.reading?.findings ?? []).map((found) => found.code);
  return [
    ...placements
      .filter((one) => newest.get(one.scan_id) === one.id)
      .map((one) => ({
        id: one.id,
        map_id: one.map_id,
        why: t("overview.review"),
        detail: one.reasons?.[0]?.detail ?? "",
        href: `#/maps/${one.map_id}/scans/${one.scan_id}`,
      })),
    ...proposals.map((one) => ({
      id: one.id,
      map_id: one.map_id,
      why: t("overview.proposal"),
      detail: one.evidence.name ?? "",
      href: `#/maps/${one.map_id}/revise`,
    })),
    ...drawings
      .filter((one) => codes(one).includes("scale-unknown"))
      .map((one) => ({
        id: one.id,
        map_id: one.map_id,
        why: t("overview.scale"),
        detail: one.file_name,
        href: `#/maps/${one.map_id}/drawings/${one.id}`,
      })),
    ...failed.map((one) => ({
      id: one.id,
      map_id: one.map_id,
      why: `${named("kind", one.kind)}: ${named("state", "failed")}`,
      detail: one.problem?.detail ?? "",
      href: "#/jobs",
    })),
  ];
}

async function glance(session: Session): Promise<Glance> {
  const [maps, revisions, fleet, proposals, queued, running, judged, drawings, failed, stats] = await Promise.all([
    all<SiteMap>("/v1/maps"),
    all<Schemas["RevisionOut"]>("/v1/revisions?status=ready", 1000),
    get<Convergence>("/v1/convergence"),
    get<Page<Proposal>>("/v1/proposals?state=open&limit=12"),
    get<Page<Job>>("/v1/jobs?state=queued&limit=20"),
    get<Page<Job>>("/v1/jobs?state=running&limit=20"),
    all<Placement>("/v1/placements", 1000),
    all<Drawing>("/v1/drawings", 400),
    get<Page<Job>>("/v1/jobs?state=failed&limit=10"),
    session.role === "admin" ? get<Stats>("/v1/stats") : null,
  ]);
  const published = new Map(
    fleet.channels.filter((one) => one.channel === "stable").map((one) => [one.map_id, one.revision]),
  );
  const latest = new Map<string, number>();
  for (const revision of revisions) latest.set(revision.map_id, Math.max(revision.n, latest.get(revision.map_id) ?? 0));
  const newest = new Map<string, string>();
  for (const one of judged) if (!newest.has(one.scan_id)) newest.set(one.scan_id, one.id);
  const review = judged.filter((one) => one.verdict === "needs-review");
  return {
    maps,
    published,
    latest,
    robots: by(fleet.robots),
    running: [...running.items, ...queued.items],
    waiting: waitingOf({ placements: review, newest, proposals: proposals.items, drawings, failed: failed.items }),
    stats,
  };
}

function RobotCounts({ robots }: { robots: Counted[] }) {
  const sum = (wanted: (progress: string) => boolean) =>
    robots.filter((one) => wanted(one.progress)).reduce((total, one) => total + one.robots, 0);
  const failed = sum((progress) => progress === "failed");
  const current = sum((progress) => progress === "up-to-date");
  const behind = sum((progress) => !["failed", "up-to-date", "nothing-published"].includes(progress));
  if (robots.length === 0) return <Chip tone="quiet">{t("overview.noRobots")}</Chip>;
  return (
    <span class="chips">
      {current > 0 && (
        <Chip tone="good">
          {current} {t("overview.onIt")}
        </Chip>
      )}
      {behind > 0 && (
        <Chip tone="busy">
          {behind} {t("overview.behind")}
        </Chip>
      )}
      {failed > 0 && (
        <Chip tone="bad">
          {failed} {t("overview.failed")}
        </Chip>
      )}
    </span>
  );
}

function MapCard({ map, seen }: { map: SiteMap; seen: Glance }) {
  const published = seen.published.get(map.id);
  const shown = published ?? seen.latest.get(map.id);
  return (
    <li class="card map-card">
      <a href={`#/maps/${map.id}`}>
        {shown ? (
          <img loading="lazy" alt="" src={`/v1/maps/${map.id}/revisions/${shown}/artifacts/preview.png`} />
        ) : (
          <div class="no-preview">{t("overview.noPreview")}</div>
        )}
        <span class="quiet">{map.site}</span>
        <h3>{map.name}</h3>
      </a>
      <div class="chips">
        {published ? (
          <Chip tone="good">
            {t("overview.published")}: {published}
          </Chip>
        ) : (
          <Chip tone="quiet">{t("overview.nothingPublished")}</Chip>
        )}
        <RobotCounts robots={seen.robots.get(map.id) ?? []} />
      </div>
      {seen.running
        .filter((job) => job.map_id === map.id)
        .slice(0, 3)
        .map((job) => (
          <Progress key={job.id} job={job} />
        ))}
    </li>
  );
}

function Disk({ stats }: { stats: Stats }) {
  const whole = stats.stored_bytes + stats.free_bytes;
  return (
    <section class="card">
      <h2>{t("overview.disk")}</h2>
      <meter min={0} max={whole} value={stats.stored_bytes} aria-label={t("overview.disk")} />
      <p>
        {bytesText(stats.stored_bytes)} {t("overview.stored")} · {bytesText(stats.free_bytes)} {t("overview.free")}
      </p>
    </section>
  );
}

export function Overview({ session }: { session: Session }) {
  const [making, setMaking] = useState(false);
  const { value, error, reload } = useLoaded(() => glance(session), [], 3000);
  const connected = useFleetEvents(reload);
  const admin = session.role === "admin" && !session.map_ids;
  return (
    <>
      <div class="title">
        <h1>{t("nav.overview")}</h1>
        <span class={connected ? "live on" : "live"} role="status">
          {connected ? t("live") : t("reconnecting")}
        </span>
        <span class="spread" />
        {admin && (
          <button class="primary" type="button" onClick={() => setMaking(true)}>
            {t("overview.newMap")}
          </button>
        )}
      </div>
      <Failure error={error} />
      {!value && !error && <Loading />}
      {value && (
        <div class="overview">
          <section aria-label={t("overview.maps")}>
            {value.maps.length === 0 && <p class="none">{t("overview.welcome")}</p>}
            <ul class="cards">
              {value.maps.map((map) => (
                <MapCard key={map.id} map={map} seen={value} />
              ))}
            </ul>
          </section>
          <aside>
            <section class="card">
              <h2>{t("overview.waiting")}</h2>
              {value.waiting.length === 0 && <p class="quiet">{t("overview.nothingWaits")}</p>}
              <ul class="waiting">
                {value.waiting.slice(0, 12).map((one) => (
                  <li key={one.id}>
                    <a href={one.href}>
                      <strong>{one.why}</strong>
                      <span>{one.detail}</span>
                    </a>
                  </li>
                ))}
              </ul>
            </section>
            <section class="card">
              <h2>{t("overview.running")}</h2>
              {value.running.length === 0 && <p class="quiet">{t("overview.nothingRuns")}</p>}
              {value.running.slice(0, 8).map((job) => (
                <div key={job.id}>
                  <strong>{named("kind", job.kind)}</strong>
                  <Progress job={job} />
                </div>
              ))}
            </section>
            {value.stats && <Disk stats={value.stats} />}
          </aside>
        </div>
      )}
      {making && <NewMap close={() => setMaking(false)} />}
    </>
  );
}
