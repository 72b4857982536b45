/** What differs between two revisions: in words, in points, and side by side under a slider. */
import { useEffect, useState } from "preact/hooks";
import { all, follow, get, type Compared, type Job, type Revision } from "../api/client";
import { useLoaded } from "../api/useLoaded";
import { t, whenText } from "../i18n";
import { Failure, Loading, Progress } from "../ui/parts";
import { extentOf, GridPicture } from "../view/GridPlan";
import { loadGrid, type Grid } from "../view/grid";

/** Two revisions over each other; left of the handle is the earlier one. */
function Slider({ before, after }: { before: Grid; after: Grid }) {
  const [share, setShare] = useState(50);
  const extent = extentOf([before, after]);
  const [wide, high] = [extent.high[0] - extent.low[0], extent.high[1] - extent.low[1]];
  return (
    <div class="stack">
      <div
        class="grid-plan compared"
        ref={(node) => {
          if (!node) return;
          node.style.aspectRatio = `${wide} / ${high}`;
          node.style.setProperty("--share", `${share}%`);
        }}
      >
        <div class="side after">
          <GridPicture grid={after} extent={extent} />
        </div>
        <div class="side before">
          <GridPicture grid={before} extent={extent} />
        </div>
        <span class="handle" />
      </div>
      <label>
        {t("compare.slider")}
        <input
          type="range"
          min={0}
          max={100}
          value={share}
          onInput={(event) => setShare(event.currentTarget.valueAsNumber)}
        />
      </label>
    </div>
  );
}

function Grids({ mapId, from, to }: { mapId: string; from: number; to: number }) {
  const { value, error } = useLoaded(
    () => Promise.all([loadGrid(mapId, from), loadGrid(mapId, to)]),
    [mapId, from, to],
  );
  if (error) return <Failure error={error} />;
  return value ? <Slider before={value[0]} after={value[1]} /> : <Loading />;
}

function useComparison(mapId: string, from: number, to: number) {
  const [found, setFound] = useState<Compared | null>(null);
  const [job, setJob] = useState<Job | null>(null);
  const [error, setError] = useState<unknown>(null);
  useEffect(() => {
    const leaving = new AbortController();
    const isWanted = () => !leaving.signal.aborted;
    const at = `/v1/maps/${mapId}/revisions/${to}/compare?with=${from}`;
    const ask = async () => {
      const first = await get<Compared>(at);
      if (!isWanted()) return;
      setFound(first);
      if (first.geometry) return;
      const ended = await follow(first.job, (now) => isWanted() && setJob(now));
      if (ended.problem) throw new Error(ended.problem.detail);
      const whole = await get<Compared>(at);
      if (isWanted()) setFound(whole);
    };
    setFound(null);
    setError(null);
    ask()
      .catch((cause: unknown) => isWanted() && setError(cause))
      .finally(() => isWanted() && setJob(null));
    return () => leaving.abort();
  }, [mapId, from, to]);
  return { found, job, error };
}

function Choice({
  label,
  value,
  revisions,
  href,
}: {
  label: string;
  value: number;
  revisions: Revision[];
  href: (n: number) => string;
}) {
  return (
    <label>
      {label}
      <select
        value={value}
        onChange={(event) => {
          location.hash = href(Number(event.currentTarget.value));
        }}
      >
        {revisions.map((one) => (
          <option key={one.n} value={one.n}>
            {one.n} · {whenText(one.created_at)}
          </option>
        ))}
      </select>
    </label>
  );
}

export function ComparePage({ mapId, from, to }: { mapId: string; from: number; to: number }) {
  const { found, job, error } = useComparison(mapId, from, to);
  const revisions = useLoaded(() => all<Revision>(`/v1/maps/${mapId}/revisions`, 1000), [mapId]);
  const ready = (revisions.value ?? [])
    .filter((one) => one.status === "ready" && !one.pruned_at)
    .sort((a, b) => b.n - a.n);
  const geometry = found?.geometry;
  const changed = geometry?.tiles?.length ?? 0;
  return (
    <>
      <div class="title">
        <h1>{t("compare.title")}</h1>
        <span class="spread" />
        <a class="button" href={`#/maps/${mapId}`}>
          {t("tablet.back")}
        </a>
      </div>
      {ready.length > 0 && (
        <div class="chips">
          <Choice
            label={t("compare.from")}
            value={from}
            revisions={ready}
            href={(n) => `#/maps/${mapId}/compare/${n}/${to}`}
          />
          <Choice
            label={t("compare.to")}
            value={to}
            revisions={ready}
            href={(n) => `#/maps/${mapId}/compare/${from}/${n}`}
          />
        </div>
      )}
      <Failure error={error ?? revisions.error} />
      <div class="workplace">
        <Grids mapId={mapId} from={from} to={to} />
        <aside class="stack">
          <section class="card" aria-label={t("compare.differences")}>
            <h2>{t("compare.differences")}</h2>
            {!found && !error && <Loading />}
            {found?.differences.length === 0 && <p class="quiet">{t("compare.same")}</p>}
            <ul class="reasons">
              {found?.differences.map((one) => (
                <li key={one.subject + one.change}>{one.message}</li>
              ))}
            </ul>
          </section>
          <section class="card" aria-label={t("compare.points")}>
            <h2>{t("compare.points")}</h2>
            {job && <Progress job={job} />}
            {geometry && (
              <dl>
                <dt>{t("compare.added")}</dt>
                <dd>{geometry.points_added}</dd>
                <dt>{t("compare.removed")}</dt>
                <dd>{geometry.points_removed}</dd>
                <dt>{t("compare.tiles")}</dt>
                <dd>
                  {changed} / {changed + (geometry.tiles_unchanged ?? 0)}
                </dd>
              </dl>
            )}
            {found?.picture_url && (
              <img
                class="picture"
                alt={t("compare.picture")}
                src={new URL(found.picture_url).pathname + new URL(found.picture_url).search}
              />
            )}
          </section>
        </aside>
      </div>
    </>
  );
}
