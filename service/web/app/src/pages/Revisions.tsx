import { useState } from "preact/hooks";
import { get, post, type Publication, type Revision, type Schemas } from "../api/client";
import { useLoaded } from "../api/useLoaded";
import { named, t, whenText } from "../i18n";
import { Graph } from "../ui/Graph";
import { Chip, Dialog, Failure, Loading } from "../ui/parts";

type Gates = Schemas["GatesOut"];
const TONES: Record<string, string> = { ready: "good", failed: "bad", building: "busy" };

interface PublishProps {
  mapId: string;
  n: number;
  back: boolean;
  done: () => void;
  close: () => void;
}

const CHANNELS = ["stable", "canary"] as const;

/** Ask once more, show what stands in the way, and let an admin override it with a reason. */
function Publish({ mapId, n, back, done, close }: PublishProps) {
  const at = `/v1/maps/${mapId}/revisions/${n}`;
  const [channel, setChannel] = useState<(typeof CHANNELS)[number]>("stable");
  const { value, error } = useLoaded(() => get<Gates>(`${at}/gates?channel=${channel}`), [channel]);
  const [reason, setReason] = useState("");
  const [problem, setProblem] = useState<unknown>(null);
  const closed = value?.gates ?? [];
  const go = () =>
    post(`${at}/publish`, { channel, ...(closed.length > 0 && { override: { reason } }) }).then(done, setProblem);
  return (
    <Dialog title={back ? t("revisions.rollBack") : t("revisions.publish")} close={close}>
      <div class="choices" role="group" aria-label={t("revisions.channel")}>
        {CHANNELS.map((name) => (
          <button key={name} type="button" aria-pressed={channel === name} onClick={() => setChannel(name)}>
            {named("channel", name)}
          </button>
        ))}
      </div>
      <p>
        {t("revisions.sure")} {n}.
      </p>
      {!value && !error && <Loading />}
      {closed.length > 0 && (
        <div class="failure">
          <strong>{t("revisions.gates")}</strong>
          <ul>
            {closed.map((gate) => (
              <li key={gate.code + gate.subject}>{gate.message}</li>
            ))}
          </ul>
          <label>
            {t("revisions.override")}
            <input value={reason} onInput={(event) => setReason(event.currentTarget.value)} />
          </label>
        </div>
      )}
      <Failure error={problem ?? error} />
      <button
        class="primary"
        type="button"
        disabled={!value || (closed.length > 0 && !reason.trim())}
        onClick={() => void go()}
      >
        {back ? t("revisions.rollBack") : t("revisions.publish")}
      </button>
    </Dialog>
  );
}

interface RevisionsProps {
  mapId: string;
  revisions: Revision[];
  published: number | null;
  canary: number | null;
  publications: Publication[];
  mayPublish: boolean;
  changed: () => void;
}

export function Revisions({ mapId, revisions, published, canary, publications, mayPublish, changed }: RevisionsProps) {
  const [publishing, setPublishing] = useState<number | null>(null);
  const [opened, setOpened] = useState<number | null>(null);
  const before = new Set(publications.map((one) => one.to_n));
  const ready = revisions.filter((one) => one.status === "ready");
  const comparedWith = (n: number) =>
    published !== null && published !== n ? published : ready.find((one) => one.n < n)?.n;
  return (
    <section class="card" aria-label={t("revisions.title")}>
      <div class="title">
        <h2>{t("revisions.title")}</h2>
        <span class="spread" />
        {ready.length > 0 && (
          <a class="button" href={`#/maps/${mapId}/revise`}>
            {t("revise.title")}
          </a>
        )}
      </div>
      {revisions.length === 0 && <p class="quiet">{t("empty")}</p>}
      <ol class="list revisions">
        {revisions.map((one) => (
          <li key={one.n}>
            {one.status === "ready" && !one.pruned_at ? (
              <img alt="" loading="lazy" src={`/v1/maps/${mapId}/revisions/${one.n}/artifacts/preview.png`} />
            ) : (
              <span class="no-preview" />
            )}
            <span>
              <strong>
                {t("revisions.n")} {one.n}
              </strong>
              <span class="quiet">
                {whenText(one.created_at)}
                {one.reason ? ` · ${one.reason}` : ""}
              </span>
            </span>
            <span class="chips">
              {one.n === published ? (
                <Chip tone="good">{t("revisions.live")}</Chip>
              ) : (
                <Chip tone={TONES[one.status]!}>{named("revision", one.status)}</Chip>
              )}
              {one.n === canary && one.n !== published && <Chip tone="busy">{named("channel", "canary")}</Chip>}
              {one.status === "ready" && (
                <button
                  type="button"
                  aria-expanded={opened === one.n}
                  onClick={() => setOpened(opened === one.n ? null : one.n)}
                >
                  {t("revisions.open")}
                </button>
              )}
              {mayPublish && one.status === "ready" && one.n !== published && (
                <button class={before.has(one.n) ? "" : "primary"} type="button" onClick={() => setPublishing(one.n)}>
                  {before.has(one.n) ? t("revisions.rollBack") : t("revisions.publish")}
                </button>
              )}
            </span>
            {opened === one.n && (
              <div class="opened">
                <img
                  alt={`${t("revisions.preview")} ${one.n}`}
                  src={`/v1/maps/${mapId}/revisions/${one.n}/artifacts/preview.png`}
                />
                <p>
                  {one.layers.length > 0
                    ? `${t("revisions.layers")}: ${one.layers.map((layer) => layer.name).join(", ")}`
                    : t("revisions.noLayers")}
                </p>
                <a class="button" href={`#/maps/${mapId}/revisions/${one.n}`}>
                  {t("view.open")}
                </a>
                {comparedWith(one.n) !== undefined && (
                  <a class="button" href={`#/maps/${mapId}/compare/${comparedWith(one.n)}/${one.n}`}>
                    {t("compare.with")} {comparedWith(one.n)}
                  </a>
                )}
              </div>
            )}
          </li>
        ))}
      </ol>
      {revisions.length > 1 && (
        <details>
          <summary>{t("revisions.graph")}</summary>
          <Graph revisions={revisions} published={published} />
        </details>
      )}
      {publications.length > 0 && (
        <details>
          <summary>{t("revisions.history")}</summary>
          <ul>
            {publications.map((one) => (
              <li key={one.id}>
                {whenText(one.published_at)} · {one.channel}: {one.from_n ?? "–"} → {one.to_n} ·{" "}
                <code>{one.published_by}</code> {one.reason}
              </li>
            ))}
          </ul>
        </details>
      )}
      {publishing !== null && (
        <Publish
          mapId={mapId}
          n={publishing}
          back={before.has(publishing)}
          close={() => setPublishing(null)}
          done={() => {
            setPublishing(null);
            changed();
          }}
        />
      )}
    </section>
  );
}
