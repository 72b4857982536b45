import { useState } from "preact/hooks";
import { isFinal, post, type Job } from "../api/client";
import { named, t, whenText } from "../i18n";
import { Dialog, Failure, Progress, StateChip } from "../ui/parts";
import { Rows, type Column } from "../ui/Rows";
import { useEvery } from "../ui/useEvery";

const STATES = ["queued", "running", "succeeded", "failed", "cancelled"] as const;

function JobDetails({ job, close }: { job: Job; close: () => void }) {
  return (
    <Dialog title={named("kind", job.kind)} close={close}>
      <StateChip job={job} />
      <Progress job={job} />
      {job.problem && (
        <div class="failure">
          <strong>{job.problem.title}</strong>
          <p>{job.problem.detail}</p>
          <a href={job.problem.type} target="_blank" rel="noreferrer">
            {t("more")}
          </a>
        </div>
      )}
      <dl>
        <dt>Id</dt>
        <dd>
          <code>{job.id}</code>
        </dd>
        <dt>{t("jobs.subject")}</dt>
        <dd>
          <code>{job.subject_id}</code>
        </dd>
        <dt>{t("jobs.started")}</dt>
        <dd>{whenText(job.created_at)}</dd>
      </dl>
    </Dialog>
  );
}

export function Jobs() {
  const [state, setState] = useState("");
  const [shown, setShown] = useState<Job | null>(null);
  const [error, setError] = useState<unknown>(null);
  const [round, again] = useEvery(3000);
  const act = async (job: Job, what: "cancel" | "retry") => {
    try {
      await post(`/v1/jobs/${job.id}/${what}`);
      setError(null);
      again();
    } catch (cause) {
      setError(cause);
    }
  };
  const columns: Column<Job>[] = [
    {
      name: t("jobs.kind"),
      width: "minmax(9rem, 1.2fr)",
      show: (job) => (
        <button class="link" type="button" onClick={() => setShown(job)}>
          {named("kind", job.kind)}
        </button>
      ),
    },
    { name: t("jobs.state"), width: "7rem", show: (job) => <StateChip job={job} /> },
    {
      name: t("jobs.stage"),
      width: "minmax(8rem, 2fr)",
      show: (job) =>
        job.problem?.detail ??
        (job.state === "running" ? `${job.stage ?? ""} ${Math.round(job.fraction * 100)} %` : (job.stage ?? "")),
    },
    { name: t("jobs.started"), width: "11rem", show: (job) => whenText(job.created_at) },
    {
      name: "",
      width: "8rem",
      show: (job) => {
        if (!isFinal(job))
          return (
            <button type="button" disabled={job.cancel_requested} onClick={() => void act(job, "cancel")}>
              {t("jobs.cancel")}
            </button>
          );
        if (job.state === "failed" || job.state === "cancelled")
          return (
            <button type="button" onClick={() => void act(job, "retry")}>
              {t("jobs.retry")}
            </button>
          );
        return null;
      },
    },
  ];
  return (
    <>
      <div class="title">
        <h1>{t("nav.jobs")}</h1>
        <div class="choices" role="group" aria-label={t("jobs.state")}>
          {(["", ...STATES] as const).map((one) => (
            <button key={one} type="button" aria-pressed={state === one} onClick={() => setState(one)}>
              {one ? named("state", one) : t("jobs.all")}
            </button>
          ))}
        </div>
      </div>
      <Failure error={error} />
      <Rows
        key={state}
        label={t("nav.jobs")}
        path={`/v1/jobs${state ? `?state=${state}` : ""}`}
        columns={columns}
        keyOf={(job) => job.id}
        refresh={round}
        none={t("jobs.none")}
      />
      {shown && <JobDetails job={shown} close={() => setShown(null)} />}
    </>
  );
}
