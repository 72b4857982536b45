import { useEffect, useRef, useState } from "preact/hooks";
import {
  all,
  follow,
  get,
  post,
  type Job,
  type Page,
  type Placement,
  type Revision,
  type Scan,
  type Schemas,
} from "../api/client";
import type { Features, Matrix, WallFeature } from "../api/told";
import { useLoaded } from "../api/useLoaded";
import { named, t, whenText } from "../i18n";
import { Chip, Failure, Loading, Progress } from "../ui/parts";
import { loadCloud, matrixOf, moved, poseOf, type Cloud } from "../view/cloud";
import { MiniPlan } from "../view/MiniPlan";
import { Octree, type MapCloud } from "../view/octree";
import { cornersOf, ELLIPSE_TIMES, ellipseOf, type At } from "../view/outlines";
import { Picked } from "../view/Picked";
import { Faces, residualColours, RESIDUALS } from "../view/residuals";
import { Stage, type Place } from "../view/Stage";

interface Loadable {
  scan: Scan;
  revision: number;
  map: MapCloud;
  points: Cloud;
  faces: Faces;
  placements: Placement[];
}

type Region = { within: At[] };

interface Part {
  include: Region[];
  exclude: Region[];
}

const VERDICT_TONES: Record<string, string> = { accepted: "good", "needs-review": "busy", rejected: "bad" };
const STEP_RAD = Math.PI / 36;
const STEP_M = 0.05;
const MOST_OF_SCAN = 60_000;
const REGION_COLOURS = { include: "#0b63c4", exclude: "#c62828" };

async function load(mapId: string, scanId: string): Promise<Loadable | null> {
  const [scan, revisions, placements] = await Promise.all([
    get<Scan>(`/v1/scans/${scanId}`),
    get<Page<Revision>>(`/v1/revisions?map=${mapId}&status=ready&limit=1`),
    all<Placement>(`/v1/scans/${scanId}/placements`),
  ]);
  const latest = revisions.items[0];
  if (!latest || !scan.files.points) return null;
  const [map, points, walls] = await Promise.all([
    Octree.open(`/v1/maps/${mapId}/revisions/${latest.n}/artifacts`),
    loadCloud(scan.files.points, MOST_OF_SCAN),
    get<Features<WallFeature>>(`/v1/maps/${mapId}/revisions/${latest.n}/artifacts/walls.geojson`),
  ]);
  return {
    scan,
    revision: latest.n,
    map,
    points,
    faces: new Faces(walls),
    placements: placements.sort((a, b) => (a.id < b.id ? 1 : -1)),
  };
}

function firstPose({ placements, scan, map, points }: Loadable): Matrix {
  const placed = placements.find((one) => one.T_map_scan)?.T_map_scan;
  if (placed) return placed;
  const rough = scan.rough_pose;
  if (rough) return matrixOf({ x: rough.x_m, y: rough.y_m, z: rough.z_m, yaw: rough.yaw_rad });
  return matrixOf({
    x: map.overview.centre[0] - points.centre[0],
    y: map.overview.centre[1] - points.centre[1],
    z: 0,
    yaw: 0,
  });
}

interface NumberFieldProps {
  label: string;
  value: number;
  step: number;
  set: (value: number) => void;
}

const NumberField = ({ label, value, step, set }: NumberFieldProps) => (
  <label>
    {label}
    <input
      type="number"
      inputmode="decimal"
      step={step}
      value={Number(value.toFixed(3))}
      onChange={(event) => Number.isFinite(event.currentTarget.valueAsNumber) && set(event.currentTarget.valueAsNumber)}
    />
  </label>
);

const centimetres = (metres: number) => (100 * metres).toPrecision(2);

const SHOWN = ["inlier_share", "residual_median_m", "euclidean_fitness_score_m2", "contradicted_share"] as const;

function Judged({ placement }: { placement: Placement }) {
  const ellipse = placement.evidence && ellipseOf(placement.evidence);
  return (
    <>
      <Chip tone={VERDICT_TONES[placement.verdict!]!}>{named("place", placement.verdict!)}</Chip>
      <ul class="reasons">
        {placement.reasons?.map(({ detail }) => (
          <li key={detail}>{detail}</li>
        ))}
      </ul>
      <dl>
        {SHOWN.flatMap((name) => {
          const value = placement.evidence?.[name];
          if (typeof value !== "number") return [];
          return [<dt key={name}>{t(`evidence.${name}`)}</dt>, <dd key={`${name}-v`}>{value.toPrecision(3)}</dd>];
        })}
      </dl>
      {ellipse && (
        <p class="quiet">
          {t("place.sure")} ±{centimetres(ellipse.half[0])} × ±{centimetres(ellipse.half[1])} cm ({t("place.ellipse")} ×
          {ELLIPSE_TIMES})
        </p>
      )}
    </>
  );
}

