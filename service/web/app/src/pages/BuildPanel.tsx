/** From the drawing to a revision: the first of a map, or with the drawing put under the layers that are there. */
import { useState } from "preact/hooks";
import { follow, get, post, type Job, type Page, type Revision, type Schemas } from "../api/client";
import { useLoaded } from "../api/useLoaded";
import { t } from "../i18n";
import { Failure, Progress } from "../ui/parts";

interface BuildPanelProps {
  mapId: string;
  drawingId: string;
  blocked: boolean;
}

export function BuildPanel({ mapId, drawingId, blocked }: BuildPanelProps) {
  const latest = useLoaded(() => get<Page<Revision>>(`/v1/revisions?map=${mapId}&status=ready&limit=1`), [mapId]);
  const base = latest.value?.items[0];
  const [voxel, setVoxel] = useState(0.4);
  const [height, setHeight] = useState(2.5);
  const [flat, setFlat] = useState({ floor: true, ceiling: false });
  const [job, setJob] = useState<Job | null>(null);
  const [made, setMade] = useState<number | null>(null);
  const [error, setError] = useState<unknown>(null);
  const build = async (event: Event) => {
    event.preventDefault();
    setError(null);
    setMade(null);
    try {
      const recipe = { voxel_size_m: voxel, wall_height_m: height, ...flat };
      const body = base
        ? { base: base.n, operations: [{ op: "set-drawing", drawing_id: drawingId }] }
        : { drawing_id: drawingId, recipe };
      const asked = await post<Schemas["RevisionWithJob"]>(`/v1/maps/${mapId}/revisions`, body);
      setJob(asked.job);
      const ended = await follow(asked.job, setJob);
      if (ended.problem) throw new Error(ended.problem.detail);
      setMade(asked.revision.n);
      latest.reload();
    } catch (cause) {
      setError(cause);
    } finally {
      setJob(null);
    }
  };
  return (
    <section class="card" aria-label={t("draw.build")}>
      <h2>{t("draw.build")}</h2>
      <form onSubmit={(event) => void build(event)}>
        {base ? (
          <p class="quiet">
            {t("draw.under")} {base.n}.
          </p>
        ) : (
          <>
            <label>
              {t("draw.voxel")}
              <input
                type="number"
                min={0.005}
                max={5}
                step={0.005}
                value={voxel}
                onInput={(event) => setVoxel(event.currentTarget.valueAsNumber)}
              />
            </label>
            <label>
              {t("draw.height")}
              <input
                type="number"
                min={0.1}
                max={100}
                step={0.1}
                value={height}
                onInput={(event) => setHeight(event.currentTarget.valueAsNumber)}
              />
            </label>
            {(["floor", "ceiling"] as const).map((name) => (
              <label key={name} class="line">
                <input
                  type="checkbox"
                  checked={flat[name]}
                  onChange={(event) => setFlat({ ...flat, [name]: event.currentTarget.checked })}
                />
                {t(`draw.${name}`)}
              </label>
            ))}
          </>
        )}
        {job && <Progress job={job} />}
        <Failure error={error ?? latest.error} />
        <button class="primary big" disabled={blocked || job !== null || !(voxel > 0) || !(height > 0)}>
          {t("draw.build")}
        </button>
        {made !== null && (
          <p class="done" role="status">
            {t("place.made")} <a href={`#/maps/${mapId}`}>{made}</a>
          </p>
        )}
      </form>
    </section>
  );
}
