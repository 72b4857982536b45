import { useEffect, useState } from "preact/hooks";
import { all, follow, get, post, type Job, type Placement, type Scan, type Schemas } from "../api/client";
import { forget, keep, type Parcel } from "../api/parcels";
import { deliver, giveUp } from "../api/tus";
import { bytesText, named, t } from "../i18n";
import { Chip, Failure, Progress } from "../ui/parts";
import { loadCloud, type Cloud } from "../view/cloud";
import { MiniPlan } from "../view/MiniPlan";
import { Octree } from "../view/octree";

interface Sight {
  map: Cloud;
  scan: Cloud;
}

/** Place a scan where it is said to be, and everywhere if it does not fit there. */
async function placed(scan: Scan, watch: (job: Job) => void): Promise<Placement> {
  const before = await all<Placement>(`/v1/scans/${scan.id}/placements`);
  const judged = before.sort((a, b) => (a.id < b.id ? 1 : -1)).find((one) => one.verdict);
  if (judged) return judged;
  const place = async (body: Record<string, unknown>) => {
    const asked = await post<Schemas["PlacementWithJob"]>(`/v1/scans/${scan.id}/placements`, body);
    watch(asked.job);
    const ended = await follow(asked.job, watch);
    if (ended.problem) throw new Error(ended.problem.detail);
    return get<Placement>(`/v1/placements/${asked.placement.id}`);
  };
  const first = await place({});
  return first.verdict === "rejected" && scan.rough_pose ? place({ search: true }) : first;
}

/** One scan that was sent from this tablet: on its way, being placed, looked at, taken. */
export function SentScan({ parcel, putAway }: { parcel: Parcel; putAway: () => void }) {
  const [inTurn, setInTurn] = useState(parcel.scanId !== null);
  const [bytes, setBytes] = useState(0);
  const [waiting, setWaiting] = useState(false);
  const [job, setJob] = useState<Job | null>(null);
  const [placement, setPlacement] = useState<Placement | null>(null);
  const [sight, setSight] = useState<Sight | null>(null);
  const [taken, setTaken] = useState<Job | null>(null);
  const [error, setError] = useState<unknown>(null);
  const [stop] = useState(() => new AbortController());

  const run = async (signal: AbortSignal) => {
    const scanId =
      parcel.scanId ??
      (await deliver(parcel, { began: () => setInTurn(true), sent: setBytes, waiting: setWaiting }, signal));
    signal.throwIfAborted();
    setBytes(parcel.size);
    if (!parcel.scanId) await keep({ ...parcel, file: null, scanId });
    const sent = await get<Scan>(`/v1/scans/${scanId}`);
    setJob(sent.job);
    const read = await follow(sent.job, setJob);
    if (read.problem) throw new Error(read.problem.detail);
    const scan = await get<Scan>(`/v1/scans/${scanId}`);
    const found = await placed(scan, setJob);
    setJob(null);
    setPlacement(found);
    const artifacts = `/v1/maps/${scan.map_id}/revisions/${found.revision}/artifacts`;
    const [{ overview }, points] = await Promise.all([Octree.open(artifacts), loadCloud(scan.files.points!)]);
    setSight({ map: overview, scan: points });
  };
  useEffect(() => {
    const { signal } = stop;
    run(signal).catch((cause: unknown) => {
      if (!signal.aborted) setError(cause);
    });
    return () => stop.abort();
    // eslint-disable-next-line react-hooks/exhaustive-deps -- a scan is sent once, as it was when the row came
  }, [stop]);

  const confirm = async () => {
    try {
      const asked = await post<Schemas["RevisionWithJob"]>(`/v1/placements/${placement!.id}/accept`, {
        reviewed: placement!.verdict !== "accepted",
      });
      await forget(parcel);
      setTaken(asked.job);
      setTaken(await follow(asked.job, setTaken));
    } catch (cause) {
      setError(cause);
    }
  };
  const drop = () => {
    stop.abort();
    void giveUp(parcel).then(putAway);
  };
  const percent = Math.floor((100 * bytes) / Math.max(1, parcel.size));
  const words = { accepted: t("tablet.done"), "needs-review": t("tablet.look"), rejected: t("tablet.bad") };
  return (
    <section class="card">
      <h2>{parcel.name}</h2>
      {!parcel.isKept && bytes < parcel.size && <p class="failure">{t("tablet.noRoom")}</p>}
      {!inTurn && <p role="status">{t("tablet.inLine")}</p>}
      {inTurn && bytes < parcel.size && (
        <div class="progress">
          <progress max={100} value={percent} aria-label={t("tablet.sending")} />
          <span role="status">
            {waiting
              ? t("tablet.waitingForNet")
              : `${t("tablet.sending")}: ${percent} % · ${bytesText(bytes)} / ${bytesText(parcel.size)}`}
          </span>
        </div>
      )}
      {job && (
        <div role="status">
          <strong>{named("kind", job.kind)}</strong>
          <Progress job={job} />
        </div>
      )}
      {placement && !taken && (
        <>
          <p class="big-words" role="status">
            {words[placement.verdict!]}
          </p>
          <Chip tone={placement.verdict === "accepted" ? "good" : placement.verdict === "rejected" ? "bad" : "busy"}>
            {named("place", placement.verdict!)}
          </Chip>
          {sight && placement.T_map_scan && (
            <div class="sight">
              <MiniPlan
                map={sight.map}
                scan={sight.scan}
                T={placement.T_map_scan}
                label={`${t("place.map")}, ${t("place.scan")}`}
              />
            </div>
          )}
          <ul class="reasons">
            {placement.reasons?.map(({ detail }) => (
              <li key={detail}>{detail}</li>
            ))}
          </ul>
          {placement.verdict !== "rejected" && (
            <button class="primary huge" type="button" onClick={() => void confirm()}>
              {t("tablet.confirm")}
            </button>
          )}
          <a class="button huge" href={`/#/maps/${parcel.mapId}/scans/${placement.scan_id}`}>
            {t("tablet.move")}
          </a>
        </>
      )}
      {taken && (
        <div role="status">
          <p class="done">{taken.state === "succeeded" ? `${t("place.made")} ✓` : t("tablet.taken")}</p>
          {taken.state !== "succeeded" && <Progress job={taken} />}
        </div>
      )}
      {taken?.problem && <p class="failure">{taken.problem.detail}</p>}
      <Failure error={error} />
      <button class="huge" type="button" onClick={drop}>
        {taken ? t("close") : placement ? t("tablet.later") : t("tablet.giveUp")}
      </button>
    </section>
  );
}