function Workplace({ loaded, mapId, scanId }: { loaded: Loadable; mapId: string; scanId: string }) {
  const canvas = useRef<HTMLCanvasElement>(null);
  const stage = useRef<Stage | null>(null);
  const [T, setT] = useState<Matrix>(() => firstPose(loaded));
  const [mode, setMode] = useState<"above" | "room">("above");
  const [placement, setPlacement] = useState<Placement | null>(
    () => loaded.placements.find((one) => one.verdict) ?? null,
  );
  const [job, setJob] = useState<Job | null>(null);
  const [error, setError] = useState<unknown>(null);
  const [made, setMade] = useState<number | null>(null);
  const [part, setPart] = useState<Part>({ include: [], exclude: [] });
  const [brush, setBrush] = useState<keyof Part | null>(null);
  const [picked, setPicked] = useState<Place | null>(null);

  useEffect(() => {
    const dragged = (next: Matrix) => {
      setT(next);
      setPlacement(null);
    };
    stage.current = new Stage(canvas.current!, {
      map: loaded.map,
      scan: { cloud: loaded.points, T, moved: dragged },
      picked: setPicked,
    });
    return () => stage.current?.leave();
    // eslint-disable-next-line react-hooks/exhaustive-deps -- `T` is where it begins; later moves go to the stage
  }, [loaded]);
  useEffect(() => stage.current?.look(mode), [mode]);
  useEffect(() => {
    const at = placement?.T_map_scan;
    stage.current?.colour(at ? residualColours(loaded.faces, loaded.points, at, loaded.map.overview.low[2]) : null);
  }, [placement, loaded]);
  useEffect(() => {
    const ellipse = placement?.T_map_scan && placement.evidence ? ellipseOf(placement.evidence) : null;
    const sure = ellipse ? [{ corners: cornersOf(ellipse, [T[0]![3]!, T[1]![3]!]), colour: "#d6006c" }] : [];
    const drawn = (["include", "exclude"] as const).flatMap((name) =>
      part[name].map(({ within }) => ({ corners: within, colour: REGION_COLOURS[name] })),
    );
    stage.current?.outline([...sure, ...drawn]);
  }, [placement, part, loaded, T]);
  useEffect(() => {
    stage.current?.drawRegions(
      brush && ((within) => setPart((now) => ({ ...now, [brush]: [...now[brush], { within }] }))),
    );
    if (brush) setMode("above");
  }, [brush, loaded]);

  const show = (next: Matrix, of: Placement | null) => {
    setT(next);
    setPlacement(of);
    stage.current?.place(next);
  };
  const turn = (yaw: number) => show(moved(T, { x: 0, y: 0, yaw }, loaded.points.centre), null);
  const pose = poseOf(T);
  const set = (change: Partial<typeof pose>) => {
    const next = { ...pose, ...change };
    const there = moved(T, { x: next.x - pose.x, y: next.y - pose.y, yaw: next.yaw - pose.yaw }, [0, 0, 0]);
    there[2]![3] = next.z;
    show(there, null);
  };

  const pressed = (event: KeyboardEvent) => {
    const far = event.shiftKey ? 10 : 1;
    const step = STEP_M * far;
    const moves: Record<string, () => void> = {
      ArrowLeft: () => set({ x: pose.x - step }),
      ArrowRight: () => set({ x: pose.x + step }),
      ArrowUp: () => set({ y: pose.y + step }),
      ArrowDown: () => set({ y: pose.y - step }),
      q: () => turn((far * Math.PI) / 180),
      e: () => turn((-far * Math.PI) / 180),
      Enter: () => void (job === null && snap(true)),
    };
    const wanted = moves[event.key] ?? moves[event.key.toLowerCase()];
    if (!wanted || event.ctrlKey || event.metaKey || event.altKey) return;
    event.preventDefault();
    wanted();
  };

  const snap = async (rough: boolean) => {
    setError(null);
    setMade(null);
    try {
      const body = rough
        ? { rough_pose: { x_m: pose.x, y_m: pose.y, z_m: pose.z, yaw_rad: pose.yaw } }
        : { search: true };
      const asked = await post<Schemas["PlacementWithJob"]>(`/v1/scans/${scanId}/placements`, body);
      setJob(asked.job);
      const ended = await follow(asked.job, setJob);
      setJob(null);
      if (ended.problem) throw new Error(ended.problem.detail);
      const placed = await get<Placement>(`/v1/placements/${asked.placement.id}`);
      show(placed.T_map_scan ?? T, placed);
    } catch (cause) {
      setJob(null);
      setError(cause);
    }
  };
  const accept = async () => {
    try {
      const reviewed = placement!.verdict !== "accepted";
      const asked = await post<Schemas["RevisionWithJob"]>(`/v1/placements/${placement!.id}/accept`, {
        reviewed,
        part: { points: "target", ...part },
      });
      setJob(asked.job);
      const ended = await follow(asked.job, setJob);
      setJob(null);
      if (ended.problem) throw new Error(ended.problem.detail);
      setMade(asked.revision.n);
    } catch (cause) {
      setJob(null);
      setError(cause);
    }
  };

  const candidates = placement?.candidates?.flatMap((one) => (one.T_map_scan ? [one.T_map_scan] : [])) ?? [];
  return (
    <div class="workplace">
      <div class="stage">
        <canvas
          ref={canvas}
          class="cloud"
          role="img"
          tabIndex={0}
          aria-keyshortcuts="ArrowLeft ArrowRight ArrowUp ArrowDown Q E Enter"
          onKeyDown={pressed}
          aria-label={`${t("place.map")}, ${t("place.scan")}: ${mode === "above" ? t("place.above") : t("place.room")}`}
        />
        <div class="choices over" role="group" aria-label={t("place.view")}>
          <button type="button" aria-pressed={mode === "above"} onClick={() => setMode("above")}>
            {t("place.above")}
          </button>
          <button type="button" aria-pressed={mode === "room"} onClick={() => setMode("room")}>
            {t("place.room")}
          </button>
        </div>
        <div class="legend over">
          <span class="of-map">{t("place.map")}</span>
          <span class="of-scan">{placement?.T_map_scan ? t("place.offWalls") : t("place.scan")}</span>
          {placement?.T_map_scan &&
            RESIDUALS.map(({ label }) => (
              <span key={label} class={label.replace(".", "-")}>
                {t(label)}
              </span>
            ))}
          <Picked place={picked} />
        </div>
      </div>
      <aside class="card">
        <p class="quiet">
          {t("place.hint")} {t("place.keys")}
        </p>
        <div class="numbers">
          <NumberField label={t("place.x")} step={0.1} value={pose.x} set={(x) => set({ x })} />
          <NumberField label={t("place.y")} step={0.1} value={pose.y} set={(y) => set({ y })} />
          <NumberField label={t("place.z")} step={0.05} value={pose.z} set={(z) => set({ z })} />
          <NumberField
            label={t("place.yaw")}
            step={1}
            value={(pose.yaw * 180) / Math.PI}
            set={(degrees) => set({ yaw: (degrees * Math.PI) / 180 })}
          />
        </div>
        <div class="chips">
          <button type="button" onClick={() => turn(STEP_RAD)} aria-label={t("place.left")}>
            ↺ 5°
          </button>
          <button type="button" onClick={() => turn(-STEP_RAD)} aria-label={t("place.right")}>
            ↻ 5°
          </button>
        </div>
        <div class="chips">
          <button class="primary big" type="button" disabled={job !== null} onClick={() => void snap(true)}>
            {t("place.snap")}
          </button>
          <button class="big" type="button" disabled={job !== null} onClick={() => void snap(false)}>
            {t("place.everywhere")}
          </button>
        </div>
        <div aria-live="polite" class="verdict">
          {job && <Progress job={job} />}
          <Failure error={error} />
          {placement?.verdict && <Judged placement={placement} />}
        </div>
        {placement?.T_map_scan && placement.verdict !== "rejected" && made === null && (
          <div class="chips" role="group" aria-label={t("place.part")}>
            {(["include", "exclude"] as const).map((name) => (
              <button
                key={name}
                type="button"
                aria-pressed={brush === name}
                onClick={() => setBrush(brush === name ? null : name)}
              >
                {t(`place.${name}`)} ({part[name].length})
              </button>
            ))}
            <button
              type="button"
              disabled={part.include.length + part.exclude.length === 0}
              onClick={() => setPart({ include: [], exclude: [] })}
            >
              {t("place.noRegions")}
            </button>
          </div>
        )}
        {placement?.T_map_scan && placement.verdict !== "rejected" && made === null && (
          <button class="primary big" type="button" disabled={job !== null} onClick={() => void accept()}>
            {placement.verdict === "accepted" ? t("place.accept") : t("place.acceptReviewed")}
          </button>
        )}
        {made !== null && (
          <p class="done" role="status">
            {t("place.made")} <a href={`#/maps/${mapId}`}>{made}</a>
          </p>
        )}
        {candidates.length > 1 && (
          <section>
            <h2>{t("place.candidates")}</h2>
            <div class="candidates">
              {candidates.map((T, k) => (
                <button key={k} type="button" onClick={() => show(T, k === 0 ? placement : null)}>
                  <MiniPlan map={loaded.map.overview} scan={loaded.points} T={T} label={`${k + 1}`} />
                  <span>{k + 1}</span>
                </button>
              ))}
            </div>
          </section>
        )}
      </aside>
    </div>
  );
}

export default function PlacementPage({ mapId, scanId }: { mapId: string; scanId: string }) {
  const { value, error } = useLoaded(() => load(mapId, scanId).then((loaded) => ({ loaded })), [mapId, scanId]);
  return (
    <>
      <div class="title">
        <h1>{t("place.title")}</h1>
        {value?.loaded && (
          <span class="quiet">
            {value.loaded.scan.file_name} · {whenText(value.loaded.scan.created_at)}
          </span>
        )}
        <span class="spread" />
        <a class="button" href={`#/maps/${mapId}`}>
          {t("tablet.back")}
        </a>
      </div>
      <Failure error={error} />
      {!value && !error && <Loading />}
      {value && !value.loaded && <p class="none">{t("place.noMap")}</p>}
      {value?.loaded && <Workplace loaded={value.loaded} mapId={mapId} scanId={scanId} />}
    </>
  );
}
