/** Change a map: layers and regions, and what later scans say has gone; what is planned becomes one revision. */
import { useState } from "preact/hooks";
import {
  all,
  follow,
  get,
  post,
  type Job,
  type Layer,
  type Page,
  type Placement,
  type Proposal,
  type Revision,
  type Schemas,
} from "../api/client";
import { useLoaded } from "../api/useLoaded";
import { t } from "../i18n";
import { Chip, Failure, Loading, Progress } from "../ui/parts";
import { cornersOf, GridPlan, type Point } from "../view/GridPlan";
import { loadGrid, type Grid } from "../view/grid";
import { LayerRow, type Planned } from "./LayerRow";

interface Base {
  revision: Revision;
  grid: Grid;
  proposals: Proposal[];
  placements: Placement[];
}

async function look(mapId: string): Promise<Base | null> {
  const latest = (await get<Page<Revision>>(`/v1/revisions?map=${mapId}&status=ready&limit=1`)).items[0];
  if (!latest) return null;
  const [grid, proposals, placements] = await Promise.all([
    loadGrid(mapId, latest.n),
    all<Proposal>(`/v1/maps/${mapId}/proposals?state=open`, 200),
    all<Placement>(`/v1/placements?map=${mapId}`, 200),
  ]);
  return {
    revision: latest,
    grid,
    proposals,
    placements: placements.filter((one) => one.verdict && one.verdict !== "rejected"),
  };
}

interface GoneProps {
  proposals: Proposal[];
  layers: Layer[];
  decide: (proposal: Proposal, how: "accept" | "dismiss") => void;
}

function Gone({ proposals, layers, decide }: GoneProps) {
  if (proposals.length === 0) return null;
  return (
    <section class="card" aria-label={t("revise.gone")}>
      <h2>{t("revise.gone")}</h2>
      <p class="quiet">{t("revise.goneHelp")}</p>
      <ul class="list">
        {proposals.map((one) => (
          <li key={one.id}>
            <span>
              <strong>{layers.find((layer) => layer.layer_id === one.layer_id)?.name ?? one.layer_id}</strong>
              <span class="quiet">
                {one.evidence.whole_layer
                  ? t("revise.allOfIt")
                  : `${one.evidence.things?.length ?? 0} ${t("revise.things")}`}
              </span>
            </span>
            <span class="chips">
              <button type="button" onClick={() => decide(one, "accept")}>
                {t("revise.takeOff")}
              </button>
              <button type="button" onClick={() => decide(one, "dismiss")}>
                {t("revise.stays")}
              </button>
            </span>
          </li>
        ))}
      </ul>
    </section>
  );
}

interface PlanProps {
  planned: Planned[];
  job: Job | null;
  drop: (k: number) => void;
  make: (reason: string) => void;
}

function Plan({ planned, job, drop, make }: PlanProps) {
  const [reason, setReason] = useState("");
  return (
    <section class="card" aria-label={t("revise.planned")}>
      <h2>{t("revise.planned")}</h2>
      {planned.length === 0 && <p class="quiet">{t("revise.nothing")}</p>}
      <ol class="list">
        {planned.map((one, k) => (
          <li key={`${k} ${one.words}`}>
            <span>{one.words}</span>
            <button
              class="plain"
              type="button"
              aria-label={`${t("revise.undo")}: ${one.words}`}
              onClick={() => drop(k)}
            >
              ✕
            </button>
          </li>
        ))}
      </ol>
      <label>
        {t("revise.why")}
        <input value={reason} maxLength={200} onInput={(event) => setReason(event.currentTarget.value)} />
      </label>
      {job && <Progress job={job} />}
      <button
        class="primary big"
        type="button"
        disabled={planned.length === 0 || job !== null}
        onClick={() => make(reason.trim())}
      >
        {t("revise.make")}
      </button>
    </section>
  );
}

