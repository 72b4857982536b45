/** Small pieces that every page is made of. */
import type { ComponentChildren } from "preact";
import { useEffect, useRef } from "preact/hooks";
import { Refused, type Job } from "../api/client";
import { named, t } from "../i18n";

export const Loading = () => (
  <p class="loading" role="status">
    {t("loading")}…
  </p>
);

/** What went wrong, in the service's own words, with the page that explains it. */
export function Failure({ error }: { error: unknown }) {
  if (!error) return null;
  const refused = error instanceof Refused ? error : null;
  return (
    <div class="failure" role="alert">
      <strong>{refused?.title ?? (error instanceof Error ? error.message : JSON.stringify(error))}</strong>
      {refused && <p>{refused.detail}</p>}
      {refused && refused.type !== "about:blank" && (
        <a href={refused.type} target="_blank" rel="noreferrer">
          {t("more")}
        </a>
      )}
    </div>
  );
}

export const Chip = ({ tone, children }: { tone: string; children: ComponentChildren }) => (
  <span class={`chip ${tone}`}>{children}</span>
);

const JOB_TONES: Record<string, string> = {
  queued: "quiet",
  running: "busy",
  succeeded: "good",
  failed: "bad",
  cancelled: "quiet",
};
export const StateChip = ({ job }: { job: Job }) => (
  <Chip tone={JOB_TONES[job.state]!}>{named("state", job.state)}</Chip>
);

export function Progress({ job }: { job: Job }) {
  const percent = Math.round(job.fraction * 100);
  return (
    <div class="progress">
      <progress max={100} value={percent} aria-label={named("kind", job.kind)} />
      <span>
        {job.stage ?? named("state", job.state)} · {percent} %
      </span>
    </div>
  );
}

interface DialogProps {
  title: string;
  close: () => void;
  children: ComponentChildren;
}

export function Dialog({ title, close, children }: DialogProps) {
  const dialog = useRef<HTMLDialogElement>(null);
  useEffect(() => dialog.current?.showModal(), []);
  return (
    <dialog ref={dialog} onClose={close} aria-label={title}>
      <header>
        <h2>{title}</h2>
        <button class="plain" type="button" onClick={close} aria-label={t("close")}>
          ✕
        </button>
      </header>
      {children}
    </dialog>
  );
}
