import { useState } from "preact/hooks";
import {
  all,
  get,
  onceKey,
  post,
  send,
  type Drawing,
  type Publication,
  type Revision,
  type Scan,
  type Schemas,
  type Session,
  type SiteMap,
} from "../api/client";
import { useFleetEvents } from "../api/useFleetEvents";
import { useLoaded } from "../api/useLoaded";
import { t, whenText } from "../i18n";
import { Chip, Dialog, Failure, Loading, Progress, StateChip } from "../ui/parts";
import { Revisions } from "./Revisions";

async function look(mapId: string) {
  const [map, drawings, scans, revisions, channels, publications] = await Promise.all([
    get<SiteMap>(`/v1/maps/${mapId}`),
    all<Drawing>(`/v1/maps/${mapId}/drawings`, 200),
    all<Scan>(`/v1/maps/${mapId}/scans`, 1000),
    all<Revision>(`/v1/maps/${mapId}/revisions`, 1000),
    get<Schemas["ChannelsOut"]>(`/v1/maps/${mapId}/channels`),
    all<Publication>(`/v1/maps/${mapId}/publications`, 200),
  ]);
  const on = (name: string) => channels.channels.find((channel) => channel.name === name)?.revision_n ?? null;
  return {
    map,
    drawings: drawings.reverse(),
    scans: scans.reverse(),
    revisions: revisions.sort((a, b) => b.n - a.n),
    published: on("stable"),
    canary: on("canary"),
    publications,
  };
}

interface SendFileProps {
  label: string;
  to: string;
  sent: () => void;
  failed: (cause: unknown) => void;
}

function SendFile({ label, to, sent, failed }: SendFileProps) {
  const [busy, setBusy] = useState(false);
  const picked = async (input: HTMLInputElement) => {
    const file = input.files?.[0];
    if (!file) return;
    const body = new FormData();
    body.append("file", file, file.name);
    setBusy(true);
    await send("POST", to, { body, headers: { "Idempotency-Key": onceKey() } }).then(sent, failed);
    setBusy(false);
    input.value = "";
  };
  return (
    <label class="button" aria-busy={busy}>
      {busy ? `${t("tablet.sending")}…` : label}
      <input class="hidden" type="file" disabled={busy} onChange={(event) => void picked(event.currentTarget)} />
    </label>
  );
}

interface InputRowProps {
  href: string;
  way: string;
  input: Drawing | Scan;
}

function InputRow({ href, way, input }: InputRowProps) {
  const over = input.job.state === "succeeded";
  return (
    <li>
      {input.files.preview ? <img alt="" loading="lazy" src={input.files.preview} /> : <span class="no-preview" />}
      <span>
        <strong>{input.file_name}</strong>
        <span class="quiet">{whenText(input.created_at)}</span>
        {input.job.problem && <span class="quiet">{input.job.problem.detail}</span>}
      </span>
      {over ? (
        <a class="button" href={href}>
          {way}
        </a>
      ) : input.job.state === "running" ? (
        <Progress job={input.job} />
      ) : (
        <StateChip job={input.job} />
      )}
    </li>
  );
}

function BuildFrom({ mapId, drawing, built }: { mapId: string; drawing: Drawing; built: () => void }) {
  const [error, setError] = useState<unknown>(null);
  const build = () => post(`/v1/maps/${mapId}/revisions`, { drawing_id: drawing.id }).then(built, setError);
  return (
    <>
      <button class="primary" type="button" onClick={() => void build()}>
        {t("draw.build")}
      </button>
      {error !== null && (
        <Dialog title={t("draw.build")} close={() => setError(null)}>
          <Failure error={error} />
        </Dialog>
      )}
    </>
  );
}

export function MapPage({ mapId, session }: { mapId: string; session: Session }) {
  const [problem, setProblem] = useState<unknown>(null);
  const { value, error, reload } = useLoaded(() => look(mapId), [mapId], 3000);
  useFleetEvents(reload);
  if (!value) return error ? <Failure error={error} /> : <Loading />;
  const { map, drawings, scans } = value;
  const admin = session.role === "admin";
  const sent = () => {
    setProblem(null);
    reload();
  };
  const read = drawings.find((drawing) => drawing.files.walls);
  return (
    <>
      <div class="title">
        <div>
          <span class="quiet">{map.site}</span>
          <h1>{map.name}</h1>
        </div>
        {value.published !== null && (
          <Chip tone="good">
            {t("overview.published")}: {value.published}
          </Chip>
        )}
      </div>
      <Failure error={problem ?? error} />
      <div class="inputs">
        <section class="card" aria-label={t("map.drawings")}>
          <div class="title">
            <h2>{t("map.drawings")}</h2>
            <span class="spread" />
            {admin && read && value.revisions.length === 0 && <BuildFrom mapId={mapId} drawing={read} built={reload} />}
            {admin && (
              <SendFile
                label={t("map.sendDrawing")}
                to={`/v1/maps/${mapId}/drawings`}
                sent={sent}
                failed={setProblem}
              />
            )}
          </div>
          {drawings.length === 0 && <p class="quiet">{t("map.noDrawing")}</p>}
          <ul class="list">
            {drawings.map((one) => (
              <InputRow key={one.id} input={one} href={`#/maps/${mapId}/drawings/${one.id}`} way={t("map.correct")} />
            ))}
          </ul>
        </section>
        <section class="card" aria-label={t("map.scans")}>
          <div class="title">
            <h2>{t("map.scans")}</h2>
            <span class="spread" />
            <SendFile label={t("map.sendScan")} to={`/v1/maps/${mapId}/scans`} sent={sent} failed={setProblem} />
          </div>
          {scans.length === 0 && <p class="quiet">{t("map.noScan")}</p>}
          <ul class="list">
            {scans.map((one) => (
              <InputRow key={one.id} input={one} href={`#/maps/${mapId}/scans/${one.id}`} way={t("map.place")} />
            ))}
          </ul>
        </section>
      </div>
      <Revisions
        mapId={mapId}
        revisions={value.revisions}
        published={value.published}
        canary={value.canary}
        publications={value.publications}
        mayPublish={admin}
        changed={reload}
      />
    </>
  );
}