function Reviser({ base, mapId, reload }: { base: Base; mapId: string; reload: () => void }) {
  const { revision, grid } = base;
  const [planned, setPlanned] = useState<Planned[]>([]);
  const [corners, setCorners] = useState<Point[] | null>(null);
  const [walls, setWalls] = useState(true);
  const [job, setJob] = useState<Job | null>(null);
  const [error, setError] = useState<unknown>(null);
  const [made, setMade] = useState<Schemas["RevisionWithJob"] | null>(null);
  const erased = revision.erased ?? [];
  const plan = (one: Planned) => setPlanned((old) => [...old, one]);
  const dot = Math.max(grid.high[0] - grid.low[0], grid.high[1] - grid.low[1]) / 120;

  const make = async (asking: () => Promise<Schemas["RevisionWithJob"]>) => {
    setError(null);
    setMade(null);
    try {
      const asked = await asking();
      setJob(asked.job);
      const ended = await follow(asked.job, setJob);
      if (ended.problem) throw new Error(ended.problem.detail);
      setMade(asked);
      setPlanned([]);
      reload();
    } catch (cause) {
      setError(cause);
    } finally {
      setJob(null);
    }
  };
  const decide = (proposal: Proposal, how: "accept" | "dismiss") => {
    const at = `/v1/proposals/${proposal.id}/${how}`;
    if (how === "accept") void make(() => post(at));
    else post(at).then(reload, setError);
  };
  const close = () => {
    const within = corners!.map(([x, y]) => [x, y]);
    plan({
      operation: { op: "erase-region", region: { within }, drawing: walls },
      words: `${t("revise.erase")}: ${within.length} ${t("revise.corners")}`,
    });
    setCorners(null);
  };
  return (
    <div class="workplace">
      <div class="stack">
        <GridPlan
          grid={grid}
          label={t("revise.plan")}
          tapped={corners && !job ? (at) => setCorners([...corners, at]) : undefined}
        >
          {erased.map((one) => (
            <polygon
              key={one.region_id}
              points={cornersOf(one.region.within)}
              class="erased-region"
              stroke-width={dot / 4}
            />
          ))}
          {base.proposals.flatMap((one) =>
            (one.evidence.things ?? []).map(
              ({ region }, k) =>
                region && (
                  <polygon
                    key={`${one.id} ${k}`}
                    points={cornersOf(region.within)}
                    class="gone-region"
                    stroke-width={dot / 4}
                  />
                ),
            ),
          )}
          {planned.map(
            ({ operation }, k) =>
              operation.op === "erase-region" && (
                <polygon
                  key={k}
                  points={cornersOf(operation.region.within)}
                  class="planned-region"
                  stroke-width={dot / 4}
                />
              ),
          )}
          {corners && <polygon points={cornersOf(corners)} class="planned-region" stroke-width={dot / 4} />}
          {corners?.map(([x, y], k) => (
            <circle key={k} cx={x} cy={-y} r={dot} class="corner" />
          ))}
        </GridPlan>
        <div class="chips">
          {!corners && (
            <button type="button" onClick={() => setCorners([])}>
              {t("revise.erase")}
            </button>
          )}
          {corners && (
            <>
              <span class="quiet">{t("revise.tapCorners")}</span>
              <label class="line">
                <input type="checkbox" checked={walls} onChange={(event) => setWalls(event.currentTarget.checked)} />
                {t("revise.wallsToo")}
              </label>
              <button class="primary" type="button" disabled={corners.length < 3} onClick={close}>
                {t("revise.closeRegion")}
              </button>
              <button type="button" disabled={corners.length === 0} onClick={() => setCorners(corners.slice(0, -1))}>
                {t("revise.undo")}
              </button>
              <button type="button" onClick={() => setCorners(null)}>
                {t("cancel")}
              </button>
            </>
          )}
        </div>
      </div>
      <aside class="stack">
        <div aria-live="polite" class="stack">
          <Failure error={error} />
          {made && (
            <p class="done" role="status">
              {t("place.made")} <a href={`#/maps/${mapId}`}>{made.revision.n}</a>
              {made.rebased && ` · ${t("revise.rebased")} ${made.rebased.onto}`}
            </p>
          )}
        </div>
        <Gone proposals={base.proposals} layers={revision.layers} decide={decide} />
        <section class="card" aria-label={t("revisions.layers")}>
          <h2>{t("revisions.layers")}</h2>
          {revision.layers.length === 0 && <p class="quiet">{t("revisions.noLayers")}</p>}
          <ul class="list">
            {revision.layers.map((layer) => (
              <LayerRow key={layer.layer_id} layer={layer} placements={base.placements} plan={plan} />
            ))}
          </ul>
          {erased.length > 0 && (
            <>
              <h3>{t("revise.erasedRegions")}</h3>
              <ul class="list">
                {erased.map((one, k) => (
                  <li key={one.region_id}>
                    <Chip tone="quiet">{k + 1}</Chip>
                    <span>
                      {one.region.within.length} {t("revise.corners")}
                    </span>
                    <button
                      type="button"
                      onClick={() =>
                        plan({
                          operation: { op: "restore-region", region_id: one.region_id },
                          words: `${t("revise.restore")}: ${k + 1}`,
                        })
                      }
                    >
                      {t("revise.restore")}
                    </button>
                  </li>
                ))}
              </ul>
            </>
          )}
        </section>
        <Plan
          planned={planned}
          job={job}
          drop={(k) => setPlanned(planned.filter((_, at) => at !== k))}
          make={(reason) =>
            void make(() =>
              post(`/v1/maps/${mapId}/revisions`, {
                base: revision.n,
                operations: planned.map((one) => one.operation),
                ...(reason && { reason }),
              }),
            )
          }
        />
      </aside>
    </div>
  );
}

export function RevisePage({ mapId }: { mapId: string }) {
  const { value, error, reload } = useLoaded(() => look(mapId).then((base) => ({ base })), [mapId]);
  return (
    <>
      <div class="title">
        <h1>{t("revise.title")}</h1>
        {value?.base && (
          <span class="quiet">
            {t("revisions.n")} {value.base.revision.n}
          </span>
        )}
        <span class="spread" />
        <a class="button" href={`#/maps/${mapId}`}>
          {t("tablet.back")}
        </a>
      </div>
      <Failure error={error} />
      {!value && !error && <Loading />}
      {value && !value.base && <p class="none">{t("place.noMap")}</p>}
      {value?.base && <Reviser base={value.base} mapId={mapId} reload={reload} />}
    </>
  );
}
