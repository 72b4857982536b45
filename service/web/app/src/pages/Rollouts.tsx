/** Staged roll-outs: how far each is, its brake, and a new one. */
import { useState } from "preact/hooks";
import { get, post, Refused, type Page, type Revision, type Rollout, type SiteMap } from "../api/client";
import { useLoaded } from "../api/useLoaded";
import { named, t, whenText } from "../i18n";
import { Chip, Dialog, Failure } from "../ui/parts";

const TONES: Record<string, string> = {
  running: "busy",
  paused: "quiet",
  stopped: "bad",
  aborted: "quiet",
  finished: "good",
};
const FIRST_STAGES = "10, 50, 100";

function Begin({ map, begun, close }: { map: SiteMap; begun: () => void; close: () => void }) {
  const { value, error } = useLoaded(
    () => get<Page<Revision>>(`/v1/revisions?map=${map.id}&status=ready&limit=50`),
    [map.id],
  );
  const [revision, setRevision] = useState<number | null>(null);
  const [stages, setStages] = useState(FIRST_STAGES);
  const [limit, setLimit] = useState(1);
  const [override, setOverride] = useState("");
  const [problem, setProblem] = useState<unknown>(null);
  const chosen = revision ?? value?.items[0]?.n;
  const shares = stages
    .split(/[,;\s]+/)
    .filter(Boolean)
    .map((word) => Number(word) / 100);
  const valid = shares.length > 0 && shares.every((share) => share > 0 && share <= 1);
  const closed = problem instanceof Refused && problem.type.endsWith("/gates-closed");
  const go = (event: Event) => {
    event.preventDefault();
    const body = {
      revision: chosen,
      stages: shares.map((share) => ({ share })),
      failure_limit: limit,
      ...(override.trim() && { override: override.trim() }),
    };
    post(`/v1/maps/${map.id}/rollouts`, body).then(begun, setProblem);
  };
  return (
    <Dialog title={`${t("rollouts.begin")}: ${map.site} · ${map.name}`} close={close}>
      <Failure error={error ?? problem} />
      {value?.items.length === 0 ? (
        <p class="quiet">{t("rollouts.noRevision")}</p>
      ) : (
        <form onSubmit={go}>
          <label>
            {t("rollouts.revision")}
            <select value={chosen} onChange={(event) => setRevision(Number(event.currentTarget.value))}>
              {value?.items.map((one) => (
                <option key={one.n} value={one.n}>
                  {one.n} · {whenText(one.created_at)}
                </option>
              ))}
            </select>
          </label>
          <label>
            {t("rollouts.stages")}
            <input value={stages} aria-invalid={!valid} onInput={(event) => setStages(event.currentTarget.value)} />
          </label>
          <label>
            {t("rollouts.limit")}
            <input
              type="number"
              min={1}
              value={limit}
              onInput={(event) => setLimit(event.currentTarget.valueAsNumber || 1)}
            />
          </label>
          {closed && (
            <label>
              {t("rollouts.override")}
              <input value={override} onInput={(event) => setOverride(event.currentTarget.value)} />
            </label>
          )}
          <button class="primary" disabled={!valid || chosen === undefined || (closed && !override.trim())}>
            {t("rollouts.begin")}
          </button>
        </form>
      )}
    </Dialog>
  );
}

interface RowProps {
  rollout: Rollout;
  name: string;
  admin: boolean;
  act: (rollout: Rollout, verb: "pause" | "resume" | "abort") => void;
}

function RolloutRow({ rollout, name, admin, act }: RowProps) {
  const over = ["aborted", "finished"].includes(rollout.state);
  return (
    <li>
      <span>
        <strong>
          {name} · {t("revisions.n")} {rollout.revision}
        </strong>
        <span class="quiet">
          {whenText(rollout.created_at)} · {rollout.channel} · {t("rollouts.stage")} {rollout.stage + 1}{" "}
          {t("rollouts.of")} {rollout.stages.length}
          {rollout.taken !== null && ` · ${rollout.enabled} / ${rollout.taken} ${t("rollouts.run")}`}
        </span>
        {rollout.reason && <span class="quiet">{rollout.reason}</span>}
      </span>
      <span class="chips">
        <Chip tone={TONES[rollout.state]!}>{named("rollout", rollout.state)}</Chip>
        {admin && rollout.state === "running" && (
          <button type="button" onClick={() => act(rollout, "pause")}>
            {t("rollouts.pause")}
          </button>
        )}
        {admin && ["paused", "stopped"].includes(rollout.state) && (
          <button type="button" onClick={() => act(rollout, "resume")}>
            {t("rollouts.resume")}
          </button>
        )}
        {admin && !over && (
          <button class="danger" type="button" onClick={() => act(rollout, "abort")}>
            {t("rollouts.abort")}
          </button>
        )}
      </span>
    </li>
  );
}

const OPEN = ["running", "paused", "stopped"];

/** The latest roll-out of each map, as its page tells it; ended ones without figures. */
async function latest(maps: readonly SiteMap[]): Promise<Rollout[]> {
  const pages = await Promise.all(maps.map((map) => get<Page<Rollout>>(`/v1/maps/${map.id}/rollouts?limit=1`)));
  const found = pages.flatMap((page) => page.items);
  return Promise.all(
    found.map(async (one) => (OPEN.includes(one.state) ? get<Rollout>(`/v1/rollouts/${one.id}`) : one)),
  );
}

export function Rollouts({ maps, round, admin }: { maps: SiteMap[]; round: number; admin: boolean }) {
  const [chosen, setChosen] = useState(maps[0]?.id);
  const [beginning, setBeginning] = useState(false);
  const [problem, setProblem] = useState<unknown>(null);
  const { value, error, reload } = useLoaded(() => latest(maps), [maps, round], 5000);
  const nameOf = (id: string) => maps.find((one) => one.id === id)?.name ?? id;
  const map = maps.find((one) => one.id === chosen);
  const act = (rollout: Rollout, verb: string) =>
    post(`/v1/rollouts/${rollout.id}/${verb}`).then(() => {
      setProblem(null);
      reload();
    }, setProblem);
  return (
    <section class="card" aria-label={t("rollouts.title")}>
      <div class="title">
        <h2>{t("rollouts.title")}</h2>
        <span class="spread" />
        {admin && map && (
          <span class="chips">
            <select
              aria-label={t("fleet.map")}
              value={chosen}
              onChange={(event) => setChosen(event.currentTarget.value)}
            >
              {maps.map((one) => (
                <option key={one.id} value={one.id}>
                  {one.site} · {one.name}
                </option>
              ))}
            </select>
            <button class="primary" type="button" onClick={() => setBeginning(true)}>
              {t("rollouts.begin")}
            </button>
          </span>
        )}
      </div>
      <Failure error={problem ?? error} />
      {value?.length === 0 && <p class="quiet">{t("rollouts.none")}</p>}
      <ul class="list">
        {value?.map((one) => (
          <RolloutRow
            key={one.id}
            rollout={one}
            name={nameOf(one.map_id)}
            admin={admin}
            act={(rollout, verb) => void act(rollout, verb)}
          />
        ))}
      </ul>
      {beginning && map && (
        <Begin
          map={map}
          close={() => setBeginning(false)}
          begun={() => {
            setBeginning(false);
            reload();
          }}
        />
      )}
    </section>
  );
}
